"""A digest of the source of modules and of all that they import: the code version of a cached stage."""

import ast
import hashlib
import os
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from rescore.files import file_digest

PACKAGES = ("recon", "rescore", "datasets_synth", "reports")
ROOT = Path(__file__).resolve().parents[2]
"""The folder that holds the packages."""


def source_digest(*modules: ModuleType, root: Path = ROOT) -> str:
    """Digest of the source of modules and of everything of this project that they import, at any depth.

    The code version of a cached stage: an edit of what the stage runs makes a new key, an edit elsewhere does
    not.

    Args:
        modules: modules of this project, or one of yours that its registries name.
        root: the folder that holds the packages, for a copy of the source.

    Raises:
        ValueError: the source of a module is not there.
    """
    total = hashlib.sha256()
    for name, file in sorted(_closure(modules, root).items()):
        total.update(name.encode() + b"\0" + file_digest(file))
    return total.hexdigest()


def source_files(root: Path = ROOT) -> dict[str, Path]:
    """The source file of every module of this project, by the module's name."""
    found: dict[str, Path] = {}
    for package in PACKAGES:
        for folder, _, names in os.walk(root / package):
            within = Path(folder).relative_to(root).parts
            for name in names:
                stem, end = os.path.splitext(name)
                if end == ".py":
                    module = within if stem == "__init__" else (*within, stem)
                    found[".".join(module)] = Path(folder, name)
    return found


def _closure(modules: Iterable[ModuleType], root: Path) -> dict[str, Path]:
    """Files of modules and of all modules of the project that they import, by module name."""
    files, found = source_files(root), dict[str, Path]()
    todo = [(m.__name__, files.get(m.__name__) or _own_file(m)) for m in modules]
    while todo:
        name, file = todo.pop()
        if name in found:
            continue
        if file is None:
            raise ValueError(f"{name}: expected a module of {', '.join(PACKAGES)}, found no source of it")
        found[name] = file
        todo += [(other, files[other]) for other in imported_modules(file, files)]
    return found


def _own_file(module: ModuleType) -> Path | None:
    """The source file of a module that is none of this project's."""
    own = module.__name__.partition(".")[0] in PACKAGES
    return None if own or not getattr(module, "__file__", None) else Path(str(module.__file__))


def imported_modules(file: Path, files: Mapping[str, Path]) -> set[str]:
    """Modules of this project that a source file imports anywhere in its syntax tree.

    Args:
        file: the source file.
        files: what ``source_files`` gives.

    Raises:
        ValueError: the file imports a module of this project that is not there.
    """
    found = set()
    for module, members in _imports(file):
        if module.partition(".")[0] not in PACKAGES:
            continue
        # an unknown name must not pass: the stage would never go stale again
        if module not in files:
            raise ValueError(f"{file}: expected imports of modules that are there, got {module}")
        found |= {module, *(name for m in members if (name := f"{module}.{m}") in files)}
    return found


def _imports(file: Path) -> tuple[tuple[str, tuple[str, ...]], ...]:
    state = file.stat()
    return _imports_at(file, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=10_000)
def _imports_at(file: Path, _size: int, _modified_ns: int) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Imports of a file as modules and the names taken from each.

    Parsed once in a process unless the file changes: stages share most of their code.
    """
    found: list[tuple[str, tuple[str, ...]]] = []
    todo: list[ast.AST] = [ast.parse(file.read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            # never run: names for annotations alone
            todo += node.orelse
        elif isinstance(node, ast.Import):
            found += [(alias.name, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.append((node.module, tuple(alias.name for alias in node.names)))
        else:
            todo += ast.iter_child_nodes(node)
    return tuple(found)
