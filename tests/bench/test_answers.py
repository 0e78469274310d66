"""What the benchmarks compare: wrong answers are refused, meshes and rays are what they say, curves are not read beyond their ends."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.bench import gl, meshes, paths, raster, rays, start
from maquette.bench.harness import Disagreement

RNG = np.random.default_rng(5)


def test_the_knot_is_closed_and_faces_outwards() -> None:
    mesh = meshes.knot(40, 12)
    assert len(mesh.triangles) == 960
    edges = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
    assert {tuple(e) for e in edges.tolist()} == {tuple(e[::-1]) for e in edges.tolist()}
    assert len(np.unique(edges, axis=0)) == len(edges)
    a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    assert np.sum(np.cross(a, b) * c) > 0.0
    faces = np.cross(b - a, c - a)
    assert np.all(np.sum(faces * mesh.normals[mesh.triangles[:, 0]], axis=1) > 0.0)
    assert np.linalg.norm(mesh.positions, axis=1).max() < 1.0


def test_boulders_turn_and_shrink_evenly() -> None:
    matrices = meshes.boulders(50)
    linear = matrices[:, :, :3]
    size = np.cbrt(np.linalg.det(linear))
    assert np.all(size > 0.0)
    np.testing.assert_allclose(linear @ linear.transpose(0, 2, 1), size[:, None, None] ** 2 * np.eye(3), atol=1e-12)


def test_primary_rays_are_the_pixels_of_the_camera_each_once() -> None:
    rays_ = meshes.primary(8)
    at = np.column_stack([rays_.direction, np.zeros(64)]) @ gl.to_clip().T
    pixels = np.floor((at[:, :2] / at[:, 3:] + 1.0) * 4.0).astype(int)
    assert len({tuple(p) for p in pixels.tolist()}) == 64
    assert pixels.min() == 0
    assert pixels.max() == 7
    neighbours = np.abs(np.diff(pixels.reshape(16, 4, 2), axis=1)).max(axis=(1, 2))
    assert neighbours.max() == 1  # four that follow each other are a square
    np.testing.assert_allclose(np.linalg.norm(rays_.direction, axis=1), 1.0, atol=1e-6)


def hits(count: int = 1000) -> tuple[Any, Any]:
    t = RNG.uniform(1.0, 3.0, count).astype(np.float32)
    triangle = RNG.integers(0, 9, count).astype(np.int32)
    triangle[::3] = -1
    t[::3] = np.inf
    return t, triangle


def test_hits_that_agree_are_counted() -> None:
    t, triangle = hits()
    said = rays.agree_closest({"maquette": (t, triangle), "peer": (t * np.float32(1.00001), triangle)})
    assert said == "67% of 1,000 rays hit; peer: 0 hit in one only, 0 distances differ, 0 another triangle"


@pytest.mark.parametrize("wrong", ["distance", "miss", "triangle"])
def test_hits_that_differ_are_refused(wrong: str) -> None:
    t, triangle = hits()
    theirs = (t.copy(), triangle.copy())
    if wrong == "distance":
        theirs[0][1:200] *= 1.01
    elif wrong == "miss":
        theirs[1][1:200] = -1
    else:
        theirs[1][triangle >= 0] += 1
    with pytest.raises(Disagreement):
        rays.agree_closest({"maquette": (t, triangle), "peer": theirs})


def test_blocked_rays_that_differ_are_refused() -> None:
    blocked = RNG.random(1000) < 0.5
    assert rays.agree_any({"maquette": blocked, "peer": blocked}).endswith("; peer: 0 differ")
    other = blocked.copy()
    other[:5] ^= True
    with pytest.raises(Disagreement, match="peer: 5 differ"):
        rays.agree_any({"maquette": blocked, "peer": other})


def picture() -> np.ndarray:
    rgba = np.zeros((64, 64, 4), np.float32)
    rgba[8:40, 8:40] = (0.5, 0.4, 0.3, 1.0)
    return rgba


def test_coverage_and_colours_that_differ_are_refused() -> None:
    mine = picture()
    said = raster.agree({"maquette": mine, "peer": mine + 0.001 * (mine > 0)})
    assert said.endswith("coverage of 0 pixels differs, colour of 0, in the mean by 1.0e-03")
    moved, dyed = np.roll(mine, 1, axis=0), mine.copy()
    dyed[8:40, 8:40, 0] = 0.6
    for wrong in (moved, dyed):
        with pytest.raises(Disagreement):
            raster.agree({"maquette": mine, "peer": wrong})
    with pytest.raises(Disagreement):
        raster.agree_in_mean({"maquette": mine, "peer": mine * np.float32(0.8)})


def test_pictures_of_whole_programs_that_differ_are_refused() -> None:
    mine = picture()[..., :3].astype(np.float64)
    assert start.agree({"maquette": mine, "peer": mine}) == "mean 0.1000; peer: mean +0.00%, 0.00% of pixels differ by more than 0.06"
    for wrong in (mine * 1.02, np.roll(mine, 20, axis=1)):
        with pytest.raises(Disagreement):
            start.agree({"maquette": mine, "peer": wrong})


def test_block_scores_are_one_by_chance_and_see_a_small_bias() -> None:
    shape = (4, 64, 64, 3)
    a, b = RNG.normal(1.0, 0.5, shape), RNG.normal(1.0, 0.5, shape)
    assert 0.6 < paths.block_z2(a, b) < 1.6
    b[:, :32, :32] += 0.2  # a quarter of the picture, by four and a half standard errors of a block
    assert paths.block_z2(a, b) > paths.MAX_Z2


def fake(name: str, bias: float, stuck: bool = False) -> paths.Renderer:
    """A renderer of noise about a picture of ones; `stuck`: it does not hear of seeds."""

    def draw(size: int, samples: int, seed: int) -> Any:
        rng = np.random.default_rng([len(name), samples, 0 if stuck else seed])
        return lambda: 1.0 + bias + rng.normal(0.0, 1.0 / np.sqrt(samples), (size, size, 3))

    return paths.Renderer(name, draw, lambda rgb: rgb)


def test_long_runs_that_differ_are_refused() -> None:
    said, references = paths.long_runs([fake("maquette", 0.0), fake("peer", 0.0)], 32, 64)
    assert said.startswith("4 × 64 samples a pixel; peer: mean ")
    assert references["peer"].mean.shape == (32, 32, 3)
    with pytest.raises(Disagreement, match="peer: mean"):
        paths.long_runs([fake("maquette", 0.0), fake("peer", 0.05)], 32, 64)
    with pytest.raises(Disagreement, match="runs with different seeds are the same"):
        paths.long_runs([fake("maquette", 0.0, stuck=True), fake("peer", 0.0)], 32, 64)


def test_errors_do_not_hold_the_noise_of_their_reference() -> None:
    """A picture of variance 1/16 against four runs of 1/16 each: the reference's share, a fifth of the whole, is taken away."""
    size, sigma = 128, 0.25
    reference = paths.Reference.from_runs(RNG.normal(1.0, sigma, (4, size, size, 3)))
    picture = RNG.normal(1.0, sigma, (size, size, 3))
    plain = paths.metrics.root_relmse(picture, reference.mean)
    assert reference.noise[0] / plain**2 == pytest.approx(0.2, rel=0.05)
    assert reference.errors(picture)[0] == pytest.approx(sigma * (1.0 + 1.5 * sigma**2 / 4.0), rel=0.02)
    assert reference.errors(reference.mean)[0] == 0.0


