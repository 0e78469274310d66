"""Entry point of the compiler: a .scene, USD, mesh or saved file becomes a validated ir.Scene."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..lang import collector, file_types, foreign_formats
from ..lang.diagnostics import Diagnostics, Span, suggest
from ..lang.eval import evaluator
from ..lang.input_error import InputError
from . import ir
from .catalogue import CATALOGUE
from .importers.common.mesh_options import MeshOptions
from .importers.stage_options import StageOptions
from .io import color_config, source_files
from .io.sandbox import Files, open_main
from .lower import lowering
from .mesh import built_geometry
from .plan import camera_view, coincident_faces, enclosed_lights, scene_extent
from .scene import defaults, motion_keys, serialize, texture_coordinates, transforms, validate
from .scene.builder import SceneBuilder
from .scene.row_records import InstanceData


@collector.fewer_collections()
def load(
    path: Path | str,
    *,
    sets: Mapping[str, str] | None = None,
    time: float | None = None,
    code: float | None = None,
    allow: Sequence[Path | str] = (),
    stage: StageOptions | None = None,
    mesh: MeshOptions | None = None,
    max_elements: int | None = None,
    diagnostics: Diagnostics | None = None,
    seconds: dict[str, float] | None = None,
) -> ir.Scene:
    """The scene in a file, validated: no backend will raise on it.

    `sets` are values of params as text; `time` is in seconds (None: the file's own default, 0 in a .scene); `code` is a USD
    stage's time code, in place of `time`; `allow` are folders the scene may read beside its own; `stage` and `mesh` are the
    options of USD stages and of meshes; `max_elements` limits what a .scene makes (None: 2 million).
    Warnings are added to `diagnostics`, the time each stage took to `seconds`. Raises SceneError with everything found.
    """
    messages = diagnostics if diagnostics is not None else Diagnostics()
    watch = Stopwatch(seconds)
    path = Path(path)
    suffix = path.suffix.lower()
    scene = None
    try:
        files, real = open_main(path, allow, "scene" if suffix in file_types.SCENE else "file")
        files.colors = color_config.of_pictures()
        options, meshes = stage or StageOptions(), mesh or MeshOptions()
        _refuse_unused(suffix, str(path), sets, (time, code), options, meshes, messages)
        if max_elements is not None and suffix not in file_types.SCENE:
            messages.error("only .scene files make elements", Span(str(path)), "leave out --max-elements")
        if suffix in file_types.SCENE:
            evaluate = partial(_scene, path, real, files, sets or {}, (max_elements, meshes.deviation), watch)
            start = time or 0.0
            scene = evaluate(start, messages)
            scene = _blurred(scene, lambda later, messages: evaluate(start + later, messages), messages)
        elif suffix in file_types.USD:
            scene = _stage(path, files, (time, code), options, messages, watch)
            scene = _blurred(scene, lambda later, messages: _stage(path, files, (time, code), options, messages, watch, later), messages)
        elif suffix in file_types.MESH:
            scene = _mesh(path, real, files, time, meshes, messages, watch)
        elif suffix in file_types.SAVED:
            with watch.stage("import"):
                scene = serialize.load(path)
        else:
            _refuse_unknown(path, messages)
    except InputError as failure:
        messages.error(failure.message, Span(str(path)), failure.hint)
    messages.raise_if_failed()
    assert scene is not None
    with watch.stage("validate"):
        scene, _ = validate.validate(scene, messages)
    messages.raise_if_failed()
    enclosed_lights.warn_of_enclosed_lights(scene, messages)
    camera_view.warn_of_cameras(scene, messages, not built_geometry.is_left_out())
    coincident_faces.warn_of_coincident_faces(scene, messages)
    texture_coordinates.warn_of_missing_coordinates(scene, messages)
    return scene


def load_with_colors(ocio: str | None, path: Path | str, **options: Any) -> ir.Scene:
    """As `load`, with a configuration of OpenColorIO whose colour spaces pictures may be of; None: that of the environment, if any."""
    with color_config.used_by_pictures(ocio):
        return load(path, **options)


def _refuse_unknown(path: Path, diagnostics: Diagnostics) -> None:
    """Report a file of another format, with the program that writes one that is read."""
    endings = (*file_types.SCENE, *file_types.USD, *file_types.MESH, *file_types.SAVED)
    advice = foreign_formats.advice(path.name)
    hint = advice or suggest(path.suffix.lower(), endings) or f"scenes are {', '.join(endings)}"
    diagnostics.error(f"`{path.name}` is not a known kind of scene", Span(str(path)), hint)


def _blurred(scene: ir.Scene, scene_at: Callable[[float, Diagnostics], ir.Scene], diagnostics: Diagnostics) -> ir.Scene:
    """The scene with motion keys over its cameras' shutters; `scene_at` compiles it a number of seconds later."""
    if diagnostics.failed or motion_keys.shutters(scene) == (0.0, 0.0):
        return scene

    def later(seconds: float) -> ir.Scene | None:
        messages = Diagnostics()
        moved = scene_at(seconds, messages)
        if messages.failed:
            message = f"{seconds:.4g} s later, while the shutter is open, the scene has errors: it is drawn as at the opening"
            diagnostics.warning(message, Span(scene.name))
            return None
        return moved

    return motion_keys.add_motion(scene, later, diagnostics)


class Stopwatch:
    """Adds the seconds of stages to a dict, if any."""

    def move(self, stage: str, part: str, seconds: float) -> None:
        """Count the seconds of a part of a stage separately."""
        if self._seconds is not None:
            self._seconds[stage] -= seconds
            self._seconds[part] = self._seconds.get(part, 0.0) + seconds

    def __init__(self, seconds: dict[str, float] | None) -> None:
        self._seconds = seconds

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        started = clock.perf_counter()
        try:
            yield
        finally:
            if self._seconds is not None:
                self._seconds[name] = self._seconds.get(name, 0.0) + clock.perf_counter() - started


def _scene(
    path: Path, real: Path, files: Files, sets: Mapping[str, str], limits: tuple[int | None, float | None], watch: Stopwatch, time: float,
    diagnostics: Diagnostics,
) -> ir.Scene:  # fmt: skip
    reader = source_files.SceneReader(files)
    parsing: dict[str, float] = {}
    with watch.stage("evaluate"):
        source = reader.main(str(path), real)
        document = evaluator.evaluate(source, CATALOGUE, reader, diagnostics, sets=sets, time=time, max_elements=limits[0], seconds=parsing)
    watch.move("evaluate", "parse", parsing["parse"])
    with watch.stage("lower"):
        builder = SceneBuilder(diagnostics, files)
        builder.deviation = limits[1]
        scene = lowering.lower(document, builder, reader.folder)
    if not diagnostics.failed and not document.names_length:
        scene_extent.warn_of_large_scene(scene, diagnostics)
    return scene


def _stage(
    path: Path, files: Files, moment: tuple[float | None, float | None], options: StageOptions, diagnostics: Diagnostics, watch: Stopwatch,
    later: float = 0.0,
) -> ir.Scene:  # fmt: skip
    with watch.stage("import"), np.errstate(all="ignore"):
        from .importers.usd import load as usd_load

        return usd_load.scene(path, SceneBuilder(diagnostics, files), time=moment[0], code=moment[1], options=options, later=later)


def _mesh(
    path: Path, real: Path, files: Files, time: float | None, options: MeshOptions, diagnostics: Diagnostics, watch: Stopwatch
) -> ir.Scene:  # fmt: skip
    """A bare mesh file: its own materials or grey; the lights and cameras of a glTF file, else the default ones."""
    builder = SceneBuilder(diagnostics, files)
    with watch.stage("import"), np.errstate(all="ignore"):
        from .importers import mesh_files

        parts = mesh_files.read(real, str(path), builder, diagnostics, None, files, as_scene=True, time=time, options=options)
    with watch.stage("lower"):
        for part in parts:
            span = Span(f"{path}<{part.name[:80]}>" if part.name else str(path))
            row = builder.transform(transforms.identity() if part.transform is None else part.transform, span)
            material = -1 if part.material is None else part.material
            builder.instance(InstanceData(part.geometry, row, material, name=part.name), Span(str(path)))
        photometric = builder.count("lights") > 0  # glTF has candela and lux
        sentences = defaults.add(builder, ir.Settings())
        return builder.finish(str(path), defaults=sentences, files=files.read, photometric=photometric, duration=builder.duration)


def _refuse_unused(
    suffix: str, name: str, sets: Mapping[str, str] | None, moment: tuple[float | None, float | None],
    options: StageOptions, meshes: MeshOptions, diagnostics: Diagnostics,
) -> None:  # fmt: skip
    """Report settings that this kind of file does not support."""
    time, code = moment
    if options.variants and suffix not in file_types.USD:
        diagnostics.error("only USD stages have variants", Span(name), "leave out --variant")
    if suffix not in file_types.USD:
        for option in options.option_names():
            diagnostics.error(f"only USD stages have {option.replace('-', ' ')}", Span(name), f"leave out --{option}")
    if code is not None and suffix not in file_types.USD:
        diagnostics.error("only USD stages have time codes", Span(name), "give the time in seconds")
    if suffix not in file_types.SCENE:
        for param in sets or {}:
            diagnostics.error(f"there is no param `{param}`: only .scene files have params", Span(name), "leave out --set")
    for option in meshes.option_names():
        endings = file_types.ANIMATED if option == "animation" else file_types.MESH
        if suffix not in endings:
            which = "glTF files have animations with names" if option == "animation" else f"mesh files take --{option}"
            diagnostics.error(f"only {which}", Span(name), f"leave out --{option}")
    if time and suffix not in (*file_types.SCENE, *file_types.USD, *file_types.ANIMATED):
        diagnostics.error("nothing moves in this kind of file: it has no time", Span(name), "leave out --time")
