"""A table by the kinds of an enumeration has each kind, or is listed with the reason why not."""

from __future__ import annotations

import enum
import importlib
from pathlib import Path
from types import ModuleType

from maquette.compiler import ir

ROOT = Path(__file__).resolve().parent.parent
KINDS = [kind for kind in vars(ir).values() if isinstance(kind, type) and issubclass(kind, enum.Enum) and kind is not enum.Enum]
NOT_ALL = {  # the module of a table and its enumeration: why some kinds are not in it
    "shapes: GeometryKind": "meshes and formulas are no analytic shapes",
    "compiler.exporters.gltf.materials: Wrap": "glTF's samplers do not end in black: it is reported",
    "compiler.exporters.language.shapes: GeometryKind": "meshes are files, and formulas triangles",
    "compiler.exporters.material_values: MaterialModel": "others are UsdPreviewSurface, which has all of them",
    "compiler.exporters.mitsuba.materials: Wrap": "Mitsuba's bitmaps do not end in black: it is reported",
    "compiler.scene.builder: Interpolation": "a constant has one value",
    "materials.losses: Slot": "other inputs bear the names of the enumeration",
    "materials.openpbr: Slot": "slabs that are glass alone may have any value in the other inputs",
    "compiler.scene.validate: GeometryKind": "measures of a mesh are those of its triangles",
}


def modules() -> list[ModuleType]:
    """The modules of the IR's readers and writers, of plan and renderer."""
    names = []
    for package in ("compiler", "render", "shapes", "lights", "materials"):
        for path in sorted((ROOT / package).rglob("*.py")):
            names.append("maquette." + ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"))
    return [importlib.import_module(name) for name in names if ".cluster" not in name]  # which needs an extra


def tables() -> list[tuple[str, dict[enum.Enum, object]]]:
    """Each table by one kind of the IR, with its module, the one of the shortest name, and its enumeration."""
    tables: dict[int, tuple[str, dict[enum.Enum, object]]] = {}
    for module in modules():
        for value in vars(module).values():
            if isinstance(value, dict) and value and len(types := {type(key) for key in value}) == 1 and types <= set(KINDS):
                title = f"{module.__name__.removeprefix('maquette.')}: {types.pop().__name__}"
                if id(value) not in tables or len(title) < len(tables[id(value)][0]):
                    tables[id(value)] = title, value
    return list(tables.values())


def test_each_table_has_each_kind_or_a_reason() -> None:
    missing = {}
    for name, table in tables():
        if lacking := set(type(next(iter(table)))) - set(table):
            missing[name] = sorted(kind.name for kind in lacking)
    assert {name: kinds for name, kinds in missing.items() if name not in NOT_ALL} == {}
    assert set(NOT_ALL) <= set(missing), "a table that is whole, or gone, needs no reason"
