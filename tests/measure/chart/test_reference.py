"""References: independent seeds, disk cache, extension, and replacement of damaged or outdated files."""

from __future__ import annotations

import threading
from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.measure.chart import reference, reference_light, runs
from maquette.measure.records import NothingMeasured, Reference

SCENE = """\
sphere(1, center: [0, 1, 0], material: lambert(#c04030))
plane(y: 0, material: lambert(0.6))
area([1, 4, 1], look_at: [0, 1, 0], size: [1, 1], luminance: 20)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
"""
SETTINGS = ir.Settings(size=(20, 14), threads=2)
DAY = 1e5  # seconds: the aim is what ends it


@pytest.fixture
def scene(tmp_path: Path) -> ir.Scene:
    return load(SCENE, tmp_path)


def load(text: str, folder: Path) -> ir.Scene:
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    return maquette.load(path)


def made(scene: ir.Scene, folder: Path, aim: int = 256, seconds: float = DAY, settings: ir.Settings = SETTINGS) -> Reference:
    light = reference_light.choose(scene, settings)
    return reference.make(scene, light, reference.Effort(seconds, aim, lambda share: None, threading.Event()), folder / "kept")


def kept(folder: Path) -> list[Path]:
    return sorted((folder / "kept").iterdir())


@pytest.mark.long
def test_it_is_the_mean_of_its_seeds_and_their_variance(scene: ir.Scene, tmp_path: Path) -> None:
    found = made(scene, tmp_path)
    assert found.samples == 256 == 16 * len(found.seeds)
    assert found.seeds == tuple(range(reference.FIRST_SEED, reference.FIRST_SEED + 16))
    assert found.how == "256 samples a pixel of ray, float64, seeds 10000000 to 10000015; interreflection to 14 bounces"
    pictures = np.array(
        [maquette.render(scene, size=(20, 14), samples=16, bounces=14, seed=seed).channels["rgba"] for seed in found.seeds], np.float64
    )
    np.testing.assert_allclose(found.rgb, pictures[..., :3].mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.variance, pictures[..., :3].var(axis=0, ddof=1) / 16, rtol=1e-8, atol=1e-15)
    assert found.alpha is not None
    np.testing.assert_allclose(found.alpha, pictures[..., 3].mean(axis=0), rtol=1e-12)
    assert found.halves is not None
    for half, first in zip(found.halves, (0, 1), strict=True):
        np.testing.assert_allclose(half, pictures[first::2].mean(axis=0), rtol=1e-12)


