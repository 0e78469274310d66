"""Writer of a scene as readable source: materials and parts by name, objects in groups, lights, cameras and settings.

Numbers are short: the same in single precision. Meshes and pictures are in the folder `NAME.parts` beside the file.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ....lang.syntax import formatter
from ....materials import traits
from ....materials.contract import Lobes
from ... import ir
from ...ir.single_sided import SINGLE_SIDED
from ...scene.row_records import ALL_RAYS
from .. import placement
from ..export import Export
from ..export_job import ExportJob
from . import cameras, outline, words
from .files import Files
from .lights import Lights
from .materials import Materials, medium_arguments
from .outline import Item
from .places import Place, place
from .shapes import Shapes
from .textures import Textures


def export(job: ExportJob) -> Export:
    """The scene as a text, and its meshes and pictures."""
    out = Export(job.scene)
    writer = _Writer(job, out)
    out.text = formatter.lay_out(writer.text())
    return out


class _Writer:
    def __init__(self, job: ExportJob, out: Export) -> None:
        self.job, self.out, self.tables = job, out, job.scene.tables
        self.converters = job.converters()
        self.files = Files(out, job.output)
        photometric = job.scene.photometric
        self.textures = Textures(out, self.files, self.converters.png)
        self.materials = Materials(out, self.files, self.textures, photometric)
        self.shapes = Shapes(out, self.files, self.converters.tessellate)
        self.lights = Lights(out, self.textures, photometric)
        self._parts: dict[str, str] = {}  # names of shapes that several objects are
        self._lets: list[str] = []

    def text(self) -> str:
        objects = list(outline.statements(list(self._items())))
        lights = [self.lights.text(row) for row in self._own_lights()]
        if not lights and not (self.tables.lights.instance >= 0).any() and not self._is_lit():
            lights = ["sky(luminance: 0)  // no light but what emits"]
        scene = self.job.scene
        size = self.job.plan["size"]
        moves = self._tell_motion()
        order = sorted(range(len(self.tables.cameras.projection)), key=lambda row: row != self.job.plan["camera"])
        seen = [cameras.camera(self.out, row, size, moves) for row in order]
        settings = [cameras.render(self.out, self.job.settings.over(scene.settings), size)]
        fog = [self._fog(int(row)) for row in np.flatnonzero(self.tables.media.everywhere)]
        blocks = (
            ("", [f"// {scene.name.rsplit('/', 1)[-1]}, as maquette convert wrote it."]),
            ("Textures", self.textures.lets), ("Materials", self.materials.lets), ("Parts", self._lets), ("Objects", objects),
            ("Lights", [*lights, *fog]), ("Picture", [*seen, *settings]),
        )  # fmt: skip
        return "\n\n".join("\n".join([f"// {title}"] * bool(title) + lines) for title, lines in blocks if lines) + "\n"

    def _is_lit(self) -> bool:
        """Whether a scene without lights gets none by default: what emits lights it by bounces that are asked for."""
        m, used = self.tables.materials, self.tables.instances.material
        emits = bool((m.values[used, ir.Slot.EMISSION] > 0.0).any())
        return emits and (self.job.settings.over(self.job.scene.settings).bounces or 0) > 0

    def _tell_motion(self) -> bool:
        """Report what moves. Returns whether anything does."""
        moves = bool(len(self.tables.keys.move))
        if moves or self.job.scene.duration is not None:
            self.out.cannot("motion is not carried: everything stands as at the scene's time")
        return moves

    # --- objects ---

    def _items(self) -> Iterator[Item]:
        instances = self.tables.instances
        counts = np.bincount(instances.geometry, minlength=len(self.tables.geometries.kind))
        for i in range(len(instances.geometry)):
            path, copy = self._path(i)
            if instances.light[i] >= 0:
                yield from self._shining(i, path)
                continue
            self._tell_visibility(i)
            matrix = placement.world(self.tables, i)
            g, row = int(instances.geometry[i]), int(instances.material[i])
            where, flags = place(matrix), bool(instances.visible[i] & SINGLE_SIDED)
            source = path[-1] or ir.GeometryKind(int(self.tables.geometries.kind[g])).name.lower()
            if traits.has(self.tables, Lobes.PARTS)[row] and not self.shapes.is_exact(g):
                yield from self._split(i, row, path, where, source)
                continue
            call = self.shapes.text(i, source, flags)
            if call is None:
                continue
            if counts[g] > 1 and call.startswith("mesh("):
                names = self.out.scene.names.geometries
                call = self._part(call, (names[g] if g < len(names) else "") or source)
            yield Item(path, call, where, self.materials.name(row, source), self.materials.medium(row), copy=copy)

    def _path(self, i: int) -> tuple[tuple[str, ...], bool]:
        """The parts of the name of an instance, and whether it is a copy with a number."""
        names = self.out.scene.names.instances
        name, copy = outline.written_name(names[i] if i < len(names) else "")
        return tuple(name.split("/")), copy

    def _tell_visibility(self, i: int) -> None:
        instances = self.tables.instances
        if instances.visible[i] & ALL_RAYS != ALL_RAYS and not self.out.boundaries[instances.material[i]]:
            self.out.cannot("this shows in some rays only, and is carried for all", "instances", i)

    def _part(self, call: str, source: str) -> str:
        """The call of a part by its name."""
        if call not in self._parts:
            self._parts[call] = self.files.identifiers.new(source, "part")
            self._lets.append(f"let {self._parts[call]}() = {call}")
        return f"{self._parts[call]}()"

    def _split(self, i: int, row: int, path: tuple[str, ...], where: Place, source: str) -> Iterator[Item]:
        """A solid whose parts have materials: triangles by material."""
        if self.out.is_endless(i):
            return
        matrix = placement.world(self.tables, i)
        positions, triangles, *_ = self.converters.tessellate(i)
        if not len(triangles):
            self.out.cannot("this has no surface, or is thinner than the cells in which it is sampled: left out", "instances", i)
            return
        self.out.note("of blended materials each triangle has the one that counts more", "materials", row)
        rows = self.converters.materials(self.tables, i, positions[triangles].mean(axis=1) @ matrix[:3, :3].T + matrix[:3, 3])
        for part in np.unique(rows).tolist():
            call = self.shapes.triangles(i, source, np.flatnonzero(rows == part))
            if call is not None:
                yield Item(path, call, where, self.materials.name(part, source), self.materials.medium(part))

    def _shining(self, i: int, path: tuple[str, ...]) -> Iterator[Item]:
        """The shape of an area light: the light itself."""
        row = int(self.tables.instances.light[i])
        lights = self.tables.lights
        if lights.kind[row] == ir.LightKind.SPHERE and lights.image[row] < 0 and not self.lights.is_linked(row):
            ball = words.call("sphere", words.number(float(lights.size[row, 0])))
            yield Item(path, ball, place(placement.world(self.tables, i)), self.lights.emits(row))
        else:
            yield Item(path, "", Place({}), text=self.lights.text(row))

    def _own_lights(self) -> list[int]:
        """The lights that are no instances, and shine."""
        lights = self.tables.lights
        return np.flatnonzero((lights.instance < 0) & (lights.color.max(axis=1, initial=0.0) > 0.0)).tolist()

    def _fog(self, row: int) -> str:
        media = self.tables.media
        texts = medium_arguments(self.out, row)
        texts |= {"top": words.number(float(media.top[row]))} if np.isfinite(media.top[row]) else {}
        return words.call("fog", **texts, falloff=words.number(float(media.falloff[row])))
