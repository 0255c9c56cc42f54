"""Pages and texts from the templates of this package."""

from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup


def render(template: str, **values: Any) -> str:
    """A template filled in; in HTML, values are escaped. A name without a value is an error."""
    environment = Environment(
        loader=PackageLoader("reports", "templates"),
        autoescape=select_autoescape(["html.j2"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def asset(name: str) -> Markup:
    """A style sheet or script of this package, to be put into a page as it is."""
    return Markup((files("reports") / "templates" / name).read_text(encoding="utf-8"))
