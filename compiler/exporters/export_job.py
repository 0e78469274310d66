"""What an exporter gets: the scene, the file to write, and functions of the renderer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from ...lang.diagnostics import Diagnostic
from .. import ir
from ..mesh.parts import Part
from ..mesh.shells import Converters, Tessellate
from ..plan.plan import Plan


class RendererFunctions(NamedTuple):
    """Functions of the renderer that make triangles. A `deviation` is in metres; None: by the size of the scene."""

    converters: Callable[[ir.Scene, float | None], Converters]
    tessellator: Callable[[ir.Scene, Plan], Tessellate]
    parts: Callable[[ir.Scene, float | None], tuple[list[Part], list[Diagnostic]]]


@dataclass(eq=False)
class ExportJob:
    """A scene to write to `output`, whose name alone matters. The plan and the renderer are made when an exporter asks for them."""

    scene: ir.Scene
    output: Path
    deviation: float | None
    make_plan: Callable[[], Plan]
    load_renderer: Callable[[], RendererFunctions]
    settings: ir.Settings = field(default_factory=ir.Settings)  # those of the command, which precede the scene's
    bake: int = 1024  # texels of the side of the largest picture of a pattern; 0: patterns are left out

    @property
    def stem(self) -> str:
        """The name of the file without its ending."""
        return self.output.stem

    @property
    def ending(self) -> str:
        """The ending of the file in small letters."""
        return self.output.suffix.lower()

    @cached_property
    def plan(self) -> Plan:
        """The render plan: camera, size, filter and others. Raises SceneError."""
        return self.make_plan()

    def converters(self) -> Converters:
        """Triangles, materials at points and pictures, for formats that have meshes alone."""
        return self.load_renderer().converters(self.scene, self.deviation)

    def tessellator(self) -> Tessellate:
        """Triangles of single shapes that a format lacks, within pixels of the plan."""
        return self.load_renderer().tessellator(self.scene, self.plan)

    def parts(self) -> tuple[list[Part], list[Diagnostic]]:
        """The objects of the scene as triangles in the world, and diagnostics of those that are open or left out."""
        return self.load_renderer().parts(self.scene, self.deviation)
