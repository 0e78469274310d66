"""The formats of files that are read, a row each; units and axes of mesh files; whether data is text."""

from __future__ import annotations

from dataclasses import dataclass

from . import text_encoding


@dataclass(frozen=True, slots=True)
class Reader:
    """One format.

    `kind` is "scene" for the language, "stage" for USD, "saved" for tables, "mesh" for everything that the element `mesh` places.
    `module`, in compiler/importers, reads a mesh: its function `parts` takes a common.mesh_parts.MeshFile; it is loaded for such a
    file alone. `unit` and `up` are those of files that say neither; without them, every file says both. `contents` is for docs/meshes.md.
    """

    name: str
    endings: tuple[str, ...]
    kind: str
    module: str = ""
    unit: str = ""
    up: str = ""
    contents: str = ""
    animated: bool = False


READERS = (
    Reader("scene", (".scene",), "scene"),
    Reader("USD", (".usd", ".usda", ".usdc", ".usdz"), "stage"),
    Reader("MaterialX", (".mtlx",), "stage"),
    Reader("OBJ", (".obj",), "mesh", "obj", "m", "y", "polygons and points with materials of a .mtl file and pictures"),
    Reader("PLY", (".ply",), "mesh", "ply", "m", "y", "polygons and points with colours and a picture"),
    Reader("STL", (".stl",), "mesh", "stl", "mm", "z", "triangles, in VisCAM's form with colours"),
    Reader(
        "glTF", (".glb", ".gltf"), "mesh", "gltf", animated=True,
        contents="a scene in metres, y up: meshes, materials, pictures, lights, cameras, animations",
    ),
    Reader("OFF", (".off",), "mesh", "off", "m", "y", "polygons and points with colours"),
    Reader(
        "3MF", (".3mf",), "mesh", "assemblies.threemf",
        contents="parts for printing, with colours: millimetres and z up where the file does not say",
    ),
    Reader("XYZ", (".xyz",), "mesh", "xyz", "m", "z", "points with colours"),
    Reader("saved tables", (".npz",), "saved"),
)


def _endings(kind: str) -> tuple[str, ...]:
    return tuple(ending for reader in READERS if reader.kind == kind for ending in reader.endings)


SCENE, USD, MESH, SAVED = (_endings(kind) for kind in ("scene", "stage", "mesh", "saved"))
OPENED = (*SCENE, *USD, *MESH)  # what commands and the live window open
ANIMATED = tuple(ending for reader in READERS if reader.animated for ending in reader.endings)
_BY_ENDING = {ending: reader for reader in READERS for ending in reader.endings}
FONT = (".ttf", ".otf", ".ttc")
# Metres in the units of length of mesh files.
UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "um": 1e-6, "km": 1000.0, "in": 0.0254, "inch": 0.0254, "ft": 0.3048}
AXES = ("x", "y", "z")
MOST_ZEROS = 1 / 16  # share of zero bytes in a text; UTF-16 has about a half


def reader_of(path: str) -> Reader | None:
    """The row of READERS for a file of this name; None for other formats."""
    _, dot, ending = path.rpartition(".")
    return _BY_ENDING.get(dot + ending.lower())


def assumed(field: str) -> str:
    """What is assumed of mesh files that say no unit or up axis (`field`): mm for .stl, m for the others."""
    rows = [(getattr(reader, field), reader.endings) for reader in READERS if getattr(reader, field)]
    values = [value for value, _ in rows]
    usual = max(dict.fromkeys(values), key=values.count)
    others = {value: [e for v, endings in rows if v == value for e in endings] for value in dict.fromkeys(values) if value != usual}
    return ", ".join([*(f"{value} for {' and '.join(endings)}" for value, endings in others.items()), f"{usual} for the others"])


def is_binary(data: bytes) -> bool:
    """Whether zero bytes show that data is not text. A UTF-8 text with stray ones is parsed, so that they are errors with their places."""
    if b"\0" not in data or text_encoding.is_wide(data):
        return False
    try:
        data.decode()
    except UnicodeDecodeError:
        return True
    return data.count(0) > len(data) * MOST_ZEROS
