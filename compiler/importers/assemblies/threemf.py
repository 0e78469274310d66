"""Reads 3MF: meshes, components, units, transforms, base materials and colours of triangles.

Format: 3MF Core Specification 1.3, Materials and Properties Extension 1.2 (colorgroup), Production Extension 1.1 (p:path). The archive is
an Open Packaging Conventions file; of it only models are read, each once.
"""

from __future__ import annotations

import io
import posixpath
import zipfile
import zlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ... import ir
from ...mesh.polygon_mesh import PolyMesh
from ...scene.row_records import MeshAttribute
from ..common.mesh_parts import MeshFile, Part
from . import safe_xml
from .assembly import Assembly, AssemblyError, AssemblyMesh, BaseMaterial, Place, parts_of

UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
MOST_BYTES = 1 << 30  # of all models of a file, unpacked
MOST_MODELS = 4096
MOST_PLACES = 100_000  # of objects and components, those in others counted each time
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
_MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_NOT_DRAWN = {
    "texture2dgroup": "textures of triangles", "compositematerials": "mixed materials", "multiproperties": "layered properties",
    "pbmetallicdisplayproperties": "metallic properties", "pbspeculardisplayproperties": "specular properties",
    "translucentdisplayproperties": "translucent properties", "beamlattice": "lattices of beams", "slicestack": "slices",
    "displacementmesh": "displaced meshes", "booleans": "boolean operations", "volumedata": "volumes",
    "implicitfunction": "implicit functions",
}  # fmt: skip
Warn = Callable[[str], None]
_Key = tuple[str, str]  # (model, id) of a resource


def parts(file: MeshFile) -> list[Part]:
    """The parts of a 3MF file. Raises MeshFileError."""
    return parts_of(file, read)


def read(data: bytes, warn: Warn) -> Assembly:
    """The assembly of a 3MF file. `warn` gets a message for each part that is left out. Raises AssemblyError."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError, EOFError):
        raise AssemblyError("this is not a 3MF file: it is not a zip archive") from None
    package = _Package(archive)
    models = _Models(package, warn)
    root = models.load(package.root())
    assembly = _Expansion(models, warn).run(root)
    if not assembly.places:
        raise AssemblyError("the 3MF file shows no mesh: its build has no items" if not root.items else "the 3MF file shows no mesh")
    return assembly


class _Package:
    """The parts of an archive by name, read up to MOST_BYTES in all."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive, self._left = archive, MOST_BYTES
        self._names = {f"/{info.filename.lstrip('/')}".lower(): info for info in archive.infolist()}

    def __contains__(self, name: str) -> bool:
        return name.lower() in self._names

    def bytes_of(self, name: str) -> bytes:
        """The content of a part. Raises AssemblyError."""
        info = self._names.get(name.lower())
        if info is None:
            raise AssemblyError(f"the 3MF file has no part `{name[:80]}`")
        try:
            with self._archive.open(info) as file:
                content = file.read(self._left + 1)
        except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, OSError, EOFError, ValueError) as failure:
            raise AssemblyError(f"the part `{name[:80]}` of the 3MF file cannot be unpacked: {failure}") from None
        self._left -= len(content)
        if self._left < 0:
            raise AssemblyError(f"the models of the 3MF file have more than {MOST_BYTES >> 20:,} MiB")
        return content

    def root(self) -> str:
        """The name of the model that the package begins with."""
        targets: list[str] = []

        def start(name: str, attributes: Mapping[str, str]) -> None:
            if safe_xml.local(name)[1] == "Relationship" and attributes.get("Type") == _MODEL:
                targets.append(posixpath.normpath("/" + attributes.get("Target", "").lstrip("/")))

        if "/_rels/.rels" in self:
            safe_xml.parse(self.bytes_of("/_rels/.rels"), "_rels/.rels", start, lambda _: None)
        named = next((target for target in targets if target in self), "/3D/3dmodel.model")
        if named in self:
            return named
        other = sorted(name for name in self._names if name.endswith(".model"))
        if not other:
            raise AssemblyError("the 3MF file has no model")
        return other[0]


class _Object:
    """An object: its triangles or its components."""

    def __init__(self, name: str, default: tuple[str, int] | None) -> None:
        self.name, self.default = name, default
        self.points: list[float] = []
        self.corners: list[int] = []
        self.properties: dict[int, tuple[str, tuple[int, int, int]]] = {}  # of a triangle: group, rows of its corners
        self.components: list[tuple[_Key, np.ndarray]] = []