def test_means_that_differ_are_refused() -> None:
    ours = np.ones((64, 64, 3))
    assert paths.agree_means({"maquette": ours, "peer": ours * 1.001}) == "means maquette 1.00000, peer 1.00100"
    with pytest.raises(Disagreement):
        paths.agree_means({"maquette": ours, "peer": ours * 1.01})


def test_means_of_noisy_pictures_may_differ_by_what_the_noise_leaves_open() -> None:
    """Of 64² pixels of variance 1 each, by four times √2 / 64."""
    ours, noise = np.ones((64, 64, 3)), RNG.normal(0.0, 1.0, (64, 64, 1))
    noise -= noise.mean()
    paths.agree_means({"maquette": ours + noise, "peer": ours * 1.08 + noise[::-1]})
    with pytest.raises(Disagreement):
        paths.agree_means({"maquette": ours + noise, "peer": ours * 1.1 + noise[::-1]})


def test_time_to_an_error_is_read_between_points_alone() -> None:
    curve = [(1.0, 0.4), (4.0, 0.2), (16.0, 0.1)]
    assert paths.time_to(0.2, curve) == pytest.approx(4.0)
    assert paths.time_to(0.1 * 2**0.5, curve) == pytest.approx(8.0)
    assert paths.time_to(0.5, curve) is None
    assert paths.time_to(0.05, curve) is None
    table = paths.equal_error({"maquette": curve, "peer": [(2.0 * t, e) for t, e in curve]})
    rows = ["| 30% | 1.78e+03 | 3.56e+03 | 2.00 |", "| 20% | 4e+03 | 8e+03 | 2.00 |", "| 10% | 1.6e+04 | 3.2e+04 | 2.00 |"]
    assert table.splitlines()[2:] == rows  # to 30 %: 4 to the power of log₂ 4/3


def test_the_mesh_in_the_box_is_the_same_in_its_file(tmp_path: Path) -> None:
    mesh = meshes.knot(20, 6)
    meshes.write_ply(tmp_path / "knot.ply", mesh)
    scene = paths.build_scene(tmp_path / "knot.ply")
    assert scene.tables.geometries.triangle_count.tolist().count(240) == 1
    assert len(scene.tables.instances.geometry) == len(paths.build_scene(None).tables.instances.geometry) - 1
    assert dataclasses.asdict(scene.settings)["samples"] is None
