"""A model of error and time: which command has an error in the least time, from runs of few samples.

The noise of a picture falls as n^(-1/2) with n samples a pixel (Monte Carlo), faster with Sobol points: across edges as n^(-3/4). The last
two runs tell the power, of which a share is believed for more samples. The error that denoising leaves falls slower at first, and as the
noise where little of it is left. Light that a limit on bounces leaves out is a bias, which does not fall: the squares of both add up.
The time of a command is that of its start and of its preparation, and that of its samples, which grows with them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..lang.schema.picture_settings import BACKENDS, MAX_SAMPLES
from ..render.film import adaptive_sampling
from .records import Answer, Curve, Point, Setting

ERRORS = (0.01, 0.02, 0.05, 0.1)  # √relMSE that are asked about
SAMPLES, ERROR, DENOISED = "samples", "error", "denoised samples"  # kinds of ways, by the names of render/quality_settings.py
USUAL = 0.5  # power of the samples by which noise falls
POWERS = {SAMPLES: (0.4, 0.8), ERROR: (0.4, 0.95), DENOISED: (0.12, 0.55)}  # that are believed
BELIEVED = {SAMPLES: 0.7, ERROR: 0.7, DENOISED: 0.5}  # share of what runs tell in the power of more samples
LATER = {SAMPLES: USUAL, ERROR: USUAL, DENOISED: 0.45}  # the power that it tends to
UNSURE = {SAMPLES: 0.03, ERROR: 0.03, DENOISED: 0.06}  # of these powers, at least
ALONE = {SAMPLES: (0.5, 0.06), ERROR: (0.55, 0.06), DENOISED: (0.4, 0.2)}  # power of one run, and how wrong it may be
CLOSE = 1.15  # factor of the samples, either way, that any prediction may be wrong by
CLOSE_ENOUGH = 1.05  # times a power of two, that samples may exceed it by
MAX_DOUBT = 100.0  # most factor of the samples that bounds are told with


class Seconds(NamedTuple):
    """A time: wall seconds and CPU seconds of all threads."""

    wall: float = 0.0
    cpu: float = 0.0


NO_TIME = Seconds()


class Run(NamedTuple):
    """What one run tells: mean samples a pixel, its √relMSE, and the time of drawing the picture."""

    samples: float
    error: float
    wall: float
    cpu: float


@dataclass(frozen=True, slots=True)
class Way:
    """A way to draw a picture, and what runs tell of it.

    `setting` is that of a run, of which another value makes a command; `start` the time of a command beside drawing; `bias` the share of
    light that it is known to leave out, and `bias_reason` what to do about that. `doubt` widens the bounds of the samples.
    """

    setting: Setting
    how: str  # "ray with paths"
    runs: tuple[Run, ...]
    start: Seconds = NO_TIME
    bias: float = 0.0
    bias_reason: str = ""
    doubt: float = 1.0

    @property
    def kind(self) -> str:
        """SAMPLES, ERROR or DENOISED."""
        return self.setting.knob

    def with_value(self, value: int | float) -> Setting:
        """The setting with another number of samples, or another error."""
        name = ERROR if self.kind == ERROR else SAMPLES
        return replace(self.setting, value=value, options={**self.setting.options, name: value})

    def _noise(self) -> list[tuple[float, float]]:
        """(samples, noise) of the runs, few samples first; noise never rises."""
        found: list[tuple[float, float]] = []
        for run in sorted(self.runs):
            noise = math.sqrt(max(run.error**2 - self.bias**2, 0.0))
            found.append((run.samples, min(noise, found[-1][1]) if found else noise))
        return found

    def power(self) -> tuple[float, float]:
        """(the power of the samples by which noise falls from the last run on, how wrong that may be)."""
        kind, (least, most) = self.kind, POWERS[self.kind]
        known = [(n, noise) for n, noise in self._noise() if noise > 0.0 and n > 0.0]
        slopes = [math.log(a[1] / b[1]) / math.log(b[0] / a[0]) for a, b in itertools.pairwise(known) if b[0] > 1.2 * a[0]]
        if not slopes:
            return ALONE[kind]
        seen = min(max(slopes[-1], least), most)
        share, later = BELIEVED[kind], LATER[kind]
        return share * seen + (1.0 - share) * later, max(0.5 * abs(seen - later), UNSURE[kind])

    def samples(self, target: float) -> tuple[float, float, float] | None:
        """(samples a pixel for a target error, at least, at most); None where no number of samples reaches it."""
        if target <= self.bias:
            return None
        wanted, known = math.sqrt(target**2 - self.bias**2), self._noise()
        fewest = float(adaptive_sampling.first_samples(target)) if self.kind == ERROR else known[0][0]
        factor = CLOSE * self.doubt
        power, unsure = self.power()
        before, last = known[0], known[-1]
        if wanted >= before[1]:
            margin = (before[1] / wanted) ** (1.0 / USUAL)  # of the first samples, which suffice
            count = before[0] * margin if self.kind == ERROR else before[0]
            return max(count, fewest), max(count / factor, fewest), max(before[0] * margin * factor, count, fewest)
        elif wanted < last[1]:
            growth = last[1] / wanted
            count = last[0] * growth ** (1.0 / power)
            steep, flat = (growth ** (1.0 / p) / growth ** (1.0 / power) for p in (power + unsure, max(power - unsure, 0.5 * power)))
            low, high = count * max(steep / factor, 1.0 / MAX_DOUBT), count * min(flat * factor, MAX_DOUBT)
            return None if count > MAX_SAMPLES else (max(count, fewest), max(low, fewest), max(high, fewest))
        else:
            before, after = next((a, b) for a, b in itertools.pairwise(known) if a[1] >= wanted >= b[1])
            share = math.log(before[1] / wanted) / math.log(before[1] / after[1]) if before[1] > after[1] > 0.0 else 1.0
            count = before[0] * (after[0] / before[0]) ** share
        return max(count, fewest), max(count / factor, fewest), max(count * factor, fewest)

    def seconds(self, samples: float) -> Seconds:
        """The time of the whole command with so many samples a pixel."""
        ordered = sorted(self.runs)
        last = ordered[-1]
        few = next((run for run in reversed(ordered) if run.samples < 0.8 * last.samples), None)

        def drawn(before: float | None, after: float) -> float:
            rate = after / last.samples if before is None or few is None else (after - before) / (last.samples - few.samples)
            rate = min(max(rate, 0.0), after / last.samples)
            return after + rate * (samples - last.samples)

        wall, cpu = drawn(few and few.wall, last.wall), drawn(few and few.cpu, last.cpu)
        return Seconds(self.start.wall + max(wall, 0.0), self.start.cpu + max(cpu, 0.0))

    def answer(self, target: float) -> Answer | None:
        """The command for a target error; None where this way does not reach it."""
        found = self.samples(target)
        if found is None:
            return None
        count, low, high = found
        if self.kind == ERROR:
            setting = self.with_value(_down(math.sqrt(target**2 - self.bias**2)))
            words = f"about {_round(count)} samples as needed"
        else:
            count = float(_up(count))
            setting = self.with_value(int(count))
            samples = f"{_round(count)} sample{'' if count == 1 else 's'}"
            words = f"{samples} and denoising" if self.kind == DENOISED else samples
        time, least, most = (self.seconds(n) for n in (count, low, max(high, count)))
        bounds = (time.wall, min(least.wall, time.wall), most.wall, time.cpu, min(least.cpu, time.cpu), most.cpu)
        return Answer(target, f"{self.how}, {words}", setting, count, *bounds)


def targets(asked: float) -> tuple[float, ...]:
    """The errors that a chart answers: the one asked for, then larger ones, then smaller ones."""
    others = [error for error in ERRORS if abs(error - asked) > 1e-9]
    return (asked, *(error for error in others if error > asked), *(error for error in reversed(others) if error < asked))


def answers(ways: Sequence[Way], asked: float) -> tuple[Answer, ...]:
    """The fastest way to each error of `targets`, or why there is none."""
    found = []
    for target in targets(asked):
        reaching = [answer for way in ways if way.runs and (answer := way.answer(target)) is not None]
        found.append(min(reaching, key=lambda answer: answer.seconds) if reaching else Answer(target, why=_why(ways, target)))
    return tuple(found)


def _why(ways: Sequence[Way], target: float) -> str:
    """Why no way reaches an error."""
    biased = [way for way in ways if way.bias >= target]
    if biased:
        least = min(biased, key=lambda way: way.bias)
        return least.bias_reason or f"no command reaches it: a bias of {100 * least.bias:.2g} % stays at any number of samples"
    if any(way.runs for way in ways):
        return f"no command reaches it with {MAX_SAMPLES:,} samples a pixel, the most there are"
    return "unknown: nothing was drawn in the budget"


def ways_of(curves: Sequence[Curve], names: Mapping[str, str], start: Seconds = NO_TIME, bias: float = 0.0, reason: str = "") -> list[Way]:
    """The ways of measured curves of our backends, `names` by backend.

    `bias` is the share of light that all of them leave out, and the reference too.
    """
    ways = []
    for curve in curves:
        points = [p for p in curve.points if p.setting.knob in POWERS and "relmse" in p.errors]
        points = [p for p in points if p.setting.value != 1] or points  # one sample lies at the centre of its pixel
        runs = [run for p in points if (run := _run_of(p)) is not None]
        if curve.backend not in BACKENDS or not runs:
            continue
        last = points[-1]
        own = last.bias if last.setting.knob != DENOISED and last.bias and last.bias > 2.0 * (last.bias_error or 0.0) else 0.0
        told = tuple(run._replace(error=math.hypot(run.error, bias)) for run in runs)
        why = reason if bias > own else f"no command reaches it: {curve.backend}: {curve.stops}" if curve.stops else ""
        ways.append(Way(last.setting, names.get(curve.backend, curve.backend), told, start, math.hypot(own, bias), why))
    return ways


def _run_of(point: Point) -> Run | None:
    """What a measured point tells; None where its samples are unknown.

    A picture until an error tells that of its first samples where these were enough, otherwise the error that it was to reach.
    """
    error, samples = point.errors["relmse"].median, point.samples
    if point.setting.knob == ERROR:
        if samples is None:
            return None
        if samples > 1.01 * adaptive_sampling.first_samples(point.setting.value):
            error = point.setting.value
    samples = float(point.setting.value) if samples is None else samples
    wall = point.seconds.median + point.stages.get("build", 0.0)
    return Run(samples, error, wall, wall if point.cpu is None else point.cpu) if math.isfinite(error) else None


def _up(samples: float) -> int:
    """A number of samples, rounded up to a power of two: others are no nets of Sobol points, and have more noise."""
    return min(1 << max(math.ceil(math.log2(max(samples, 1.0) / CLOSE_ENOUGH)), 0), MAX_SAMPLES)


def _down(error: float) -> float:
    """An error, rounded down to two digits."""
    scale = 10.0 ** (math.floor(math.log10(error)) - 1)
    return float(f"{math.floor(error / scale + 1e-6) * scale:.3g}")


def _round(samples: float) -> str:
    return f"{samples if samples == int(samples) else float(f'{samples:.2g}'):,.0f}"
