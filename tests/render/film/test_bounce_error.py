"""Tests of the bounce limit's error estimate: known losses, messages, and unchanged pictures."""

from __future__ import annotations

import json
from pathlib import Path

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.lang.schema.picture_settings import MAX_BOUNCES
from maquette.render.film import bounce_error
from maquette.render.image.image import Image

from ...files import standing_by

INSIDE = "camera(position: [0.1, 0.2, 0.5], look_at: [-0.3, 0, -1], fov: 70deg)\n"
WALLS = "box([2, 4, 3], material: principled({0}, specular: 0, emission: #fff, luminance: 1))\n"


def drawn(folder: Path, text: str, **settings: object) -> Image:
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    return maquette.render(maquette.load(path), **{"size": (40, 30), "samples": 64, "background": "transparent", **settings})


@pytest.mark.parametrize(("albedo", "bounces"), [(0.5, 1), (0.8, 4), (0.8, 20)])
def test_of_an_enclosure_a_power_of_its_albedo_is_cut_off(tmp_path, albedo, bounces):
    """e/(1 − ρ) without a limit, e (1 − ρ^(k+1))/(1 − ρ) with one: the share ρ^(k+1) is missing."""
    cut = drawn(tmp_path, INSIDE + WALLS.format(albedo), bounces=bounces).metadata["cut"]
    assert 0 < cut.error < 0.05
    assert abs(cut.share - albedo ** (bounces + 1)) < 4 * cut.error


def test_how_many_bounces_leave_out_less_is_said(tmp_path):
    """0.8⁵ is a third; 0.8¹⁷ is the first below 1/20 of those with twice the bounces, and twice those."""
    cut = drawn(tmp_path, INSIDE + WALLS.format(0.8), bounces=4, samples=None, error=0.05).metadata["cut"]
    assert cut.matters
    assert cut.enough == 16


@pytest.mark.parametrize("bounces", [0, MAX_BOUNCES])
def test_without_a_limit_to_lift_nothing_is_measured(tmp_path, bounces):
    assert drawn(tmp_path, INSIDE + WALLS.format(0.5), bounces=bounces, samples=1).metadata["cut"] is None


def test_darkness_loses_nothing(tmp_path):
    cut = drawn(tmp_path, INSIDE + "box(2, material: mirror(0.9))\n", samples=1).metadata["cut"]
    assert (cut.share, cut.error) == (0.0, 0.0)


@pytest.mark.long
def test_glass_and_mirrors_are_followed_further(tmp_path):
    """Of a tree more rays wait than the picture's own limit has room for. What is told is what the picture lacks in the same blocks."""
    text = INSIDE + "sphere(0.3, center: [-0.2, 0, -0.5], material: glass())\nbox([2, 4, 3], material: mirror(0.9))\n"
    text += "sphere(0.1, center: [0.4, 0.5, -0.3], material: emissive(1))\n"
    short, far = (drawn(tmp_path, text, bounces=k, samples=16) for k in (3, MAX_BOUNCES))
    ours, all_of_it = (image.channels["rgba"][..., :3].astype(float) for image in (short, far))
    blocks = [np.s_[tile.y0 : tile.y1, tile.x0 : tile.x1] for tile in bounce_error.blocks((0, 0, 40, 30))]
    unlimited, limited = (np.array([picture[block].mean() for block in blocks]) for picture in (all_of_it, ours))
    true = np.mean((unlimited - limited) / np.hypot(unlimited, 0.01 * all_of_it.mean()))
    assert true > 0.3
    assert abs(short.metadata["cut"].share - true) < 0.1


@pytest.mark.long
def test_it_is_the_same_on_any_number_of_threads(tmp_path):
    by_one, by_three = (drawn(tmp_path, INSIDE + WALLS.format(0.7), bounces=2, threads=n).metadata["cut"] for n in (1, 3))
    assert by_one == by_three