@pytest.mark.long
def test_it_is_kept_and_a_longer_run_goes_on_where_it_ended(scene: ir.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []
    real = runs.run

    def counting(scene: ir.Scene, plan: object, cancel: object = None) -> object:
        drawn.append(plan["seed"])  # type: ignore[index]
        return real(scene, plan, cancel)  # type: ignore[arg-type]

    monkeypatch.setattr(runs, "run", counting)
    first = made(scene, tmp_path)
    assert drawn == [reference.FIRST_SEED - 1, *first.seeds]  # the first finds out how long it takes
    drawn.clear()
    again = made(scene, tmp_path)
    assert drawn == []
    np.testing.assert_array_equal(again.rgb, first.rgb)
    longer = made(scene, tmp_path, aim=320)
    assert drawn == [reference.FIRST_SEED + k for k in range(16, 20)]
    assert longer.samples == 320
    assert len(kept(tmp_path)) == 1
    elsewhere = made(scene, tmp_path / "other", aim=320)
    assert elsewhere.samples == 320
    np.testing.assert_allclose(longer.rgb, elsewhere.rgb, rtol=0.2)


def damaged(data: bytes) -> list[bytes]:
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 0xFF
    return [b"", data[:50], data[: len(data) // 2], bytes(flipped), b"no archive at all" * 100]


@pytest.mark.long
def test_a_damaged_file_is_made_anew(scene: ir.Scene, tmp_path: Path) -> None:
    sound = made(scene, tmp_path)
    (path,) = kept(tmp_path)
    data = path.read_bytes()
    for broken in damaged(data):
        path.write_bytes(broken)
        np.testing.assert_array_equal(made(scene, tmp_path).rgb, sound.rgb)
        assert kept(tmp_path) == [path]
        assert reference.load(path, (14, 20, 4)) is not None
    assert reference.load(path, (14, 21, 4)) is None
    np.savez(path, samples=16)
    assert reference.load(path, (14, 20, 4)) is None


def test_what_shows_something_else_has_a_file_of_its_own(scene: ir.Scene, tmp_path: Path) -> None:
    variants = [
        (scene, SETTINGS),
        (scene, ir.Settings(size=(20, 15))),
        (scene, ir.Settings(size=(20, 14), bounces=1)),
        (scene, ir.Settings(size=(20, 14), filter="box")),
        (load(SCENE.replace("#c04030", "#c04031"), tmp_path), SETTINGS),
    ]
    keys = [reference.cache_name(s, reference_light.choose(s, settings).plan(s)) for s, settings in variants]
    assert len(set(keys)) == len(keys)
    alike = reference_light.choose(scene, ir.Settings(size=(20, 14), threads=1, seed=5))
    assert reference.cache_name(scene, alike.plan(scene, samples=9)) == keys[0]


@pytest.mark.long
def test_a_folder_that_cannot_be_written_to_is_done_without(scene: ir.Scene, tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("a file stands where the folder should")
    assert made(scene, tmp_path).samples == 256


def test_the_oldest_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = reference.Accumulation(4)
    for seed in range(4):
        run.add(np.full((8, 8, 4), float(seed)))
    for name in "abc":
        reference.save(run, tmp_path / f"{name}.npz")
    size = (tmp_path / "a.npz").stat().st_size
    monkeypatch.setattr(reference, "CACHE_BYTES", int(2.5 * size))
    reference.save(run, tmp_path / "d.npz")
    left = [p.name for p in tmp_path.iterdir()]
    assert len(left) == 2
    assert "d.npz" in left


def test_little_time_makes_few_samples_and_too_little_is_said(scene: ir.Scene, tmp_path: Path) -> None:
    with pytest.raises(NothingMeasured, match=r"^a reference of 4 times 4 samples alone would take .* s of the 1e-05 s there are for it: "):
        made(scene, tmp_path, seconds=1e-5)


@pytest.mark.long
def test_a_stop_keeps_what_there_is(scene: ir.Scene, tmp_path: Path) -> None:
    cancel = threading.Event()
    light = reference_light.choose(scene, SETTINGS)
    told: list[float] = []

    def progress(share: float) -> None:
        told.append(share)
        if len(told) == 5:
            cancel.set()

    with pytest.raises(runs.Cancelled):
        reference.make(scene, light, reference.Effort(DAY, 256, progress, cancel), tmp_path / "kept")
    assert told == sorted(told)
    (path,) = kept(tmp_path)
    found = reference.load(path, (14, 20, 4))
    assert found is not None
    assert found.count == 5


def test_a_closed_form_is_exact(tmp_path: Path) -> None:
    scene = load("plane(y: 0, material: lambert(0.5))\ndirectional(from: [0, 1, 0], illuminance: 2)\n"
                 "camera(position: [0, 3, 0.01], look_at: [0, 0, 0], fov: 30deg)\n", tmp_path)  # fmt: skip
    found = made(scene, tmp_path)
    np.testing.assert_allclose(found.rgb, 1.0 / np.pi, rtol=1e-12)
    assert not found.variance.any()
    assert (found.samples, found.seeds, found.halves) == (0, (), None)
    assert found.how == "closed form: one matt plane in directional and ambient light, ρE/π + k_a L_a"
    assert not (tmp_path / "kept").exists()
