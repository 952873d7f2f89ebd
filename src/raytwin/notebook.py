"""How images and results show themselves in a notebook, without knowing what shows them."""

from importlib import import_module
from typing import Any


class InNotebook:
    """Shown by `report.notebook_page`, which is loaded by its name: it stands above all that it shows."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Return the picture or table that stays when a notebook is saved."""
        text: str = page().html_of(self)
        return text

    def _repr_mimebundle_(self, **_: Any) -> dict[str, Any]:
        """Return the pictures as PNG, and the viewer as a widget where anywidget is installed and a notebook runs."""
        bundle: dict[str, Any] = page().bundle_of(self)
        return bundle

    def _ipython_display_(self) -> None:
        """Display the pictures, and the viewer that hides them while a kernel runs. Raises NotImplementedError where
        there is no viewer: IPython then asks the two above."""
        page().display(self)


def page() -> Any:
    """Return the module that makes HTML and widgets."""
    return import_module("raytwin.show.notebook_page")
