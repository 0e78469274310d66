"""The stop reasons of curves."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.measure.chart import setting_sweeps, summary
from maquette.measure.chart.contestant import Step
from maquette.measure.records import Reference, Run, Setting

SHAPE = (12, 16, 3)
REFERENCE = Reference(np.full(SHAPE, 0.5), np.zeros(SHAPE), "made", 0, (), np.ones(SHAPE[:2]))


def sweep(backend: str, knob: str, values: tuple[float, ...], light: str = "") -> setting_sweeps.Sweep:
    return setting_sweeps.Sweep(backend, knob, tuple(Setting(backend, knob, v, {knob: v}) for v in values), values, light)


def step(setting: Setting, factor: float, noise: float = 0.01, notes: tuple[str, ...] = ()) -> Step:
    """Sixteen runs of a picture `factor` times as bright as the reference."""
    made, random = Step(setting), np.random.default_rng(4)
    for seed in range(16):
        rgb = (0.5 * factor * (1.0 + noise * random.standard_normal(SHAPE))).astype(np.float32)
        made.add(Run(rgb, {"build": 0.1, "render": 1.0 + seed}, 2.0, seed, np.ones(SHAPE[:2], np.float32), notes), REFERENCE, 0.0, "relmse")
    return made


def stops(of: setting_sweeps.Sweep, *factors: float, **more: object) -> str:
    """What is said of a curve whose steps are so much too bright."""
    steps = [step(setting, factor, **more) for setting, factor in zip(of.settings, factors, strict=False)]  # type: ignore[arg-type]
    found = summary.make_curve(of, steps, "relmse", REFERENCE, {"import": 3.0})
    assert found is not None
    return found.stops


@pytest.mark.parametrize(
    ("of", "factors", "said"),
    [
        (sweep("raster", "samples", (1, 4, 16), "no interreflection"), (1.1, 1.1), "no interreflection: bias 10 %"),
        (sweep("ray", "samples", (1, 4, 16)), (1.1, 1.1, 1.1), "16 samples: another picture than the reference: bias 10 %"),
        (sweep("mitsuba", "samples", (1, 4)), (1.1, 1.1), "what it computes differs: bias 10 %"),
        (sweep("ray", "samples", (1, 4, 16)), (1.1, 1.0), ""),  # no bias
        (sweep("ray", "samples", (1, 4, 16)), (1.1,), ""),  # only the pixels' centres yet
        (sweep("ray", "samples", (1,)), (1.1,), "one sample a pixel is its centre: edges are not smoothed: bias 10 %"),
        (sweep("raster", "tolerance", (3.2, 0.8)), (1.5,), ""),  # the next would have been finer
        (sweep("raster", "tolerance", (3.2, 0.8), "no interreflection"), (1.5, 1.1), "no interreflection: bias 10 %"),
    ],
)
def test_why_a_curve_stops(of: setting_sweeps.Sweep, factors: tuple[float, ...], said: str) -> None:
    assert stops(of, *factors) == said


def test_noise_larger_than_the_bias_is_no_stop() -> None:
    of = sweep("raster", "samples", (4, 16), "no interreflection")
    assert stops(of, 1.02, 1.02, noise=0.2) == ""


def test_what_the_backend_does_not_draw_is_said() -> None:
    of = sweep("raster", "samples", (4,), "no interreflection")
    assert stops(of, 1.1, notes=("raster draws glass unrefracted",)) == "no interreflection; raster draws glass unrefracted: bias 10 %"


def test_a_point_holds_medians_quartiles_and_every_stage() -> None:
    point = summary.make_point(step(Setting("ray", "samples", 4), 1.1), "relmse", REFERENCE, {"import": 3.0, "compile_kernels": 5.0})
    assert point is not None
    assert (point.seconds.low, point.seconds.median, point.seconds.high, point.seconds.count) == (4.75, 8.5, 12.25, 16)
    assert point.stages == {"import": 3.0, "compile_kernels": 5.0, "build": 0.1, "render": 8.5}
    assert point.cpu == 2.0
    assert point.error.median == pytest.approx(0.1, rel=0.02)
    assert (point.bias_block, point.note) == (1, "")
    assert summary.make_point(step(Setting("ray", "samples", 4), 1.1), "other", REFERENCE, {}) is None


def test_the_floor_is_the_references_own_error() -> None:
    """Of sixteen pictures 8 % noisy: 2 % of a relative metric, and the largest difference of either half to the mean."""
    random = np.random.default_rng(2)
    seeds = 0.5 * (1.0 + 0.08 * random.standard_normal((16, 200, 200, 4)))
    mean, variance = seeds.mean(axis=0), seeds.var(axis=0, ddof=1) / 16
    halves = seeds[::2].mean(axis=0), seeds[1::2].mean(axis=0)
    reference = Reference(mean[..., :3], variance[..., :3], "made", 16, tuple(range(16)), mean[..., 3], halves)
    found = summary.reference_uncertainty(reference, 0.0)
    assert found["relmse"] == pytest.approx(0.02, rel=0.02)
    assert found["relmse 99.9%"] == pytest.approx(0.02, rel=0.03)
    assert 0.03 < found["max"] < 0.08
    assert summary.reference_uncertainty(REFERENCE, 0.0) == {}
