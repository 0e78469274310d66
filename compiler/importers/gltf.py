"""Reads glTF 2.0 files: meshes, nodes, EXT_mesh_gpu_instancing, lights, cameras and materials.

Format: glTF 2.0 (Khronos, ISO/IEC 12113:2022), sections named in the functions. Unsupported features are reported by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ...lang.elements import Quaternion
from .. import ir
from ..mesh import polygon_mesh, strands
from ..mesh.polygon_mesh import PolyMesh
from ..scene import transforms
from ..scene.builder import SceneBuilder
from ..scene.row_records import WHITE, CameraData, LightData, MeshAttribute, as_color, nonnegative, scale_color
from . import gltf_animation, gltf_draco, gltf_materials, gltf_tables, gltf_tangents
from .common import point_clouds, uv_sets, vertex_numbers
from .common.mesh_parts import MeshFile, Part, add
from .gltf_container import Container, Rows, check_finite, open_container
from .gltf_errors import GltfError

__all__ = ["GltfError", "parts"]

POINTS, LINES, LOOP, TRIANGLES, STRIP, FAN = 0, 1, 2, 4, 5, 6
WRONG = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError)  # of a document that contradicts itself
_T = TypeVar("_T")
MAX_NODES = 200_000


def parts(file: MeshFile) -> list[Part]:
    """The parts of a glTF scene: one for each primitive of each visible mesh node; nodes share geometries.

    Nodes stand where the first animation, or that of the options, has them at the file's time; without both, where the file places them.
    With `as_scene`, the builder gets lights, cameras and the duration of the animation; else they are reported as left out.
    Raises GltfError if nothing can be drawn.
    """
    options = file.options
    if options is not None and (options.unit or options.up):
        file.diagnostics.error("a glTF file is in metres with y up", file.import_span, "leave out unit and up; scale or rotate it")
        return []
    moment = file.time, None if options is None else options.animation
    container = open_container(file.data, file.folder, file.files)
    reader = _Reader(container, file.name, file.builder, file.diagnostics, file.as_scene, file.repaired, moment=moment)
    try:
        return reader.parts()
    except WRONG as failure:
        raise GltfError(f"the glTF file contradicts itself ({type(failure).__name__}: {failure})") from None
    finally:
        for message in container.warnings:
            reader.warn(message)


@dataclass(slots=True)
class _Reader:
    container: Container
    name: str
    builder: SceneBuilder
    diagnostics: Diagnostics
    as_scene: bool
    repaired: Callable[..., Any]  # MeshFile.repaired
    alone: bool = True  # whether the mesh has one primitive: holes between several are not filled
    moment: tuple[float | None, str | None] = (None, None)
    warned: set[str] = field(default_factory=set)
    meshes: dict[Any, list[Part]] = field(default_factory=dict)
    globals: dict[int, np.ndarray] = field(default_factory=dict)  # of all nodes of the scene
    materials: gltf_materials.Materials = field(init=False)

    def __post_init__(self) -> None:
        self.materials = gltf_materials.Materials(self.container, self.name, self.builder, self.warn)

    def parts(self) -> list[Part]:
        document = self.container.document
        for message in self.container.warnings:
            self.warn(message)
        gltf_tables.report(document, self.warn)
        document["nodes"] = self.animated()
        placed: list[Part] = []
        nodes = list(self.nodes())
        self.globals = {index: matrix for index, _, matrix, _ in nodes}
        for index, node, matrix, visible in nodes:
            if not visible:
                continue
            if "mesh" in node:
                placed += self.attempt(f"the mesh of node {index}", lambda n=node, m=matrix: self.shown(n, m), [])
            light = node.get("extensions", {}).get("KHR_lights_punctual", {}).get("light")
            if light is not None:
                self.attempt(f"the light of node {index}", lambda k=light, n=node, m=matrix: self.light(k, n, m), None)
            if "camera" in node:
                self.attempt(f"the camera of node {index}", lambda n=node, m=matrix: self.camera(n, m), None)
        if not placed and not self.diagnostics.failed:
            raise GltfError("the glTF file shows no mesh")
        return placed

    def animated(self) -> list[dict[str, Any]]:
        """The nodes at the moment; as they are without one. Raises GltfError for an animation that the file lacks."""
        (time, name), nodes = self.moment, Rows(dict(node) for node in self.container.document.get("nodes", ()))
        animation = gltf_animation.chosen(self.container, name)
        if animation is None:
            return nodes
        length = self.attempt("the length of the animation", lambda: gltf_animation.duration(self.container, animation), 0.0)
        if self.as_scene and 0.0 < length < math.inf:
            self.builder.duration = length
        if time is None and name is None:
            self.warn(gltf_animation.unused(self.container, length, self.as_scene))
            return nodes
        if name is None:
            self.warn_of_others()
        return self.attempt("the animation", lambda: gltf_animation.animated(self.container, animation, time or 0.0, self.warn), nodes)

    def warn_of_others(self) -> None:
        """Tell of the animations beside the first, which is drawn."""
        names = gltf_animation.names(self.container)
        if len(names) > 1:
            others = ", ".join(f"`{name}`" for name in names[1:6]) + (", …" if len(names) > 6 else "")
            self.warn(f"only the first of {len(names)} animations, `{names[0]}`, is drawn: --animation takes another ({others})")

    def attempt(self, what: str, make: Callable[[], _T], otherwise: _T) -> _T:
        """The result of `make`; `otherwise`, with a warning, where the file contradicts itself."""
        try:
            return make()
        except GltfError as failure:
            self.warn(f"{what} is left out: {failure}")
        except WRONG as failure:
            self.warn(f"{what} is left out: the glTF file contradicts itself ({type(failure).__name__}: {failure})")
        return otherwise

    def shown(self, node: dict[str, Any], matrix: np.ndarray) -> list[Part]:
        """The parts of a node's mesh at all its places."""
        title, skin = node.get("name") or "", None
        if "skin" in node:
            skin = self.attempt("a skin", lambda: gltf_animation.Skin.from_node(self.container, node, self.globals), None)
        places = self.places(node, matrix) if skin is None else [transforms.identity()]
        return [replace(p, name=title or p.name, transform=place[:3]) for place in places for p in self.mesh(node, skin)]

    def nodes(self) -> Iterator[tuple[int, dict[str, Any], np.ndarray, bool]]:
        """The nodes of the scene: (row, node, (4, 4) matrix to world, whether visible)."""
        document = self.container.document
        scenes = document.get("scenes") or [{"nodes": list(range(len(document.get("nodes", ()))))}]
        scene = self.attempt("the default scene", lambda: scenes[document.get("scene", 0)], scenes[0])
        waiting = [(n, transforms.identity(), True) for n in reversed(scene.get("nodes", ()))]
        most = min(MAX_NODES, len(waiting) + sum(len(node.get("children", ())) for node in document.get("nodes", ())))
        seen = 0
        while waiting:
            index, above, visible = waiting.pop()
            seen += 1
            if seen > most:
                why = f"the glTF file has more than {MAX_NODES:,} nodes" if seen > MAX_NODES else "the glTF file's nodes contain each other"
                self.warn(f"{why}: the rest is left out")
                return
            node = self.attempt(f"node {index}", lambda i=index: document["nodes"][i], {})
            visible = visible and node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True) is not False
            matrix = above @ self.attempt(f"the transform of node {index}", lambda n=node: _local(n), transforms.identity())
            yield index, node, matrix, visible
            waiting += [(child, matrix, visible) for child in reversed(node.get("children", ()))]

    def warn(self, message: str) -> None:
        if message not in self.warned:
            self.warned.add(message)
            self.diagnostics.warning(message, Span(self.name))

    # --- meshes ---

    def places(self, node: dict[str, Any], matrix: np.ndarray) -> list[np.ndarray]:
        """Matrices of a node's mesh: the node's own, or one for each EXT_mesh_gpu_instancing instance."""
        attributes = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes")
        if not attributes:
            return [matrix]
        columns = {key: self.container.accessor(index) for key, index in attributes.items()}
        count = min(len(column) for column in columns.values())

        def row(name: str, k: int) -> list[float] | None:
            return [float(v) for v in columns[name][k]] if name in columns else None

        return [
            matrix @ _local({"translation": row("TRANSLATION", k), "rotation": row("ROTATION", k), "scale": row("SCALE", k)})
            for k in range(count)
        ]

    def mesh(self, node: dict[str, Any], skin: gltf_animation.Skin | None) -> list[Part]:
        """The parts of a node's mesh; nodes with the same mesh, morph weights and skin share them."""
        index = node["mesh"]
        mesh = self.container.document["meshes"][index]
        weights = tuple(map(float, node.get("weights") or mesh.get("weights") or ()))
        key = (index, weights, None if skin is None else skin.joints.tobytes())
        if key not in self.meshes:
            name, parts = mesh.get("name") or f"mesh {index}", []
            self.alone = len(mesh["primitives"]) == 1
            for k, p in enumerate(mesh["primitives"]):
                parts += self.attempt(f"primitive {k} of `{name}`", lambda p=p: self.primitive(p, name, weights, skin), [])
            self.meshes[key] = parts
        return self.meshes[key]

    def primitive(self, primitive: dict[str, Any], name: str, weights: tuple[float, ...], skin: gltf_animation.Skin | None) -> list[Part]:
        """One primitive (§3.7.2), morphed and skinned; several parts if its pictures read several sets of texture coordinates."""
        if not self.decompressed(primitive):
            return []
        if (mode := primitive.get("mode", TRIANGLES)) not in range(FAN + 1):
            raise GltfError(f"there is no mode {str(mode)[:40]}: 0 to {FAN} are points, lines and triangles")
        if mode not in (TRIANGLES, STRIP, FAN):
            return self.thin(primitive, name, weights)
        material: int | None = primitive.get("material")
        sets: list[int] = []
        if material is not None:
            uv_names = self.attempt(f"material {material}", lambda m=material: self.materials.uv_sets(m), None)
            sets, material = uv_names or [], None if uv_names is None else material
        uv_name = f"TEXCOORD_{sets[0] if sets else 0}"
        attributes = primitive["attributes"]
        accessor = self.container.accessor
        points = gltf_animation.morphed(self.container, primitive, "POSITION", weights).astype(np.float64)
        triangles = self.triangles(primitive, points, name)
        columns = {key: accessor(attributes[key])[: len(points)] for key in (uv_name, "COLOR_0") if key in attributes}
        if "NORMAL" in attributes:
            columns["NORMAL"] = gltf_animation.morphed(self.container, primitive, "NORMAL", weights)[: len(points)]
        for key in [key for key, values in columns.items() if len(values) < len(points)]:
            self.warn(f"`{key}` of `{name}` has {len(columns.pop(key))} values for {len(points)} vertices: it is left out")
        uvs, colors = columns.get(uv_name), columns.get("COLOR_0")
        if "TANGENT" in attributes and uvs is not None and material is not None and self.materials.has_normal_map(material):
            tangents = accessor(attributes["TANGENT"])[: len(points)]
            if len(tangents) == len(points) and gltf_tangents.differ(points, triangles, uvs, tangents):
                self.warn(f"the tangents of `{name}` differ from those of its texture coordinates, in which its normal map is drawn")
        mesh = PolyMesh(
            points, np.full(len(triangles), 3), triangles.reshape(-1),
            MeshAttribute(columns["NORMAL"]) if "NORMAL" in columns else None,
            None if uvs is None else MeshAttribute(_upward(uvs)),
            MeshAttribute(colors[:, :3]) if colors is not None else None,
            None if "NORMAL" in columns else np.zeros(len(triangles), np.int64),  # §3.7.2.1: flat faces
        )  # fmt: skip
        if skin is not None:
            mesh = skin.deform(mesh, self.container, attributes, self.warn)
        parts: Iterable[tuple[PolyMesh, gltf_materials.Fit]] = [(mesh, gltf_materials.Fit())]
        if material is not None:
            parts = self.mapped(*self.faded(mesh, material, colors, bool(sets)), sets, attributes)
        added = []
        for part, fit in parts:
            row = None if material is None else self.material(material, fit)
            repaired_part, _ = self.repaired(part, name, self.alone)
            added.append(add(repaired_part, row, name, self.builder, self.diagnostics, Span(self.name)))
        parts_named = [self.named(part, primitive) for part in added if part is not None]
        if material is None or not self.materials.is_double_sided(material):
            self.builder.single_sided.update(part.geometry for part in parts_named)
        return parts_named

    def named(self, part: Part, primitive: dict[str, Any]) -> Part:
        """A part with the name of the material of its primitive, which may have failed to be read."""
        index = primitive.get("material")
        if index is None:
            return part
        name = self.attempt(f"material {index}", lambda: self.container.document["materials"][index].get("name"), None)
        return replace(part, material_name=str(name or f"material {index}"))

    def thin(self, primitive: dict[str, Any], name: str, weights: tuple[float, ...]) -> list[Part]:
        """A primitive of points as spheres, or of lines as tubes: glTF gives them no width (§3.7.2.1). Pictures show one texel."""
        points = gltf_animation.morphed(self.container, primitive, "POSITION", weights).astype(np.float64)
        order = self.container.accessor(primitive["indices"]).reshape(-1) if "indices" in primitive else np.arange(len(points))
        order = order.astype(np.int64)
        sound = order < len(points)
        sound[sound] = np.isfinite(points[order[sound]]).all(axis=1)
        if not sound.all():
            self.warn(f"{np.count_nonzero(~sound)} of {len(sound)} points of `{name}` do not exist or are not finite: they are left out")
        runs = _polylines(order, sound, primitive["mode"])
        rows = np.concatenate(runs) if runs else np.zeros(0, np.int64)
        if not len(rows):
            return []
        if primitive["mode"] == POINTS:
            rows = point_clouds.thinned(rows, self.diagnostics, Span(self.name))
        radius = point_clouds.radius(points[rows])
        accessor = primitive["attributes"].get("COLOR_0")
        colors = None if accessor is None else self.container.accessor(accessor)
        tints = None if colors is None or len(colors) < len(points) else colors[rows, :3]
        if primitive["mode"] == POINTS:
            mesh = strands.balls(points[rows], np.full(len(rows), radius), tints)
        else:
            counts = np.array([len(run) for run in runs])
            lines = strands.Strands(points[rows], np.full(len(rows), radius), counts, np.zeros(len(runs), bool))
            mesh = strands.tubes(lines, None, tints)
        material = None if "material" not in primitive else self.material(primitive["material"], gltf_materials.Fit())
        part = add(mesh, material, name, self.builder, self.diagnostics, Span(self.name))
        return [] if part is None else [self.named(part, primitive)]

    def material(self, index: int, fit: gltf_materials.Fit) -> int | None:
        return self.attempt(f"material {index}", lambda: self.materials.row(index, fit), None)

    def triangles(self, primitive: dict[str, Any], points: np.ndarray, name: str) -> np.ndarray:
        """The triangles (t, 3) of a primitive whose corners exist and are finite."""
        order = self.container.accessor(primitive["indices"]).reshape(-1) if "indices" in primitive else np.arange(len(points))
        triangles = _triangles(order.astype(np.int64), primitive.get("mode", TRIANGLES))
        sound = np.asarray((triangles < len(points)).all(axis=1))
        sound[sound] = np.isfinite(points[triangles[sound]]).all(axis=(1, 2))
        if not sound.all():
            lost = f"{np.count_nonzero(~sound)} of {len(sound)} triangles of `{name}`"
            self.warn(f"{lost} use vertices that do not exist or are not finite: they are left out")
        return triangles[sound]

    def decompressed(self, primitive: dict[str, Any]) -> bool:
        """Decompress a primitive in place; False, with a warning, where that fails."""
        extensions = primitive.get("extensions", {})
        if gltf_draco.EXTENSION in extensions:
            if reason := gltf_draco.missing():
                self.warn(reason)
                return False
            try:
                gltf_draco.decode(self.container, primitive)
            except GltfError as failure:
                self.warn(f"{failure}: it is left out")
                return False
        return True

    def faded(self, mesh: PolyMesh, material: int, colors: np.ndarray | None, mapped: bool) -> tuple[PolyMesh, gltf_materials.Fit]:
        """A mesh with the opacity of its vertex colours, as a factor or as its u; its mean if pictures use u."""
        if colors is None or colors.shape[1] < 4 or not self.materials.is_see_through(material):
            return mesh, gltf_materials.Fit()
        alpha = colors[:, 3]
        if np.ptp(alpha) < 1e-4:
            return mesh, gltf_materials.Fit(alpha=float(alpha[0]))
        if mapped:
            self.warn("the opacity of vertex colours is drawn as its mean on meshes with pictures")
            return mesh, gltf_materials.Fit(alpha=float(np.clip(alpha.mean(), 0.0, 1.0)))
        return replace(mesh, uvs=vertex_numbers.coordinates(MeshAttribute(alpha), self.warn)), gltf_materials.Fit(ramp=True)

    def mapped(
        self, mesh: PolyMesh, fit: gltf_materials.Fit, sets: list[int], attributes: dict[str, int]
    ) -> Iterator[tuple[PolyMesh, gltf_materials.Fit]]:
        """The parts of a mesh whose pictures read several sets of texture coordinates."""
        others = [s for s in sets[1:] if f"TEXCOORD_{s}" in attributes]
        if not others or mesh.uvs is None:
            yield mesh, fit
            return
        corners = np.asarray(mesh.indices)
        columns = [_upward(self.container.accessor(attributes[f"TEXCOORD_{s}"])) for s in others]
        columns_by_corner = [np.nan_to_num(column[corners].astype(np.float64)) for column in (mesh.uvs.values, *columns)]
        groups = uv_sets.split(columns_by_corner[0], np.concatenate(columns_by_corner[1:], axis=1), np.asarray(mesh.counts))
        if groups is None:
            yield mesh, replace(fit, maps=dict.fromkeys(others))
            return
        for faces, maps in groups:
            part = mesh if len(groups) == 1 else polygon_mesh.subset(mesh, faces)
            yield part, replace(fit, maps=dict(zip(others, maps, strict=True)))

    # --- lights and cameras ---

    def light(self, index: int, node: dict[str, Any], matrix: np.ndarray) -> None:
        """Adds a KHR_lights_punctual light: lux of a directional light, candela of a point or spot light, pointing to −z."""
        if not self.as_scene:
            self.warn("the lights of a mesh file are left out: only a file that is drawn by itself brings its lights")
            return
        light = Rows(self.container.document["extensions"]["KHR_lights_punctual"]["lights"])[index]
        check_finite(light)
        color = scale_color(nonnegative(as_color(light.get("color", WHITE))), max(float(light.get("intensity", 1.0)), 0.0))
        axis = matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-300)
        backward, forward = as_color(axis), as_color(-axis)
        position, kind, name = as_color(matrix[:3, 3]), light.get("type"), node.get("name") or light.get("name", "")
        if kind == "directional":
            data = LightData(ir.LightKind.DIRECTIONAL, color, direction=backward, name=name)
        elif kind == "point":
            data = LightData(ir.LightKind.POINT, color, position=position, name=name)
        elif kind == "spot":
            spot = light.get("spot", {})
            outer = min(float(spot.get("outerConeAngle", math.pi / 4)), math.pi / 2)
            inner = min(float(spot.get("innerConeAngle", 0.0)), outer)
            data = LightData(
                ir.LightKind.SPOT, color, position=position, direction=forward, name=name,
                cos_cone=math.cos(outer), cos_full=math.cos(inner),
            )  # fmt: skip
        else:
            self.warn(f"lights of the type `{str(kind)[:40]}` are not drawn")
            return
        self.builder.light(data, Span(self.name))

    def camera(self, node: dict[str, Any], matrix: np.ndarray) -> None:
        """Adds a camera (§3.10), which looks along −z of its node."""
        if not self.as_scene:
            self.warn("the cameras of a mesh file are left out: only a file that is drawn by itself brings its cameras")
            return
        camera = self.container.document["cameras"][node["camera"]]
        check_finite(camera)
        name = node.get("name") or camera.get("name", "")
        row = self.builder.transform(transforms.unscaled(matrix), Span(self.name))
        if camera.get("type") == "orthographic":
            lens = camera["orthographic"]
            wide, high = float(lens["xmag"]), float(lens["ymag"])
            data = CameraData(
                row, high, ir.Projection.ORTHOGRAPHIC, aspect=wide / high, near=float(lens["znear"]), far=float(lens["zfar"]), name=name
            )
        else:
            lens = camera["perspective"]
            data = CameraData(
                row, math.tan(float(lens["yfov"]) / 2), aspect=float(lens.get("aspectRatio", 0.0)), near=float(lens["znear"]),
                far=float(lens.get("zfar", math.inf)), name=name,
            )  # fmt: skip
        if not 0 < data.extent < math.inf:
            raise GltfError("its field of view is not above 0")
        self.builder.camera(data, Span(self.name))