class _Model:
    """One model of the package, filled by the events of its XML."""

    def __init__(self, path: str, warn: Warn) -> None:
        self.path, self._warn = path, warn
        self.unit = UNITS["millimeter"]
        self.objects: dict[str, _Object] = {}
        self.bases: dict[str, list[BaseMaterial]] = {}
        self.colors: dict[str, list[tuple[float, float, float, float]]] = {}
        self.items: list[tuple[_Key, np.ndarray]] = []
        self._object: _Object | None = None
        self._group = ""
        self._starts: dict[str, Callable[[Mapping[str, str]], None]] = {
            "model": self._model, "object": self._begin, "vertex": self._vertex, "triangle": self._triangle, "component": self._component,
            "item": self._item, "basematerials": self._bases, "base": self._base, "colorgroup": self._colors, "color": self._color,
        }  # fmt: skip

    def start(self, name: str, attributes: Mapping[str, str]) -> None:
        space, tag = safe_xml.local(name)
        if tag in _NOT_DRAWN:
            self._warn(f"the 3MF file has {_NOT_DRAWN[tag]}, which are not drawn")
        handler = self._starts.get(tag) if space in (CORE, _MATERIAL, "") else None
        if handler is None:
            return
        try:
            handler(attributes)
        except KeyError as missing:
            raise AssemblyError(f"a `{tag}` has no attribute {missing}") from None
        except ValueError:
            raise AssemblyError(f"an attribute of a `{tag}` is not a number") from None

    def end(self, name: str) -> None:
        tag = safe_xml.local(name)[1]
        if tag == "object":
            self._object = None

    def _model(self, attributes: Mapping[str, str]) -> None:
        unit = attributes.get("unit", "millimeter")
        if unit not in UNITS:
            self._warn(f"the 3MF file has the unit `{unit[:40]}`, which is not known: millimeter is taken")
        self.unit = UNITS.get(unit, UNITS["millimeter"])

    def _begin(self, attributes: Mapping[str, str]) -> None:
        default = None
        if "pid" in attributes:
            default = attributes["pid"], int(attributes.get("pindex", "0"))
        self._object = self.objects[attributes["id"]] = _Object(attributes.get("name", ""), default)

    def _vertex(self, attributes: Mapping[str, str]) -> None:
        if self._object is not None:
            self._object.points += (float(attributes["x"]), float(attributes["y"]), float(attributes["z"]))

    def _triangle(self, attributes: Mapping[str, str]) -> None:
        current = self._object
        if current is None:
            return
        current.corners += (int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"]))
        if "p1" in attributes:
            group = attributes.get("pid") or (current.default[0] if current.default else "")
            first = int(attributes["p1"])
            rows = first, int(attributes.get("p2", first)), int(attributes.get("p3", first))
            current.properties[len(current.corners) // 3 - 1] = group, rows

    def _component(self, attributes: Mapping[str, str]) -> None:
        if self._object is not None:
            self._object.components.append(self._placed(attributes))

    def _item(self, attributes: Mapping[str, str]) -> None:
        self.items.append(self._placed(attributes))

    def _placed(self, attributes: Mapping[str, str]) -> tuple[_Key, np.ndarray]:
        path = next((value for name, value in attributes.items() if safe_xml.local(name)[1] == "path"), self.path)
        return (posixpath.normpath("/" + path.lstrip("/")), attributes["objectid"]), _matrix(attributes.get("transform"))

    def _bases(self, attributes: Mapping[str, str]) -> None:
        self._group = attributes["id"]
        self.bases[self._group] = []

    def _base(self, attributes: Mapping[str, str]) -> None:
        *color, opacity = _srgb(attributes["displaycolor"])
        name = attributes.get("name", "")
        self.bases.setdefault(self._group, []).append(BaseMaterial(name, (color[0], color[1], color[2]), opacity))

    def _colors(self, attributes: Mapping[str, str]) -> None:
        self._group = attributes["id"]
        self.colors[self._group] = []

    def _color(self, attributes: Mapping[str, str]) -> None:
        self.colors.setdefault(self._group, []).append(_srgb(attributes["color"]))


def _srgb(text: str) -> tuple[float, float, float, float]:
    """`#RRGGBB` or `#RRGGBBAA` as shares. Raises ValueError."""
    text = text.strip()
    if len(text) not in (7, 9) or text[0] != "#":
        raise ValueError
    r, g, b, a = bytes.fromhex(text[1:].ljust(8, "F"))
    return r / 255, g / 255, b / 255, a / 255


def _matrix(text: str | None) -> np.ndarray:
    """(4, 4) of the twelve numbers of a transform, rows of which are images of the axes. Raises ValueError."""
    matrix = np.eye(4)
    if text is not None:
        numbers = [float(word) for word in text.split()]
        if len(numbers) != 12:
            raise ValueError
        matrix[:3] = np.array(numbers).reshape(4, 3).T
    return matrix


class _Models:
    """The models of a package by name, each parsed once."""

    def __init__(self, package: _Package, warn: Warn) -> None:
        self._package, self._warn = package, warn
        self._known: dict[str, _Model | None] = {}

    def load(self, path: str) -> _Model:
        """The model of a part. Raises AssemblyError."""
        if len(self._known) >= MOST_MODELS:
            raise AssemblyError(f"the 3MF file has more than {MOST_MODELS:,} models")
        model = _Model(path, self._warn)
        self._known[path.lower()] = None
        safe_xml.parse(self._package.bytes_of(path), path.lstrip("/")[:80], model.start, model.end)
        self._known[path.lower()] = model
        return model

    def object_of(self, key: _Key) -> tuple[_Model, _Object] | None:
        """An object with its model; None, with a warning, of one that is not there."""
        path, number = key
        if path.lower() not in self._known:
            try:
                self.load(path)
            except AssemblyError as failure:
                self._warn(f"a part is left out: {failure}")
        model = self._known.get(path.lower())
        object_ = None if model is None else model.objects.get(number)
        if model is None or object_ is None:
            self._warn(f"the 3MF file has no object `{number[:40]}`, which is used: it is left out")
            return None
        return model, object_


class _Expansion:
    """Places the objects of a build, and of components in components."""

    def __init__(self, models: _Models, warn: Warn) -> None:
        self._models, self._warn = models, warn
        self._rows: dict[_Key, int | None] = {}
        self._materials: dict[BaseMaterial, int] = {}
        self._meshes: list[AssemblyMesh] = []

    def run(self, root: _Model) -> Assembly:
        places: list[Place] = []
        waiting: list[tuple[_Key, np.ndarray, tuple[_Key, ...]]] = [(key, matrix, ()) for key, matrix in reversed(root.items)]
        seen = 0
        while waiting:
            key, matrix, above = waiting.pop()
            seen += 1
            if seen > MOST_PLACES:
                self._warn(f"the 3MF file places more than {MOST_PLACES:,} objects: the rest is left out")
                break
            if key in above or len(above) > safe_xml.DEEPEST:
                self._warn("components of the 3MF file contain each other: they are left out where they begin again")
                continue
            resolved = self._models.object_of(key)
            if resolved is None:
                continue
            model, object_ = resolved
            frame = matrix if model.unit == root.unit else matrix @ np.diag([*(model.unit / root.unit,) * 3, 1.0])
            if (row := self._mesh(key, model, object_)) is not None:
                places.append(Place(row, frame, object_.name))
            waiting += [(below, frame @ place, (*above, key)) for below, place in reversed(object_.components)]
        return Assembly(root.unit, "z", self._meshes, list(self._materials), places)

    def _mesh(self, key: _Key, model: _Model, item: _Object) -> int | None:
        """The row of the mesh of an object; None of one without triangles."""
        if key not in self._rows:
            mesh = self._built(model, item) if item.corners else None
            if mesh is not None:
                self._meshes.append(mesh)
            self._rows[key] = None if mesh is None else len(self._meshes) - 1
        return self._rows[key]

    def _built(self, model: _Model, item: _Object) -> AssemblyMesh | None:
        points = np.array(item.points, np.float64).reshape(-1, 3)
        corners = np.array(item.corners, dtype=object).reshape(-1, 3)
        in_range = np.array([all(0 <= int(v) < len(points) for v in row) for row in corners.tolist()])
        corners = np.where(in_range[:, None], corners, 0).astype(np.int64)
        sound = in_range & (np.isfinite(points[corners]).all(axis=(1, 2)) if len(points) else False)
        if not sound.all():
            lost = int(np.count_nonzero(~sound))
            self._warn(f"{lost} of {len(sound)} triangles use vertices that do not exist or are not finite: they are left out")
        if not sound.any():
            return None
        material, colors = self._looks(model, item, len(corners))
        tints = None if colors is None else MeshAttribute(colors[sound].reshape(-1, 3), ir.Interpolation.CORNER)
        triangles = corners[sound]
        mesh = PolyMesh(np.nan_to_num(points), np.full(len(triangles), 3), triangles.reshape(-1), colors=tints)
        return AssemblyMesh(item.name, mesh, material[sound])

    def _looks(self, model: _Model, item: _Object, count: int) -> tuple[np.ndarray, np.ndarray | None]:
        """(materials (m,) of triangles, linear colours (m, 3, 3) of their corners or None)"""
        material, colors, wrong = np.full(count, -1, np.int64), None, 0
        default = None if item.default is None else (item.default[0], (item.default[1],) * 3)
        for k in range(count):
            group, rows = item.properties.get(k) or default or ("", (0, 0, 0))
            bases, tints = model.bases.get(group), model.colors.get(group)
            if bases is not None and 0 <= rows[0] < len(bases):
                material[k] = self._materials.setdefault(bases[rows[0]], len(self._materials))
            elif tints is not None and all(0 <= row < len(tints) for row in rows):
                if colors is None:
                    colors = np.ones((count, 3, 3))
                colors[k] = [tints[row][:3] for row in rows]
                if any(tints[row][3] < 1.0 for row in rows):
                    self._warn("colours of triangles of the 3MF file are see-through: they are drawn opaque")
            elif bases is not None or tints is not None:
                wrong += 1
        if wrong:
            self._warn(f"{wrong} of {count} triangles use colours that do not exist: they are drawn grey")
        return material, None if colors is None else _linear(colors)


def _linear(srgb: Any) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
