"""Path tracing against Mitsuba 3, on the Cornell box and other scenes: samples a second, and √relMSE against time."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import load
from ..compiler import ir
from ..compiler.plan import plan
from ..lights import SURFACES
from ..render.backends import prepare, ray
from ..render.film import film
from ..render.image import metrics
from ..render.types import View
from . import meshes, mitsuba, path_scenes, report
from .cycles import peer
from .harness import OURS, Case, Contender, Disagreement, Effort, Missing, Peers, Result, measure

SCENES = Path(__file__).resolve().parent / "scenes"
TEXT = """
The Cornell box as Mitsuba's `cornell_box()` has it, its lamp made black, and the same box with a torus knot of 70,000 flat triangles in
place of the two blocks. Path tracing to depth 8 (the lamp seen counts as 1), box filter, 32-bit colours, one thread. Scenes are loaded and
trees built before. *Rate* is a picture of 256² with 16 samples a pixel. *Error* is √relMSE of a picture of 128² against the mean of long
runs of the same renderer with other seeds, less what those runs' own noise adds; the long runs of both must agree, block by block, within
what their own seeds differ. *Asked for* is what `--error` takes, where pixels take as many samples as they need (from 2), beside what
Mitsuba takes to the error that the picture has. Mitsuba: the `path` integrator and its independent sampler, in llvm mode, and for the rate
also in scalar mode.

In diffuse scenes, groups of 16 pixels share their paths beyond the first surface (`transport.path_reuse`).

The other scenes are written in our language and for Mitsuba by our exporter: a room with 200 small lights (depth 6), four balls of rough
metal and four matt ones under a picture of the sky with a small sun (depth 6), glass on a table by a lamp (depth 10), and an interior of
500,000 triangles (depth 6).

Four rooms have media: a slab (depth 130), a ball of thin milk (258), haze with the sun through a window (66), a cloud of 256³ voxels (258).
Mitsuba's `volpath` draws them; `volpathmis` and Cycles the three even ones, with the coefficients as given.

The rooms are examples, written as USD by our exporter and read from there by all (depth 10): patterns are white, and the shapes of lights
are not seen. Mitsuba has no such lamps, and draws the room by a window alone. Cycles reads the stage itself, in a Python of its own with
bpy. It has no clamping, adaptive sampling or denoising; *guided* has path guiding. Materials and lights differ from ours: each is measured
against its own long runs, and answers are not compared. *Of blocks* is √relMSE of the means of 4 × 4 pixels.
"""
NAMES = ("cornell", "knot", *path_scenes.SETTINGS)  # values of `--only`
SLOW = ("knot", "lamps", "interior", "daylight", "evening", "door")  # fewer rounds, and long runs of 256 samples a pixel instead of 512
MEDIA = {"slab": 64, "milk": 64, "haze": 64, "cloud": 16}  # likewise; samples a pixel of long runs, of hundreds of collisions each
SAMPLE_COUNTS = (1, 4, 16, 64, 256)  # samples a pixel
ERRORS = (0.5, 0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01)  # at which times are compared
DEPTH = 8
BLOCKS = 8  # blocks along each side whose means are compared
SEEDS = 4  # of the long runs
MAX_Z2 = 2.5  # mean z² of blocks: 1 for noise alone, slightly more for variances of 2 · 4 runs
MAX_BIAS = 0.002  # allowed difference of the picture means beyond four standard errors

Picture = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reference:
    """The mean of a renderer's long runs, and the contributions of its noise to squared errors: of pixels, and of means of blocks."""

    mean: Picture
    noise: tuple[float, float]

    @classmethod
    def from_runs(cls, runs: Picture) -> Reference:
        """The reference of pictures (seeds, h, w, 3)."""

        def noise(values: Picture) -> float:
            mean = values.mean(axis=0)
            return metrics.root_relmse(mean + np.sqrt(values.var(axis=0, ddof=1) / len(values)), mean) ** 2

        return cls(runs.mean(axis=0), (noise(runs), noise(np.stack([metrics.block_means(run) for run in runs]))))

    def errors(self, picture: Picture) -> tuple[float, float]:
        """(√relMSE of pixels, √relMSE of the means of 4 × 4 pixels) of a picture."""
        measured = metrics.root_relmse(picture, self.mean), metrics.block_relmse(picture, self.mean)
        pixels, blocks = (math.sqrt(max(error**2 - noise, 0.0)) for error, noise in zip(measured, self.noise, strict=True))
        return pixels, blocks