class Recorded:
    """A renderer of which only the limits matter; those beyond 8 find all light, 3 finds half."""

    cell = 1

    def __init__(self) -> None:
        self.limits: list[int] = []

    def limit(self, bounces: int) -> None:
        self.limits.append(bounces)

    def sample(self, tile, first, count, total, film) -> None:
        film.color[...] += min(self.limits[-1] + 1, 8) / 8 * total


def test_the_limit_is_put_back(tmp_path):
    (tmp_path / "a.scene").write_text(INSIDE + WALLS.format(0.5), encoding="utf-8")
    plan = planner.make_plan(maquette.load(tmp_path / "a.scene"), ir.Settings(bounces=3, size=(9, 7)))
    renderer = Recorded()
    cut = bounce_error.measure(renderer, plan, 1, 0.02)
    assert cut == bounce_error.Cut(pytest.approx(0.5, rel=1e-3), 0.0, 0.02, 12)  # pyright: ignore[reportArgumentType]
    assert renderer.limits == [64, 3, 6, 12, 3]


@pytest.mark.parametrize("crop", [(0, 0, 1, 1), (3, 2, 6, 40), (10, 20, 1930, 1100)])
def test_blocks_lie_in_the_crop_and_all_over_it(crop):
    x0, y0, x1, y1 = crop
    places = bounce_error.blocks(crop)
    for tile in places:
        assert x0 <= tile.x0 < tile.x1 <= x1
        assert y0 <= tile.y0 < tile.y1 <= y1
    if x1 - x0 > 100:
        middles = np.array([(tile.x0 - x0, tile.y0 - y0) for tile in places]) / (x1 - x0, y1 - y0)
        assert {(x, y) for x, y in (middles * 4).astype(int).tolist()} == {(x, y) for x in range(4) for y in range(4)}


def test_strips_have_the_mean_of_theirs():
    first, second = bounce_error.Cut(0.1, 0.03, 0.02, 8), bounce_error.Cut(0.3, 0.04, 0.05, 16)
    combined = bounce_error.combine([first, second], np.array([3.0, 1.0]))
    assert combined == bounce_error.Cut(pytest.approx(0.15), pytest.approx(np.hypot(0.0225, 0.01)), 0.05, 16)  # pyright: ignore[reportArgumentType]
    assert bounce_error.combine([first, None], np.array([1.0, 1.0])) is None


def test_the_command_line_says_where_the_limit_is(tmp_path, monkeypatch):
    text = INSIDE + WALLS.format(0.8) + 'render(bounces: 4, size: [40, 30], background: "transparent")\n'
    standing_by(tmp_path, monkeypatch, text.replace(', background: "transparent"', ""))
    done = CliRunner().invoke(cli, ["render", "a.scene", "-o", "a.exr", "--error", "5%", "--stats", "a.json"])
    assert done.exit_code == 0
    warning = next(line for line in done.stderr.splitlines() if "bounces leaves out" in line)
    assert warning.startswith("a.scene:3:1: warning: the limit of 4 bounces leaves out 3")
    assert warning.endswith("more than is the error asked for")
    assert "render(bounces: 16) or --bounces 16 leaves out less" in done.stderr
    stats = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert 0.25 < stats["cut"] < 0.4
    assert [w["message"] for w in stats["warnings"] if "bounces" in w["message"]]


def test_whole_cells_are_measured_where_their_pixels_share_paths():
    crop = (20, 9, 150, 100)
    places = bounce_error.blocks(crop, 16)
    assert len(places) == len(set(places)) == bounce_error.CELLS
    for tile in places:
        assert tile.x0 in (20, *range(32, 150, 16))
        assert tile.x1 in (*range(32, 150, 16), 150)
        assert tile.y1 - tile.y0 in (7, 16, 4)  # of the first row, of most, of the last
        assert tile.x1 - tile.x0 <= 16
    assert len(bounce_error.blocks((0, 0, 12, 16), 16)) == bounce_error.BLOCKS
