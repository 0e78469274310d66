"""Exports a scene as a USD stage (.usda, .usdc, .usdz): meshes, UsdPreviewSurface materials, cameras and UsdLux lights.

Metres, +y up. Equal meshes are written once and referenced.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils, Vt

from ....lights import LIGHTS
from ....lights.contract import ExportedLight, Form, UsdLight
from ... import ir
from ...ir.light_links import CASTERS, EVERYTHING
from ...mesh.shells import Shell
from ...plan.plan import Plan
from .. import camera_frames, placement, texture_values
from ..baking.patterns import SIDE, Baked, Style, bake, bodies_of
from ..bodies import Body, Converters, compact, part_of
from ..export import Export
from ..export_job import ExportJob
from ..lights import LightFormat, exported
from ..material_values import CARRYING
from ..media import without_media
from ..placement import F64
from .graphs import is_graph
from .materials import PICTURED, Materials, set_name

ROOT = "/World"
MAIN_CAMERA = "main_cam"  # the name that usdrecord looks for
FOCAL = 50.0  # tenths of a metre: any focal length makes the same picture with its aperture
_TURNED = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # USD's plates shine along −z, ours along +y
_LIGHTS = LightFormat("USD")


def export(job: ExportJob) -> Export:
    """The file of a scene."""
    return write(job.scene, job.plan, job.stem, job.ending, job.converters(), job.bake)


def stage_of(scene: ir.Scene, plan: Plan, name: str, converters: Converters, side: int = SIDE) -> tuple[Export, Any]:
    """(losses, and the contents of the files that the stage names as ./file; the stage in memory). `side`: see `write`."""
    out = Export(scene)
    without_media(out, CARRYING)
    is_formula = scene.tables.textures.kind == ir.TextureKind.FORMULA

    style = Style(side, PICTURED, lambda texture: bool(is_formula[texture]), has_graph=lambda texture: is_graph(scene.tables, texture))
    baked = bake(out, list(bodies_of(out, converters, side)), converters, style)
    writer = _Writer(baked, name, converters)
    writer.write(plan)
    return baked.out, writer.stage


def write(scene: ir.Scene, plan: Plan, name: str, ending: str, converters: Converters, side: int = SIDE) -> Export:
    """Exports `scene`, with the camera of `plan` first. Pictures are called `name`.0.png and so on. Losses are in its `diagnostics`.

    `side`: texels of the side of the largest picture of a pattern.
    """
    out, stage = stage_of(scene, plan, name, converters, side)
    _encode(out, stage, name, ending)
    return out


def _encode(out: Export, stage: Any, name: str, ending: str) -> None:
    """Set the main file's content; a .usdz holds the pictures."""
    if ending == ".usda":
        out.text = stage.GetRootLayer().ExportToString()
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.usdc")
        stage.GetRootLayer().Export(str(path))
        if ending == ".usdz":
            for picture, data in out.files.items():
                (path.parent / picture).write_bytes(data)
            out.files, package = {}, path.with_suffix(".usdz")
            UsdUtils.CreateNewUsdzPackage(str(path), str(package))
            path = package
        out.data = path.read_bytes()


