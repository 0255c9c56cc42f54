"""JSON files of a stated shape: read into typed values, or one line that says where they differ from it."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import FailFast, Field, FiniteFloat, TypeAdapter, ValidationError

from recon.errors import RescoreError
from recon.reading import utf8_of

T = TypeVar("T")
Rows = Annotated[list[T], FailFast()]
"""A list of which the first item that differs is told: to note each takes memory without end."""
Number = Annotated[int, Field(ge=-(2**63), lt=2**63)]
"""An id: what 64 bits hold, as arrays of them do."""
Pixels = Annotated[FiniteFloat, Field(ge=-1e7, le=1e7)]
"""A length in a picture; the limits keep sums and areas finite."""
Box = tuple[Pixels, Pixels, Pixels, Pixels]
"""Left, top, width, height."""
Metres = Annotated[FiniteFloat, Field(ge=-1e5, le=1e5)]
"""A place; the limits keep volumes finite."""
Length = Annotated[FiniteFloat, Field(gt=0, le=1e5)]
"""A size in metres."""
Box3D = tuple[Metres, Metres, Metres, Length, Length, Length, FiniteFloat]
"""Centre in the camera frame, length, width, height, KITTI's rotation_y (see ``rescore.data.boxes3d``)."""
Deviation = Annotated[FiniteFloat, Field(ge=0)]
Box3DDeviations = tuple[Deviation, Deviation, Deviation, Deviation, Deviation, Deviation, Deviation]
"""Standard deviations of the numbers of a ``Box3D``."""


def read_checked(path: Path, shape: TypeAdapter[T], what: str) -> T:
    """The value of a JSON file.

    Raises:
        RescoreError: no such file, not JSON, or another shape; the first difference is named with its place.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected {what}, found no file; check the path")
    try:
        return shape.validate_json(utf8_of(path.read_bytes()))
    except ValidationError as error:
        raise RescoreError(
            f"{path}: expected {what}, got {first_difference(error)}; mend the file"
        ) from error


def first_difference(error: ValidationError, n_before: int = 0) -> str:
    """Where the first difference is, what should be there and what is, in one line.

    ``n_before`` items of a list came before those that were checked.
    """
    problems = error.errors(include_url=False)
    first = problems[0]
    path = [p + n_before if i == 0 and isinstance(p, int) else p for i, p in enumerate(first["loc"])]
    place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).lstrip(".")
    if n_before and not place:
        place = f"after item {n_before - 1}"
    seen = "" if first["type"] in {"json_invalid", "missing"} else f" ({_short(first['input'])})"
    more = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
    text = first["msg"][:1].lower() + first["msg"][1:]
    return f"{place}: {text}{seen}{more}" if place else f"{text}{seen}{more}"


def _short(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


def refuse_unknown_keys(place: str, kind: Any, value: Any) -> None:
    """Raises ValueError where the JSON value of a dataclass has a key, at any depth, that is no field.

    ``place`` names the value in the error. Anything that is no dataclass passes.
    """
    if not (is_dataclass(kind) and isinstance(value, Mapping)):
        return
    known = {f.name for f in fields(kind)}
    unknown = sorted(set(value) - known)
    if unknown:
        raise ValueError(f"{place}: unknown setting {unknown[0]!r}, known are {', '.join(sorted(known))}")
    hints = get_type_hints(kind)
    for name, part in value.items():
        refuse_unknown_keys(f"{place}.{name}", hints.get(name), part)


def merged(base: Any, changes: Any) -> Any:
    """The JSON value with the values of ``changes`` put in place of its own, at any depth of its objects."""
    if isinstance(base, dict) and isinstance(changes, dict):
        return base | {key: merged(base.get(key), value) for key, value in changes.items()}
    return changes
