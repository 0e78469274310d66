"""The printed form: hello.scene's whole text, stable, and its data as JSON has it."""

from __future__ import annotations

import json

import numpy as np
from maquette.compiler.scene import dump, serialize

HELLO = """
param radius = 1 in 0.2..2  "sphere radius"

let grey = checker(#e8e8e8, #8a8a8a, size: 50cm)
let red  = blinn_phong(#d0402a, specular: 0.04, shininess: 80)

plane(y: 0, material: lambert(grey))
sphere(center: [0, radius, 0], radius: radius, material: red)

sun(from: [2, 4, 3], illuminance: 20000lx)
sky(color: #87b5e0, luminance: 3000nit)

camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
render(size: [800, 600], error: 1%)
"""

PRINTED = """\
scene hello
  size: [800 600]
  error: 0.01
  photometric: true
transforms 3
  0: matrix=[[1 0 0 0] [0 1 0 0] [0 0 1 0]]
  1: matrix=[[1 0 0 0] [0 1 0 1] [0 0 1 0]]
  2: matrix=[[1 0 0 0] [0 0.992876838 0.119145221 1.6] [0 -0.119145221 0.992876838 5]]
geometries 2
  0: plane bounds=[[-inf 0 -inf] [inf 0 inf]]
  1: sphere parameters=[1] bounds=[[-1 -1 -1] [1 1 1]]
instances 2
  0: "plane" geometry=0 material=0
  1: "sphere" geometry=1 transform=1 material=1
materials 2
  0: lambert ambient=[1 1 1] diffuse=[1 1 1] ambient*=texture 0 diffuse*=texture 0
  1: blinn_phong ambient=[0.630757136 0.0512694584 0.0231533662] diffuse=[0.630757136 0.0512694584 0.0231533662] \
specular=[0.04 0.04 0.04] shininess=80 ior=1.5
textures 1
  0: checker size=0.5 color_a=[0.806952258 0.806952258 0.806952258] color_b=[0.254152094 0.254152094 0.254152094]
images 1
  0: "even sky" first=0 width=16 height=256 #ed8f363afa
lights 2
  0: sun color=[20000 20000 20000] direction=[0.371390676 0.742781353 0.557086015] angle=0.00462512252
  1: dome color=[3000 3000 3000] image=0
cameras 1
  0: transform=2 extent=0.315298789
"""


def renamed(text: str) -> str:
    """Without the test's own folder."""
    lines = text.splitlines()
    return "\n".join(["scene hello", *lines[1:]]) + "\n"


def test_hello(compiled) -> None:
    assert renamed(dump.text(compiled(HELLO))) == PRINTED


def test_meshes_are_counts_and_hashes(compiled) -> None:
    text = dump.text(compiled('polygon([[0,0,0],[1,0,0],[1,1,0],[0,1,0]], name: "tile")\ncamera([0,0,5])\nsun()'))
    lines = text.splitlines()
    at = lines.index("pools")
    assert [line.split(" #")[0] for line in lines[at : at + 6]] == [
        "pools", "  positions: 4", "  triangles: 2", "  values: 8", "  loops: 1", "  corners: 4",
    ]  # fmt: skip
    assert "  0: mesh bounds=[[0 0 0] [1 1 0]] origin=[0.5 0.5 0] vertex_count=4 triangle_count=2 polygon_count=1 uvs=0" in lines
    assert '  0: "tile" geometry=0 material=0' in lines


def test_the_text_changes_with_the_content_alone(compiled) -> None:
    mesh = "mesh(points: [[0,0,0],[1,0,0],[0,{},0]], faces: [[0,1,2]])\ncamera([0,0,5])\nsun()"
    one, same, other = (dump.text(compiled(mesh.format(y))) for y in ("1", "1.0", "1.0001"))
    assert one == same != other


def test_many_rows_are_summed_up(compiled) -> None:
    text = dump.text(compiled("for (k in 1..1500) { sphere(1, translate: [k, 0, 0]) }\ncamera([0,0,5])\nsun()"))
    assert "instances 1500" in text
    assert sum(line.startswith("  … 500 more #") for line in text.splitlines()) == 1  # of the instances
    assert sum(line.startswith("  … 502 more #") for line in text.splitlines()) == 1  # of the transforms


def test_data_is_json(compiled) -> None:
    scene = compiled(HELLO)
    data = json.loads(json.dumps(dump.data(scene), allow_nan=False))
    assert data["hash"] == serialize.content_hash(scene)
    assert data["geometries"][1]["kind"] == "sphere"
    assert data["geometries"][0]["bounds"] == [[None, 0, None], [None, 0, None]]  # JSON has no infinity
    assert data["instances"][1] == {"name": "sphere", "geometry": 1, "transform": 1, "material": 1, "light": -1, "visible": 7}
    assert data["params"][0]["name"] == "radius"
    assert data["size"] == [800, 600]


def test_hashes_are_of_the_content() -> None:
    assert dump.short_hash(np.zeros(3)) == dump.short_hash(np.zeros(6)[::2]) != dump.short_hash(np.zeros(4))


def test_one_row_as_text_by_column(compiled) -> None:
    scene = compiled("sphere(2, material: phong(#ffffff, specular: 0.5, shininess: 9))")
    assert dump.cells(scene, "geometries", 0) == {"kind": "sphere", "parameters": "[2]", "bounds": "[[-2 -2 -2] [2 2 2]]"}
    assert dump.cells(scene, "materials", 0) == {
        "model": "phong", "ambient": "[1 1 1]", "diffuse": "[1 1 1]", "specular": "[0.5 0.5 0.5]",
        "shininess": "9", "ior": "1.5",
    }  # fmt: skip
