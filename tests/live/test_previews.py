"""Denoised previews in the live window, and the finished picture after them."""

from __future__ import annotations

import threading
from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.live.previews import MORE, NOISY, RESTED, Previews
from maquette.render.film.progress import Picture, Progress
from maquette.render.image import metrics

from .windows import client, served

ROOM = """
box([4, 3, 4], center: [0, 1.5, 0], material: lambert(0.7))
sphere(0.5, center: [0.8, 0.5, 0.3], material: lambert(#d04030))
cylinder(0.3, 1, center: [-0.8, 0.5, -0.4], material: mirror(0.9))
camera(position: [0, 1.4, 1.8], look_at: [0, 0.8, 0], fov: 60deg)
sphere(1cm, center: [1.5, 2.5, -1], material: emissive(luminance: 90000))
box([0.6, 0.02, 0.6], center: [1.5, 2.3, -1], material: lambert(0.7))
render(bounces: 4, size: [96, 72])
"""


def noisy(samples: float, error: float | None = 2.0 * NOISY, made: bool = True) -> Progress:
    """Progress of a picture of 4 × 3 pixels whose denoiser returns zeros."""
    picture = Picture(np.ones((3, 4, 4), np.float32), np.full((3, 4), int(samples)))
    return Progress("rendering", 0.5, samples, 0, error, picture, denoiser=(lambda: np.zeros_like) if made else None)


def preview_of(previews: Previews, progress: Progress, seconds: float = 2.0 * RESTED) -> np.ndarray | None:
    """The preview that an offer leads to."""
    previews.offer(progress, seconds)
    for thread in threading.enumerate():
        if thread.name == "previews":
            thread.join()
    return previews.take()


def test_a_noisy_picture_that_rests_is_denoised() -> None:
    previews = Previews()
    assert preview_of(previews, noisy(16), 0.5 * RESTED) is None
    assert preview_of(previews, noisy(16, None)) is None
    assert preview_of(previews, noisy(16, 0.5 * NOISY)) is None
    assert preview_of(previews, noisy(16, made=False)) is None
    assert not previews.shown
    found = preview_of(previews, noisy(16))
    assert found is not None
    assert found.shape == (3, 4, 4)
    assert not found.any()
    assert previews.shown


def test_the_next_preview_has_more_samples() -> None:
    previews = Previews()
    assert preview_of(previews, noisy(16)) is not None
    assert preview_of(previews, noisy(16 * MORE - 1)) is None
    assert previews.shown
    assert preview_of(previews, noisy(16 * MORE)) is not None
    assert preview_of(previews, noisy(64, 0.5 * NOISY)) is None
    assert not previews.shown  # little noise is left


def test_a_cancelled_denoiser_and_a_failing_one_leave_the_noise() -> None:
    def fail(rgba: np.ndarray) -> np.ndarray:
        raise RuntimeError

    for made in (lambda: None, lambda: fail):
        previews = Previews()
        assert preview_of(previews, noisy(16)._replace(denoiser=made)) is None
        assert not previews.shown


@pytest.mark.long
def test_the_window_shows_previews_and_then_what_render_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyoidn")
    monkeypatch.setattr("maquette.live.previews.RESTED", 0.0)
    monkeypatch.setattr("maquette.live.studio.TICK", 0.03)
    path = tmp_path / "a.scene"
    path.write_text(ROOM, encoding="utf-8")
    final = maquette.render(path)
    assert final.metadata["denoised"]
    with served(path) as shown, client(shown) as page:
        page.wait(lambda: page.last["progress"].get("denoised"), 120.0)
        told = page.last["progress"]
        assert told["stage"] == "rendering"
        assert told["error"] > NOISY
        current = shown.session.studio.current
        assert current is not None
        preview = current.shown.rgba
        page.finished(seconds=240.0)
        assert page.wait(lambda: page.last["progress"]["stage"] == "done" and page.last["progress"])["denoised"]
        assert current.finished is not None
        assert np.array_equal(current.finished.channels["rgba"], final.channels["rgba"])
        assert metrics.root_relmse(preview, final.channels["rgba"]) < told["error"]
