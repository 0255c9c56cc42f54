"""Who may import whom, read from the source: between the packages, and between the rooms of each."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("recon", "rescore", "datasets_synth", "reports")
DRAWING = {"plotly", "jinja2", "matplotlib", "rerun"}
MESHES = {"open3d", "trimesh"}
FILES = {
    ".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f
    for package in PACKAGES
    for f in sorted((ROOT / package).rglob("*.py"))
}

TOP = (
    "rescore.experiment",
    "rescore.large",
    "rescore.studies",
    "rescore.grasping",
    "rescore.commands",
    "rescore.cli",
)
"""What may import the renderer and the pages: the experiment, the studies, the robot and the commands."""
METHOD = {"recon", "rescore"}
ALLOWED = {
    "recon": {"recon"},
    "rescore": METHOD,
    "datasets_synth": METHOD | {"datasets_synth"},
    "reports": METHOD | {"reports"},
}
"""Packages that a package may import, where a module is not of ``TOP``."""

FLOORS = {
    "recon": (
        *(
            "errors arrays",
            "compiled",
            "stores",
            "files reading workers boxes camera depth_map outlines view_bins pixels shapes",
            "shape_space view_looks",
        ),
        *("part_views", "class_model", "stereo", "learning", "reconstruction", "localization"),
    ),
    "rescore": (
        *(
            "speech defaults",
            "files parallel locks memory stopping engines",
            "data",
            "metrics",
            "cues",
            "evidence",
            "detectors",
            "fusion",
            "formats",
        ),
        *("results", "library doctor", "experiment", "studies large", "grasping", "commands", "cli"),
    ),
    "datasets_synth": ("presets meshes", "render", "cars", "objects", "street", "photos", "build"),
    "reports": ("palette templating", "charts pages", "objects run", "page recording studies", "publishing"),
}
"""Modules and rooms of each package from the ground up. What stands on a floor imports lower floors and its
own room; rooms of one floor do not know each other."""
MOST_IN_A_ROOM = 17
"""Modules beside each other in a folder."""
MOST_OF_A_COMMAND = 25
"""Lines of a function in ``rescore.commands`` without docstring and imports; longer work has another home."""


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


def in_top(module: str) -> bool:
    return any(module == top or module.startswith(f"{top}.") for top in TOP)


def floor_of(module: str) -> tuple[str, int] | None:
    """The module or room of ``FLOORS`` that a module belongs to, and its floor; None for a package itself."""
    package, _, rest = module.partition(".")
    room = rest.partition(".")[0]
    if not room:
        return None
    for number, names in enumerate(FLOORS[package]):
        if room in names.split():
            return room, number
    raise AssertionError(f"{module}: expected a room of FLOORS; say there on which floor it stands")


def test_all_packages_are_read() -> None:
    assert {"recon.stereo.sgbm", "rescore.cli", "datasets_synth.build", "reports"} <= set(FILES)


@pytest.mark.parametrize("module", FILES)
def test_between_the_packages(module: str) -> None:
    package = module.partition(".")[0]
    names = imports(FILES[module])
    packages = {n.partition(".")[0] for n in names}
    if not in_top(module):
        assert packages & set(PACKAGES) <= ALLOWED[package]
    if package != "reports":
        assert not packages & DRAWING
    if package in METHOD:
        assert not packages & MESHES


@pytest.mark.parametrize("module", [m for m in FILES if floor_of(m)])
def test_inside_the_packages(module: str) -> None:
    package = module.partition(".")[0]
    room, floor = floor_of(module) or ("", 0)
    for name in own(imports(FILES[module])):
        other = floor_of(name) if name.partition(".")[0] == package else None
        if other and other[0] != room:
            assert other[1] < floor, f"{module} imports {name}, which does not stand below it"


def test_reports_draw_what_the_studies_found_and_nothing_else_of_the_top() -> None:
    for module, file in FILES.items():
        if not in_top(module):
            top = {n for n in own(imports(file)) if in_top(n)}
            studies = module.startswith("reports.studies") or module == "reports.recording.grasp"
            allowed = ("rescore.studies", "rescore.grasping") if studies else ()
            assert all(n.startswith(allowed) for n in top), f"{module} imports {sorted(top)}"


@pytest.mark.parametrize("folder", sorted({f.parent for f in FILES.values()}))
def test_rooms_have_a_purpose_and_few_modules(folder: Path) -> None:
    modules = [f for f in folder.glob("*.py") if f.name != "__init__.py"]
    assert len(modules) <= MOST_IN_A_ROOM
    first = ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
    assert first, f"{folder}: expected a first sentence that says what the room is for"


@pytest.mark.parametrize("module", sorted(m for m in FILES if m == "rescore.cli" or ".commands" in m))
def test_the_commands_import_heavy_modules_lazily(module: str) -> None:
    allowed = {"recon.errors", "recon.stores", "recon", "rescore", "rescore.speech", "rescore.stopping"}
    # a package that holds words alone
    allowed |= {"datasets_synth", "datasets_synth.cars"}
    names = own(imports(FILES[module], lazy=False)) - allowed
    assert all(n == "rescore.cli" or n.startswith("rescore.commands") for n in names)


@pytest.mark.parametrize("module", sorted(m for m in FILES if m.startswith("rescore.commands.")))
def test_a_command_parses_calls_and_prints(module: str) -> None:
    for node in ast.parse(FILES[module].read_text()).body:
        if isinstance(node, ast.FunctionDef):
            does = [s for s in node.body if not isinstance(s, ast.Import | ast.ImportFrom)]
            does = does[1:] if ast.get_docstring(node) and len(does) > 1 else does
            lines = (does[-1].end_lineno or 0) - does[0].lineno + 1
            assert lines <= MOST_OF_A_COMMAND, f"{module}.{node.name} has {lines} lines"


def test_no_circular_imports() -> None:
    graph = {m: own(imports(f, lazy=False)) - {m} for m, f in FILES.items()}
    # a module that imports a member of a package imports the package too, which must not import it back
    while graph:
        free = [m for m, needs in graph.items() if not needs & set(graph)]
        assert free, f"circle among {sorted(graph)}"
        for m in free:
            del graph[m]
