"""Tests of the measured number of photons."""

from __future__ import annotations

import re
from pathlib import Path

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.render.backends import photon_effort

ROOM = """
box([3, 0.1, 3], center: [0, -0.05, 0], material: lambert(0.6))
box([0.1, 2.5, 3], center: [-1.55, 1.25, 0], material: lambert(0.6))
box([3, 2.5, 0.1], center: [0, 1.25, -1.55], material: lambert(0.6))
camera(position: [1.3, 1.4, 1.3], look_at: [-0.5, 0.6, -0.8], fov: 65deg)
render(bounces: 6)
"""
BULB = """
sphere(0.06, center: [0, 1.5, -0.5], material: glass())
sphere(0.02, center: [0, 1.5, -0.5], material: emissive(1, luminance: 3000))
"""
BALL = "sphere(0.2, center: [0.3, 0.2, 0], material: glass())\npoint([0.3, 2, 0.3], intensity: 10)\n"


@pytest.fixture
def found(tmp_path, monkeypatch):
    measured, measure = [], photon_effort.measure

    def record(*of):
        measured.append(measure(*of))
        return measured[-1]

    def run(text, **settings):
        path = tmp_path / "a.scene"
        path.write_text(ROOM + text, encoding="utf-8")
        monkeypatch.setattr(photon_effort, "measure", record)
        image = maquette.render(path, size=(96, 64), **settings).channels["rgba"]
        return image, measured.pop()

    return run


def test_light_that_photons_alone_carry_gets_many(found):
    """In a room that a bulb lights most noise is that of photons, under a point light that of few pixels in the caustic."""
    assert found(BULB, samples=1)[1] >= 16.0
    assert found(BALL, samples=1)[1] <= 3.0


@pytest.mark.long
def test_the_number_does_not_depend_on_threads(found):
    """With an error, rounds end where photons are renewed."""
    by_one, by_two = (found(BULB, error=0.3, samples=256, threads=n) for n in (1, 2))
    assert by_one[1] == by_two[1]
    assert np.array_equal(by_one[0], by_two[0])


def test_photons_need_no_medium(tmp_path: Path) -> None:
    """A scene with caustics of plain glass, without a medium, is explained."""
    text = "sphere(1, material: glass())\nplane(y: -2)\nspot([0, 4, 0], look_at: [0, 0, 0])\ncamera([0, 1, 6], look_at: [0, 0, 0])\n"
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(cli, ["explain", str(tmp_path / "a.scene"), "--bounces", "3"])
    assert done.exit_code == 0, done.output
    assert re.search(r"transport\.caustics +photons", done.output)
