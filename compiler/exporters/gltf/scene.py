"""Exports a scene as a binary glTF 2.0 file (.glb): meshes, materials, cameras and KHR_lights_punctual.

Units and axes agree: metres, +y up, cameras and lights look along −z, candela and lux.
https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....lights import LIGHTS
from ....lights.contract import ExportedLight
from ... import ir
from ...plan.plan import Plan
from .. import camera_frames, placement
from ..baking.patterns import SIDE, Baked, Style, bake, bodies_of
from ..bodies import Body, Converters, compact, part_of
from ..export import Export
from ..export_job import ExportJob
from ..lights import LightFormat, exported
from ..media import without_fog
from ..placement import F64
from .container import Container
from .materials import PICTURED, TOGETHER, Materials

NEAR = 1e-3  # metres: glTF requires a near distance above 0
_PUNCTUAL = "KHR_lights_punctual"
_LIGHTS = LightFormat("glTF", skies=False, lacking="glTF has point, spot and directional lights")


def export(job: ExportJob) -> Export:
    """The file of a scene."""
    return write(job.scene, job.plan, job.converters(), job.bake)


def write(scene: ir.Scene, plan: Plan, converters: Converters, side: int = SIDE) -> Export:
    """Exports `scene`, with the camera of `plan` first. Losses are in its `diagnostics`. `side`: of the largest picture of a pattern."""
    out = Export(scene)
    out.without_links()
    without_fog(out)
    is_formula = scene.tables.textures.kind == ir.TextureKind.FORMULA
    bodies = bodies_of(out, converters, side)
    baked = bake(out, list(bodies), converters, Style(side, PICTURED, lambda texture: bool(is_formula[texture]), TOGETHER))
    _Writer(baked, converters, bodies.radius).write(plan)
    return baked.out


class _Writer:
    def __init__(self, baked: Baked, converters: Converters, radius: float) -> None:
        self.out, self.tables, self.container = baked.out, baked.out.scene.tables, Container()
        self.bodies, self._radius = baked.bodies, radius
        self.materials = Materials(self.out, self.container, converters.png, baked.coordinates)
        self.nodes: list[int] = []
        self._meshes: dict[Any, int] = {}

    def write(self, plan: Plan) -> None:
        if len(self.tables.keys.move):
            self.out.cannot("motion is not carried: everything stands as at the scene's time")
        for body in self.bodies:
            self._place({"name": body.name, "mesh": self._mesh(body)}, body.matrix)
        rows = range(len(self.tables.cameras.projection))
        for row in sorted(rows, key=lambda row: row != plan["camera"]):
            self._camera(row, plan["size"])
        rows = [row for row in self.out.lights if self.tables.lights.instance[row] < 0]  # the shapes of the others shine
        for light in exported(self.out, rows, _LIGHTS):
            self._light(light)
        self.container.document |= {"scene": 0, "scenes": [{"nodes": self.nodes}]}
        self.out.data = self.container.encode()

    def _place(self, node: dict[str, Any], matrix: F64) -> None:
        if not np.array_equal(matrix, np.eye(4)):
            node["matrix"] = matrix.T.ravel().tolist()
        self.nodes.append(self.container.add("nodes", node))

    # --- meshes ---

    def _mesh(self, body: Body) -> int:
        scale = placement.mean_scale(body.matrix)
        key = (body.key, scale)
        if key not in self._meshes:
            light = int(self.tables.instances.light[body.instance])
            radiance = self.tables.lights.color[light] if light >= 0 else None
            if radiance is not None:
                self.out.note("the shape of an area light is carried as a material that shines", "lights", light)
            primitives = [self._primitive(body, row, chosen, scale, radiance) for row, chosen in body.parts]
            self._meshes[key] = self.container.add("meshes", {"name": body.name, "primitives": primitives})
        return self._meshes[key]

    def _primitive(self, body: Body, row: int, chosen: NDArray[np.intp], scale: float, radiance: F64 | None) -> dict[str, Any]:
        written = self.materials.written(row, radiance)
        shell = part_of(body.shell, chosen)
        kind = int(self.tables.geometries.kind[self.tables.instances.geometry[body.instance]])
        shell, sets = written.sets.coordinates(self.out, shell, kind, scale)
        if written.is_turned and not sets and shell.uvs is not None:  # they are the direction of its highlights
            sets = [shell.uvs]
        shell, sets = compact(shell, sets)
        attributes = {"POSITION": self.container.floats(shell.positions, bounds=True)}
        if shell.normals is not None and self.tables.materials.shading[row] != ir.Shading.FLAT:
            length = np.linalg.norm(shell.normals, axis=1, keepdims=True)
            attributes["NORMAL"] = self.container.floats(np.where(length > 0, shell.normals / np.maximum(length, 1e-300), [0.0, 1.0, 0.0]))
        for k, values in enumerate(sets):
            attributes[f"TEXCOORD_{k}"] = self.container.floats(np.stack([values[:, 0], 1.0 - values[:, 1]], axis=1))  # v down
        if shell.colors is not None:
            attributes["COLOR_0"] = self.container.floats(np.clip(shell.colors, 0.0, 1.0))
        return {"attributes": attributes, "indices": self.container.indices(shell.triangles), "material": written.index}

    # --- cameras and lights ---

    def _camera(self, row: int, size: tuple[int, int]) -> None:
        cameras, placed = self.tables.cameras, camera_frames.placed_camera(self.out, row, size)
        if placed is None:
            return
        seen, half = placed.seen, placed.half
        camera_frames.report_planes(self.out, row)
        if seen.shift.any():
            self.out.cannot("the camera's shift is not carried", "cameras", row)
        if cameras.lens[row] > 0:
            self.out.cannot("depth of field is not carried: glTF's cameras are pinholes", "cameras", row)
        near, far = max(float(cameras.near[row]), NEAR), float(cameras.far[row])
        if seen.perspective:
            lens: dict[str, Any] = {"aspectRatio": half[0] / half[1], "yfov": 2.0 * math.atan(half[1]), "znear": near}
            if math.isfinite(far):
                lens["zfar"] = far
            camera = {"type": "perspective", "perspective": lens}
        else:
            end = far if math.isfinite(far) else near + 100.0 * self._radius
            camera = {"type": "orthographic", "orthographic": {"xmag": half[0], "ymag": half[1], "znear": near, "zfar": end}}
        self._place({"name": placed.name, "camera": self.container.add("cameras", camera)}, placed.frame)

    def _light(self, light: ExportedLight) -> None:
        strength, describe = float(light.color.max()), LIGHTS[light.kind].gltf
        if describe is None:
            self.out.cannot("an area light that is not seen is not carried", "lights", light.row)
            return
        described = describe(light)
        if described.note:
            self.out.note(described.note, "lights", light.row)
        entry: dict[str, Any] = {"name": light.name, **described.entry}
        entry |= {"color": (light.color / strength).tolist(), "intensity": strength}
        self.container.use(_PUNCTUAL)
        listed = self.container.document.setdefault("extensions", {}).setdefault(_PUNCTUAL, {"lights": []})["lights"]
        listed.append(entry)
        self._place({"name": entry["name"], "extensions": {_PUNCTUAL: {"light": len(listed) - 1}}}, placement.light_frame(light))
