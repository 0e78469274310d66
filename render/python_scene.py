"""The scene that `maquette.load` returns: a compiled scene with the methods of an object in Python."""

from __future__ import annotations

import atexit
import shutil
import tempfile
import time
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar

from ..compiler import ir
from ..compiler.plan import plan as planner
from ..lang.diagnostics import Diagnostic, Diagnostics
from . import picture_notes, python_options, render_scene
from .film.deadline import Deadline
from .image.image import Image


class Scene(ir.Scene):
    """A compiled scene. `render` draws it; its tables and names are those of ir.Scene."""

    diagnostics: ClassVar[tuple[Diagnostic, ...]] = ()
    """Warnings and notes of its compilation."""

    @classmethod
    def of(cls, scene: ir.Scene, diagnostics: Iterable[Diagnostic] = ()) -> Scene:
        """The same scene, with the diagnostics of its compilation."""
        if isinstance(scene, cls):
            return scene
        wrapped = cls(**{field.name: getattr(scene, field.name) for field in fields(ir.Scene)})
        object.__setattr__(wrapped, "diagnostics", tuple(diagnostics))
        return wrapped

    def render(self, *, plan: Mapping[str, str] | None = None, diagnostics: Diagnostics | None = None, **settings: Any) -> Image:
        """Draw the scene.

        `settings` are the fields of ir.Settings: size=(800, 600), backend="ray", samples=16, error=0.01, aov=("depth",) and so on;
        they go before the scene's own. `plan` overrides decisions by name. The Image holds float32 linear channels. Its `diagnostics`
        are warnings and notes about it. They are added to those given; without some, warnings are SceneWarnings.
        Raises planner.PlanError for what this scene cannot have, ValueError for values that a setting cannot have, TypeError for
        other names.
        """
        return self.render_since((time.perf_counter(), time.process_time()), plan, diagnostics, settings)

    def render_since(
        self, began: tuple[float, float], plan: Mapping[str, str] | None, diagnostics: Diagnostics | None, settings: Mapping[str, Any]
    ) -> Image:  # fmt: skip
        """As `render`, for a call at `began`, the times of time.perf_counter and time.process_time from which a budget counts."""
        request = python_options.settings_of(self, settings)
        if plan is not None and not isinstance(plan, Mapping):
            raise TypeError(f"plan is a dict of decisions by name, not {type(plan).__name__}")
        decided = planner.make_plan(self, request, plan)
        image = render_scene.draw(self, decided, deadline=Deadline(decided["budget"], began[0], processed=began[1]))
        items = [*picture_notes.plan_warnings(self, decided), *picture_notes.of_render(image.metadata, self, decided, request)]
        items += picture_notes.late_drawing_warnings(image.metadata, decided)
        image.metadata["diagnostics"] = tuple(items)
        if diagnostics is None:
            python_options.warn(items, 3)
        else:
            diagnostics.items += items
        return image

    def show(self, **settings: Any) -> None:
        """Draw the scene and open the picture in the desktop's viewer. A notebook shows `scene.render()`; see maquette.show, too."""
        self.render(**settings).show()

    def to_usd(
        self, folder: str | Path | None = None, *, deviation: float | None = None, diagnostics: Diagnostics | None = None, **settings: Any
    ) -> Any:  # fmt: skip
        """The scene as a pxr.Usd.Stage in memory: that of `maquette convert`, with the camera and the size of `settings`.

        Its pictures are written into `folder`, by default one that is removed when Python ends. The stage names them by their full paths.
        `deviation` is the greatest distance of triangles from surfaces in metres. What USD lacks is added to `diagnostics`; without some,
        losses are SceneWarnings. Raises what `render` raises, and OSError for a folder that cannot be written.
        """
        from pxr import UsdUtils

        from ..compiler.exporters.usd.scene import stage_of
        from ..compiler.io.replace_file import replace_file
        from .tessellation.scene_meshes import make_converters

        plan = planner.make_plan(self, python_options.settings_of(self, settings))
        out, stage = stage_of(self, plan, Path(self.name).stem, make_converters(self, deviation))
        if out.files:
            place = Path(_pictures() if folder is None else folder).absolute()
            for name, data in out.files.items():
                replace_file(place / name, data)
            modify: Any = UsdUtils.ModifyAssetPaths  # pyright: ignore[reportAttributeAccessIssue]
            modify(stage.GetRootLayer(), lambda path: str(place / path[2:]) if path.startswith("./") else path)
        if diagnostics is None:
            python_options.warn(out.diagnostics, 2)
        else:
            diagnostics.items += out.diagnostics
        return stage

    def __repr__(self) -> str:
        counts = len(self.tables.instances.geometry), len(self.tables.lights.kind), len(self.tables.cameras.projection)
        parts = [f"{count} {name}{'' if count == 1 else 's'}" for count, name in zip(counts, ("instance", "light", "camera"), strict=True)]
        return f"<Scene {self.name}, {', '.join(parts)}>"


def _pictures() -> str:
    """A folder for the pictures of a stage, removed when Python ends."""
    folder = tempfile.mkdtemp(prefix="maquette-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
