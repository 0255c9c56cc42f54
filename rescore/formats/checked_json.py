"""JSON files of a stated shape: read into typed values, or one line that says where they differ from it."""

from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import Field, FiniteFloat, TypeAdapter, ValidationError

from recon.errors import RescoreError

T = TypeVar("T")
Number = Annotated[int, Field(ge=-(2**63), lt=2**63)]
"""An id: what 64 bits hold, as arrays of them do."""
Pixels = Annotated[FiniteFloat, Field(ge=-1e7, le=1e7)]
"""A length in a picture; the limits keep sums and areas finite."""
Box = tuple[Pixels, Pixels, Pixels, Pixels]
"""Left, top, width, height."""


def read_checked(path: Path, shape: TypeAdapter[T], what: str) -> T:
    """The value of a JSON file.

    Raises:
        RescoreError: no such file, not JSON, or another shape; the first difference is named with its place.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected {what}, found no file; check the path")
    try:
        return shape.validate_json(path.read_bytes())
    except ValidationError as error:
        raise RescoreError(
            f"{path}: expected {what}, got {first_difference(error)}; mend the file"
        ) from error


def first_difference(error: ValidationError) -> str:
    """Where the first difference is, what should be there and what is, in one line."""
    problems = error.errors(include_url=False)
    first = problems[0]
    place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in first["loc"]).lstrip(".")
    seen = "" if first["type"] in {"json_invalid", "missing"} else f" ({_short(first['input'])})"
    more = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
    text = first["msg"][:1].lower() + first["msg"][1:]
    return f"{place}: {text}{seen}{more}" if place else f"{text}{seen}{more}"


def _short(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."