class _Writer:
    def __init__(self, baked: Baked, name: str, converters: Converters) -> None:
        self.out, self.tables, self.name, self.converters = baked.out, baked.out.scene.tables, name, converters
        self.stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        self.stage.SetDefaultPrim(UsdGeom.Xform.Define(self.stage, ROOT).GetPrim())
        self.bodies = baked.bodies
        self.materials = Materials(self.out, self.stage, f"{ROOT}/Materials", name, converters.png, baked)
        self._meshes: dict[Any, Any] = {}
        self._placed: dict[int, str] = {}  # paths of instances
        self._lights: dict[int, Any] = {}  # prims of lights
        self._used: dict[str, int] = {}

    def write(self, plan: Plan) -> None:
        if len(self.tables.keys.move):
            self.out.cannot("motion is not carried: everything stands as at the scene's time")
        for row in sorted(range(len(self.tables.cameras.projection)), key=lambda row: row != plan["camera"]):
            self._camera(row, plan["size"], row == plan["camera"])
        for light in exported(self.out, self.out.lights, _LIGHTS):
            self._light(light)
        for body in self.bodies:
            if self.tables.instances.light[body.instance] < 0:
                self._place(body)
        for row, prim in self._lights.items():
            self._link(row, prim)

    def _path(self, name: str) -> str:
        """A free path of a prim."""
        plain = Tf.MakeValidIdentifier(name)
        count = self._used[plain] = self._used.get(plain, 0) + 1
        return f"{ROOT}/{plain}" if count == 1 else self._path(f"{plain}_{count}")

    # --- meshes ---

    def _place(self, body: Body) -> None:
        scale, path = placement.mean_scale(body.matrix), self._path(body.name)
        key = (body.key, scale)
        if key in self._meshes:
            prim = self.stage.DefinePrim(path)
            prim.GetReferences().AddInternalReference(self._meshes[key])
        else:
            prim = self._mesh(path, body, scale)
            self._meshes[key] = path
        self._placed[body.instance] = path
        if path != f"{ROOT}/{body.name}":
            prim.SetDisplayName(body.name)
        transform = UsdGeom.Xformable(prim)
        transform.ClearXformOpOrder()
        transform.MakeMatrixXform().Set(Gf.Matrix4d(body.matrix.T.tolist()))

    def _mesh(self, path: str, body: Body, scale: float) -> Any:
        kind = int(self.tables.geometries.kind[self.tables.instances.geometry[body.instance]])
        if len(body.parts) > 1:
            parent = UsdGeom.Xform.Define(self.stage, path).GetPrim()
            for number, (row, chosen) in enumerate(body.parts):
                self._part(f"{path}/part{number}", row, part_of(body.shell, chosen), kind, scale)
            return parent
        return self._part(path, body.parts[0][0], body.shell, kind, scale)

    def _part(self, path: str, row: int, shell: Shell, kind: int, scale: float) -> Any:
        """One mesh with one material."""
        written = self.materials.written(row, shell.colors is not None)
        shell, sets = compact(*written.sets.coordinates(self.out, shell, kind, scale))
        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        mesh.CreatePointsAttr(_vectors(shell.positions))
        mesh.CreateExtentAttr(_vectors(np.stack([shell.positions.min(axis=0), shell.positions.max(axis=0)])))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(shell.triangles), 3))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(shell.triangles.ravel(), np.int32)))
        shares = UsdGeom.PrimvarsAPI(mesh)
        if shell.normals is not None and self.tables.materials.shading[row] != ir.Shading.FLAT:
            mesh.CreateNormalsAttr(_vectors(shell.normals))
            mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        else:
            mesh.CreateNormalsAttr(_vectors(_face_normals(shell)))
            mesh.SetNormalsInterpolation(UsdGeom.Tokens.uniform)
        for number, values in enumerate(sets):
            coordinates = shares.CreatePrimvar(set_name(number), Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
            coordinates.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(values, np.float32)))
        if shell.colors is not None:
            tint = (1.0, 1.0, 1.0) if written.tint is None else written.tint
            mesh.CreateDisplayColorAttr(_vectors(shell.colors * tint))
            UsdGeom.Primvar(mesh.GetDisplayColorAttr()).SetInterpolation(UsdGeom.Tokens.vertex)
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(written.material)
        return mesh.GetPrim()

    # --- cameras and lights ---

    def _camera(self, row: int, size: tuple[int, int], main: bool) -> None:
        cameras, placed = self.tables.cameras, camera_frames.placed_camera(self.out, row, size)
        if placed is None:
            return
        seen, name = placed.seen, placed.name
        camera = UsdGeom.Camera.Define(self.stage, self._path(MAIN_CAMERA if main else name))
        if main and name != "camera":
            camera.GetPrim().SetDisplayName(name)
        aperture = 2.0 * np.array(placed.half) * (FOCAL if seen.perspective else 10.0)
        camera.CreateProjectionAttr(UsdGeom.Tokens.perspective if seen.perspective else UsdGeom.Tokens.orthographic)
        camera.CreateFocalLengthAttr(FOCAL)
        camera.CreateHorizontalApertureAttr(float(aperture[0]))
        camera.CreateVerticalApertureAttr(float(aperture[1]))
        camera.CreateHorizontalApertureOffsetAttr(float(0.5 * seen.shift[0] * aperture[0]))
        camera.CreateVerticalApertureOffsetAttr(float(0.5 * seen.shift[1] * aperture[1]))
        near, far = max(float(cameras.near[row]), 1e-3), float(cameras.far[row])
        camera.CreateClippingRangeAttr(Gf.Vec2f(near, far if math.isfinite(far) else 1e6))
        if cameras.lens[row] > 0:
            camera.CreateFStopAttr(0.1 * FOCAL / (2.0 * float(cameras.lens[row])))
            camera.CreateFocusDistanceAttr(float(cameras.focus[row]))
        if planes := [Gf.Vec4f(*plane.tolist()) for plane in cameras.planes[row] if plane.any()]:
            camera.CreateClippingPlanesAttr(planes)
        camera.MakeMatrixXform().Set(Gf.Matrix4d(placed.frame.T.tolist()))

    def _light(self, light: ExportedLight) -> None:
        row, strength = light.row, float(light.color.max())
        describe = LIGHTS[light.kind].usd
        if describe is None:
            self.out.cannot(f"a {light.kind.name.lower()} light is not carried: USD has none", "lights", row)
            return
        path = self._path(light.name.strip("/").replace("/", "_"))
        prim, factor, frame = self._define_light(path, light, describe)
        prim.CreateIntensityAttr(strength * factor)
        prim.CreateColorAttr(Gf.Vec3f(*(light.color / strength).tolist()))
        if not self.tables.lights.shadows[row]:
            UsdLux.ShadowAPI.Apply(prim.GetPrim()).CreateShadowEnableAttr(False)
        prim.MakeMatrixXform().Set(Gf.Matrix4d(frame.T.tolist()))
        self._lights[row] = prim.GetPrim()

    def _link(self, row: int, prim: Any) -> None:
        """Light and shadow links, as collections of the paths of the instances."""
        lights, visible = self.tables.lights, self.tables.instances.visible
        for name, mask, every in (("lightLink", lights.receivers[row], EVERYTHING), ("shadowLink", lights.blockers[row], CASTERS)):
            if mask != every:
                collection = Usd.CollectionAPI(prim, name)
                collection.CreateIncludeRootAttr(False)
                members = np.flatnonzero(visible & mask != 0).tolist()
                collection.CreateIncludesRel().SetTargets([self._placed[i] for i in members if i in self._placed])

    def _define_light(self, path: str, light: ExportedLight, describe: Callable[[ExportedLight], UsdLight]) -> tuple[Any, float, F64]:
        """(the light, its intensity over our color, its frame)"""
        kind, lights, row = LIGHTS[light.kind], self.tables.lights, light.row
        described = describe(light)
        if described.loss:
            self.out.cannot(described.loss, "lights", row)
        schema, frame = getattr(UsdLux, described.prim).Define(self.stage, path), placement.light_frame(light)
        for name, value in described.attributes.items():
            getattr(schema, f"Create{name}Attr")(value)
        if described.shaping:
            shaping = UsdLux.ShapingAPI.Apply(schema.GetPrim())
            for name, value in described.shaping.items():
                getattr(shaping, f"Create{name}Attr")(value)
        if kind.FORM == Form.SKY:
            if lights.image[row] < 0:
                return schema, described.intensity, np.eye(4)
            name = f"{self.name}.{len(self.out.files)}.exr"
            self.out.files[name] = self.converters.exr(texture_values.pixels(self.tables.images, int(lights.image[row]))[..., :3])
            schema.CreateTextureFileAttr(f"./{name}")
            schema.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
        if lights.instance[row] >= 0:
            self.out.cannot("the shape of an area light is not carried: USD's lights light what is there, and are not seen", "lights", row)
        if kind.FORM in (Form.RECTANGLE, Form.DISK):
            frame[:3, :3] = frame[:3, :3] @ _TURNED
        return schema, described.intensity, frame


def _vectors(values: F64) -> Any:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))


def _face_normals(shell: Shell) -> F64:
    a, b, c = (shell.positions[shell.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
