"""POV-Ray renders the same pictures, sample for sample, to half floats. Skipped if it is not installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from maquette.measure.peers import registry

from ...files import write_image
from . import peer_scenes as scenes

POVRAY = registry.find(["povray"])[0]
pytestmark = pytest.mark.skipif(bool(POVRAY.missing), reason=POVRAY.missing)

HALF = 5e-4  # a half float's spacing, relative, and no more
SAME = {
    "point": scenes.VIEW + scenes.FLOOR + scenes.BALL + scenes.BLOCK + scenes.LAMP,
    "directional": scenes.VIEW + scenes.FLOOR + scenes.BALL + "directional(from: [2, 4, 3], irradiance: 3)",
    "spot": scenes.VIEW + scenes.FLOOR + scenes.SPOT,
    "highlights and ambient light": scenes.VIEW
    + scenes.FLOOR
    + "sphere(0.8, center: [0, 0.8, 0], material: phong(rgb(0.5, 0.2, 0.1), specular: 0.4, shininess: 20))\n"
    + "sphere(0.5, center: [1.2, 0.5, 1], material: blinn_phong(rgb(0.1, 0.2, 0.5), specular: 0.4, shininess: 30))\n"
    + "ambient(rgb(0.1, 0.1, 0.2))\n"
    + scenes.LAMP,
    "checker": scenes.VIEW + scenes.CHECKER + scenes.BALL + scenes.LAMP,
    "stripes": scenes.VIEW + scenes.STRIPES + scenes.LAMP,
    "picture on a mesh": scenes.VIEW + scenes.PICTURE + scenes.LAMP,
    "mirror": scenes.VIEW + scenes.FLOOR + scenes.MIRROR + scenes.BLOCK + scenes.LAMP,
    "mirror and sky": scenes.VIEW + scenes.MIRROR + scenes.SKY,
    "glass": scenes.VIEW + scenes.CHECKER + scenes.GLASS + scenes.BLOCK + scenes.LAMP,
    "orthographic": scenes.ORTHOGRAPHIC + scenes.CHECKER + scenes.BALL + scenes.LAMP,
    "shifted and cropped": scenes.SHIFTED + scenes.CHECKER + scenes.BALL + scenes.LAMP,
}


@pytest.mark.parametrize("name", SAME)
def test_every_pixel_is_the_same(name: str, tmp_path: Path) -> None:
    write_image(tmp_path / "noise.exr", np.random.default_rng(0).uniform(0.1, 0.9, (5, 7, 3)).astype(np.float32))
    ours, theirs = scenes.both("povray", tmp_path, SAME[name], 1, 1)
    assert scenes.apart(ours, theirs)[0] < HALF


def test_round_shapes_differ_at_their_outlines_only(tmp_path: Path) -> None:
    ours, theirs = scenes.both("povray", tmp_path, scenes.VIEW + scenes.FLOOR + scenes.ROUND + scenes.LAMP, 1, 1)
    off = np.abs(ours - theirs).max(axis=2) > HALF * ours.max()
    assert off.mean() < 1e-3


def test_a_grid_of_samples_is_taken(tmp_path: Path) -> None:
    text = scenes.VIEW + scenes.CHECKER + scenes.BALL + scenes.LAMP
    one, many = (scenes.both("povray", tmp_path, text, 256, n) for n in (1, 64))
    assert scenes.apart(*many)[0] < 0.06
    assert scenes.apart(*one)[0] > 0.2


def test_its_sweep_improves(tmp_path: Path) -> None:
    scene, plan = scenes.compiled(tmp_path, scenes.VIEW + scenes.FLOOR + scenes.LAMP)
    assert [s.options["samples"] for s in POVRAY.sweep(scene, plan)] == [1, 4, 9, 16, 36, 64]