@dataclass(frozen=True, eq=False)
class Renderer:
    """A renderer of one scene: `draw(size, samples, seed)` returns a callable that renders linear (size, size, 3)."""

    name: str
    draw: Callable[[int, int, int], Callable[[], Any]]
    read: Callable[[Any], Picture]
    draw_to: Callable[[int, float, int], Callable[[], Any]] | None = None  # the same with an error instead of a number of samples
    alike: bool = True  # whether its answers are compared with ours


def section(quick: bool, effort: Effort, only: str = "") -> report.Section:
    """Measure all scenes, or only one of NAMES. Each part records its own machine and day."""
    peers, effort = Peers(), dataclasses.replace(effort, seconds=effort.seconds / 2.0)  # a scene has a dozen cases
    result = report.Section("paths", "Paths", TEXT, versions=report.version_of("mitsuba", "drjit"))
    with tempfile.TemporaryDirectory() as folder:
        for k, name in enumerate(NAMES):
            if only not in ("", name) or (quick and not only and k > 2):
                continue
            title, sides, scalar = _scene_of(name, Path(folder), quick, peers)
            part = report.Section(f"paths {k + 1} {name}", title, "", versions=result.versions, level=3)
            ladder = (1, 4) if quick else (*SAMPLE_COUNTS, 1024) if name == "cornell" else SAMPLE_COUNTS
            ladder = tuple(samples for samples in ladder if samples <= MEDIA.get(name, ladder[-1]))
            slow = name in (*SLOW, *MEDIA)
            less = dataclasses.replace(effort, rounds=min(effort.rounds, 3), fewest=min(effort.fewest, 2)) if slow else effort
            _compare(part, sides, scalar, quick, MEDIA.get(name, 256 if slow else 512), ladder, less)
            result.parts.append(part)
    result.missing = peers.missing
    return result


def _scene_of(name: str, folder: Path, quick: bool, peers: Peers) -> tuple[str, list[Renderer], Callable[[], list[Renderer]]]:
    """(title, available renderers, a factory of the renderers that are measured for their rate alone)."""
    if name in path_scenes.SETTINGS:
        setting = path_scenes.SETTINGS[name](folder, quick)
        sides = [our_renderer(setting.decide), *_available(peers, functools.partial(exported_renderer, setting, folder))]
        if setting.media:
            sides += _available(peers, functools.partial(exported_renderer, setting, folder, "volpathmis"))
        if setting.stage is not None:
            sides += _available(peers, functools.partial(cycles_renderer, setting, False))
            sides += [] if setting.media else _available(peers, functools.partial(cycles_renderer, setting, True))
        return setting.title, sides, list
    filled, title = None, "Cornell box"
    if name == "knot":
        rings = (100, 10) if quick else meshes.SIZES["70k"]
        filled, title = folder / "knot.ply", f"{2 * rings[0] * rings[1]:,} triangles in the box"
        meshes.write_ply(filled, meshes.knot(*rings))
    sides = [
        our_renderer(functools.partial(_decide, build_scene(filled))),
        *_available(peers, functools.partial(mitsuba_renderer, filled, mitsuba.LLVM)),
    ]
    return title, sides, functools.partial(_available, peers, functools.partial(mitsuba_renderer, filled, "scalar_rgb"))


def _compare(
    result: report.Section, sides: list[Renderer], scalar: Callable[[], list[Renderer]], quick: bool, long: int,
    ladder: Sequence[int], effort: Effort,
) -> None:  # fmt: skip
    """Measure one scene: long runs, samples a second, and errors."""
    size, samples = (32, 4) if quick else (256, 16)
    try:
        agreement, references = long_runs(sides, 32 if quick else 128, 16 if quick else long)
    except Disagreement as why:
        result.refused.append(f"{result.title}: {why}")
        result.blocks.append(f"No times: the long runs differ: {why}.")
        return
    fast = rates(sides, size, samples, effort)
    tables = error_tables(sides, references, ladder, effort)
    slower = scalar()  # last, as a change of Mitsuba's mode slows its next picture
    slow = [rates([sides[0], *slower], size, samples, effort)] if slower else []
    result.add("Rate", [fast, *slow], "Msamples/s")
    result.blocks.append(f"**Error**\n\n{tables}\n\nLong runs: {agreement}.")


def _available(peers: Peers, make: Callable[[], Renderer]) -> list[Renderer]:
    """The renderer in a list, empty if it is not installed."""
    try:
        return [make()]
    except Missing as why:
        if str(why) not in peers.missing:
            peers.missing.append(str(why))
        return []


# --- the two renderers ---------------------------------------------------------------------------------------------------


