"""A digest of the source of modules and of all that they import: the code version of a cached stage."""

import ast
import hashlib
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from rescore.files import _file_digest


def source_digest(*modules: str) -> str:
    """Digest of the source of modules and of everything of this project that they import, at any depth.

    The code version of a cached stage: an edit of what the stage runs makes a new key, an edit elsewhere does
    not.
    """
    total = hashlib.sha256()
    for name, file in sorted(_closure(modules).items()):
        total.update(name.encode() + b"\0" + _file_digest(file))
    return total.hexdigest()


PACKAGES = ("recon", "rescore", "datasets_synth", "reports")


def _closure(modules: Iterable[str]) -> dict[str, Path]:
    """Files of modules and of all modules of the project that they import, by module name."""
    found: dict[str, Path] = {}
    todo = list(modules)
    while todo:
        name = todo.pop()
        file = module_file(name)
        if file is None or name in found:
            continue
        found[name] = file
        todo += imported_modules(file)
    return found


def module_file(name: str) -> Path | None:
    """The source file of a module of this project; None where the name is no such module."""
    if name.partition(".")[0] not in PACKAGES:
        return None
    base = Path(__file__).resolve().parent.parent.joinpath(*name.split("."))
    return next((f for f in (base.with_suffix(".py"), base / "__init__.py") if f.is_file()), None)


def imported_modules(file: Path) -> tuple[str, ...]:
    """Names of modules (or members of them) that a source file imports anywhere in it, by its syntax tree."""
    state = file.stat()
    return _imports_at(file, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=10_000)
def _imports_at(file: Path, _size: int, _modified_ns: int) -> tuple[str, ...]:
    """Imports of a file, parsed once in a process unless it changes: stages share most of their code."""
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(names)