def _local(node: dict[str, Any]) -> np.ndarray:
    if node.get("matrix"):
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    rotation = Quaternion(*map(float, node["rotation"])) if any(node.get("rotation") or ()) else None
    return transforms.place(node.get("translation"), rotation, node.get("scale"))


def _upward(uvs: np.ndarray) -> np.ndarray:
    """Texture coordinates (n, 2) with v up; glTF's points down."""
    return np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)


def _polylines(order: np.ndarray, sound: np.ndarray, mode: int) -> list[np.ndarray]:
    """The sound points, or the polylines of two sound points or more: of pairs, a loop or a strip."""
    if mode == POINTS:
        return [order[sound]]
    if mode == LINES:
        pairs, valid = order[: len(order) // 2 * 2].reshape(-1, 2), sound[: len(order) // 2 * 2].reshape(-1, 2).all(axis=1)
        return list(pairs[valid])
    if mode == LOOP:
        order, sound = np.append(order, order[:1]), np.append(sound, sound[:1])
    runs = np.split(order, np.flatnonzero(~sound))
    runs = [run if k == 0 else run[1:] for k, run in enumerate(runs)]
    return [run for run in runs if len(run) > 1]


def _triangles(order: np.ndarray, mode: int) -> np.ndarray:
    """Triangles (t, 3) of a list, strip or fan (§3.7.2.1)."""
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    if len(order) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == FAN:
        return np.stack([np.broadcast_to(order[0], len(order) - 2), order[1:-1], order[2:]], axis=1)
    strip = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
    strip[1::2] = strip[1::2][:, [0, 2, 1]]
    return strip