def our_renderer(decide: Callable[..., tuple[ir.Scene, plan.Plan]]) -> Renderer:
    """maquette; each picture is prepared before the measurement."""

    def draw(size: int, samples: int | None, seed: int, error: float | None = None) -> Callable[[], Any]:
        scene, decided = decide(size, samples, seed, error)
        view = View(decided["camera"], size, size)
        prepared = prepare.prepare(scene, decided, view)
        return lambda: film.run(ray.Renderer(prepared, decided, view), decided, view).channels["rgba"]

    def draw_to(size: int, error: float, seed: int) -> Callable[[], Any]:
        return draw(size, None, seed, error)

    return Renderer(OURS, draw, lambda rgba: np.asarray(rgba[..., :3], np.float64), draw_to)


def build_scene(filled: Path | None) -> ir.Scene:
    if filled is None:
        return load(SCENES / "cornell.scene")
    lines = [line for line in (SCENES / "cornell.scene").read_text(encoding="utf-8").splitlines() if not line.startswith("box(")]
    path = filled.with_suffix(".scene")
    flat = 'lambert(rgb(0.885809, 0.698859, 0.666422), shading: "flat")'  # a file without normals would get smooth ones
    path.write_text("\n".join([*lines, f'mesh("{filled.name}", translate: [0, -0.35, 0], material: {flat})']), encoding="utf-8")
    return load(path)


def _decide(scene: ir.Scene, size: int, samples: int | None, seed: int, error: float | None = None) -> tuple[ir.Scene, plan.Plan]:
    settings = ir.Settings(
        size=(size, size), samples=samples, error=error, seed=seed, backend="ray", bounces=DEPTH - 2, filter="box", threads=1,
        background=(0.0, 0.0, 0.0),
    )  # fmt: skip
    return scene, plan.make_plan(scene, settings)


def exported_renderer(setting: path_scenes.Setting, folder: Path, integrator: str = "") -> Renderer:
    """Mitsuba's LLVM mode on our exported scene, with its own integrator or this one. Raises Missing for lights that are not carried."""
    mi = mitsuba.load()
    lit = setting.scene.tables.lights
    if (ir.is_in(lit.kind, SURFACES) & (lit.instance < 0)).any():
        raise Missing(f"Mitsuba has no area lights that are not seen: not measured on “{setting.title}”")

    @functools.cache
    def loaded(size: int) -> Any:
        place = folder / f"{setting.title.split()[0]}-{size}"
        place.mkdir(exist_ok=True)
        path = setting.exported(size, place)
        if integrator:
            before, integrators, after = path.read_text(encoding="utf-8").partition('integrator type="volpath"')
            if not integrators:
                raise ValueError("the exported scene has no integrator of media")
            path = path.with_name(f"{integrator}.xml")
            path.write_text(f'{before}integrator type="{integrator}"{after}', encoding="utf-8")
        return mi.load_file(str(path))

    def draw(size: int, samples: int, seed: int) -> Callable[[], Any]:
        scene = loaded(size)
        return lambda: np.array(mi.render(scene, spp=samples, seed=seed))

    return Renderer(f"Mitsuba {integrator or 'llvm'}", draw, lambda rgb: np.asarray(rgb, np.float64)[..., :3], alike=not setting.staged)


def cycles_renderer(setting: path_scenes.Setting, guiding: bool) -> Renderer:
    """Cycles on the stage of a room, with or without path guiding."""
    assert setting.stage is not None
    worker = peer.Cycles(setting.stage, setting.media)

    def draw(size: int, samples: int, seed: int) -> Callable[[], Any]:
        return lambda: peer.read(worker.draw(size, samples, seed, setting.depth - 2, guiding))

    return Renderer("Cycles guided" if guiding else "Cycles", draw, lambda rgb: rgb, alike=False)


def mitsuba_renderer(filled: Path | None, variant: str) -> Renderer:
    """Mitsuba's own Cornell box, with a black light."""
    mi = mitsuba.load(variant)

    @functools.cache
    def loaded(size: int) -> Any:
        description = mi.cornell_box()
        description["light"]["bsdf"] = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
        description["integrator"]["max_depth"] = DEPTH
        description["sensor"]["film"].update(width=size, height=size, rfilter={"type": "box"})
        if filled is not None:
            del description["small-box"], description["large-box"]
            to_world = mi.ScalarTransform4f().translate([0.0, -0.35, 0.0])
            white = {"type": "ref", "id": "white"}
            description["knot"] = {"type": "ply", "filename": str(filled), "to_world": to_world, "face_normals": True, "bsdf": white}
        return mi.load_dict(description)

    def draw(size: int, samples: int, seed: int) -> Callable[[], Any]:
        scene = loaded(size)
        return lambda: np.array(mi.render(scene, spp=samples, seed=seed))

    return Renderer(f"Mitsuba {variant.split('_')[0]}", draw, lambda rgb: np.asarray(rgb, np.float64))


