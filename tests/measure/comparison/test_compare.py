"""Comparisons of hand-made pictures and small renders: objects, outlines, noise, bias, encodings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import flip_evaluator
import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.measure import errors
from maquette.measure.comparison import compare, object_errors, sides
from maquette.measure.comparison.sides import Side
from maquette.render.image import image_files, metrics
from maquette.render.image.image import Image

SCENE = """\
sphere(0.6, center: [-0.8, 0, 0], material: lambert(#c04030), name: "ball")
box(0.9, center: [0.8, 0, 0], material: lambert(#3060c0))
point([0, 3, 6], intensity: 60)
sky(luminance: 0.5)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 40deg)
render(size: [48, 32])
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> ir.Scene:
    path = tmp_path_factory.mktemp("compare") / "two.scene"
    path.write_text(SCENE, encoding="utf-8")
    return maquette.load(path)


def drawn(scene: ir.Scene, **settings: Any) -> Side:
    return sides.render(scene, sides.make_plan(scene, ir.Settings(**{"samples": 4, **settings})), "two")


def painted(rgb: np.ndarray, ids: Any = None, depth: Any = None, coverage: Any = None, **metadata: Any) -> Side:
    """A side of these pixels; ids and depth (h, w)."""
    h, w = rgb.shape[:2]
    channels = {"rgba": np.dstack([rgb, np.ones((h, w)) if coverage is None else coverage]).astype(np.float32)}
    if ids is not None:
        channels["id"] = np.dstack([ids, ids]).astype(np.float32)
    if depth is not None:
        channels["depth"] = np.asarray(depth, np.float32)[..., None]
    return Side("painted", Image(w, h, channels, {"size": (w, h), "crop": (0, 0, w, h), "bits": 0, "about": {}, **metadata}))


def test_shares_belong_to_the_pixels_of_an_object() -> None:
    b = np.ones((2, 4, 3))
    a = b.copy()
    a[0, 0] += 0.3  # on object 5
    a[1, 3] -= 0.1  # on nothing
    ids = [[5, 5, 7, 7], [7, 7, 7, -1]]
    found = compare.compare(painted(a, ids), painted(b, ids))
    told = {c.label: (c.pixels, round(c.share, 6), round(c.bias, 6)) for c in found.objects}
    assert told == {"instance 5": (2, 0.9, 0.15), "background": (1, 0.1, -0.1), "instance 7": (5, 0.0, 0.0)}
    assert [c.label for c in found.objects] == ["instance 5", "background", "instance 7"]
    assert found.largest_on == "instance 5"
    assert found.objects[0].error == pytest.approx(math.sqrt(0.09 / (1 + 0.01**2) / 2), rel=1e-5)


def test_the_nearer_of_two_objects_has_the_pixel() -> None:
    """An object that appears in front owns its pixels; so does an object that vanishes."""
    flat = np.ones((1, 3, 3))
    a = painted(flat, [[1, 2, 1]], [[5.0, 1.0, 5.0]])
    b = painted(flat, [[1, 1, 3]], [[5.0, 5.0, 2.0]])
    owner = object_errors.pixel_owners(a, b, {1: 1, 2: 2, 3: 3})
    assert owner is not None
    assert owner.tolist() == [[1, 2, 3]]
    gone = object_errors.pixel_owners(a, b, {1: 1})  # B has no object like A's 2
    assert gone is not None
    assert gone.tolist() == [[1, -2 - 2, 3]]


def test_a_picture_says_nothing_of_a_scenes_objects(scene: ir.Scene) -> None:
    real = drawn(scene, samples=1)
    wrong = painted(real.rgb, np.full((32, 48), 99), np.zeros((32, 48)))
    for a, b in ((real, wrong), (wrong, real)):
        found = compare.compare(a, b)
        assert {c.label for c in found.objects} == {"sphere `ball`", "box", "background"}


def test_endless_pixels_have_all_of_the_error() -> None:
    b = np.ones((2, 2, 3))
    a = b * 1.5
    a[1, 1] = np.nan
    found = compare.compare(painted(a, [[0, 0], [0, 1]]), painted(b, [[0, 0], [0, 1]]))
    assert found.error == math.inf
    assert {c.label: c.share for c in found.objects} == {"instance 0": 0.0, "instance 1": 1.0}
    assert found.value("maximum") == math.inf


@pytest.mark.parametrize(("filter_name", "samples", "reach"), [("box", 4, 1), ("tent", 4, 1), ("gaussian", 4, 2), ("gaussian", 1, 1)])
def test_outlines_reach_as_far_as_the_filter(scene: ir.Scene, filter_name: str, samples: int, reach: int) -> None:
    plan = sides.make_plan(scene, ir.Settings(samples=samples), {"filter": filter_name})
    side = sides.render(scene, plan)
    assert side.reach == reach
    ids, mask = side.ids, object_errors.outline_mask(side)
    assert ids is not None
    assert mask is not None
    h, w = ids.shape
    for y, x in np.ndindex(h, w):
        near = ids[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]
        covered = 0 < side.image.channels["rgba"][y, x, 3] < 1
        assert mask[y, x] == (len(np.unique(near)) > 1 or covered)


def test_where_no_outline_passes_backends_agree(scene: ir.Scene) -> None:
    found = compare.compare(drawn(scene, backend="raster"), drawn(scene, backend="ray"))
    assert found.interior is not None
    assert found.outline is not None
    assert found.interior.error < 1e-6
    assert found.outline.pixels + found.interior.pixels == 48 * 32
    assert found.outline.share == pytest.approx(1.0)
    assert found.noise.shared is True


def test_independent_noise_is_seen_to_be_noise(scene: ir.Scene) -> None:
    found = compare.compare(drawn(scene, samples=16, seed=1), drawn(scene, samples=16, seed=2))
    assert found.error > 0.005
    assert (found.within_noise, found.biased, found.noise.shared) == (True, False, False)
    assert found.noise.ratio is not None
    assert 0.5 < found.noise.ratio < 1.2


def test_a_hidden_bias_shows_beneath_the_noise(scene: ir.Scene) -> None:
    """Two per cent less light is below the noise of a pixel and yet significant."""
    a, b = drawn(scene, samples=4, seed=1), drawn(scene, samples=4, seed=2)
    rgba = a.image.channels["rgba"] * np.array([0.98, 0.98, 0.98, 1.0], np.float32)
    dimmed = Side("dimmed", Image(48, 32, {**a.image.channels, "rgba": rgba}, a.image.metadata), a.noise, a.scene, a.plan)
    found = compare.compare(dimmed, b)
    assert (found.within_noise, found.biased) == (True, True)
    assert found.bias.standard_error is not None
    assert all(abs(value + 0.02) < 5 * doubt for value, doubt in zip(found.bias.channels, found.bias.standard_error, strict=True))


def test_one_sample_has_noise_only_where_light_is_soft(scene: ir.Scene, tmp_path: Path) -> None:
    assert drawn(scene, samples=1).noise is None  # the sky is sampled
    path = tmp_path / "hard.scene"
    path.write_text(SCENE.replace("sky(luminance: 0.5)\n", ""), encoding="utf-8")
    hard = drawn(maquette.load(path), samples=1)
    assert hard.noise == 0.0
    found = compare.compare(hard, hard)
    assert (found.within_noise, found.biased, found.error) == (True, False, 0.0)


def test_a_render_is_exposed_and_clipped_like_the_picture_it_is_held_against(scene: ir.Scene, tmp_path: Path) -> None:
    render = drawn(scene, samples=2)
    path = tmp_path / "shown.png"
    image_files.write(render.image, path, image_files.Look(exposure=1.5, bits=16), {"exposure": 1.5})
    found = compare.compare(render, sides.read(path))
    assert found.error < 0.01  # 16 bits a channel
    assert found.a.changes == (f"exposed by +1.5 stops and clipped to 0..1, as {path} holds 16 bits a channel",)
    assert found.a.rgb.max() <= 1.0
    assert compare.compare(render, sides.read(path), exposure=0.0).error > 0.1
    back = compare.compare(sides.read(path), render)
    assert back.b.changes == found.a.changes
    assert back.error == pytest.approx(found.error, rel=0.05)


def test_variance_is_exposed_too(scene: ir.Scene, tmp_path: Path) -> None:
    render = drawn(scene, samples=8)
    path = tmp_path / "shown.png"
    image_files.write(render.image, path, image_files.Look(exposure=-2.0), {"exposure": -2.0})
    a, _ = sides.match_encoding(render, sides.read(path))
    assert a.variance is not None
    assert render.variance is not None
    np.testing.assert_allclose(a.variance, render.variance / 16.0, rtol=1e-6)


def test_pictures_without_alpha_tell_no_silhouette() -> None:
    flat = np.ones((3, 3, 3))
    one, other = painted(flat, coverage=np.eye(3)), painted(flat, alpha=False)
    assert compare.compare(one, other).value("silhouette") is None
    assert compare.compare(one, one).value("silhouette") == 0.0


def test_outlines_a_known_way_apart() -> None:
    """Discs whose radii differ by 0.3 pixels, antialiased: 2πR of outline, 0.3 pixels of area a pixel of it."""
    y, x = np.mgrid[:160, :160] - 79.5

    def disc(radius: float) -> np.ndarray:
        return np.clip(radius + 0.5 - np.hypot(x, y), 0.0, 1.0)

    assert errors.outline_length(disc(60)) == pytest.approx(2 * math.pi * 60, rel=0.02)
    assert errors.silhouette(disc(60.3), disc(60)) == pytest.approx(0.3, rel=0.03)
    assert errors.silhouette(disc(60), np.zeros((160, 160))) == pytest.approx(30, rel=0.03)  # πR² / 2πR


def test_flip_is_nothing_alike_and_near_one_for_black_and_white() -> None:
    black, white = np.zeros((8, 8, 3)), np.ones((8, 8, 3))
    assert errors.flip(white, white) == 0.0
    assert errors.flip(white, black) > 0.9
    assert errors.flip(black + 0.2, black + 0.21) < 0.1


def test_flip_is_its_authors_of_the_pictures_in_srgb() -> None:
    a, b = np.random.default_rng(1).random((2, 20, 30, 3), np.float32)
    known, seen = (image_files.encode_srgb(rgb).astype(np.float32) for rgb in (b, a))
    _, theirs, _ = flip_evaluator.evaluate(known, seen, "LDR", applyMagma=False)
    assert errors.flip(a, b) == pytest.approx(theirs, rel=1e-4)


def test_flip_looks_at_the_exposure_that_was_meant(scene: ir.Scene) -> None:
    a, b = drawn(scene, samples=4), drawn(scene, samples=4, seed=1)

    def dimmed(side: Side) -> Side:
        rgba = (side.image.channels["rgba"] / 1024).astype(np.float32)
        return Side("x", Image(48, 32, {**side.image.channels, "rgba": rgba}, side.image.metadata))

    plain, lit = compare.compare(a, b), compare.compare(dimmed(a), dimmed(b), exposure=10.0)
    assert lit.figures["flip"] == pytest.approx(plain.figures["flip"], rel=1e-4)
    dark, bright = compare.compare(dimmed(a), dimmed(b)).figures["flip"], plain.figures["flip"]
    assert dark is not None
    assert bright is not None
    assert dark < bright / 5


def test_sizes_that_differ_are_refused() -> None:
    with pytest.raises(metrics.SizeError, match="sizes differ: 3x2 and 2x2 pixels"):
        compare.compare(painted(np.ones((2, 3, 3))), painted(np.ones((2, 2, 3))))


@pytest.mark.parametrize("odd", [np.inf, -np.inf, np.nan])
def test_what_is_endless_in_both_is_alike(odd: float) -> None:
    a, b = np.ones((2, 3, 3)), np.ones((2, 3, 3))
    a[0, 0] = b[0, 0] = odd
    a[1, 1] = 1.1
    found = compare.compare(painted(a), painted(b))
    assert (found.differing, found.at) == (1, (1, 1))
    assert found.bias.largest == pytest.approx(0.1 / 5, rel=1e-4)
    b[0, 0] = 1.0
    alone = compare.compare(painted(a), painted(b))
    assert (alone.error, alone.bias.largest, alone.at) == (math.inf, math.inf, (0, 0))


def test_pictures_of_one_pixel_and_of_nothing_lit() -> None:
    black, white = np.zeros((1, 1, 3)), np.ones((1, 1, 3))
    assert compare.compare(painted(black), painted(black)).error == 0.0
    assert compare.compare(painted(white), painted(black)).bias.largest == math.inf
    assert compare.compare(painted(black), painted(white)).bias.channels == (-1.0, -1.0, -1.0)
