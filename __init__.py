"""maquette: a scene-description language compiler and renderer. The public functions: load, load_text, render, sweep, show, compare.

    import maquette
    scene = maquette.load("room.scene", hour=20)
    image = scene.render(size=(320, 240), backend="raster")
    print(maquette.compare(image, "reference.exr").error)
"""

# ruff: noqa: E402 (this comes first, before a module of Python's could come from the current folder; so would __future__)
from .compiler.io import import_path  # isort: split

import_path.isolate_command(__name__, __path__[0])

import sys
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

# The function `render` below has the name of the package render/. Importing that package here, first, settles which one
# `maquette.render` is: the function. `from maquette.render import …` goes by sys.modules and finds the package.
from . import render as _package  # noqa: F401
from .lang.distribution import VERSION

if TYPE_CHECKING:
    from .compiler import ir
    from .lang.diagnostics import Diagnostics
    from .live.widget import Widget
    from .render.image.image import Image
    from .render.image.metrics import Difference
    from .render.python_options import Swept
    from .render.python_scene import Scene

__all__ = ["__version__", "compare", "load", "load_text", "render", "show", "sweep"]

__version__ = VERSION
LOADING = ("sets", "time", "allow", "variants", "max_elements", "diagnostics")  # the options of `load` that are not params


def load(
    source: str | Path | Any,
    *,
    sets: Mapping[str, str] | None = None,
    time: float | None = None,
    allow: str | Path | Sequence[str | Path] = (),
    variants: Mapping[str, str] | None = None,
    max_elements: int | None = None,
    ocio: str | Path | None = None,
    diagnostics: "Diagnostics | None" = None,
    **params: Any,
) -> "Scene":
    """Compile a .scene, USD or mesh file, a Usd.Stage, or a mesh or scene of trimesh.

    `params` are values of the scene's params: numbers, truth values, lists, arrays, and texts in the language ("2cm", "#d0402a").
    `sets` are further ones, all as text, for names that are options here; `time` is in seconds; `allow` are folders it may read
    beside its own; `variants` choose USD variants ({"/prim:set": "name"}). `max_elements` limits the elements that a scene
    makes and places (default 2 million). `ocio` is the configuration of OpenColorIO whose colour spaces pictures may be of, by default
    $OCIO. Warnings and notes are added to `diagnostics`; without it, warnings are SceneWarnings.
    Both are in the scene's `diagnostics` as well.
    Raises maquette.lang.diagnostics.SceneError with everything that is wrong in it, ValueError for a wrong `time` or `max_elements`.
    """
    from .compiler import load as loader
    from .compiler.importers.stage_options import StageOptions
    from .lang import diagnostics as messages
    from .lang.schema import setting_values
    from .render.python_options import as_text, read, warn
    from .render.python_scene import Scene

    folders = (Path(allow),) if isinstance(allow, str | Path) else tuple(map(Path, allow))
    if not isinstance(source, str | Path):
        with tempfile.TemporaryDirectory(prefix="maquette-") as folder:
            path, more = _written(source, Path(folder))
            return load(
                path, sets=sets, time=time, allow=(*folders, *more), variants=variants, max_elements=max_elements, ocio=ocio,
                diagnostics=diagnostics, **params,
            )  # fmt: skip
    collected = diagnostics if diagnostics is not None else messages.Diagnostics()
    earlier_count = len(collected.items)
    param_values = {name: as_text(value) for name, value in {**params, **(sets or {})}.items()}
    time = read("time", time, setting_values.seconds)
    max_elements = read("max_elements", max_elements, setting_values.whole_number(1, sys.maxsize))
    compiled = loader.load_with_colors(
        None if ocio is None else str(ocio), Path(source),
        sets=param_values, time=time, allow=folders, stage=StageOptions(variants=variants or {}), max_elements=max_elements,
        diagnostics=collected, seconds={},
    )  # fmt: skip
    if diagnostics is None:
        warn(collected.items, 2)
    return Scene.of(compiled, collected.items[earlier_count:])


def _written(source: Any, folder: Path) -> tuple[Path, list[Path]]:
    """(file written from an open stage or a trimesh object, files that the stage refers to and folders of its layers)"""
    if hasattr(source, "GetUsedLayers"):
        from .compiler.importers.usd import stage

        path = folder / "stage.usdc"
        source.Export(str(path))  # flattened: paths of textures become absolute
        folders = sorted({Path(layer.realPath).parent for layer in source.GetUsedLayers() if layer.realPath})
        return path, [*folders, *stage.assets_of(path)]
    if hasattr(source, "export"):
        path = folder / "mesh.glb"
        source.export(path)
        return path, []
    kind = type(source)
    raise TypeError(f"load takes a file, a pxr.Usd.Stage, or a mesh or scene of trimesh, not {kind.__module__}.{kind.__name__}")


