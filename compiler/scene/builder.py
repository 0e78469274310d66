"""Scene builder: creates the rows of the IR's tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from itertools import repeat
from typing import Any

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ...shapes import SHAPES
from .. import ir
from ..formula.tape import Tape
from ..io.sandbox import LIBRARY, Files
from ..ir.light_links import CASTERS, EVERYTHING
from ..ir.single_sided import SINGLE_SIDED
from . import link_sets, mesh_storage, row_tables, shape_bounds, transforms
from .instance_rows import GEOMETRY, LIGHT, MATERIAL, TRANSFORM, VISIBLE, InstanceNames, InstanceRows
from .row_records import (
    ALL_RAYS,
    BLACK,
    WHITE,
    CameraData,
    Color,
    InstanceData,
    LightData,
    MaterialData,
    MediumData,
    MeshAttribute,
    MeshData,
    TextureData,
    default_material,
)  # fmt: skip

NONE = -1  # the row of a rejected item; a diagnostic says why
FARTHEST_PLACE = 1e30  # largest coordinate of a transform; single precision ends at 3.4e38
FRAMED = FARTHEST_PLACE / 100  # largest coordinate of shapes that are framed: the camera stands at less than 100 times that
SPANNED = ("geometries", "instances", "calls", "materials", "media", "textures", "lights", "cameras", "settings")
_NO_INVERSE = {
    True: ("this is flattened to nothing by its transform (no inverse)", "a scale must not be 0 along any axis"),
    False: ("the transform of this has numbers that are not finite", ""),
}
_BOUNDS = ir.Geometries._fields.index("bounds")
_CHUNK = 1 << 16  # copies that are added at once: their temporaries stay small
_EXPECTED = {ir.Interpolation.FACE: "one a triangle", ir.Interpolation.VERTEX: "one a vertex", ir.Interpolation.CORNER: "one a corner"}


class SceneBuilder:
    """Collects rows and returns their indices; `finish` returns the immutable ir.Scene. Equal transforms, shapes, textures and materials
    share one row. An invalid row is reported as a diagnostic and becomes NONE. Every method accepts NONE and leaves it out.
    """

    def __init__(self, diagnostics: Diagnostics | None = None, files: Files | None = None) -> None:
        """`files` decides which files may be read meanwhile (default: the library only)."""
        self.diagnostics = diagnostics if diagnostics is not None else Diagnostics()
        self.files = files if files is not None else Files(LIBRARY)
        self._matrices: list[np.ndarray] = []  # (k, 3, 4) each
        self._inverses: list[np.ndarray] = []
        self._links: dict[int, link_sets.Links] = {}  # by rows of lights
        self._rows: dict[str, list[tuple[Any, ...]]] = {name: [] for name in ir.TABLES}
        self._names: dict[str, list[str]] = {f.name: [] for f in fields(ir.Names)}
        self._spans: dict[str, list[Span | None]] = {name: [] for name in SPANNED}
        self._known: dict[Any, int] = {}
        self._instances, self._instance_names = InstanceRows(), InstanceNames()
        self._known_transforms: dict[bytes, int] = {}
        self._places = 0  # rows of transforms
        self._tapes: list[Tape] = []
        self._pools: dict[str, list[np.ndarray]] = {name: [] for name in (*ir.Pools._fields, "texels", "polygons")}
        self._length: dict[str, int] = dict.fromkeys(self._pools, 0)
        self._colorful: list[bool] = []  # of each image: whether its channels differ
        self.single_sided: set[int] = set()  # geometries that are drawn from their front alone
        self.is_wide = False  # whether some image has colours beyond Rec.709
        self._holes: list[bool] = []  # of each image: whether some alpha is below 1
        self.duration: float | None = None  # seconds of the animation of an imported file
        self.deviation: float | None = None  # metres: greatest distance of generated triangles from their surfaces; None: the default
        self.transform(np.eye(4))

    # --- transforms ---

    def transform(self, matrix: np.ndarray, span: Span | None = None) -> int:
        """The row of a (3, 4) or (4, 4) object-to-world matrix. NONE and a warning if it is singular."""
        affine = np.ascontiguousarray(np.asarray(matrix, dtype=np.float64)[:3])
        key = (affine + 0.0).tobytes()  # + 0.0: −0 becomes 0
        row = self._known_transforms.get(key)
        if row is not None:
            return row
        inverse = transforms.inverse(affine)
        if inverse is None:
            reason, hint = _NO_INVERSE[bool(np.isfinite(affine).all())]
            self.diagnostics.warning(f"{reason}: it is not drawn", span, hint)
            return NONE
        if not (np.abs(affine) < FARTHEST_PLACE).all():
            self.diagnostics.warning(f"this is placed or scaled beyond {FARTHEST_PLACE:g}: it is not drawn", span)
            return NONE
        row = self._known_transforms[key] = self._places
        self._places += 1
        self._matrices.append(affine[None])
        self._inverses.append(inverse[None])
        return row

    def transforms(self, matrices: np.ndarray, spans: Sequence[Span | None]) -> list[int]:
        """The rows of transforms (n, 3, 4); see `transform`."""
        affine = np.ascontiguousarray(matrices, dtype=np.float64)
        inverses, good = transforms.inverses(affine)
        good &= (np.abs(affine) < FARTHEST_PLACE).all(axis=(1, 2))
        data, size = (affine + 0.0).tobytes(), affine[:1].nbytes
        row_of, rows, fresh, flat = self._known_transforms, [], [], good.tolist()
        for k in range(len(affine)):
            key = data[k * size : (k + 1) * size]
            row = row_of.get(key)
            if row is None:
                if not flat[k]:
                    rows.append(NONE)
                    continue
                row = row_of[key] = self._places + len(fresh)
                fresh.append(k)
            rows.append(row)
        self._places += len(fresh)
        self._matrices.append(affine[fresh])
        self._inverses.append(inverses[fresh])
        for k in np.flatnonzero(~good).tolist():
            rows[k] = self.transform(affine[k], spans[k])  # raises the reason why it has none
        return rows

    # --- geometry ---

    def geometry(self, kind: ir.GeometryKind, parameters: Sequence[float] = (), span: Span | None = None, name: str = "") -> int:
        """The row of an analytic shape; `parameters` in the order of its MEASURES."""
        numbers = tuple(map(float, parameters))
        key = (int(kind), numbers)
        row = self._known.get(key)
        if row is None:
            bounds = SHAPES[kind].bounds(numbers)
            row = self._geometry(kind, numbers, bounds, np.zeros(3), (0,) * 6, (NONE,) * 4, span, name)
            self._known[key] = row
        return row

    def formula(self, tape: Tape, bounds: np.ndarray, parameters: Sequence[float], span: Span | None = None, name: str = "") -> int:
        """The row of an implicit surface in a box (2, 3); `parameters` are those of ir.GeometryKind.FORMULA without the last."""
        numbers = (*map(float, parameters), float(np.abs(bounds).max()))
        row = self.tape(tape)
        columns = (NONE, NONE, NONE, row)
        return self.shared(
            ("formula", row, numbers, bounds.tobytes()),
            lambda: self._geometry(ir.GeometryKind.FORMULA, numbers, bounds, np.zeros(3), (0,) * 6, columns, span, name),
        )

    def shape(self, geometry: int) -> tuple[ir.GeometryKind, tuple[float, ...], np.ndarray, Tape | None]:
        """(kind, parameters, bounds, tape of a formula) of a geometry row."""
        row = dict(zip(ir.Geometries._fields, self._rows["geometries"][geometry], strict=True))
        tape = self._tapes[row["tape"]] if row["tape"] >= 0 else None
        return ir.GeometryKind(row["kind"]), row["parameters"], np.array(row["bounds"], np.float64), tape

    def triangles(self, geometry: int) -> tuple[np.ndarray, np.ndarray]:
        """(positions (n, 3), triangles (m, 3)) of a mesh row, in its own frame."""
        row = dict(zip(ir.Geometries._fields, self._rows["geometries"][geometry], strict=True))
        triangles = mesh_storage.pool_rows(self._pools["triangles"], row["first_triangle"], row["triangle_count"])
        points = mesh_storage.pool_rows(self._pools["positions"], row["first_vertex"], row["vertex_count"])
        return points.astype(np.float64) + row["origin"], triangles - row["first_vertex"]

    def tape(self, tape: Tape) -> int:
        """The row of a tape; equal tapes share one."""
        key = ("tape", tape.structure(), tape.constants.tobytes())
        if key not in self._known:
            results = (*tape.results, *(0,) * (4 - len(tape.results)))
            row = (self._length["code"], len(tape.code), self._length["constants"], len(tape.constants), results, len(tape.results))
            self._known[key] = self._add("tapes", row, None, "")
            self._tapes.append(tape)
            self._pool("code", tape.code)
            self._pool("constants", tape.constants)
        return self._known[key]

    def mesh(self, mesh: MeshData, span: Span | None = None, name: str = "") -> int:
        """The row of a mesh, its positions stored as float32 relative to mesh_storage.origin; equal meshes share one.

        Attributes of wrong length are left out with a warning. A mesh without triangles is NONE.
        """
        content = mesh_storage.digest(mesh)
        return self.shared(("mesh", content), lambda: self._mesh(mesh, content, span, name or mesh.name))

    def _mesh(self, mesh: MeshData, content: bytes, span: Span | None, name: str) -> int:
        triangles = np.asarray(mesh.triangles, dtype=np.int32).reshape(-1, 3)
        if not len(triangles):
            self.diagnostics.warning(f"the mesh{f' `{name}`' if name else ''} has no triangles: nothing is drawn", span)
            return NONE
        origin, stored, bounds, rounding = mesh_storage.stored(mesh, content)
        first_vertex, first_triangle = self._length["positions"], self._length["triangles"]
        first_polygon, polygon_count = self._outlines(mesh, first_vertex, first_triangle)
        self._pool("positions", stored)
        self._pool("triangles", triangles + np.int32(first_vertex))
        ranges = (first_vertex, len(stored), first_triangle, len(triangles), first_polygon, polygon_count)
        attributes = tuple(
            self._attribute(kind, attribute, width, len(stored), len(triangles), span)
            for kind, attribute, width in (("normals", mesh.normals, 3), ("uvs", mesh.uvs, 2), ("colors", mesh.colors, 3))
        )
        return self._geometry(ir.GeometryKind.MESH, (mesh.deviation + rounding,), bounds, origin, ranges, (*attributes, NONE), span, name)

    def _geometry(self, kind: int, parameters: tuple[float, ...], bounds: Any, origin: Any, ranges: tuple[int, ...],
                  attributes: tuple[int, ...], span: Span | None, name: str) -> int:  # fmt: skip
        padded = parameters + (0.0,) * (ir.PARAMETERS - len(parameters))
        return self._add("geometries", (int(kind), padded, bounds, origin, *ranges, *attributes), span, name)

    def _outlines(self, mesh: MeshData, first_vertex: int, first_triangle: int) -> tuple[int, int]:
        """Adds the mesh's polygons. Returns (first row, count)."""
        first = self._length["polygons"]
        if mesh.outlines is None:
            return first, 0
        outlines = mesh.outlines
        first_corner, first_loop = self._length["corners"], self._length["loops"]
        self._pool("corners", np.asarray(outlines.corners, dtype=np.int32).reshape(-1) + np.int32(first_vertex))
        self._pool("loops", np.asarray(outlines.loops, dtype=np.int32).reshape(-1, 2) + np.array([first_corner, 0], dtype=np.int32))
        rows = np.asarray(outlines.polygons, dtype=np.int32).reshape(-1, 4)
        self._pool("polygons", rows + np.array([first_loop, 0, first_triangle, 0], dtype=np.int32))
        return first, len(rows)

    def _attribute(self, name: str, attribute: MeshAttribute | None, width: int, vertices: int, triangles: int, span: Span | None) -> int:
        if attribute is None:
            return NONE
        values = np.asarray(attribute.values, dtype=np.float32).reshape(-1, width)
        kind = ir.Interpolation(attribute.interpolation)
        expected = {"FACE": triangles, "VERTEX": vertices, "CORNER": 3 * triangles}.get(kind.name, 1)
        if len(values) != expected:
            how = f", {_EXPECTED[kind]}" if kind in _EXPECTED else ""
            self.diagnostics.warning(f"the mesh has {len(values)} {name} where {expected} belong{how}: they are left out", span)
            return NONE
        row = self._add("attributes", (int(kind), width, self._length["values"], len(values)), None, name)
        self._pool("values", values.reshape(-1))
        return row

    # --- instances, materials, lights, cameras ---

    def instance(self, instance: InstanceData, span: Span | None = None) -> int:
        """Adds an instance of a geometry. NONE if its geometry or transform is NONE."""
        if instance.geometry < 0 or instance.transform < 0:
            return NONE
        row = (instance.geometry, instance.transform, instance.material, instance.light, instance.visible)
        self._spans["calls"].append(span)
        return self._add("instances", row, span, instance.name)

    def instances(
        self, geometries: Sequence[int], transforms: Sequence[int], materials: Sequence[int], names: Sequence[str],
        spans: Sequence[Span | None], calls: Sequence[Span | None] | None = None,
    ) -> None:  # fmt: skip
        """Adds instances, except those whose geometry or transform is NONE. `calls` are the outermost calls that make them."""
        if min(geometries) < 0 or min(transforms) < 0:
            for geometry, transform, material, name, span in zip(geometries, transforms, materials, names, spans, strict=True):
                self.instance(InstanceData(geometry, transform, material, name=name), span)
            return
        self._instances.extend(zip(geometries, transforms, materials, repeat(NONE), repeat(ALL_RAYS)))
        self._instance_names.extend(names)
        self._spans["instances"].extend(spans)
        self._spans["calls"].extend(spans if calls is None else calls)

    def copies(self, geometry: int, matrices: np.ndarray, materials: np.ndarray, name: str, ids: np.ndarray, span: Span) -> None:
        """Adds instances `name[id]` of a geometry under matrices (n, 4, 4), with n materials. Equal matrices have rows of their own."""
        valid = []
        for first in range(0, len(matrices), _CHUNK):
            affine = np.ascontiguousarray(matrices[first : first + _CHUNK, :3], dtype=np.float64)
            inverses, good = transforms.inverses(affine)
            good &= (np.abs(affine) < FARTHEST_PLACE).all(axis=(1, 2))
            for k in np.flatnonzero(~good).tolist():
                self.transform(affine[k], span)  # warns of the reason
            count = int(np.count_nonzero(good))
            self._matrices.append(affine[good])
            self._inverses.append(inverses[good])
            rows = np.full((count, len(ir.Instances._fields)), NONE, np.int32)
            rows[:, GEOMETRY], rows[:, TRANSFORM] = geometry, self._places + np.arange(count)
            rows[:, MATERIAL], rows[:, VISIBLE] = materials[first : first + _CHUNK][good], ALL_RAYS
            self._places += count
            self._instances.block(rows)
            valid.append(ids[first : first + _CHUNK][good])
            for table in ("instances", "calls"):
                self._spans[table].extend([span] * count)
        self._instance_names.copies(name, np.concatenate(valid) if valid else ids)

    def material(self, material: MaterialData, span: Span | None = None) -> int:
        """The row of a material; equal materials of the same name share one."""
        values, images = [[0.0, 0.0, 0.0] for _ in range(ir.SLOTS)], [NONE] * ir.SLOTS
        values[ir.Slot.IOR][0] = values[ir.Slot.OPACITY][0] = 1.0
        for slot, value in material.inputs.items():
            values[slot], images[slot] = list(map(float, value.value)), value.texture
        how = (int(material.model), int(material.shading), bool(material.normalized), float(material.threshold))
        parts = material.first, material.second
        column = ir.Materials._fields.index("textured")
        textured = max(images) >= 0 or any(part >= 0 and bool(self._rows["materials"][part][column]) for part in parts)
        row = (*how, tuple(map(tuple, values)), tuple(images), textured, *parts, material.medium)
        return self.shared(("material", row, material.name), lambda: self._add("materials", row, span, material.name))

    def medium(self, medium: MediumData, span: Span | None = None) -> int:
        """The row of a participating medium; equal media share one."""
        return self.shared(("medium", medium), lambda: self._add("media", tuple(map(medium.__getattribute__, ir.Media._fields)), span, ""))

    def material_data(self, material: int) -> MaterialData:
        """The record of a material row."""
        return row_tables.material_data(self._rows["materials"][material], self._names["materials"][material])

    def texture(self, texture: TextureData, span: Span | None = None) -> int:
        """The row of a texture; equal textures share one."""
        columns = ir.Textures._fields
        return self.shared(("texture", texture), lambda: self._add("textures", tuple(map(texture.__getattribute__, columns)), span, ""))

    def alpha_of(self, texture: int) -> int:
        """The row of the alpha channel of an image texture, with the same mapping; NONE for an opaque image."""
        if texture < 0:
            return NONE
        row = dict(zip(ir.Textures._fields, self._rows["textures"][texture], strict=True))
        if not self.has_holes(row["image"]):
            return NONE
        return self.texture(TextureData(**{**row, "channel": 3, "gain": WHITE, "bias": BLACK}))

    def with_levels(self, texture: int, gain: Color, bias: Color) -> int:
        """The row of a copy of a texture with other gain and bias."""
        row = dict(zip(ir.Textures._fields, self._rows["textures"][texture], strict=True))
        return self.texture(TextureData(**{**row, "gain": gain, "bias": bias}))

    def channels_differ(self, texture: int) -> bool:
        """Whether an image's channels differ: such an image holds directions or colours, not heights."""
        image = self._rows["textures"][texture][ir.Textures._fields.index("image")]
        return image >= 0 and self._colorful[image]

    def image(self, texels: np.ndarray, name: str = "") -> int:
        """The row of an image: (h, w, 4) linear r, g, b, a, row 0 at the top. Callers share rows by file (see images.py)."""
        height, width, _ = texels.shape
        row = self._add("images", (self._length["texels"], width, height), None, name)
        self._pool("texels", np.asarray(texels, dtype=np.float32).reshape(-1, 4))
        self._holes.append(bool((texels[..., 3] < 1).any()))
        self._colorful.append(bool((texels[..., 0] != texels[..., 2]).any()))
        return row

    def has_holes(self, image: int) -> bool:
        """Whether some alpha of an image is below 1."""
        return image >= 0 and self._holes[image]

    def light(self, light: LightData, span: Span | None = None) -> int:
        """The row of a light; NONE if its transform is NONE."""
        if light.transform < 0:
            return NONE
        columns = {f.name: getattr(light, f.name) for f in fields(light)}
        columns |= {"instance": NONE, "receivers": EVERYTHING, "blockers": CASTERS}
        if light.links is not None:
            self._links[self.count("lights")] = light.links
        self._names["groups"].append(light.group)
        return self._add("lights", tuple(columns[c] for c in ir.Lights._fields), span, light.name)

    def camera(self, camera: CameraData, span: Span | None = None) -> int:
        """The row of a camera; NONE if its transform is NONE."""
        if camera.transform < 0:
            return NONE
        return self._add("cameras", tuple(getattr(camera, c) for c in ir.Cameras._fields), span, camera.name)

    def default_material(self) -> int:
        """The row of the default material, a grey."""
        return self.material(default_material())

    def shared(self, key: Any, make: Callable[[], int]) -> int:
        """The row cached under `key`, made by `make` on first use: for costly rows such as a file's mesh or image."""
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    @property
    def texels(self) -> int:
        """Total texels of all images so far."""
        return self._length["texels"]

    def bounds(self, geometry: int, matrix: np.ndarray) -> np.ndarray:
        """(2, 3) bounds of a geometry under a matrix; ±inf for an unbounded one."""
        return shape_bounds.boxes_under(np.array([self._rows["geometries"][geometry][_BOUNDS]]), np.asarray(matrix)[None, :3])[0]

    def world_bounds(self) -> np.ndarray | None:
        """(2, 3) bounds of all bounded instances within a camera's reach; None without any."""
        rows = self._instances.table()
        local, (matrices, _) = np.array([row[_BOUNDS] for row in self._rows["geometries"]]), self._joined()
        extents = []
        for first in range(0, len(rows), _CHUNK):
            chosen = rows[first : first + _CHUNK]
            boxes = shape_bounds.boxes_under(local[chosen[:, GEOMETRY]], matrices[chosen[:, TRANSFORM]])
            bounded = boxes[(np.abs(boxes) < FRAMED).all(axis=(1, 2))]
            if len(bounded):
                extents.append(np.stack([bounded[:, 0].min(axis=0), bounded[:, 1].max(axis=0)]))
        return np.stack([np.min(extents, axis=0)[0], np.max(extents, axis=0)[1]]) if extents else None

    def emission(self) -> tuple[bool, bool]:
        """(whether some instance's material, or some medium, emits light; whether some medium emits or scatters it)."""
        emitting, glows, scatters = row_tables.emitting(self._rows["materials"], self._rows["media"])
        return bool(np.isin(self._instances.table()[:, MATERIAL], emitting).any()) or glows, glows or scatters

    def count(self, table: str) -> int:
        """Number of rows of a table so far."""
        apart = {"instances": len(self._instances), "transforms": self._places}
        return apart[table] if table in apart else len(self._rows[table])

    # --- result ---

    def settings_at(self, span: Span) -> None:
        """Record the span of the scene's render settings."""
        self._spans["settings"].append(span)

    def finish(self, name: str = "", **about: Any) -> ir.Scene:
        """The scene, with a default material and links of area lights to their shapes. `about` are further fields of ir.Scene."""
        instances = self._instances.table().copy()
        if (instances[:, MATERIAL] < 0).any():
            instances[instances[:, MATERIAL] < 0, MATERIAL] = self.default_material()
        instances[np.isin(instances[:, MATERIAL], row_tables.clear_rows(self._rows["materials"])), VISIBLE] &= ~ir.Visibility.SHADOW
        shape_of = {int(instances[index, LIGHT]): index for index in np.flatnonzero(instances[:, LIGHT] >= 0).tolist()}
        place = ir.Lights._fields.index("instance")
        lights = [(*row[:place], shape_of.get(index, NONE), *row[place + 1 :]) for index, row in enumerate(self._rows["lights"])]
        instances[np.isin(instances[:, GEOMETRY], list(self.single_sided)), VISIBLE] |= SINGLE_SIDED
        tables = {table: ir.table_of(table, row_tables.columns(table, rows)) for table, rows in (self._rows | {"lights": lights}).items()}
        tables["instances"] = ir.table_of("instances", dict(zip(ir.Instances._fields, instances.T, strict=True)))
        tables["transforms"] = self._transforms()
        tables["pools"] = ir.table_of("pools", {column: self._pooled(column) for column in ir.Pools._fields})
        polygons = np.asarray(self._pooled("polygons"), np.int32).reshape(-1, 4).T
        tables["polygons"] = ir.table_of("polygons", dict(zip(ir.Polygons._fields, polygons, strict=True)))
        tables["images"] = ir.table_of("images", {**row_tables.columns("images", self._rows["images"]), "texels": self._pooled("texels")})
        named: dict[str, Any] = {table: tuple(names) for table, names in self._names.items() if table != "groups" or any(names)}
        placed = named["instances"] = self._instance_names.names()
        if self._links:
            linked = link_sets.linked(tables["instances"], tables["lights"], self._links, placed, self.diagnostics)
            tables["instances"], tables["lights"] = linked
        return ir.Scene(name, ir.Tables(**tables), ir.Names(**named), row_tables.spans(self._spans), is_wide=self.is_wide, **about)

    def _joined(self) -> tuple[np.ndarray, np.ndarray]:
        """The matrices and inverses of all transforms, (n, 3, 4) each."""
        self._matrices, self._inverses = [np.concatenate(self._matrices)], [np.concatenate(self._inverses)]
        return self._matrices[0], self._inverses[0]

    def _transforms(self) -> ir.Transforms:
        matrices, inverses = self._joined()
        flips = np.linalg.det(matrices[:, :, :3]) < 0
        still = np.full(len(matrices), NONE)
        return ir.table_of("transforms", {"matrix": matrices, "inverse": inverses, "flips": flips, "first_key": still, "keys": still + 1})

    def _add(self, table: str, row: tuple[Any, ...], span: Span | None, name: str) -> int:
        rows = self._instances if table == "instances" else self._rows[table]
        rows.append(row)
        if table in self._names:
            (self._instance_names if table == "instances" else self._names[table]).append(name)
        if table in self._spans:
            self._spans[table].append(span)
        return len(rows) - 1

    def _pool(self, name: str, piece: np.ndarray) -> None:
        self._pools[name].append(piece)
        self._length[name] += len(piece)

    def _pooled(self, name: str) -> Any:
        return np.concatenate(self._pools[name]) if self._pools[name] else ()
