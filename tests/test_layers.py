"""The layers, read from the imports: cli, live, measure → render → compiler → lang, nothing upwards, hidden or in circles."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("lang", "compiler", "render", "live", "measure", "stdlib")
MAX_LINES = 600

# What a layer may import from. The top is the files beside the packages: cli*.py and __init__.py.
ALLOWED = {
    "lang": {"lang"},
    "compiler": {"compiler", "lang", "stdlib"},
    "render": {"render", "compiler", "lang"},
    "live": {"live", "render", "compiler", "lang"},
    "measure": {"measure", "render", "compiler", "lang"},
    "stdlib": set(),
    "top": {"top", "live", "measure", "render", "compiler", "lang", "stdlib"},
}
RENDER_READS = {
    "compiler.ir",
    "compiler.plan",
    "compiler.folders",  # only names a folder, for what both keep on disk
    "compiler.tapes",  # what tapes of the IR hold and mean
    "compiler.operations",
    "compiler.tape_points",
    "compiler.enclosures",
    "compiler.slope_bounds",
    "compiler.tape_walks",
    "compiler.closed_forms",  # solids of planes, quadrics and tori among them
    "compiler.contour",  # their surfaces as triangles
    "compiler.mesh_solids",  # fewer of them
    "compiler.export_meshes",
}

# Modules that may be imported inside a function, and why: a command that does not need one must not wait for it.
LATE = {
    "OpenImageIO": "only scenes with pictures need it",
    "manifold3d": "only solids with meshes in them need it",
    "pyoidn": "an extra, for who asks for pictures without noise",
    "rich": "only a terminal sees colours",
    "trimesh": "only OFF files need it, and it takes half a second",
}
# Libraries that one file alone may import: everything else goes through it. That file is loaded when a picture of it is wanted.
ONE_FILE = {
    "matplotlib": "measure/draw.py",
    "flip_evaluator": "measure/errors.py",
    "manifold3d": "compiler/mesh/mesh_csg.py",
}
# Files whose functions open the next stage's door when it is reached, so that `--help` and `check` stay quick.
DOORS = {
    "__init__.py": "`import maquette` loads no numpy",
    "cli/main.py": "each command loads its own stages",
    "cli/common_options.py": "settings are asked for once numpy is needed anyway",
    "cli/chart.py": "drawing again loads no scene, and nobody else loads matplotlib",
    "cli/compare.py": "pictures and scenes load what they need",
    "cli/convert.py": "each format loads what writes it",
    "cli/format.py": "`--help` loads no parser",
    "cli/render_job.py": "a job loads the stages it comes to",
    "render/render_scene.py": "a picture loads the backend that draws it",
    "render/backends/prepare.py": "what makes ready for a backend, or for formulas, is loaded where there is a use for it",
    "render/film/aov.py": "only formulas' surfaces that could not be proved need their definition",
    "render/formula/tables.py": "what makes formulas ready is loaded where there are some",
    "render/accel/traverse/shape_hit.py": "what meets formulas is loaded where there are some",
    "render/texture/procedural.py": "tapes are run where a scene has patterns",
    "render/accel/intersect.py": "only formulas need their definition",
    "render/backends/ray.py": "what paths, or formulas, are drawn with is loaded where there are any",
    "render/backends/reference.py": "what paths are drawn with is loaded where there are any",
    "compiler/plan/plan.py": "only formulas are looked at for closed forms",
    "compiler/lower/lowering.py": "a mesh or a stage inside a scene loads what reads its file",
    "compiler/load.py": "each kind of file has its own front end and libraries",
}


@dataclass(frozen=True)
class Import:
    """One imported module: `target` is lang.ast for the package's own, numpy for others."""

    file: str
    line: int
    target: str
    own: bool
    hidden: bool  # inside a function
    typing_only: bool


def sources() -> list[Path]:
    """Every Python file of the package."""
    return sorted([*ROOT.glob("*.py"), *(f for p in PACKAGES for f in (ROOT / p).rglob("*.py"))])


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def layer_of(module: str) -> str:
    first = module.split(".")[0]
    return first if first in PACKAGES else "top"


