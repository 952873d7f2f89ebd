"""The viewer within a notebook's cell: an anywidget (extra `notebook`)."""

import sys
from importlib.util import find_spec
from typing import Any

from raytwin.show import viewer


def in_notebook() -> bool:
    """Return whether this runs in a notebook's kernel."""
    shell = sys.modules.get("IPython")
    return shell is not None and getattr(shell.get_ipython(), "kernel", None) is not None


def has_widgets() -> bool:
    """Return whether anywidget is installed, and there is a notebook to show it."""
    return in_notebook() and find_spec("anywidget") is not None


def widget(data: dict[str, Any], head: str = "", still: str = "") -> Any:
    """Return the viewer of `data`, as `mount` of viewer.js takes it, below the HTML `head`.

    It hides what the page marks `data-raytwin=still`: the pictures that are seen where no kernel runs.
    """
    import anywidget
    import traitlets

    class Viewer(anywidget.AnyWidget):
        _esm = viewer.module() + (
            "\nexport default { render({ model, el }) {"
            " const head = document.createElement('div'); head.innerHTML = model.get('head') || '';"
            " const body = document.createElement('div'); el.append(head, body);"
            " mount(body, model.get('data'));"
            " const still = model.get('still');"
            " if (still) for (const one of document.querySelectorAll(`[data-raytwin='${still}']`)) one.hidden = true;"
            " } };\n"
        )
        _css = viewer.style() + ".rt { padding: 8px 12px; background: var(--rt-ground); }"  # whatever a cell's is
        data = traitlets.Dict().tag(sync=True)
        head = traitlets.Unicode().tag(sync=True)
        still = traitlets.Unicode().tag(sync=True)

    return Viewer(data=data, head=head, still=still)


def pane(key: str, title: str, tab: str, alt: str = "", kind: str = "radiance") -> dict[str, str]:
    """Return one pane of the viewer's."""
    return {"key": key, "kind": kind, "title": title, "tab": tab, "alt": alt or title}
