"""Imports between packages follow one table, without circles; files, folders and functions keep their limits."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("lang", "compiler", "shapes", "lights", "materials", "render", "live", "measure", "stdlib", "cli")
MAX_LINES = 450
MAX_MODULES = 25  # in a folder
MAX_FUNCTION_LINES = 60
MAX_PARAMETERS = 10
MAX_PACKAGE_LINES = 8

# The packages each package may import, with all that those may, from the ground up. The modules beside the folders of compiler and render
# have rows of their own; those of lang are "lang" together.
MAY_IMPORT = {
    "lang": "",
    "lang.syntax": "lang",
    "lang.schema": "lang",
    "lang.eval": "lang.syntax lang.schema",
    "stdlib": "",
    "compiler.ir": "lang",
    "compiler.io": "lang.eval",
    "compiler.formula": "compiler.ir",
    "compiler.texture_graph": "compiler.formula",
    "compiler.fillets": "compiler.formula",
    "render.types": "compiler.ir",
    "render.simd": "compiler.io",
    "render.jit": "compiler.io render.simd",
    "render.lanes": "render.types render.jit",
    "shapes": "lang.schema compiler.formula render.lanes",
    "lights": "shapes",
    "compiler.scene": "compiler.io compiler.texture_graph lights",
    "materials": "compiler.scene",
    "compiler.catalogue": "materials",
    "lang.reference_page": "lang.eval compiler.catalogue",
    "lang.stdlib_page": "lang.reference_page",
    "compiler.mesh": "compiler.scene",
    "compiler.plan": "materials compiler.mesh",
    "compiler.importers.common": "compiler.mesh",
    "compiler.importers.materialx": "compiler.texture_graph",
    "compiler.importers.assemblies": "compiler.importers.common",
    "compiler.importers.khronos": "materials compiler.importers.common",
    "compiler.importers": "compiler.importers.khronos compiler.importers.assemblies",
    "compiler.importers.usd.layers": "compiler.io compiler.importers.materialx",
    "compiler.importers.usd.pictures": "compiler.importers",
    "compiler.importers.usd.shaders": "materials compiler.importers compiler.importers.materialx",
    "compiler.importers.usd": "compiler.importers.usd.shaders compiler.importers.usd.pictures compiler.importers.usd.layers",
    "compiler.lower": "compiler.fillets compiler.plan compiler.importers.usd",
    "compiler.exporters": "compiler.mesh compiler.plan",
    "compiler.exporters.language": "compiler.exporters compiler.importers compiler.catalogue",
    "compiler.exporters.triangles": "compiler.exporters",
    "compiler.exporters.baking": "compiler.exporters",
    "compiler.exporters.gltf": "compiler.exporters.baking",
    "compiler.exporters.mitsuba": "compiler.exporters",
    "compiler.exporters.povray": "compiler.exporters",
    "compiler.exporters.usd": "compiler.exporters.baking",
    "compiler.load": "compiler.lower compiler.catalogue",
    "compiler.format_pages": "compiler.importers.usd",
    "render.packing": "compiler.plan",
    "render.image": "compiler.ir compiler.io",
    "render.sampling": "render.lanes",
    "render.geometry": "lights",
    "render.camera": "render.sampling render.geometry",
    "render.formula": "compiler.texture_graph render.geometry",
    "render.texture": "render.formula",
    "render.medium": "render.texture",
    "render.surface": "compiler.plan render.camera render.texture",
    "render.light": "render.image render.surface render.medium",
    "render.material": "render.light render.medium",
    "render.accel.bvh_build": "render.formula",
    "render.accel.traverse": "render.surface render.accel.bvh_build",
    "render.accel": "render.accel.traverse",
    "render.accel.formula_packets": "render.light render.accel",
    "render.integrator.state": "render.material render.accel.formula_packets",
    "render.integrator.photon_maps": "render.integrator.state",
    "render.integrator": "render.integrator.photon_maps",
    "render.integrator.photons": "render.integrator",
    "render.film": "render.material",
    "render.tessellation": "compiler.mesh render.image render.accel",
    "render.raster": "render.integrator render.tessellation",
    "render.backends": "render.integrator.photons render.film render.raster render.packing",
    "render.quality_settings": "compiler.plan",
    "render.working_space": "compiler.plan",
    "render.render_scene": "render.backends render.working_space",
    "render.large_images": "render.film",
    "render.memory_estimate": "render.film",
    "render.picture_notes": "render.render_scene",
    "render.cluster": "compiler.scene render.render_scene",
    "render.python_options": "render.image",
    "render.python_scene": "render.picture_notes render.python_options render.tessellation compiler.exporters.usd",
    "live": "*",
    "live.lsp": "live",
    "measure": "*",
    "measure.peers": "measure",
    "measure.report": "measure",
    "measure.comparison": "measure",
    "measure.chart": "measure.peers",
    "measure.light": "measure",
    "cli": "*",
    "cli.scene_tests": "cli",
    "cli.process": "lang",
    "cli.cluster": "cli",
    "cli.commands": "cli.scene_tests cli.process cli.cluster",
    "top": "*",
}
# `*` is every package but these and the packages inside them.
EXCEPT = {"live": ("measure", "cli", "top"), "measure": ("measure", "live", "cli", "top"), "cli": (), "top": ("stdlib",)}

# Modules that may be imported inside a function, and why: a command that does not need one must not wait for it.
LATE = {
    "DracoPy": "an extra, for compressed glTF meshes",
    "PIL": "only animations and sheets need it",
    "av": "an extra, for .mp4 files",
    "distributed": "an extra, for rendering on a cluster",
    "OpenImageIO": "only scenes with pictures need it",
    "ctypes": "`--help` calls nothing by it",
    "fcntl": "some systems lack it",
    "mapbox_earcut": "only concave polygons need it",
    "opengl_basisu": "an extra, for pictures in KTX 2",
    "manifold3d": "only solids with meshes in them need it",
    "pxr": "only a scene that becomes a stage needs it",
    "pyoidn": "only noisy pictures need it",
    "resource": "some systems lack it",
    "rich": "only a terminal sees colours",
    "trimesh": "only measuring and repair of meshes need it",
    "uharfbuzz": "only text needs it",
}
# Libraries that one file alone may import: everything else goes through it. That file is loaded when a picture of it is wanted.
ONE_FILE = {
    "lark": "lang/syntax/grammar.py",
    "matplotlib": "measure/report/plot.py",
    "flip_evaluator": "measure/errors.py",
    "manifold3d": "compiler/mesh/mesh_csg.py",
    "uharfbuzz": "compiler/importers/fonts.py",
    "av": "render/image/animation.py",
    "anywidget": "live/widget.py",
    "distributed": "render/cluster/dask_cluster.py",
}
# Files whose functions open the next stage's door when it is reached, so that `--help` and `check` stay quick.
DOORS = {
    "__init__.py": "`import maquette` loads no numpy",
    "__main__.py": "Ctrl-C ends the process silently while the command is loaded",
    "cli/commands/check.py": "`--help` loads no compiler",
    "cli/commands/explain.py": "`--help` loads no renderer",
    "cli/commands/inspect.py": "`--help` loads no tables",
    "cli/commands/lsp.py": "`--help` loads no server",
    "cli/commands/render.py": "`--help` loads no renderer",
    "cli/common_options.py": "settings are asked for once numpy is needed anyway",
    "cli/animation.py": "only an animation loads what writes it",
    "cli/commands/chart.py": "drawing again loads no scene, and nobody else loads matplotlib",
    "cli/commands/compare.py": "pictures and scenes load what they need",
    "cli/commands/convert.py": "each format loads what writes it",
    "cli/memory.py": "only a render estimates its memory",
    "cli/commands/measure.py": "`--help` loads no numpy of meshes",
    "cli/scene_selection.py": "who selects nothing loads no selection",
    "cli/commands/format.py": "`--help` loads no parser",
    "cli/commands/test.py": "`--help` loads no renderer",
    "cli/commands/thumbnail.py": "asking for help, or keeping pictures, loads no renderer",
    "cli/commands/watch.py": "asking for help loads neither server nor renderer",
    "live/scene_files.py": "only stages load what reads USD",
    "cli/commands/doctor.py": "`--help` looks at no packages",
    "cli/installation.py": "what cannot be imported is a finding",
    "cli/scene_source.py": "each kind of file loads what reads it",
    "cli/job/ignored_options.py": "`--help` loads no writers of pictures",
    "cli/job/checkpoints.py": "a picture without checkpoints loads nothing for them",
    "cli/job/kept_frames.py": "a picture that is not of an animation loads nothing for it",
    "cli/render_job.py": "a job loads the stages it comes to",
    "cli/job/picture_summary.py": "NumPy starts threads when it is imported, and a process is confined before",
    "cli/job/rescue.py": "only a picture that could not be written is rescued",
    "render/python_scene.py": "only a scene that becomes a stage loads USD",
    "render/render_scene.py": "a picture loads the backend that draws it",
    "render/backends/prepare.py": "what makes ready for a backend, or for formulas, is loaded where there is a use for it",
    "render/tessellation/view.py": "dual contouring is loaded where there are implicit surfaces",
    "render/image/image.py": "only a picture that is saved loads OpenImageIO",
    "render/film/aov.py": "only formulas' surfaces that could not be proved need their definition",
    "render/formula/scene_tables.py": "what makes formulas ready is loaded where there are some",
    "render/texture/procedural.py": "tape evaluators are loaded for scenes with patterns",
    "render/accel/traverse/shape_hit.py": "formula kernels are loaded for scenes with formulas",
    "render/accel/intersect.py": "the reference of formulas is loaded for scenes with formulas",
    "render/backends/ray.py": "what paths, or formulas, are drawn with is loaded where there are any",
    "render/backends/reference.py": "what paths are drawn with is loaded where there are any",
    "render/jit/function_pointer.py": "Numba is loaded where a kernel is compiled",
    "render/jit/kernel.py": "Numba is loaded where a kernel is compiled",
    "render/jit/kernel_cache.py": "Numba is loaded where a kernel is compiled",
    "compiler/plan/scene_rules.py": "only formulas are looked at for closed forms",
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


def package_of(module: str) -> str:
    """The row of MAY_IMPORT that a dotted module belongs to."""
    if layer_of(module) == "top":
        return "top"
    while module not in MAY_IMPORT and "." in module:
        module = module.rpartition(".")[0]
    return module


def module_of(file: str) -> str:
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


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


def allowed(package: str) -> set[str]:
    if MAY_IMPORT[package] == "*":
        return {each for each in {*MAY_IMPORT, *PACKAGES} if layer_of(each) not in EXCEPT[package]} | {package}
    return {package}.union(*(allowed(each) for each in MAY_IMPORT[package].split()))


@pytest.mark.long
def test_packages_import_what_the_table_allows() -> None:
    found = {
        (package_of(module_of(i.file)), package_of(i.target)): f"{i.file}:{i.line} {package_of(module_of(i.file))} imports {i.target}"
        for i in IMPORTS
        if i.own and package_of(i.target) not in allowed(package_of(module_of(i.file)))
    }
    assert not found, listed([*found.values()])


def test_the_table_goes_one_way() -> None:
    """Each package is written below all that it may import."""
    above: set[str] = set()
    for package, imports in MAY_IMPORT.items():
        if imports != "*":
            assert set(imports.split()) <= above, f"{package} imports {set(imports.split()) - above}, which stand below it"
        above.add(package)


def test_imports_inside_the_package_are_relative() -> None:
    ours = {"maquette", *PACKAGES}
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
    wrong = [f"{i.file}:{i.line}" for i in IMPORTS if i.own and i.target == "measure.report.plot" and not i.hidden]
    assert not wrong, listed(wrong)


def test_modules_do_not_import_in_circles() -> None:
    """At module level, in functions and for types."""
    edges: dict[str, set[str]] = {}
    for i in IMPORTS:
        if i.own:
            edges.setdefault(module_of(i.file), set()).add(i.target)
    done: set[str] = set()

    def walk(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " → ".join((*path[path.index(module) :], module))
        if module not in done:
            for target in sorted(edges.get(module, ())):
                walk(target, (*path, module))
            done.add(module)

    for module in list(edges):
        walk(module, ())


COMPILES = {
    *(f"render/jit/{name}.py" for name in ("compiler", "lto", "numba_patches", "numba_types")),
    *(f"render/simd/{name}.py" for name in (
        "bounds_check", "constructors", "denormals", "elementary", "functions", "gather_scatter", "memory", "operators", "shuffles",
        "vector_indexing", "vector_type",
    )),
}  # fmt: skip


def test_numba_is_loaded_to_compile_alone() -> None:
    """Only the modules of COMPILES import Numba, and only they import each other before a kernel is compiled."""
    compiling = {module_of(file) for file in COMPILES}
    wrong = [
        f"{i.file}:{i.line} {i.target}" for i in IMPORTS
        if (i.target.split(".")[0] == "numba" or (i.target in compiling and not i.hidden)) and i.file not in COMPILES
    ]  # fmt: skip
    assert not wrong, listed(wrong)
    assert {i.file for i in IMPORTS if i.target.split(".")[0] == "numba"} == COMPILES


def test_lang_knows_no_arrays_and_no_disk() -> None:
    banned = {"numpy", "os", "pathlib", "io", "shutil", "tempfile", "importlib"}
    own = {
        "lang/syntax/grammar.py",
        "lang/stdlib_page.py",
        "lang/reference_page.py",
    }  # grammar and tables stand in files of their own; the pages read the library
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


@pytest.mark.long
def test_functions_are_short_and_take_few_parameters() -> None:
    found = []
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines, parameters = (node.end_lineno or node.lineno) - node.lineno + 1, len(_parameters(node.args))
                if lines > MAX_FUNCTION_LINES or parameters > MAX_PARAMETERS:
                    found.append(f"{name_of(path)}:{node.lineno} {node.name}: {lines} lines, {parameters} parameters")
    assert not found, listed(found)


def _parameters(arguments: ast.arguments) -> list[ast.arg]:
    more = [arg for arg in (arguments.vararg, arguments.kwarg) if arg]
    return [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, *more]


@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES}), ids=name_of)
def test_a_folder_is_small(folder: Path) -> None:
    modules = [*folder.glob("*.py")]
    assert len(modules) <= MAX_MODULES, f"{name_of(folder)} holds {len(modules)} modules"


@pytest.mark.parametrize("path", [path for path in FILES if path.name == "__init__.py" and path.parent != ROOT], ids=name_of)
def test_a_package_says_what_lives_there(path: Path) -> None:
    lines = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").splitlines()
    assert 1 <= len(lines) <= MAX_PACKAGE_LINES, f"{name_of(path)} describes its package in {len(lines)} lines"
