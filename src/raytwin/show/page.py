"""One shell for every page: a template that fills the blocks of page.html.j2, and its styles, scripts and data.

Everything that a page shows lies in it, or in files beside it that belong to it: it opens offline. Text is escaped, and
a name that is missing in a template is an error.
"""

import functools
import os
from importlib import resources
from typing import Any

import jinja2

from raytwin.safe_write import write_text
from raytwin.show import numbers


def write_page(path: str | os.PathLike[str], template: str, *parts: tuple[str, ...], **data: Any) -> None:
    """Write the page; `parts` are the styles and scripts of `render_page`."""
    write_text(path, render_page(template, *parts, **data))


def render_page(template: str, styles: tuple[str, ...] = (), scripts: tuple[str, ...] = (), **data: Any) -> str:
    """Return the page of `template` (a file of show/, or FOLDER/FILE below it), with report.css and `styles` before
    it and `scripts`, all file names or texts that hold a line break, in it."""
    css = "".join(asset(name) for name in ("report.css", *styles))
    return render_part(template, css=css, js="".join(map(asset, scripts)), **data)


def render_part(template: str, **data: Any) -> str:
    """Return the template filled with the data; the template need not be a whole page."""
    return _environment().get_template(template).render(**data)


def asset(name: str) -> str:
    """Return the text of a file of show/, or of FOLDER/FILE below it; a text of several lines as it is."""
    if "\n" in name:
        return name
    return resources.files("raytwin.show").joinpath(name).read_text(encoding="utf-8")


@functools.cache
def _environment() -> jinja2.Environment:
    made = jinja2.Environment(
        loader=jinja2.FunctionLoader(asset),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    made.filters |= {f.__name__: f for f in (numbers.shown, numbers.beside, numbers.short, numbers.seconds)}
    return made
