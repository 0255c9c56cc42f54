"""Pages and texts from the templates of this package."""

from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape


def render(template: str, **values: Any) -> str:
    """A template filled in; in HTML, values are escaped. A name without a value is an error."""
    environment = Environment(
        loader=PackageLoader("reports", "templates"),
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


def asset(name: str) -> Markup:
    """A style sheet or script of this package, to be put into a page as it is."""
    return Markup((files("reports") / "templates" / name).read_text(encoding="utf-8"))
