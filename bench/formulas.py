"""Formula surfaces: first hits and normals of an orthographic picture, against fidget (https://github.com/mkeeter/fidget)."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from ..compiler import solids
from ..compiler.tapes import INPUTS, Builder, Op, Tape, arity
from ..render import across, rays
from ..render.formulas import compiled, fields, meet, plain
from ..render.handles import Handle
from ..render.kernels import kernel
from ..render.links import FLOAT, VEC
from . import report
from .harness import OURS, Case, Contender, Disagreement, Effort, Missing, Peers, measure

TEXT = """
First hits and normals of orthographic pictures, one ray a pixel, on one core. Ours: the grid of cells is built anew for each picture,
then all rays are met to rounding in double precision; the formula's own code is compiled (that happens once, in the background).
fidget: a height map of as many voxels deep as the picture is wide, single precision, with normals, by its JIT and its interpreter; its
process is timed from its start, which takes about 3 ms. Where two differ in what is hit, they differ at outlines. Of each model 500
rays are checked against the definition in numpy.
"""
MOST_APART = 6.0  # pixels for each of a row that may be hit by one and not by the other: outlines, which fidget has half a pixel off
BOX = np.array([[-1.0] * 3, [1.0] * 3])
POINT = (0, 1, 2)


def section(quick: bool, effort: Effort) -> report.Section:
    """Every model at one size, or two."""
    peers = Peers()
    found = report.Section("formulas", "Formula surfaces", TEXT)
    with tempfile.TemporaryDirectory() as folder:
        for size in (32,) if quick else (512, 1024):
            results = []
            for name, tape in models().items():
                desk = Desk(Path(folder), name, tape, size)
                sides = peers.gather(desk.ours, lambda d=desk: d.fidget("jit"), lambda d=desk: d.fidget("vm"))
                results.append(measure(Case(name, sides, desk.agree, amount=size * size), effort))
            found.add(f"{size}²", results, "M rays/s", by="cpu")
    found.missing = peers.missing
    return found


class Desk:
    """A model, the rays of its picture, and its contenders."""

    def __init__(self, folder: Path, name: str, tape: Tape, size: int) -> None:
        self.folder, self.name, self.tape, self.size = folder, name, tape, size
        self.turn = _turn()
        steps = (np.arange(size) + 0.5) / size * 2 - 1
        x, y = np.meshgrid(steps, -steps)
        self.origin = np.stack([x.ravel(), y.ravel(), np.full(size * size, 2.5)], axis=1) @ self.turn.T
        self.way = np.tile(self.turn @ [0.0, 0.0, -1.0], (size * size, 1))
        self.parameters = np.zeros(13)
        self.parameters[5] = 1.0

    def ours(self) -> Contender:
        address = _linked()
        self._trees()
        compiled.finish()
        n = len(self.origin)
        out = np.empty(n), np.empty(n, np.int64), np.empty(n), np.empty(n)

        def work() -> Any:
            fields._known.clear()
            trace(self._trees(), address, self.origin, self.way, *out)
            return out

        return Contender(OURS, work, lambda found: found[0].copy())

    def _trees(self) -> Handle:
        return Handle(fields._pooled(np.array([0], np.int32), [fields.field(self.tape, self.parameters, BOX)]))

    def fidget(self, how: str) -> Contender:
        program = shutil.which("fidget-once")
        if program is None:
            raise Missing("fidget-once is not on the PATH (cargo install --path bench/fidget)")
        model, depths = self.folder / f"{self.name}.vm", self.folder / f"{self.name}-{how}.depths"
        model.write_text(text_of(self.tape), encoding="utf-8")
        matrix = np.eye(4)
        matrix[:3, :3] = self.turn
        numbers = ",".join(repr(float(v)) for v in matrix.astype(np.float32).ravel())
        command = [program, str(model), str(self.size), how, numbers, str(depths)]
        return Contender(
            f"fidget {how}",
            lambda: subprocess.run(command, check=True, capture_output=True),
            lambda _: np.where(np.fromfile(depths, np.uint32) > 0, 1.0, np.inf),
        )

    def agree(self, answers: Mapping[str, Any]) -> str:
        """The share of pixels hit by one alone; ours by the definition."""
        t = answers[OURS]
        pick = np.random.default_rng(1).integers(0, len(t), 500)
        o, d = self.origin[pick], self.way[pick]
        everywhere = np.zeros(500), np.full(500, np.inf)
        true, _, _, _, doubt = plain.meet(self.tape, self.parameters, BOX, tuple(o.T), tuple(d.T), *everywhere)
        wrong = int(((np.isfinite(true) != np.isfinite(t[pick])) & ~doubt).sum())
        both = np.isfinite(true) & np.isfinite(t[pick])
        if wrong or np.abs(true[both] - t[pick][both]).max(initial=0.0) > 1e-8:
            raise Disagreement(f"{wrong} of 500 rays are not as the definition has them")
        said = [f"{np.isfinite(t).mean():.1%} hit"]
        for name, other in answers.items():
            apart = float((np.isfinite(t) != np.isfinite(other)).mean())
            if apart > MOST_APART / self.size:
                raise Disagreement(f"{name} hits {apart:.1%} of the pixels otherwise")
            if name != OURS:
                said.append(f"{name} {apart:.2%} otherwise")
        return ", ".join(said)


@kernel
def trace(forms, address, origin, direction, t, spacing, u, v):
    """Meet rays with the one surface there is."""
    n = len(t)
    for start in range(0, n, across.WIDTH):
        o, d = rays._three(origin, start, n), rays._three(direction, start, n)
        zero = 0.0 * o[0]
        at, units, a, b, _ = meet.call(address, (forms, np.int64(0), o, d, zero, zero + np.inf))
        rays._put(t, start, n, at)
        rays._put(spacing, start, n, units)
        rays._put(u, start, n, a)
        rays._put(v, start, n, b)


def _linked() -> int:
    nothing = Handle(fields._pooled(np.zeros(0, np.int32), []))
    return meet.meet.link(nothing.numba_type, types.int64, VEC, VEC, FLOAT, FLOAT)


def _turn() -> np.ndarray:
    pitch, yaw = np.radians(-25), np.radians(30)
    about_x = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    return about_y @ about_x


# --- models, in −1 … 1 --------------------------------------------------------------------------------------------------


def models() -> dict[str, Tape]:
    """Name → tape."""
    makers = {
        "torus": _torus, "heart": _heart, "gyroid shell": _gyroid, "Barth sextic": _barth, "metaballs": _metaballs,
        "smooth union": _smooth, "100 balls": _balls, "perforated plate": _plate,
    }  # fmt: skip
    made = {}
    for name, maker in makers.items():
        b = Builder()
        made[name] = b.finish(maker(b))
    return made


def _torus(b: Builder) -> int:
    return solids.analytic(b, 8, (0.6, 0.25), POINT)


def _heart(b: Builder) -> int:
    x, y, z = (b.op(Op.SQUARE, b.scaled(name, 1.35)) for name in POINT)
    body = b.power(b.linear([(1.0, x), (2.25, y), (1.0, z)], -1.0), b.constant(3.0))
    cube = b.power(b.scaled(2, 1.35), b.constant(3.0))
    return b.subtract(body, b.multiply(cube, b.linear([(1.0, x), (9 / 80, y)])))


def _gyroid(b: Builder) -> int:
    p = [b.scaled(name, 12.0) for name in POINT]
    waves = [b.multiply(b.op(Op.SIN, p[k]), b.op(Op.COS, p[(k + 1) % 3])) for k in range(3)]
    shell = b.scaled(b.shifted(b.op(Op.ABS, b.add(b.add(waves[0], waves[1]), waves[2])), -0.2), 1 / 12)
    return b.op(Op.MAX, b.shifted(solids.length(b, POINT), -0.9), shell)


def _barth(b: Builder) -> int:
    phi = (1 + 5**0.5) / 2
    x, y, z = (b.op(Op.SQUARE, b.scaled(name, 2.0)) for name in POINT)
    pairs = [b.linear([(phi**2, p), (-1.0, q)]) for p, q in ((x, y), (y, z), (z, x))]
    ball = b.op(Op.SQUARE, b.linear([(1.0, x), (1.0, y), (1.0, z)], -1.0))
    product = b.multiply(b.multiply(pairs[0], pairs[1]), pairs[2])
    return b.op(Op.MAX, b.linear([(-0.08, product), (0.02 * (1 + 2 * phi), ball)]), b.shifted(solids.length(b, POINT), -0.95))


def _away(b: Builder, center: np.ndarray) -> list[int]:
    return [b.shifted(name, -float(c)) for name, c in zip(POINT, center, strict=True)]


def _metaballs(b: Builder) -> int:
    random, total = np.random.default_rng(3), b.constant(0.0)
    for center, sharp in zip(random.uniform(-0.55, 0.55, (8, 3)), random.uniform(12, 30, 8), strict=True):
        square = b.op(Op.SQUARE, solids.length(b, _away(b, center)))
        total = b.add(total, b.op(Op.EXP, b.scaled(square, -float(sharp))))
    return b.subtract(b.constant(0.4), total)


def _spheres(b: Builder, count: int, spread: float, low: float, high: float) -> list[int]:
    random = np.random.default_rng(7)
    centers, radii = random.uniform(-spread, spread, (count, 3)), random.uniform(low, high, count)
    return [b.shifted(solids.length(b, _away(b, c)), -float(r)) for c, r in zip(centers, radii, strict=True)]


def _smooth(b: Builder) -> int:
    first, *others = _spheres(b, 8, 0.5, 0.1, 0.25)
    for other in others:
        first = solids.union(b, first, other, 0.1)
    return first


def _balls(b: Builder) -> int:
    parts = _spheres(b, 100, 0.5, 0.05, 0.12)
    while len(parts) > 1:
        parts = [b.several(Op.MIN, parts[k : k + 2]) for k in range(0, len(parts), 2)]
    return parts[0]


def _plate(b: Builder) -> int:
    """A thick plate with 64 holes through it and a rim: the large tape of an engineer."""
    plate = solids.analytic(b, 2, (0.6, 0.15, 0.6), POINT)
    for i in range(8):
        for k in range(8):
            point = (b.shifted(0, 0.14 * (i - 3.5)), 1, b.shifted(2, 0.14 * (k - 3.5)))
            plate = solids.difference(b, plate, solids.analytic(b, 6, (0.045, 0.3, 1.0), point), 0.0)
    return plate


_WORDS = {
    Op.ADD: "add", Op.SUBTRACT: "sub", Op.MULTIPLY: "mul", Op.DIVIDE: "div", Op.NEGATE: "neg", Op.ABS: "abs", Op.SQUARE: "square",
    Op.SQRT: "sqrt", Op.MIN: "min", Op.MAX: "max", Op.EXP: "exp", Op.LOG: "ln", Op.SIN: "sin", Op.COS: "cos", Op.COPY: "copy",
}  # fmt: skip


def text_of(tape: Tape) -> str:
    """A tape in fidget's text form."""
    lines = [f"_v{k} var-{axis}" for k, axis in enumerate("xyz")]
    lines += [f"_c{k} const {number!r}" for k, number in enumerate(tape.constants.tolist())]

    def named(name: int) -> str:
        return f"_v{name}" if name >= 0 else f"_c{~name}"

    for i, (op, *operands) in enumerate(tape.code.tolist()):
        given = [named(name) for name in operands[: arity(op)]]
        out = f"_v{INPUTS + i}"
        if op == Op.HYPOT:
            lines += [f"{out}a square {given[0]}", f"{out}b square {given[1]}", f"{out}s add {out}a {out}b", f"{out} sqrt {out}s"]
        else:
            lines.append(f"{out} {_WORDS[Op(op)]} {' '.join(given)}")
    return "\n".join(lines) + "\n"