def is_module(dotted: str) -> bool:
    path = ROOT.joinpath(*dotted.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def imports_of(path: Path) -> list[Import]:
    found: list[Import] = []
    package = list(path.relative_to(ROOT).parent.parts)

    def add(node: ast.stmt, target: str, own: bool, hidden: bool, typing_only: bool) -> None:
        found.append(Import(name_of(path), node.lineno, target, own, hidden, typing_only))

    def visit(node: ast.AST, hidden: bool, typing_only: bool) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                for alias in child.names:
                    add(child, alias.name, False, hidden, typing_only)
            elif isinstance(child, ast.ImportFrom) and child.level:
                base = package[: len(package) - child.level + 1] + (child.module.split(".") if child.module else [])
                for alias in child.names:
                    whole = ".".join([*base, alias.name])
                    add(child, whole if is_module(whole) else ".".join(base), True, hidden, typing_only)
            elif isinstance(child, ast.ImportFrom):
                add(child, child.module or "", False, hidden, typing_only)
            inside = hidden or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            types = typing_only or (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING")
            visit(child, inside, types)

    visit(ast.parse(path.read_text(encoding="utf-8")), False, False)
    return found


FILES = sources()
IMPORTS = [i for path in FILES for i in imports_of(path)]


def listed(found: list[str]) -> str:
    return "\n".join(found)


def test_arrows_go_down() -> None:
    wrong = [
        f"{i.file}:{i.line} {layer_of(i.file.split('/')[0])} imports {i.target}"
        for i in IMPORTS
        if i.own and layer_of(i.target) not in ALLOWED[layer_of(i.file.split("/")[0])]
    ]
    assert not wrong, listed(wrong)


def test_render_reads_only_the_ir_and_the_plan() -> None:
    wrong = [
        f"{i.file}:{i.line} {i.target}"
        for i in IMPORTS
        if i.own and i.file.startswith("render/") and i.target.startswith("compiler") and i.target not in RENDER_READS
    ]
    assert not wrong, listed(wrong)


def test_imports_inside_the_package_are_relative() -> None:
    ours = {"maquette", *PACKAGES, *(f.stem for f in ROOT.glob("cli*.py"))}
    wrong = [f"{i.file}:{i.line} {i.target}" for i in IMPORTS if not i.own and i.target.split(".")[0] in ours]
    assert not wrong, listed(wrong)


def test_imports_in_functions_have_a_reason() -> None:
    wrong = [
        f"{i.file}:{i.line} {i.target}" for i in IMPORTS if i.hidden and not (i.file in DOORS if i.own else i.target.split(".")[0] in LATE)
    ]
    assert not wrong, listed(wrong)


def test_reasons_are_still_needed() -> None:
    """A door or a late module that nobody uses any more is taken off the list."""
    hidden = [i for i in IMPORTS if i.hidden]
    assert {i.file for i in hidden if i.own} == set(DOORS)
    assert {i.target.split(".")[0] for i in hidden if not i.own} == set(LATE)


def test_a_library_has_one_door() -> None:
    wrong = [f"{i.file}:{i.line} {i.target}" for i in IMPORTS if i.file != ONE_FILE.get(i.target.split(".")[0], i.file)]
    assert not wrong, listed(wrong)


def test_matplotlib_is_loaded_for_a_chart_alone() -> None:
    """It takes half a second: nothing imports the file that draws with it but a command's function."""
    wrong = [f"{i.file}:{i.line}" for i in IMPORTS if i.own and i.target == "measure.draw" and not i.hidden]
    assert not wrong, listed(wrong)


def test_modules_do_not_import_in_circles() -> None:
    """At module level: a circle works or fails by who is imported first."""
    edges: dict[str, set[str]] = {}
    for i in IMPORTS:
        if i.own and not i.hidden and not i.typing_only:
            module = i.file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
            edges.setdefault(module, set()).add(i.target)
    done: set[str] = set()

    def walk(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " → ".join((*path[path.index(module) :], module))
        if module not in done:
            for target in edges.get(module, ()):
                walk(target, (*path, module))
            done.add(module)

    for module in list(edges):
        walk(module, ())


@pytest.mark.parametrize("layer", ["lang", "compiler", "measure", "top"])
def test_numba_is_not_reached_without_drawing(layer: str) -> None:
    wrong = [f"{i.file}:{i.line}" for i in IMPORTS if i.target.split(".")[0] == "numba" and layer_of(i.file.split("/")[0]) == layer]
    assert not wrong, listed(wrong)


def test_lang_knows_no_arrays_and_no_disk() -> None:
    banned = {"numpy", "os", "pathlib", "io", "shutil", "tempfile", "importlib"}
    own = {
        "lang/syntax/lexer.py",
        "lang/reference_page.py",
    }  # the grammar stands in a file of its own; the reference page reads the library
    lang = [i for i in IMPORTS if i.file.startswith("lang/") and not (i.file in own and i.target == "pathlib")]
    wrong = [f"{i.file}:{i.line} {i.target}" for i in lang if i.target.split(".")[0] in banned]
    assert not wrong, listed(wrong)


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_each_file_says_its_job_and_is_one_idea(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    first = text.partition("\n")[0]
    assert first.startswith('"""'), f"{name_of(path)} does not begin with its job"
    assert len(first.strip('"')) > 15, f"{name_of(path)} says too little of its job"
    assert text.count("\n") <= MAX_LINES, f"{name_of(path)} has more than {MAX_LINES} lines"
