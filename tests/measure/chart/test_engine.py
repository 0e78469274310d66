"""The chart engine: figures recomputed from raw images, hidden biases, budget, peers, interruption."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler import ir
from maquette.compiler.plan.plan import Plan
from maquette.measure.chart import contestant, engine, reference, runs
from maquette.measure.peers import process, registry
from maquette.measure.records import Chart, Curve, NothingMeasured, Point, Run, Setting, Wanted
from maquette.measure.report import json_format
from maquette.render import quality_settings as declared

SCENE = """\
plane(y: 0, material: lambert(0.7))
sphere(1, center: [0, 1, 0], material: lambert(#c04030))
area([1, 4, 1], look_at: [0, 1, 0], size: [1, 1], luminance: 20)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
render(background: #203040)
"""
PLANE = """\
plane(y: 0, material: lambert(0.5))
directional(from: [0, 1, 1], illuminance: 2)
camera(position: [0, 3, 0.01], look_at: [0, 0, 0], fov: 30deg)
"""
SIZE = (24, 18)
SETTINGS = ir.Settings(size=SIZE, threads=2)
DAY = 1e5  # seconds
RUNGS = {"samples": (1, 4, 16, 64), "error": (0.3, 0.1), "bounces": (0, 1, 3), "tolerance": (3.2, 0.2)}


def _short(knob: declared.QualitySetting) -> declared.QualitySetting:
    return replace(knob, values=RUNGS[knob.name])


def _steps(made: tuple[declared.QualitySetting, ...]) -> list[declared.QualitySetting]:
    """The settings that need no optional package."""
    return [knob for knob in made if knob.name in RUNGS]


def load(text: str, folder: Path) -> ir.Scene:
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    return maquette.load(path)


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Use a separate folder of references and few samples, so that no figure depends on the speed of the machine."""
    folder = tmp_path_factory.mktemp("references")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reference, "default_folder", lambda: folder)
        patch.setattr(engine, "TARGET_SAMPLES", 4096)
        short = {backend: tuple(map(_short, _steps(made))) for backend, made in declared.QUALITY_SETTINGS.items()}
        patch.setattr(declared, "QUALITY_SETTINGS", short)
        yield


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> ir.Scene:
    return load(SCENE, tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("kept") / "raw"


@pytest.fixture(scope="module")
def made(scene: ir.Scene, folder: Path) -> Chart:
    """One chart for many tests, with its images."""
    return engine.measure(scene, Wanted("a.scene", SETTINGS, ("ray", "raster"), budget=DAY, keep=folder))


def curve(made: Chart, backend: str, knob: str) -> Curve:
    return next(c for c in made.curves if (c.backend, c.knob) == (backend, knob))


def read(path: Path) -> np.ndarray:
    source: Any = oiio.ImageInput.open(str(path))
    pixels = source.read_image(oiio.FLOAT)
    source.close()
    return np.asarray(pixels, np.float64)[..., :3]


def weigh(squares: np.ndarray, truth: np.ndarray) -> float:
    """The mean of squares over R² + ε², as an independent implementation."""
    epsilon = 0.01 * float((truth @ np.array([0.2126729, 0.7151522, 0.0721750])).mean())
    return float((squares / (truth**2 + epsilon**2)).mean())


@pytest.mark.long
def test_every_number_comes_out_of_the_kept_images(made: Chart, folder: Path) -> None:
    index = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    truth, doubt = read(folder / "reference.exr"), read(folder / "reference-variance.exr")
    assert math.sqrt(weigh(doubt, truth)) == pytest.approx(made.floor, rel=1e-4)
    seen = whole = 0
    for of in made.curves:
        for point in of.points:
            mine = [r for r in index["runs"] if (r["backend"], r["curve"], r["value"]) == (of.backend, of.knob, point.setting.value)]
            pictures = [read(folder / r["file"]) for r in mine]
            n = len(pictures)
            seen += n
            whole += point.bias_block == 1
            assert n == point.error.count == point.seconds.count == 16
            errors = [math.sqrt(weigh((p - truth) ** 2, truth)) for p in pictures]
            assert np.quantile(errors, (0.25, 0.5, 0.75)) == pytest.approx(
                (point.error.low, point.error.median, point.error.high), rel=1e-4
            )
            assert np.median([r["seconds"]["render"] for r in mine]) == pytest.approx(point.seconds.median)
            largest = np.median([np.abs(p - truth).max() for p in pictures])
            assert largest == pytest.approx(point.errors["max"].median, rel=1e-4)
            spread = np.var(pictures, axis=0, ddof=1)
            assert point.noise == pytest.approx(math.sqrt(weigh(spread, truth)), rel=1e-4, abs=1e-9)
            away = weigh((np.mean(pictures, axis=0) - truth) ** 2 - spread / n - doubt, truth)
            if point.bias_block == 1:
                assert point.bias_squared == pytest.approx(away, rel=1e-3, abs=1e-7)
    assert seen == len(index["runs"])
    assert whole > 0.8 * len(made.points)


def test_no_two_renders_share_a_seed(made: Chart, folder: Path) -> None:
    index = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    seeds = [r["seed"] for r in index["runs"]] + index["reference"]["seeds"]
    assert len(set(seeds)) == len(seeds)
    assert min(index["reference"]["seeds"]) >= reference.FIRST_SEED > max(r["seed"] for r in index["runs"])


@pytest.mark.long
def test_a_missing_interreflection_is_a_floor_and_no_noise(scene: ir.Scene, made: Chart) -> None:
    """As large as long renders with and without it are apart."""
    full, shallow = (
        maquette.render(scene, size=SIZE, threads=2, samples=2048, seed=77 + n, bounces=n).channels["rgba"][..., :3].astype(np.float64)
        for n in (24, 0)
    )
    apart = math.sqrt(weigh((shallow - full) ** 2, full))
    assert apart > 0.03
    for of in (curve(made, "ray", "samples"), curve(made, "raster", "samples")):
        last = of.points[-1]
        assert last.bias == pytest.approx(apart, rel=0.1)
        assert of.stops.startswith("no interreflection: bias ")
        assert of.slope is not None
        assert of.slope < -0.8  # noise goes on falling, beside the floor
        assert last.noise is not None
        assert last.error.median == pytest.approx(math.hypot(apart, last.noise), rel=0.1)


def test_the_full_light_has_no_bias(made: Chart) -> None:
    of = curve(made, "ray", "samples, 20 bounces")
    assert of.stops == ""
    assert [p.bias for p in of.points if p.setting.value > 1] == [0.0] * (len(of.points) - 1)
    assert of.points[0].note == "one sample a pixel is its centre: edges are not smoothed"
    assert of.points[0].bias  # of edges
    assert of.slope is not None
    assert of.slope == pytest.approx(-1.2, abs=0.4)
    assert all(a.noise > b.noise for a, b in zip(of.points[1:], of.points[2:], strict=False))  # type: ignore[operator]


def test_bounces_bring_the_bias_down(made: Chart) -> None:
    found = [p.bias for p in curve(made, "ray", "bounces").points]
    assert all(bias is not None for bias in found)
    assert found[0] > found[1] >= found[2]  # type: ignore[operator]


def test_what_the_chart_says_of_itself(made: Chart) -> None:
    assert (made.scene, made.size, made.metric) == ("a.scene", SIZE, "relmse")
    assert made.reference.endswith("; interreflection to 20 bounces")
    assert made.machine.startswith("2 threads of ")
    assert {"maquette", "numpy", "numba", "python", "flip-evaluator"} <= set(made.versions)
    assert 0 < made.floor < 0.05
    best = [made.points[i] for i in made.front]
    assert [p.seconds.median for p in best] == sorted(p.seconds.median for p in best)
    assert made.knee is None or made.knee in made.front
    for point in made.points:
        assert {"import", "compile_kernels", "build", "render"} <= set(point.stages)
        assert point.stages["render"] == pytest.approx(point.seconds.median)
        assert set(point.errors) == {"relmse", "relmse 99.9%", "blocks", "flip", "max", "silhouette"}
        assert point.errors["relmse 99.9%"].median <= point.errors["relmse"].median * (1 + 1e-9)
        assert point.cpu is not None
        assert (point.errors["flip"].count, point.errors["max"].count) == (3, 16)
    assert json_format.read(json_format.dump(made)) == made


def measured(scene: ir.Scene, budget: float = DAY, **more: Any) -> Chart:
    more = {"settings": SETTINGS, "backends": ("ray",), **more}
    return engine.measure(scene, Wanted("a.scene", budget=budget, **more))


@pytest.mark.long
def test_the_budget_bounds_the_whole(scene: ir.Scene, made: Chart) -> None:  # which has loaded the kernels
    began = time.perf_counter()
    told: list[tuple[float, float]] = []
    wanted = Wanted("a.scene", SETTINGS, ("ray", "raster", "reference"), budget=4.0)
    found = engine.measure(scene, wanted, lambda done, total: told.append((done, total)))
    assert time.perf_counter() - began < 6.0
    assert any("do not fit into the budget of 4 s" in why or "longer --budget" in why for why in found.left_out.values())
    for backend in wanted.backends:
        assert any(point.setting.backend == backend for point in found.points) or any(name.startswith(backend) for name in found.left_out)
    assert told == sorted(told)
    assert 0 < told[0][0] <= told[-1][0] <= told[-1][1]


def test_too_little_time_is_said(tmp_path: Path) -> None:
    scene = load(SCENE.replace("#c04030", "#104030"), tmp_path)  # of which there is no reference yet
    with pytest.raises(NothingMeasured, match="give a longer --budget or a smaller --size"):
        measured(scene, budget=1e-4)


@pytest.mark.long
def test_as_many_renders_as_asked_for(scene: ir.Scene) -> None:
    assert {p.error.count for p in measured(scene, seeds=3).points} == {3}
    assert {p.error.count for p in measured(scene, seeds=2, repeats=4).points} == {4}


@pytest.mark.long
@pytest.mark.parametrize("metric", ["flip", "max", "silhouette"])
def test_every_metric_can_be_charted(scene: ir.Scene, metric: str) -> None:
    found = measured(scene, metric=metric, seeds=6)
    assert found.metric == metric
    assert 0 < found.floor < found.points[0].error.median
    for point in found.points:
        assert point.error == point.errors[metric]
        assert point.error.count == 6


@pytest.mark.long
def test_without_a_size_it_is_small(tmp_path: Path) -> None:
    scene = load(PLANE, tmp_path)
    assert measured(scene, settings=ir.Settings(threads=2), backends=("raster",), seeds=2).size == (160, 120)


@pytest.mark.long
def test_what_a_scene_says_of_samples_and_seeds_is_the_charts_to_turn(tmp_path: Path) -> None:
    scene = load(SCENE.replace("render(", "render(samples: 3, seed: 5, "), tmp_path)
    found = curve(measured(scene, seeds=2), "ray", "samples")
    assert [p.setting.value for p in found.points] == [1, 4, 16, 64]
    assert all(p.noise for p in found.points)


@pytest.mark.long
def test_a_closed_form_leaves_no_doubt(tmp_path: Path) -> None:
    scene = load(PLANE, tmp_path)
    found = measured(scene, backends=("ray", "raster"), seeds=2)
    assert found.reference.startswith("closed form: ")
    assert found.floor == 0.0
    assert max(p.error.median for p in found.points) < 1e-6
    assert all(c.stops == "" for c in found.curves)


# --- peers -----------------------------------------------------------------------------------------------------------


class Tinted:
    """A renderer that multiplies what ours draws with the full light by `factor`, and says nothing of coverage."""

    def __init__(self, name: str, factor: float = 1.0, missing: str = "", lost: tuple[str, ...] = (), fails: bool = False) -> None:
        self.name, self.factor, self.missing, self.lost, self.fails = name, factor, missing, list(lost), fails
        self.version = f"{name} 1"
        self.filters: list[str] = []

    def unsupported(self, scene: ir.Scene, plan: Plan) -> list[str]:
        return self.lost

    def sweep(self, scene: ir.Scene, plan: Plan) -> tuple[Setting, ...]:
        return tuple(Setting(self.name, "samples", n, {"samples": n}) for n in (4, 16))

    def run(self, scene: ir.Scene, plan: Plan, setting: Setting, seed: int) -> Run:
        if self.fails:
            raise process.PeerError(f"{self.name} failed: out of luck")
        self.filters.append(plan["filter"])
        settings = ir.Settings(size=plan["size"], threads=plan["threads"], bounces=plan["bounces"], filter=plan["filter"], seed=seed)
        drawn = runs.run(scene, runs.make_plan(scene, settings, Setting("ray", "samples", 1, setting.options), seed))
        return Run(drawn.rgb * np.float32(self.factor), drawn.seconds, drawn.cpu, seed)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> list[Tinted]:
    """The peers that are there."""
    there: list[Tinted] = []
    monkeypatch.setattr(registry, "find", lambda names: [peer for name in names for peer in there if peer.name == name])
    return there


def last(made: Chart, backend: str) -> Point:
    return next(c for c in made.curves if c.backend == backend).points[-1]


@pytest.mark.long
def test_a_bias_hidden_on_purpose_shows(scene: ir.Scene, found: list[Tinted]) -> None:
    """Two per cent too bright, far below its noise at 16 samples; beside it the same without."""
    found += [Tinted("honest"), Tinted("bright", 1.02)]
    made = measured(scene, peers=("honest", "bright"), seeds=16)
    honest, bright = last(made, "honest"), last(made, "bright")
    assert honest.bias == 0.0
    assert bright.bias_error is not None
    assert bright.bias_error < 0.006
    assert bright.bias == pytest.approx(0.02, abs=3 * bright.bias_error)
    assert "silhouette" not in bright.errors
    assert {made.versions[peer.name] for peer in found} == {"honest 1", "bright 1"}
    for peer in found:
        assert set(peer.filters) == {"box"}  # the one all have, and everybody takes it then
    assert all(p.setting.plan["filter"] == "box" for p in made.points if p.setting.backend == "ray")


@pytest.mark.long
def test_peers_that_cannot_are_left_out_with_why(scene: ir.Scene, found: list[Tinted]) -> None:
    found += [Tinted("absent", missing="not installed"), Tinted("plain", lost=("no light", "no matter")), Tinted("broken", fails=True)]
    made = measured(scene, peers=("absent", "plain", "broken"), seeds=2)
    said = {name: why for name, why in made.left_out.items() if not name.startswith("ray")}
    assert said == {"absent": "not installed", "plain": "no light; no matter", "broken, samples": "broken failed: out of luck"}
    assert {c.backend for c in made.curves} == {"ray"}


@pytest.mark.long
def test_a_peer_without_coverage_has_no_silhouette(scene: ir.Scene, found: list[Tinted]) -> None:
    found.append(Tinted("flat"))
    made = measured(scene, peers=("flat",), metric="silhouette", seeds=2)
    assert made.left_out["flat, samples"] == "its pictures do not have what `silhouette` measures"


# --- interruption ----------------------------------------------------------------------------------------------------


def test_interrupted_before_anything(scene: ir.Scene) -> None:
    cancel = threading.Event()
    cancel.set()
    with pytest.raises(NothingMeasured, match=r"^interrupted before anything was measured$"):
        engine.measure(scene, Wanted("a.scene", SETTINGS, ("ray",)), None, cancel)


@pytest.mark.long
def test_interrupted_on_the_way_charts_what_there_is(scene: ir.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    cancel, count = threading.Event(), [0]
    real = contestant.Step.add

    def add(*arguments: Any) -> None:
        real(*arguments)
        count[0] += 1
        if count[0] == 4:
            cancel.set()

    monkeypatch.setattr(contestant.Step, "add", add)
    found = engine.measure(scene, Wanted("a.scene", SETTINGS, ("ray",), budget=DAY), None, cancel)
    assert len(found.points) == 4
    assert {p.error.count for p in found.points} == {1}
    assert all(p.bias is None for p in found.points)
