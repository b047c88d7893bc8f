"""Self-contained HTML pages from templates.

A page fits a phone's width, and paper: a table that is wider than the screen scrolls by itself, pictures shrink. What is
put into a template is escaped, but for what is marked as HTML.
"""

from __future__ import annotations

import base64
import functools
from pathlib import Path

from jinja2 import BaseLoader, ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from softmodels.common.files import read_file


def render(template: str, package: str = "measurement", **values: object) -> str:
    """Return a page from a template.

    Args:
        template: Its name in the package's folder ``templates``; it may build upon those here, such as ``base.html``.
        package: Whose template it is.
        values: What the template names.
    """
    return _environment(package).get_template(template).render(**values)


@functools.cache
def _environment(package: str) -> Environment:
    packages = dict.fromkeys((package, "softmodels.common"))
    loader: BaseLoader = ChoiceLoader([PackageLoader(name) for name in packages])
    made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)

    def raw(name: str) -> Markup:
        """Return a static file beside the templates, such as a style sheet or a program."""
        return Markup(loader.get_source(made, name)[0])

    made.globals["raw"] = raw
    return made


def data_uri(data: bytes, kind: str) -> str:
    """Return the bytes as an address that a page carries in itself.

    Args:
        data: Such as a PNG.
        kind: Their media type, such as ``"image/png"``.
    """
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def image_uri(file: Path) -> str:
    """Return the same of a picture's file, PNG, GIF or WebP."""
    return data_uri(read_file(file), f"image/{file.suffix[1:]}")