# --- what is measured ----------------------------------------------------------------------------------------------------


def long_runs(sides: Sequence[Renderer], size: int, samples: int) -> tuple[str, dict[str, Reference]]:
    """(comparison, each renderer's reference of SEEDS long runs). Raises Disagreement if they differ by more than noise."""
    runs = {side.name: np.stack([side.read(side.draw(size, samples, 1000 + k)()) for k in range(SEEDS)]) for side in sides}
    references = {name: Reference.from_runs(pictures) for name, pictures in runs.items()}
    said, alike = [f"{SEEDS} × {samples} samples a pixel"], {side.name for side in sides if side.alike}
    for name in list(runs)[1:]:
        off = references[name].mean.mean() / references[OURS].mean.mean() - 1.0
        z2 = block_z2(runs[OURS], runs[name])
        text = f"{name}: mean {off:+.3%}, mean z² of blocks {z2:.2f}"
        if any(np.array_equal(*pictures[:2]) for pictures in runs.values()):
            raise Disagreement("runs with different seeds are the same")
        wholes = [runs[n].mean(axis=(1, 2, 3)) for n in (OURS, name)]
        chance = math.sqrt(sum(w.var(ddof=1) / len(w) for w in wholes)) / references[OURS].mean.mean()
        if name in alike and (abs(off) > MAX_BIAS + 4.0 * chance or z2 > MAX_Z2):
            raise Disagreement(text)
        said.append(text)
    return "; ".join(said), references


