"""Who may import whom, read from the source: recon <- rescore <- datasets_synth, reports <- the top."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ALLOWED = {
    "recon": {"recon"},
    "rescore": {"recon", "rescore"},
    "datasets_synth": {"recon", "rescore", "datasets_synth"},
    "reports": {"recon", "rescore", "reports"},
}
DRAWING = {"plotly", "jinja2", "matplotlib", "rerun"}
MESHES = {"open3d", "trimesh"}
FILES = {
    ".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f
    for package in ALLOWED
    for f in sorted((ROOT / package).rglob("*.py"))
}
COMMANDS = {m for m in FILES if m == "rescore.cli" or m.startswith("rescore.commands")}
TOP = COMMANDS | {"rescore.experiment.reproduce", "rescore.experiment.config"}


def imports(file: Path, lazy: bool = True) -> set[str]:
    """Modules, and members of modules, that a file imports; with lazy=False only on being imported itself."""
    found: set[str] = set()
    todo: list[ast.AST] = [ast.parse(file.read_text())]
    while todo:
        node = todo.pop()
        if not lazy and (isinstance(node, ast.FunctionDef) or _type_checking(node)):
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            found |= {node.module or ""} | {f"{node.module}.{alias.name}" for alias in node.names}
        todo += ast.iter_child_nodes(node)
    return found


def _type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def own(names: set[str]) -> set[str]:
    return {n for n in names if n in FILES}


def test_all_packages_are_read() -> None:
    assert {"recon.stereo.sgbm", "rescore.cli", "datasets_synth.build", "reports"} <= set(FILES)


@pytest.mark.parametrize("module", [m for m in FILES if m not in TOP])
def test_layers(module: str) -> None:
    package = module.partition(".")[0]
    packages = {n.partition(".")[0] for n in imports(FILES[module])}
    assert packages & set(ALLOWED) <= ALLOWED[package]
    assert not own(imports(FILES[module])) & TOP, "nothing imports the top"
    if package != "reports":
        assert not packages & DRAWING
    if package in {"recon", "rescore"}:
        assert not packages & MESHES


@pytest.mark.parametrize("module", sorted(TOP))
def test_the_top_draws_nothing_itself(module: str) -> None:
    assert not {n.partition(".")[0] for n in imports(FILES[module])} & (DRAWING | MESHES)


@pytest.mark.parametrize("module", sorted(COMMANDS))
def test_the_commands_import_heavy_modules_lazily(module: str) -> None:
    assert own(imports(FILES[module], lazy=False)) <= COMMANDS | {"recon.errors"}


def test_no_circular_imports() -> None:
    graph = {m: own(imports(f, lazy=False)) - {m} for m, f in FILES.items()}
    # a module that imports a member of a package imports the package too, which must not import it back
    while graph:
        free = [m for m, needs in graph.items() if not needs & set(graph)]
        assert free, f"circle among {sorted(graph)}"
        for m in free:
            del graph[m]
