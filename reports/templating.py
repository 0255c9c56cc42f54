"""Pages and texts from the templates that lie in the folder of a room."""

from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape


def render(room: str, template: str, **values: Any) -> str:
    """A template of a room, such as "reports.page", filled in; in HTML, values are escaped.

    Raises:
        jinja2.UndefinedError: the template names a value that is not given.
    """
    environment = Environment(
        loader=PackageLoader(room, "templates"),
        autoescape=select_autoescape(["html.j2"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["code"] = _with_code
    return environment.get_template(template).render(**values)


def _with_code(text: str) -> Markup:
    """Text for a page, with what stands between backticks as code."""
    parts = [escape(part) for part in text.split("`")]
    return Markup("").join(Markup("<code>{}</code>").format(p) if i % 2 else p for i, p in enumerate(parts))


def asset(room: str, name: str) -> Markup:
    """A style sheet or script of a room, to be put into a page as it is."""
    return Markup((files(room) / "templates" / name).read_text(encoding="utf-8"))