def load_text(text: str, folder: str | Path = ".", **options: Any) -> "Scene":
    """Compile the text of a scene as if it were a file in `folder`, called text.scene; `options` are those of `load`.

    Raises maquette.lang.diagnostics.SceneError.
    """
    from .compiler.io import sandbox

    if not isinstance(text, str):
        raise TypeError(f"load_text takes the text of a scene, not {type(text).__name__}")
    path = Path(folder) / "text.scene"
    with sandbox.unsaved({str(sandbox.resolved(path)): text}):
        return load(path, **options)


def render(scene: "ir.Scene | str | Path | Any", *, plan: Mapping[str, str] | None = None, **options: Any) -> "Image":
    """Draw a scene, or what `load` takes.

    `options` are the fields of compiler.ir.Settings: size=(800, 600), backend="ray", samples=16, aov=("depth",) and so on; they go
    before the scene's own. For a file they are the options of `load` as well, values of params among them: height=0.4.
    `plan` overrides decisions by name. The Image holds float32 linear channels. Warnings are SceneWarnings; see image.diagnostics.
    A budget counts from this call on, with the reading of a file.
    """
    began = time.perf_counter(), time.process_time()
    from .compiler import ir
    from .lang.diagnostics import SceneError
    from .render.python_options import explain_unknown, split
    from .render.python_scene import Scene

    if isinstance(scene, ir.Scene):
        return Scene.of(scene).render_since(began, plan, options.pop("diagnostics", None), options)
    settings, others = split(options)
    try:
        loaded = load(scene, ocio=settings.get("ocio"), **others)
    except SceneError as error:
        explain_unknown(error, "render", others)
        raise
    return loaded.render_since(began, plan, others.get("diagnostics"), settings)


def sweep(source: "str | Path", *, plan: Mapping[str, str] | None = None, **options: Any) -> "list[Swept]":
    """Draw a scene file for several values of its params: sweep("gear.scene", teeth=[8, 12, 16], size=(160, 120)).

    `options` are those of `render` with a file. A param with a list, tuple, range or array of values is varied; several are combined,
    the last varies fastest. One value of a vector or colour is a list in that list. Returns the pictures with their values.
    Raises ValueError if no param has several values.
    """
    from .render.python_options import Swept, combinations, split

    settings, others = split(options)
    loading = {name: value for name, value in others.items() if name in LOADING}
    params = {name: value for name, value in others.items() if name not in LOADING}
    loading["ocio"], diagnostics = settings.get("ocio"), loading.get("diagnostics")
    return [
        Swept(values, load(source, **loading, **values).render(plan=plan, diagnostics=diagnostics, **settings))
        for values in list(combinations(params))
    ]


def show(path: str | Path, *, plan: Mapping[str, str] | None = None, allow: Sequence[str | Path] = (), **options: Any) -> "Widget":
    """The live window of a scene file as a widget of a notebook, which follows its edits; see docs/live.md.

    `options` are settings of `render` and values of params, `plan` is that of `render`, `allow` that of `load`.
    Raises ImportError without anywidget.
    """
    from .compiler import load as loader
    from .lang.distribution import install_command
    from .live.scene_files import Opened
    from .render.python_options import as_text, picture_settings, split

    try:
        from .live.widget import Widget
    except ModuleNotFoundError as missing:
        raise ImportError(f"the widget of notebooks needs {missing.name}: {install_command('notebook')}") from missing
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {file}")
    settings, params = split(options)
    loader_of_file = partial(loader.load_with_colors, settings.get("ocio"), file, allow=tuple(Path(folder) for folder in allow))
    sets = {name: as_text(value) for name, value in params.items()}
    return Widget(Opened(file, loader_of_file, picture_settings(settings), plan or {}, sets))


def compare(image: "Image | str | Path", reference: "Image | str | Path") -> "Difference":
    """√relMSE and the largest difference between two pictures or files of pictures, in linear light.

    Warns of what of a file is missing, not read, or read by a guess.
    """
    from .render.image import image_reader, metrics

    a, b = (image_reader.read(Path(p)) if isinstance(p, str | Path) else p for p in (image, reference))
    for message, hint in (fault for picture in (a, b) for fault in picture.metadata.get("faults", ())):
        warnings.warn(f"{message}; {hint}", stacklevel=2)
    return metrics.difference(a.channels["rgba"], b.channels["rgba"])
