"""Tests of the film: determinism over threads, cancellation, crops, target errors, budgets and failures."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
import pytest
from maquette.render.film import adaptive_sampling, canvas, film
from maquette.render.film.deadline import Deadline
from maquette.render.film.progress import Progress
from maquette.render.image import image, metrics
from maquette.render.types import Film, Tile, View

SIZE = (100, 70)


def noise(x: np.ndarray, y: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Numbers evenly spread over 0 … 1 for pixels and samples: a hash, so that any thread gets the same."""
    with np.errstate(over="ignore"):
        h = (x.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) ^ (y.astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F))
        h = (h ^ (s.astype(np.uint64) * np.uint64(0x165667B19E3779F9))) * np.uint64(0xFF51AFD7ED558CCD)
        h = (h ^ (h >> np.uint64(33))) * np.uint64(0xC4CEB9FE1A85EC53)
    return (h >> np.uint64(11)).astype(float) / 2.0**53


def truth(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.5 + x / 200.0 + 0.0 * y


class Painter(film.Unshared):
    """A renderer whose samples are known: `truth` plus noise of a chosen width at each pixel."""

    whole = None
    side = film.TILE

    def __init__(self, width: Any = 0.4, wait: float = 0.0, fail_at: int = -1, by_tile: bool = False) -> None:
        self.width, self.wait, self.fail_at, self.by_tile, self.cell = width, wait, fail_at, by_tile, 1
        self.calls: list[tuple[Tile, int, int, int]] = []
        self.taken = np.zeros((SIZE[1], SIZE[0]), np.int64)
        self.lock = threading.Lock()

    def sample(self, tile: Tile, first: np.ndarray, count: np.ndarray, total: int, film: Film) -> None:
        with self.lock:
            self.calls.append((tile, int(first.max()), int(count.max()), total))
            if len(self.calls) == self.fail_at:
                raise ArithmeticError("the brush broke")
        if self.wait:
            time.sleep(self.wait)
        y, x = np.mgrid[tile.y0 : tile.y1, tile.x0 : tile.x1]
        wide: Any = self.width(x, y) if callable(self.width) else self.width
        if self.by_tile:
            assert np.ptp(first) == np.ptp(count) == 0
        for s in range(int(count.max())):
            value: Any = truth(x, y) + wide * (noise(x, y, first + s) - 0.5)
            film.color[:] += np.where(s < count, value, 0.0)[..., None] * np.array([1.0, 0.5, 0.25])
            film.alpha[:] += np.where(s < count, x % 2, 0)
        self.taken[tile.y0 : tile.y1, tile.x0 : tile.x1] += count
        film.issues[0, 0] += count.max()

    def first(self, tile: Tile, samples: range, total: int) -> Any:
        raise AssertionError("nobody asks a brush what it sees")

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, np.ndarray]) -> None:
        y, x = np.mgrid[tile.y0 : tile.y1, tile.x0 : tile.x1]
        for name in names:
            out[name][...] = (x + 1000 * y)[..., None]


def plan(**changed: Any) -> Any:
    base = {"crop": (0, 0, *SIZE), "aov": (), "samples": 8, "threads": 2, "error": 0.0, "budget": math.inf}
    return {**base, **changed}


def draw(painter: Painter | None = None, progress: Any = None, cancel: Any = None, **changed: Any) -> image.Image:
    return film.run(painter or Painter(), plan(**changed), View(0, *SIZE), progress, cancel)


