"""A user's changes to settings, as JSON values: merged into the defaults, misspelt ones refused."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, get_type_hints


def merged(base: Any, changes: Any) -> Any:
    """The JSON value with that of ``changes`` in place of its own, at any depth of its objects."""
    if isinstance(base, dict) and isinstance(changes, dict):
        return base | {key: merged(base.get(key), value) for key, value in changes.items()}
    return changes


def refuse_unknown_keys(place: str, kind: Any, value: Any) -> None:
    """Raises ValueError where the JSON value of a dataclass has a key that is none of its fields, at any
    depth.

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
