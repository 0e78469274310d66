"""The scene that `maquette.load` returns: a compiled scene with the methods of an object in Python."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from ..compiler import ir
from ..compiler.plan import plan as planner
from . import render_scene
from .image.image import Image


class Scene(ir.Scene):
    """A compiled scene. `render` draws it; its tables and names are those of ir.Scene."""

    @classmethod
    def of(cls, scene: ir.Scene) -> Scene:
        """The same scene."""
        return scene if isinstance(scene, cls) else cls(**{field.name: getattr(scene, field.name) for field in fields(ir.Scene)})

    def render(self, *, plan: Mapping[str, str] | None = None, **settings: Any) -> Image:
        """Draw the scene.

        `settings` are the fields of ir.Settings: size=(800, 600), backend="ray", samples=16, error=0.01, aov=("depth",) and so on;
        they go before the scene's own. `plan` overrides decisions by name. The Image holds float32 linear channels.
        Raises planner.PlanError for settings that exclude each other.
        """
        made = planner.make_plan(self, ir.Settings(**settings), plan)
        for note in made.notes:
            warnings.warn(note, DeprecationWarning, stacklevel=3)
        return render_scene.draw(self, made)

    def show(self, **settings: Any) -> None:
        """Draw the scene and open the picture in the desktop's viewer. A notebook shows `scene.render()`; see maquette.show, too."""
        self.render(**settings).show()

    def __repr__(self) -> str:
        counts = len(self.tables.instances.geometry), len(self.tables.lights.kind), len(self.tables.cameras.projection)
        parts = [f"{count} {name}{'' if count == 1 else 's'}" for count, name in zip(counts, ("instance", "light", "camera"), strict=True)]
        return f"<Scene {self.name}, {', '.join(parts)}>"