def block_z2(a: Picture, b: Picture) -> float:
    """Mean over blocks and channels of z², the difference of two sets of runs (seeds, h, w, 3) over its standard error.

    The variance of a block is the mean over 3 × 3 blocks, as few runs may make a single one small by chance.
    """

    def blocks(runs: Picture) -> Picture:
        seeds, height, width, _ = runs.shape
        return runs.reshape(seeds, BLOCKS, height // BLOCKS, BLOCKS, width // BLOCKS, 3).mean(axis=(2, 4))

    def variance(runs: Picture) -> Picture:
        padded = np.pad(runs.var(axis=0, ddof=1) / len(runs), ((1, 1), (1, 1), (0, 0)), mode="edge")
        return np.mean([padded[i : i + BLOCKS, j : j + BLOCKS] for i in range(3) for j in range(3)], axis=0)

    first, second = blocks(a), blocks(b)
    return float(np.mean((first.mean(axis=0) - second.mean(axis=0)) ** 2 / (variance(first) + variance(second))))


def rates(sides: Sequence[Renderer], size: int, samples: int, effort: Effort) -> Result:
    """Measure samples a second."""
    contenders = [_contender(side, size, samples, effort, []) for side in sides]
    return measure(Case(f"{size}², {samples} samples", contenders, _agree(sides), size * size * samples), effort)


def _contender(side: Renderer, size: int, samples: int, effort: Effort, pictures: list[Picture], error: float = 0.0) -> Contender:
    """A contender with a new seed for each run; collects the pictures."""
    draw, much = (side.draw_to, error) if error and side.draw_to else (side.draw, samples)
    work = iter([draw(size, much, seed) for seed in range(1, effort.rounds + 2)])  # pyright: ignore[reportArgumentType]

    def run() -> Any:
        picture = next(work)()
        pictures.append(side.read(picture))
        return picture

    return Contender(side.name, run, side.read)


def _agree(sides: Sequence[Renderer]) -> Callable[[Mapping[str, Any]], str]:
    """The comparison of the answers that should be alike."""
    alike = [side.name for side in sides if side.alike]
    return lambda answers: agree_means({name: answers[name] for name in alike})


def agree_means(answers: Mapping[str, Any]) -> str:
    """Compare the means of pictures within four standard errors, estimated from neighbouring pixels."""
    mean = {name: float(answer.mean()) for name, answer in answers.items()}
    text = ", ".join(f"{name} {value:.5f}" for name, value in mean.items())
    for name, value in mean.items():
        open_ = MAX_BIAS * mean[OURS] + 4.0 * math.hypot(_standard_error(answers[OURS]), _standard_error(answers[name]))
        if abs(value - mean[OURS]) > open_:
            raise Disagreement(f"means {text}")
    return f"means {text}"


def _standard_error(picture: Picture) -> float:
    """The standard error of the mean of a noisy picture (h, w, 3)."""
    light = picture.mean(axis=2, dtype=np.float64)
    return float(np.sqrt(np.mean(np.diff(light, axis=1) ** 2) / 2.0 / light.size))


def error_tables(sides: Sequence[Renderer], references: Mapping[str, Reference], ladder: Sequence[int], effort: Effort) -> str:
    """Tables of √relMSE and CPU time for each number of samples, and of the time to equal error."""
    size = len(next(iter(references.values())).mean)
    rows, curves, blocks = [], {side.name: [] for side in sides}, {side.name: [] for side in sides}
    for samples in ladder:
        pictures: dict[str, list[Picture]] = {side.name: [] for side in sides}
        contenders = [_contender(side, size, samples, effort, pictures[side.name]) for side in sides]
        result = measure(Case("", contenders, _agree(sides)), effort)
        if result.refused:
            rows.append((f"{samples}", f"no times: {result.refused}", *("" for _ in range(3 * len(sides) - 1))))
            continue
        cells = [f"{samples}"]
        for times in result.times:
            name = times.contender.name
            error, coarse = np.median([references[name].errors(picture) for picture in pictures[name]], axis=0).tolist()
            curves[name].append((times.spread().median, error))
            blocks[name].append((times.spread().median, coarse))
            cells += [f"{times.spread().median * 1e3:.3g}", f"{error:.2%}", f"{coarse:.2%}"]
        rows.append(tuple(cells))
    head = ["samples", *(f"{side.name}, {what}" for side in sides for what in ("CPU ms", "√relMSE", "of blocks"))]
    tables = [report.grid(head, rows)]
    if len(sides) > 1:
        tables += [equal_error(curves), f"The same by means of 4 × 4 pixels:\n\n{equal_error(blocks)}"]
    if sides[0].draw_to is not None:
        tables.append(adaptive_table(sides[0], references, curves, size, effort))
    return "\n\n".join(table for table in tables if table)


def adaptive_table(
    side: Renderer, references: Mapping[str, Reference], curves: Mapping[str, Sequence[tuple[float, float]]], size: int, effort: Effort
) -> str:
    """Table of CPU time with a requested error, where sampling is adaptive, beside the times of others at equal error."""
    rows = []
    peers = [name for name in curves if name != OURS]
    for target_error in (0.3, 0.2, 0.1, 0.05):
        if target_error < min((error for _, error in curves[OURS]), default=1.0):
            break  # outside of the measured range
        pictures: list[Picture] = []
        times = measure(Case("", [_contender(side, size, 0, effort, pictures, target_error)], lambda _: ""), effort).times[0]
        error, took = float(np.median([references[OURS].errors(picture)[0] for picture in pictures])), times.spread().median
        longer = [time_to(error, curves[name]) for name in peers]
        cells = [f"{target_error:.0%}", f"{error:.2%}", f"{took * 1e3:.3g}"]
        for theirs in longer:
            cells += [f"{theirs * 1e3:.3g}", f"{theirs / took:.2f}"] if theirs else ["", ""]
        rows.append(tuple(cells))
    head = ["√relMSE asked for", "is", f"{OURS}, CPU ms", *(text for name in peers for text in (f"{name}, CPU ms", f"{name} × ours"))]
    return report.grid(head, rows) if rows else ""


def equal_error(curves: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """CPU time to round errors, interpolated between measured points (log-log linear)."""
    names = list(curves)
    rows = []
    for error in ERRORS:
        took = {name: time_to(error, curve) for name, curve in curves.items()}
        if all(value is not None for value in took.values()):
            shown = {name: value or 0.0 for name, value in took.items()}
            rows.append((f"{error:.0%}", *(f"{shown[n] * 1e3:.3g}" for n in names), *(f"{shown[n] / shown[OURS]:.2f}" for n in names[1:])))
    if not rows:
        return "No error was reached by all: times to the same error are unknown."
    return report.grid(["√relMSE", *(f"{n}, CPU ms" for n in names), *(f"{n} × ours" for n in names[1:])], rows)


def time_to(error: float, curve: Sequence[tuple[float, float]]) -> float | None:
    """Seconds to an error on a curve of (seconds, error) with falling errors; None outside of the measured range."""
    for (t0, e0), (t1, e1) in itertools.pairwise(curve):
        if e0 >= error >= e1 and e0 > e1:
            share = math.log(e0 / error) / math.log(e0 / e1)
            return math.exp(math.log(t0) + share * (math.log(t1) - math.log(t0)))
    return None
