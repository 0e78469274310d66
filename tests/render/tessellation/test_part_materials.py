"""Materials in files for printing: each triangle has that of the part it came from."""

from __future__ import annotations

import xml.etree.ElementTree as xml
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli

NAMESPACE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
PIN = """
unit mm
union(round: 1%s) {
  box([20, 10, 20], center: [0, 5, 0], material: lambert(#c02020))
  cylinder(radius: 5, height: 30, center: [0, 15, 0], material: lambert(#2040c0))
}
"""


def model_of(folder: Path, text: str) -> xml.Element:
    """The model of the .3mf file that `convert` writes of a scene."""
    scene, out = folder / "a.scene", folder / "a.3mf"
    scene.write_text(text, encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(scene), str(out)])
    assert done.exit_code == 0, done.output
    with zipfile.ZipFile(out) as archive:
        return xml.fromstring(archive.read("3D/3dmodel.model"))


def colors(model: xml.Element) -> list[str]:
    return [base.get("displaycolor", "") for base in model.iter(f"{NAMESPACE}base")]


@pytest.mark.long
@pytest.mark.parametrize("seams", ["", ', seams: "blended"'])
def test_a_triangle_has_the_material_of_its_part(tmp_path: Path, seams: str) -> None:
    model = model_of(tmp_path, PIN % seams)
    assert colors(model) == ["#C02020", "#2040C0"]
    (solid,) = model.iter(f"{NAMESPACE}object")
    corners = np.array([[float(v.get(name, "")) for name in "xyz"] for v in solid.iter(f"{NAMESPACE}vertex")])
    triangles = list(solid.iter(f"{NAMESPACE}triangle"))
    centers = np.array([corners[[int(t.get(name, "")) for name in ("v1", "v2", "v3")]].mean(axis=0) for t in triangles])
    assert {t.get("pid") for t in triangles} == {"1"}
    of_pin = np.array([t.get("p1") == "1" for t in triangles])
    beyond, on_box = centers[:, 2] > 11.5, np.hypot(centers[:, 0], centers[:, 1]) > 6.5  # outside of the fillet; z is up
    assert beyond.any()
    assert on_box.any()
    assert of_pin[beyond].all()
    assert not of_pin[on_box].any()


def test_one_material_is_that_of_the_object(tmp_path: Path) -> None:
    model = model_of(tmp_path, 'unit mm\nbox(4, material: metal("gold"))\nsphere(2, center: [9, 0, 0], material: lambert(1))\n')
    assert colors(model) == ["#FFDEA3", "#FFFFFF"]
    assert [(o.get("pid"), o.get("pindex")) for o in model.iter(f"{NAMESPACE}object")] == [("1", "0"), ("1", "1")]
    assert {t.get("pid") for t in model.iter(f"{NAMESPACE}triangle")} == {None}
