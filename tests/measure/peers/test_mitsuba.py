"""Mitsuba renders the same pictures: lights, cameras, textures, path depth. Skipped if it is not installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from maquette.measure.peers import process, registry
from maquette.measure.records import Setting

from ...files import write_image
from . import peer_scenes as scenes

MITSUBA = registry.find(["mitsuba"])[0]
pytestmark = pytest.mark.skipif(bool(MITSUBA.missing), reason=MITSUBA.missing)

SAME = {  # text, samples of ours and theirs, bounces, bound on the blocks' √relMSE
    "point": (scenes.VIEW + scenes.FLOOR + scenes.BALL + scenes.BLOCK + scenes.LAMP, 64, None, 0.01),
    "sun and sky": (scenes.VIEW + scenes.FLOOR + scenes.BALL + scenes.SUN + scenes.SKY, 256, None, 0.01),
    "area": (
        scenes.VIEW + scenes.FLOOR + scenes.BALL + "area(size: [1.5, 1], position: [1, 3, 1], look_at: [0, 0.5, 0], radiance: 5)",
        256, None, 0.02,
    ),
    "mirrored area": (
        scenes.VIEW + scenes.FLOOR + scenes.BALL
        + "transform(rotate: [0, 10deg, 10deg], scale: [1, 1, -1]) {\n"
        + "area(size: [1.5, 1], position: [1, 3, -1], look_at: [0, 0.5, 0], radiance: 5) }",
        256, None, 0.02,
    ),
    "round area": (
        scenes.VIEW + scenes.FLOOR + 'area(size: [1.5, 1.5], shape: "disk", position: [1, 3, 1], look_at: [0, 0.5, 0], radiance: 5)',
        256, None, 0.02,
    ),
    "sphere light, lit twice over": (
        scenes.VIEW + scenes.FLOOR + scenes.SHINING + scenes.BLOCK,
        256, 2, 0.03,
    ),
    "spot": (
        scenes.VIEW + scenes.FLOOR + scenes.SPOT, 64, None, 0.01,
    ),
    "checker": (scenes.VIEW + scenes.CHECKER + scenes.BALL + scenes.LAMP, 256, None, 0.01),
    "stripes": (scenes.VIEW + scenes.STRIPES + scenes.LAMP, 256, None, 0.01),
    "picture on a mesh": (scenes.VIEW + scenes.PICTURE + scenes.LAMP, 64, None, 0.01),
    "mirror": (scenes.VIEW + scenes.FLOOR + scenes.MIRROR + scenes.BLOCK + scenes.SKY, 256, 6, 0.01),
    "glass": (scenes.VIEW + scenes.CHECKER + scenes.GLASS + scenes.BLOCK + scenes.SKY, 256, 8, 0.01),
    "orthographic": (scenes.ORTHOGRAPHIC + scenes.CHECKER + scenes.BALL + scenes.LAMP, 256, None, 0.01),
    "shifted and cropped": (scenes.SHIFTED + scenes.CHECKER + scenes.BALL + scenes.LAMP, 256, None, 0.01),
    "round shapes": (scenes.VIEW + scenes.FLOOR + scenes.ROUND + scenes.LAMP, 64, None, 0.01),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_it_draws_the_same(name: str, tmp_path: Path) -> None:
    text, samples, bounces, bound = SAME[name]
    write_image(tmp_path / "noise.exr", np.random.default_rng(0).uniform(0.1, 0.9, (5, 7, 3)).astype(np.float32))
    ours, theirs = scenes.both("mitsuba", tmp_path, text, samples, samples, bounces=bounces)
    _, of_blocks, of_means = scenes.apart(ours, theirs)
    assert of_blocks < bound
    assert of_means < 3e-3


def test_a_dome_stands_the_same_way(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).uniform(0.1, 1.0, (8, 16, 3)).astype(np.float32)
    pixels[1:3, 3:5] = 20.0
    write_image(tmp_path / "dome.exr", pixels)
    text = scenes.VIEW + scenes.FLOOR + scenes.BALL + 'dome("dome.exr", rotate: [0, 40deg, 0], radiance: 0.7)'
    _, of_blocks, of_means = scenes.apart(*scenes.both("mitsuba", tmp_path, text, 256, 256))
    assert of_blocks < 0.03
    assert of_means < 3e-3


def test_a_tent_filter_is_the_same(tmp_path: Path) -> None:
    text = scenes.VIEW + scenes.CHECKER + scenes.BALL + scenes.LAMP
    tent = scenes.both("mitsuba", tmp_path, text, 256, 256, filter="tent")
    box = scenes.both("mitsuba", tmp_path, text, 256, 256, filter="box")
    assert scenes.apart(*tent)[0] < 0.04
    assert scenes.apart(tent[0], box[1])[0] > 0.1  # the two filters are told apart


def test_more_bounces_are_brighter_by_the_same(tmp_path: Path) -> None:
    text = scenes.VIEW + scenes.FLOOR + scenes.BALL + scenes.SKY
    one, three = (scenes.both("mitsuba", tmp_path, text, 256, 256, bounces=n) for n in (1, 3))
    gained = [(after - before).mean() for before, after in zip(one, three, strict=True)]
    assert gained[0] > 1e-3
    assert gained[1] == pytest.approx(gained[0], rel=0.05)


def test_seeds_differ_and_repeat(tmp_path: Path) -> None:
    scene, plan = scenes.compiled(tmp_path, scenes.VIEW + scenes.FLOOR + scenes.SKY, samples=4, threads=1)
    setting = Setting("mitsuba", "samples", 4, {"samples": 4})
    first, again, other = (MITSUBA.run(scene, plan, setting, seed).rgb for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_its_sweep_improves(tmp_path: Path) -> None:
    scene, plan = scenes.compiled(tmp_path, scenes.VIEW + scenes.FLOOR + scenes.SKY)
    sweep = MITSUBA.sweep(scene, plan)
    assert [s.options["samples"] for s in sweep] == [1, 4, 16, 64, 256, 1024, 4096]
    assert sweep[1].arguments() == "--backend mitsuba --samples 4"


def test_its_own_words_are_given_back(tmp_path: Path) -> None:
    with pytest.raises(process.PeerError, match=r"Mitsuba failed: .*no-such-file"):
        process.run("Mitsuba", ["python3", "-c", "import sys; sys.exit('no-such-file')"], tmp_path)
