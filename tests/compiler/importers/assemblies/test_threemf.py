"""3MF: units, transforms, components, colours, models of other parts; and archives and documents of attackers."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers import mesh_files
from maquette.compiler.importers.assemblies import safe_xml, threemf
from maquette.compiler.importers.common.mesh_options import MeshOptions
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang.diagnostics import Diagnostics

AS_SAID = MeshOptions()
MODEL = "3D/3dmodel.model"
RELATIONS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="a" Target="/{}" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
CORNER = '<vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="2" z="0"/><vertex x="0" y="0" z="3"/></vertices>'
FACES = (
    '<triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/><triangle v1="0" v2="3" v3="2"/><triangle v1="1" v2="2" v3="3"/>'
)
MESH = f"<mesh>{CORNER}<triangles>{FACES}</triangles></mesh>"


def model(resources: str, build: str, unit: str = "millimeter", before: str = "") -> str:
    return (
        f'<?xml version="1.0"?>{before}<model unit="{unit}" xmlns="{threemf.CORE}" '
        'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" '
        'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06">'
        f"<resources>{resources}</resources><build>{build}</build></model>"
    )


def archive(parts: Mapping[str, str | bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in parts.items():
            made.writestr(name, content)
    return out.getvalue()


def read(data: bytes | str, options: MeshOptions = AS_SAID) -> tuple[ir.Scene | None, list[Any], list[str]]:
    """(scene, parts, messages) of a package, or of its only model."""
    found = Diagnostics()
    builder = SceneBuilder(found)
    whole = data if isinstance(data, bytes) else archive({MODEL: data})
    parts = mesh_files.read(whole, "a.3mf", builder, found, options=options)
    for part in parts:
        assert part.transform is not None
    boxes = [builder.bounds(p.geometry, np.vstack([np.asarray(p.transform), [0, 0, 0, 1]])).round(9).tolist() for p in parts]
    return (builder.finish() if parts else None), boxes, [f"{d.severity}: {d.message}" for d in found.items]


@pytest.mark.parametrize(("unit", "metres"), threemf.UNITS.items())
def test_units(unit: str, metres: float) -> None:
    """A tetrahedron of 1, 2 and 3 units along x, y and z of the file, where z is up: y is height, and -z depth."""
    _, boxes, messages = read(model(f'<object id="1">{MESH}</object>', '<item objectid="1"/>', unit))
    assert messages == []
    assert boxes == [pytest.approx(np.array([[0, 0, -2], [1, 3, 0]]) * metres, abs=1e-7)]


def test_an_option_precedes_the_unit_of_the_file() -> None:
    text = model(f'<object id="1">{MESH}</object>', '<item objectid="1"/>', "inch")
    assert read(text, MeshOptions("m", "y"))[1] == [[[0, 0, 0], [1, 2, 3]]]


def test_an_unknown_unit_is_told() -> None:
    _, boxes, messages = read(model(f'<object id="1">{MESH}</object>', '<item objectid="1"/>', "parsec"))
    assert messages == ["warning: the 3MF file has the unit `parsec`, which is not known: millimeter is taken"]
    assert boxes[0][1] == [0.001, 0.003, 0]


def test_transforms_and_components() -> None:
    """The rows of a transform are images of the axes: x → 2 y, y → -x, z → z, then a move by (10, 0, 0)."""
    turned = "0 2 0 -1 0 0 0 0 1 10 0 0"
    resources = (
        f'<object id="1" name="leaf">{MESH}</object>'
        f'<object id="2"><components><component objectid="1"/><component objectid="1" transform="{turned}"/></components></object>'
    )
    scene, boxes, messages = read(model(resources, '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 5"/>', "meter"))
    assert messages == []
    assert boxes == [[[0, 5, -2], [1, 8, 0]], [[8, 5, -2], [10, 8, 0]]]
    assert scene is not None
    assert len(scene.tables.geometries.kind) == 1


def test_materials_and_colours() -> None:
    looks = (
        '<basematerials id="5"><base name="red" displaycolor="#FF0000"/><base name="glass" displaycolor="#00FF0080"/></basematerials>'
        '<m:colorgroup id="6"><m:color color="#0000FF"/><m:color color="#FFFFFF"/></m:colorgroup>'
    )
    faces = (
        '<triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3" pid="5" p1="1"/>'
        '<triangle v1="0" v2="3" v3="2" pid="6" p1="0" p2="1" p3="0"/><triangle v1="1" v2="2" v3="3" pid="5" p1="9"/>'
    )
    body = f'{looks}<object id="1" pid="5" pindex="0"><mesh>{CORNER}<triangles>{faces}</triangles></mesh></object>'
    scene, _, messages = read(model(body, '<item objectid="1"/>'))
    assert messages == ["warning: 1 of 4 triangles use colours that do not exist: they are drawn grey"]
    assert scene is not None
    tables = scene.tables
    assert scene.names.materials[:2] == ("red", "glass")
    assert tables.materials.values[:2, ir.Slot.DIFFUSE].tolist() == [[1, 0, 0], [0, 1, 0]]
    assert tables.materials.values[:2, ir.Slot.OPACITY, 0].tolist() == pytest.approx([1, 128 / 255])
    assert tables.geometries.triangle_count.tolist() == [2, 1, 1]


def test_models_of_other_parts() -> None:
    """As Bambu Studio and PrusaSlicer write them, with the production extension; a model may have a unit of its own."""
    part = model(f'<object id="7">{MESH}</object>', "", "meter")
    whole = model(
        '<object id="1"><components><component p:path="/3D/Objects/a.model" objectid="7"/></components></object>', '<item objectid="1"/>'
    )
    data = archive({"_rels/.rels": RELATIONS.format("3D/other.model"), "3D/other.model": whole, "3D/Objects/a.model": part})
    _, boxes, messages = read(data)
    assert boxes == [pytest.approx(np.array([[0, 0, -2], [1, 3, 0]]), abs=1e-6)]
    assert messages == []


def test_what_is_not_drawn_is_told() -> None:
    body = f'<m:texture2dgroup id="3" texid="4"/><object id="1">{MESH}</object>'
    _, boxes, messages = read(model(body, '<item objectid="1"/><item objectid="8"/>'))
    assert len(boxes) == 1
    assert messages == [
        "warning: the 3MF file has textures of triangles, which are not drawn",
        "warning: the 3MF file has no object `8`, which is used: it is left out",
    ]


def test_damaged_triangles_are_left_out() -> None:
    bad = CORNER.replace('x="1"', 'x="nan"')
    faces = (
        '<triangle v1="0" v2="2" v3="3"/><triangle v1="0" v2="1" v3="3"/>'
        '<triangle v1="0" v2="3" v3="99"/><triangle v1="-1" v2="0" v3="3"/>'
    )
    body = f'<object id="1"><mesh>{bad}<triangles>{faces}</triangles></mesh></object>'
    scene, _, messages = read(model(body, '<item objectid="1"/>'))
    assert messages == ["warning: 3 of 4 triangles use vertices that do not exist or are not finite: they are left out"]
    assert scene is not None
    assert len(scene.tables.pools.triangles) == 1


NESTED = "<a>" * 70 + "</a>" * 70
HUGE = f'<object id="1"><mesh>{CORNER}<triangles><triangle v1="0" v2="1" v3="{10**30}"/></triangles></mesh></object>'


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"rubbish", "error: this is not a 3MF file: it is not a zip archive"),
        (archive({"a.txt": "x"}), "error: the 3MF file has no model"),
        (archive({MODEL: "<model"}), "error: line 1 of 3D/3dmodel.model is not XML: "),
        (model("", ""), "error: the 3MF file shows no mesh: its build has no items"),
        (model(MESH, '<item objectid="1"/>'), "warning: the 3MF file has no object `1`, which is used: it is left out"),
        (model('<object id="1"><mesh><vertices><vertex x="a" y="0" z="0"/></vertices></mesh></object>', ""),
         "error: line 1 of 3D/3dmodel.model: an attribute of a `vertex` is not a number"),
        (model('<object id="1"><mesh><vertices><vertex y="0" z="0"/></vertices></mesh></object>', ""),
         "error: line 1 of 3D/3dmodel.model: a `vertex` has no attribute 'x'"),
        (model(f'<object id="1">{MESH}</object>', '<item objectid="1" transform="1 2"/>'),
         "error: line 1 of 3D/3dmodel.model: an attribute of a `item` is not a number"),
        (model(NESTED, ""), f"error: line 1 of 3D/3dmodel.model: its elements stand more than {safe_xml.DEEPEST} deep in each other"),
        (model(HUGE, '<item objectid="1"/>'), "warning: 1 of 1 triangles use vertices"),
        (model("", "", before='<!DOCTYPE model [<!ENTITY a "b"><!ENTITY c "&a;&a;">]>'),
         "error: line 1 of 3D/3dmodel.model: it has a document type, which may hold entities: these are not read"),
        (model("", "", before='<!DOCTYPE model SYSTEM "file:///etc/passwd">'), "error: line 1 of 3D/3dmodel.model: it has a document type"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "data",  # archives hold the time
)  # fmt: skip
def test_broken_files(data: bytes | str, told: str) -> None:
    scene, _, messages = read(data)
    assert scene is None
    assert messages[0].startswith(told)


def test_components_in_circles_end() -> None:
    body = (
        f'<object id="1">{MESH}</object><object id="2"><components><component objectid="1"/><component objectid="3"/></components></object>'
        '<object id="3"><components><component objectid="2"/></components></object>'
    )
    _, boxes, messages = read(model(body, '<item objectid="2"/>'))
    assert len(boxes) == 1
    assert messages == ["warning: components of the 3MF file contain each other: they are left out where they begin again"]


def test_components_that_multiply_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threemf, "MOST_PLACES", 2000)
    twice = '<object id="{}"><components><component objectid="{}"/><component objectid="{}"/></components></object>'
    pairs = "".join(twice.format(k, k - 1, k - 1) for k in range(2, 40))
    _, boxes, messages = read(model(f'<object id="1">{MESH}</object>{pairs}', '<item objectid="39"/>'))
    assert 0 < len(boxes) < 2000
    assert messages == ["warning: the 3MF file places more than 2,000 objects: the rest is left out"]


def test_archives_that_unpack_to_too_much_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threemf, "MOST_BYTES", 1 << 20)
    assert read(archive({MODEL: b" " * (3 << 20)}))[2] == ["error: the models of the 3MF file have more than 1 MiB"]
    damaged = bytearray(archive({MODEL: model(f'<object id="1">{MESH}</object>', '<item objectid="1"/>')}))
    damaged[60:90] = b"x" * 30
    assert read(bytes(damaged))[2][0].startswith("error: the part `/3D/3dmodel.model` of the 3MF file cannot be unpacked: ")