def uneven(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.where(x > 50, 0.8, 0.1)


def test_tiles_cover_a_crop_once_from_the_middle_outwards() -> None:
    crop = (5, 3, 140, 99)
    count = np.zeros((110, 150), int)
    tiles = film.tiles(crop)
    for tile in tiles:
        assert tile.x1 - tile.x0 <= film.TILE
        count[tile.y0 : tile.y1, tile.x0 : tile.x1] += 1
    inside = np.zeros_like(count)
    inside[3:99, 5:140] = 1
    np.testing.assert_array_equal(count, inside)
    away = [math.hypot(t.x0 + t.x1 - 145, t.y0 + t.y1 - 102) for t in tiles]
    assert away == sorted(away)


@pytest.mark.parametrize("samples", [1, 2, 8, 13])
def test_a_fixed_number_of_samples_is_their_mean(samples: int) -> None:
    painter = Painter()
    picture = draw(painter, samples=samples)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    mean = np.mean([truth(x, y) + 0.4 * (noise(x, y, np.full(x.shape, s)) - 0.5) for s in range(samples)], axis=0)
    np.testing.assert_allclose(picture.channels["rgba"][..., 0], mean, rtol=1e-6)
    np.testing.assert_array_equal(picture.channels["rgba"][..., 3], x % 2)
    assert {total for *_, total in painter.calls} == {samples}
    about = picture.metadata
    assert (about["samples"], about["samples_mean"], about["rays"]) == (samples, samples, samples * 7000)
    assert (about["size"], about["crop"], about["partial"], about["threads"]) == (SIZE, (0, 0, *SIZE), False, 2)
    assert about["issues"] == samples * len(film.tiles((0, 0, *SIZE)))
    assert (about["error"] is None) == (samples == 1)


@pytest.mark.long
@pytest.mark.parametrize("settings", [{}, {"error": 0.02, "samples": 4096}])
def test_any_number_of_threads_gives_the_same_bits(settings: dict[str, Any]) -> None:
    single, *others = (draw(Painter(uneven), threads=threads, aov=("depth",), **settings) for threads in (1, 2, 5))
    for other in others:
        for name, channel in single.channels.items():
            np.testing.assert_array_equal(channel, other.channels[name])
        for name in ("variance", "half_difference"):
            np.testing.assert_array_equal(single.metadata[name], other.metadata[name])
        same = {k: v for k, v in single.metadata.items() if k not in ("threads", "pace", "variance", "half_difference")}
        assert same == {k: other.metadata[k] for k in same}


@pytest.mark.long
@pytest.mark.parametrize("settings", [{"samples": 64}, {"samples": 5}, {"error": 0.02, "samples": 4096}])
def test_a_progressive_picture_refines_all_tiles_together_to_the_same_bits(settings: dict[str, Any]) -> None:
    shown: list[np.ndarray] = []

    def report(progress: Progress) -> None:
        if progress.picture is not None:
            shown.append(progress.picture.samples.copy())

    by_tiles = draw(Painter(uneven), aov=("depth",), **settings)
    picture = film.run(Painter(uneven), plan(aov=("depth",), threads=1, **settings), View(0, *SIZE), report, progressive=True)
    for name, channel in by_tiles.channels.items():
        np.testing.assert_array_equal(picture.channels[name], channel)
    np.testing.assert_array_equal(picture.metadata["variance"], by_tiles.metadata["variance"])
    same = {k: v for k, v in by_tiles.metadata.items() if k not in ("threads", "pace", "variance", "half_difference")}
    assert same == {k: picture.metadata[k] for k in same}
    first = next(k for k, samples in enumerate(shown) if samples.min() > 0)
    assert shown[first].max() <= 4
    for samples in shown[first : len(film.tiles((0, 0, *SIZE))) * 2]:
        assert samples.max() <= 8 * samples.min()


def test_a_crop_is_a_part_of_the_whole() -> None:
    complete = draw(aov=("position",))
    part = draw(aov=("position",), crop=(11, 7, 64, 53))
    assert (part.width, part.height) == (53, 46)
    for name in ("rgba", "position"):
        np.testing.assert_array_equal(part.channels[name], complete.channels[name][7:53, 11:64])


def test_cancelling_returns_what_is_done() -> None:
    cancel = threading.Event()
    seen = []

    def progress(reached: Progress) -> None:
        seen.append(reached.share)
        if len(seen) == 3:
            cancel.set()

    picture = draw(Painter(wait=0.002), progress, cancel, aov=("depth",), threads=2)
    complete = draw(aov=("depth",))
    drawn = np.isfinite(picture.channels["depth"][..., 0])
    assert picture.metadata["partial"] is True
    assert picture.metadata["error"] is None
    assert 0 < drawn.sum() < drawn.size
    assert np.all(picture.channels["rgba"][~drawn] == 0.0)
    some = drawn & (picture.channels["rgba"][..., 0] == complete.channels["rgba"][..., 0])
    assert some.sum() >= 3 * 6 * 32  # the tiles that were finished; one being drawn may have fewer samples
    assert 0.0 < seen[-1] < 1.0


def test_cancelling_beforehand_draws_nothing() -> None:
    cancel = threading.Event()
    cancel.set()
    painter = Painter()
    for settings in ({}, {"error": 0.01}):
        picture = draw(painter, cancel=cancel, aov=("id",), **settings)
        assert painter.calls == []
        assert picture.metadata["partial"] is True
        assert picture.metadata["samples"] == 0
        assert np.all(picture.channels["rgba"] == 0.0)
        assert np.all(picture.channels["id"] == -1.0)


def test_a_failure_in_a_worker_is_raised_here_and_ends_the_work() -> None:
    before = threading.active_count()
    with pytest.raises(ArithmeticError, match="the brush broke"):
        draw(Painter(fail_at=5), threads=3)
    assert threading.active_count() == before


def test_an_interruption_here_ends_the_workers() -> None:
    def progress(reached: Progress) -> None:
        raise KeyboardInterrupt

    before = threading.active_count()
    painter = Painter(wait=0.002)
    with pytest.raises(KeyboardInterrupt):
        draw(painter, progress)
    assert threading.active_count() == before
    assert len({tile for tile, *_ in painter.calls}) < len(film.tiles((0, 0, *SIZE)))


@pytest.mark.parametrize("settings", [{}, {"error": 0.03, "samples": 4096}, {"budget": 0.3, "samples": 100_000}])
def test_progress_is_told_in_the_callers_thread(settings: dict[str, Any]) -> None:
    seen, threads = [], set()

    def progress(reached: Progress) -> None:
        seen.append(reached)
        threads.add(threading.current_thread())

    picture = draw(progress=progress, **settings)
    shares, samples = [p.share for p in seen], [p.samples for p in seen]
    assert len(seen) >= len(film.tiles((0, 0, *SIZE)))
    assert {p.stage for p in seen} == {"rendering"}
    assert {p.most for p in seen} == {0 if settings else picture.metadata["samples"]}
    assert min(shares) >= 0.0
    assert shares[-1] == 1.0
    assert shares == sorted(shares) or "error" in settings
    assert samples == sorted(samples)
    assert samples[-1] == pytest.approx(picture.metadata["samples_mean"])
    assert seen[-1].error == picture.metadata["error"]
    assert threads == {threading.current_thread()}


@pytest.mark.long
def test_the_error_so_far_is_told_and_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(canvas, "ESTIMATE", 0.0)
    seen: list[Progress] = []
    picture = draw(Painter(wait=0.002), seen.append, samples=256)
    np.testing.assert_array_equal(picture.channels["rgba"], draw(samples=256).channels["rgba"])
    errors = [p.error for p in seen[len(seen) // 2 :]]
    assert all(error == pytest.approx(picture.metadata["error"], rel=0.5) for error in errors)


def test_expected_samples_follow_the_last_two_rounds() -> None:
    expect = adaptive_sampling.expected_samples
    assert expect([(100, 0.04)], 0.75) == pytest.approx(400)  # variance falls as 1 / n
    assert expect([(100, 0.08), (200, 0.02)], 0.75) == pytest.approx(200 * 4 ** (1 / 1.5))  # faster than believed
    assert expect([(100, 0.08), (400, 0.04)], 0.75) == pytest.approx(400 * 4**2)
    assert expect([(100, 0.08), (100, 0.08)], 0.5) == pytest.approx(200)


def root_relmse(picture: image.Image) -> float:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    return metrics.root_relmse(picture.channels["rgba"][..., :3], truth(x, y)[..., None] * np.array([1.0, 0.5, 0.25]))


@pytest.mark.long
@pytest.mark.parametrize("error", [0.05, 0.02, 0.01])
def test_the_error_that_was_asked_for_is_reached(error: float) -> None:
    picture = draw(error=error, samples=4096)
    assert root_relmse(picture) < 1.1 * error
    assert picture.metadata["error"] < error
    assert picture.metadata["error"] == pytest.approx(root_relmse(picture), rel=0.15)
    assert adaptive_sampling.first_samples(error) <= picture.metadata["samples"] < 4096


@pytest.mark.long
@pytest.mark.parametrize("by_tile", [False, True])
def test_only_where_there_is_error_are_more_samples_taken(by_tile: bool) -> None:
    painter = Painter(lambda x, y: np.where(x >= 64, 1.0, 0.02), by_tile=by_tile)
    picture = draw(painter, error=0.01, samples=4096)
    calm, lively = painter.taken[:, :62], painter.taken[:, 66:]
    share = lively.mean() / calm.mean()
    assert 20 < share < 80 if not by_tile else share > 8  # in proportion to the noise, 50 to 1 but for its brightness
    assert picture.metadata["samples_mean"] == pytest.approx(painter.taken.mean())
    assert root_relmse(picture) < 1.1 * 0.01


def test_samples_go_where_they_take_away_most() -> None:
    """Neyman's allocation: with variance v / n at each pixel, n in proportion to √v needs the fewest samples for an error."""
    y, x = np.mgrid[:64, :64]
    v = np.exp(3.0 * np.sin(x / 9.0) + 2.0 * np.cos(y / 7.0))
    n = np.full(v.shape, 8)
    for _ in range(12):
        n = n * 2 ** adaptive_sampling.doublings_for_error(v / n, n, 1 << 20, 1.0 - 1e-3 / float(np.mean(v / n)))
    fewest = np.sqrt(v).sum() ** 2 / (v.size * 1e-3)
    assert np.mean(v / n) <= 1e-3
    assert fewest <= n.sum() < 1.15 * fewest


def test_estimates_of_pixels_do_not_depend_on_threads() -> None:
    """Each block of rows looks at a row more on either side."""
    rng = np.random.default_rng(2)
    relative, samples = rng.random((300, 7)) ** 8, rng.integers(1, 64, (300, 7))
    top_rows = adaptive_sampling.smooth(relative[:50], samples[:50])
    for threads in (1, 3):
        smoothed = adaptive_sampling.smooth(relative, samples, threads)
        assert np.array_equal(smoothed[:49], top_rows[:49])
        for top in (10, 63, 64, 65, 128, 200):
            part = slice(top, top + 60)
            assert np.array_equal(smoothed[part][1:-1], adaptive_sampling.smooth(relative[part], samples[part])[1:-1])
        assert np.array_equal(smoothed[-1], adaptive_sampling.smooth(relative[-2:], samples[-2:])[-1])


def test_a_pixel_that_is_noisy_alone_does_not_make_all_others_pay() -> None:
    v = np.ones((64, 64))
    v[30, 30] = 4000.0  # half of the error of the picture, where the neighbours know of nothing
    n = np.full(v.shape, 8)
    doublings = adaptive_sampling.doublings_for_error(adaptive_sampling.smooth(v / n, n), n, 1 << 20, 0.3)
    assert doublings[28:33, 28:33].max() > 0
    assert np.count_nonzero(doublings) < 100


@pytest.mark.parametrize("count", [100, 2_000, 40_000])
def test_what_is_taken_for_an_error_has_at_most_that_error(count: int) -> None:
    """Both the estimate, a mean over pixels, and the error itself are uncertain: the fewer the pixels, the more."""
    rng = np.random.default_rng(7)
    wrong = accepted = 0
    for variance in np.linspace(0.3, 1.2, 300):
        estimate, picture = variance * rng.standard_normal((2, count)) ** 2
        if adaptive_sampling.excess(estimate[None], 1.0) == 0.0:
            accepted += 1
            wrong += float(np.mean(picture)) > 1.0
    assert accepted > (60 if count == 100 else 150)
    assert wrong <= 0.1 * accepted


def test_samples_for_a_budget_stay_within_it_and_go_where_the_noise_is() -> None:
    v = np.ones((40, 40))
    v[10:20, 10:20] = 100.0
    n = np.full(v.shape, 8)
    more = n * (2 ** adaptive_sampling.doublings_for_samples(v / n, n, 1 << 20, 5000.0) - 1)
    assert 2000 <= more.sum() <= 5000
    assert more[12:18, 12:18].min() > 0
    assert more[22:, 22:].max() == 0
    assert adaptive_sampling.doublings_for_samples(v / n, n, 1 << 20, 3.0).max() == 0


def test_no_pixel_goes_beyond_the_most() -> None:
    n = np.full((5, 7), 8)
    doublings = adaptive_sampling.doublings_for_error(np.ones((5, 7)), n, 24, 1.0)
    assert set(np.minimum(n * 2**doublings, 24).ravel()) == {24}
    assert adaptive_sampling.doublings_for_error(np.ones((5, 7)), np.full((5, 7), 24), 24, 1.0).max() == 0
    assert adaptive_sampling.doublings_for_error(np.zeros((5, 7)), n, 24, 1.0).max() == 0


def test_the_most_samples_end_what_cannot_be_reached() -> None:
    picture = draw(error=1e-6, samples=24)
    assert picture.metadata["samples"] == 24
    assert picture.metadata["error"] > 1e-6
    assert picture.metadata["partial"] is False


def test_a_black_picture_has_no_error() -> None:
    class Black(Painter):
        def sample(self, tile: Tile, first: np.ndarray, count: np.ndarray, total: int, film: Film) -> None:
            pass

    picture = draw(Black(), error=0.01, samples=4096)
    assert (picture.metadata["error"], picture.metadata["samples"]) == (0.0, 16)


def test_the_error_of_a_fixed_number_of_samples_is_estimated() -> None:
    picture = draw(samples=64)
    assert picture.metadata["error"] == pytest.approx(root_relmse(picture), rel=0.15)


class Clockwork(Painter):
    """Noisy in one corner; time is what its samples take: a microsecond each, and some for each call."""

    def __init__(self, each: float = 1e-6, **about: Any) -> None:
        super().__init__(width=lambda x, y: np.where((x < 30) & (y < 30), 1.0, 0.05), **about)
        self.each, self.now, self.longest = each, 100.0, 0.0

    def sample(self, tile: Tile, first: np.ndarray, count: np.ndarray, total: int, film: Film) -> None:
        super().sample(tile, first, count, total, film)
        took = self.each * float(count.sum()) + 5e-5
        self.now, self.longest = self.now + took, max(self.longest, took)

    def until(self, seconds: float) -> Deadline:
        """A deadline by this clock."""
        return Deadline(seconds, None, lambda: self.now)


def timed(painter: Clockwork, seconds: float, *, grants: bool = False, **changed: Any) -> image.Image:
    decided = plan(**{"budget": seconds, "samples": 100_000, "threads": 1, **changed})
    return film.run(painter, decided, View(0, *SIZE), deadline=painter.until(seconds), grants=grants)


@pytest.mark.long
@pytest.mark.parametrize("seconds", [0.5, 2.0])
def test_a_budget_is_spent_to_a_tenth_and_where_the_noise_is(seconds: float) -> None:
    painter = Clockwork()
    picture = timed(painter, seconds)
    assert painter.now - 100.0 == pytest.approx(seconds, rel=0.1)
    assert painter.taken.sum() * 1e-6 > 0.9 * seconds
    assert np.median(painter.taken[:30, :30]) >= 4 * np.median(painter.taken[40:, 40:])
    assert picture.metadata["error"] < draw(samples=round(seconds * 1e6 / painter.taken.size)).metadata["error"]
    assert picture.metadata["undrawn"] is None


@pytest.mark.parametrize(("each", "by_tile"), [(1e-5, False), (1e-3, False), (2e-2, False), (1e-4, True)])
def test_a_deadline_interrupts_a_pass(each: float, by_tile: bool) -> None:
    """A call lasts a fifth of a second, as far as the pace is known: from the second call on."""
    painter = Clockwork(each, by_tile=by_tile)
    picture = timed(painter, 3.0)
    assert painter.now - 100.0 < max(3.0, 32 * 32 * each) + max(0.3, 100 * each)
    undrawn = picture.metadata["undrawn"]
    assert np.array_equal(painter.taken == 0, np.zeros((SIZE[1], SIZE[0]), bool) if undrawn is None else undrawn)
    assert picture.metadata["samples_mean"] == pytest.approx(painter.taken.mean())
    assert picture.metadata["partial"] is False


def test_pixels_of_an_interrupted_pass_have_the_mean_of_their_own_samples() -> None:
    painter = Clockwork(1e-4)
    picture = timed(painter, 1.0)  # 7000 pixels: a pass takes 0.7 s
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    wide: Any = painter.width(x, y)
    total = sum(np.where(s < painter.taken, truth(x, y) + wide * (noise(x, y, np.full_like(x, s)) - 0.5), 0.0) for s in range(4))
    drawn = painter.taken > 0
    np.testing.assert_allclose(picture.channels["rgba"][drawn, 0], (total / np.maximum(painter.taken, 1))[drawn], rtol=1e-5)
    assert set(np.unique(painter.taken)) == {1, 2}


def test_the_error_of_an_interrupted_picture_is_told_from_half_of_its_pixels_on() -> None:
    assert timed(Clockwork(1e-4), 0.75).metadata["error"] is None  # few pixels have two samples
    picture = timed(Clockwork(1e-4), 1.25)
    assert picture.metadata["error"] == pytest.approx(root_relmse(picture), rel=0.4)


def test_a_spent_budget_draws_one_tile_or_with_grants_each_pixel_once() -> None:
    late = timed(Clockwork(1e-4), 1e-9)
    assert (late.metadata["samples"], late.metadata["error"]) == (1, None)
    assert int(np.count_nonzero(~late.metadata["undrawn"])) == 32 * 32
    granted = timed(Clockwork(1e-4), 1e-9, grants=True)
    assert (granted.metadata["samples_mean"], granted.metadata["undrawn"]) == (1.0, None)


def test_channels_are_drawn_first_and_until_the_deadline() -> None:
    assert timed(Clockwork(), 0.5, aov=("depth",)).metadata["without_channels"] == 0
    late = timed(Clockwork(), 0.0, aov=("depth",))
    assert late.metadata["without_channels"] == len(film.tiles((0, 0, *SIZE)))


def test_the_most_samples_end_a_picture_before_its_budget() -> None:
    painter = Clockwork()
    assert timed(painter, 1e6, samples=40).metadata["samples"] == 40
    assert np.all(painter.taken == 40)


def test_luminance_is_of_the_linear_colour() -> None:
    picture = image.Image(1, 1, {"rgba": np.array([[[1.0, 2.0, 3.0, 1.0]]], np.float32)})
    assert picture.luminance[0, 0] == pytest.approx(0.2126729 + 2 * 0.7151522 + 3 * 0.0721750)
