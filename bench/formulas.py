"""Formula surfaces: first hits and normals of an orthographic picture, against fidget (https://github.com/mkeeter/fidget)."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..compiler.formula import numpy_interpreter, solid_fields
from ..compiler.formula.builder import Builder
from ..compiler.formula.opcodes import Op, arity
from ..compiler.formula.tape import INPUTS, Tape
from ..render.accel import ray_queries
from ..render.accel.formula_packets import packet_memory
from ..render.formula import intersect, numpy_reference, packet_state, packets, scene_surfaces, tape_jit
from ..render.formula.tables import Forms
from ..render.jit.kernel import kernel
from ..render.jit.packed_struct import Handle
from ..render.jit.value_types import INT64
from ..render.lanes import crosslane
from ..render.lanes.kinds import FLOAT, VEC
from ..shapes import SHAPES
from . import report
from .harness import OURS, Case, Contender, Disagreement, Effort, Missing, Peers, Result, measure

TEXT = """
First hits and normals of orthographic pictures, one ray a pixel, on one core. Ours: rays go as bundles of 64 × 64 pixels, as camera rays
of the ray backend do, and are met to rounding in double precision; the formula's own code is compiled (that happens once, in the
background), and the tape's tables are ready. Threads' memory and simpler tapes are made anew for each picture; the grid of cells that other
rays need fills where such rays come, and none do here. fidget: a height map of as many voxels deep as the picture is wide, single
precision, with normals, by its JIT and its interpreter; its process is timed from its start, which takes about 3 ms. POV-Ray: an
isosurface to 1e-6 with the largest gradient that a model has in its box, of 128² pixels (heart: 32², Barth sextic: 64²); all of its
process, its start too. Where two differ in what is hit, they differ at outlines.
Of each model 2000 rays are checked against the definition in numpy, and all rays
against rays one by one, through a grid of cells.
"""
MAX_DIFFERING = 6.0  # times the row length: pixels at outlines that only one may hit; fidget's are half a pixel off
POVRAY_SIZES = {"heart": 32, "Barth sextic": 64}  # picture sizes; all others are 128²
MAX_FORMULA = 20_000  # characters of a formula for POV-Ray
CHECKED = 2000  # rays compared with the numpy interpreter
NAMES = ("512", "1024", "povray")  # parts: picture sizes against fidget, and POV-Ray
BOX = np.array([[-1.0] * 3, [1.0] * 3])
POINT = (0, 1, 2)


def section(quick: bool, effort: Effort, only: str = "") -> report.Section:
    """Measure all models at one or two sizes and against POV-Ray, or only one of NAMES. Each part records its own machine and day."""
    result = report.Section("formulas", "Formula surfaces", TEXT)
    for k, name in enumerate(NAMES):
        if only not in ("", name) or (quick and not only and name == "1024"):
            continue
        peers = Peers()
        if name == "povray":
            title, results = "POV-Ray", against_povray(peers, quick, replace(effort, rounds=1, fewest=1))
        else:
            title = f"{32 if quick else name}²"
            less = effort if name == "512" else replace(effort, fewest=min(effort.fewest, 2), seconds=effort.seconds / 2)
            results = against_fidget(peers, 32 if quick else int(name), less)
        if not results:
            result.missing = [*result.missing, *peers.missing]
            continue
        part = report.Section(f"formulas {k + 1} {name}", title, "", missing=peers.missing, level=3)
        part.add("Each model", results, "M rays/s", by="cpu")
        result.parts.append(part)
    return result


def against_fidget(peers: Peers, size: int, effort: Effort) -> list[Result]:
    """All models at one size."""
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for name, tape in models().items():
            subject = ModelCase(Path(folder), name, tape, size)
            makers = [subject.ours, lambda d=subject: d.fidget("jit"), lambda d=subject: d.fidget("vm")]
            results.append(measure(Case(name, peers.gather(*makers), subject.agree, amount=size * size), effort))
    return results


def against_povray(peers: Peers, quick: bool, effort: Effort) -> list[Result]:
    """All models that POV-Ray supports; empty without POV-Ray."""
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for name, tape in models().items():
            subject = ModelCase(Path(folder), name, tape, 16 if quick else POVRAY_SIZES.get(name, 128))
            sides = peers.gather(subject.ours, subject.povray)
            if len(sides) > 1:
                results.append(measure(Case(name, sides, subject.agree, amount=subject.size**2), effort))
    return results


class ModelCase:
    """A model, the rays of its picture, and its contenders."""

    def __init__(self, folder: Path, name: str, tape: Tape, size: int) -> None:
        self.folder, self.name, self.tape, self.size = folder, name, tape, size
        self.turn = _view_rotation()
        steps = (np.arange(size) + 0.5) / size * 2 - 1
        x, y = np.meshgrid(steps, -steps)
        self.order = _order(size)
        origin = np.stack([x.ravel(), y.ravel(), np.full(size * size, 2.5)], axis=1) @ self.turn.T
        self.origin = np.ascontiguousarray(origin[self.order])  # packet by packet
        self.way = np.tile(self.turn @ [0.0, 0.0, -1.0], (size * size, 1))
        self.parameters = np.zeros(13)
        self.parameters[5] = 1.0

    def ours(self) -> Contender:
        n = len(self.origin)
        forms = self.forms()
        tape_jit.finish()
        columns, frame = packet_state.ray_columns(self.origin, self.way, 0.0, np.inf), np.eye(4)[:3]
        out = np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n), np.empty(n)

        def work() -> Any:
            packet = Handle(packet_memory.allocate(forms, 0))
            out[0][:] = np.inf
            if packets.trace(packet, columns, 0, n, frame, packets.HitColumns(*out, 0)) < n:
                raise RuntimeError("no packet")
            return out[0]

        return Contender(OURS, work, self._rows)

    def forms(self) -> Forms:
        return scene_surfaces.of_surfaces([scene_surfaces.Surface(self.tape, self.parameters, BOX)])

    def _rows(self, values: np.ndarray) -> np.ndarray:
        """Packet-ordered values in the order of the picture."""
        ordered = np.empty_like(values)
        ordered[self.order] = values
        return ordered

    def one_by_one(self) -> np.ndarray:
        """The same hits by single rays."""
        n = len(self.origin)
        forms = Handle(self.forms())
        out = np.empty(n), np.empty(n, np.int64), np.empty(n), np.empty(n)
        trace(forms, _linked(), self.origin, self.way, *out)
        return self._rows(out[0])

    def fidget(self, how: str) -> Contender:
        program = shutil.which("fidget-once")
        if program is None:
            raise Missing("fidget-once is not on the PATH (cargo install --path bench/fidget)")
        model, depths = self.folder / f"{self.name}.vm", self.folder / f"{self.name}-{how}.depths"
        model.write_text(fidget_text(self.tape), encoding="utf-8")
        matrix = np.eye(4)
        matrix[:3, :3] = self.turn
        numbers = ",".join(repr(float(v)) for v in matrix.astype(np.float32).ravel())
        command = [program, str(model), str(self.size), how, numbers, str(depths)]
        return Contender(
            f"fidget {how}",
            lambda: subprocess.run(command, check=True, capture_output=True),
            lambda _: np.where(np.fromfile(depths, np.uint32) > 0, 1.0, np.inf),
        )

    def povray(self) -> Contender:
        """POV-Ray's isosurface."""
        program = shutil.which("povray")
        if program is None:
            raise Missing("povray is not on the PATH (Debian's package povray)")
        text = povray_formula(self.tape)
        if len(text) > MAX_FORMULA:
            raise Missing(f"{self.name}: POV-Ray has no names for parts of a formula, and all of it is {len(text):,} letters long")
        scene, picture = self.folder / "model.pov", self.folder / "model.png"
        steepest = _max_gradient(self.tape)
        eye, right, up = self.turn @ [0, 0, 2.5], self.turn @ [2.0, 0, 0], self.turn @ [0, 2.0, 0]
        scene.write_text(
            "#version 3.7;\nglobal_settings { assumed_gamma 1 }\n"
            f"camera {{ orthographic location {_vector(eye)} direction {_vector(-eye)} right {_vector(right)} up {_vector(up)} }}\n"
            f"isosurface {{ function {{ {text} }} contained_by {{ box {{ <-1,-1,-1>, <1,1,1> }} }} max_gradient {steepest} accuracy 1e-6\n"
            "pigment { rgb 1 } finish { emission 1 diffuse 0 } }\n",
            encoding="utf-8",
        )
        size = f"+W{self.size} +H{self.size}"
        command = [program, f"+I{scene}", f"+O{picture}", *size.split(), "-D", "+FN", "-A", "+WT1", "-GA"]

        def read(_: Any) -> np.ndarray:
            import OpenImageIO as oiio

            return np.where(np.asarray(oiio.ImageBuf(str(picture)).get_pixels())[:, :, 0].ravel() > 0.5, 1.0, np.inf)

        return Contender("POV-Ray", lambda: subprocess.run(command, check=True, capture_output=True), read)

    def agree(self, answers: Mapping[str, Any]) -> str:
        """Check that few pixels are hit by only one contender, and our hits against the numpy interpreter."""
        t = answers[OURS]
        alone = self.one_by_one()
        differ = int((np.isfinite(t) != np.isfinite(alone)).sum())
        if differ:
            raise Disagreement(f"{differ} of {len(t)} rays differ between packets and single rays")
        pick = np.random.default_rng(1).integers(0, len(t), CHECKED)
        o, d = self._rows(self.origin)[pick], self.way[pick]
        everywhere = np.zeros(CHECKED), np.full(CHECKED, np.inf)
        true, _, _, _, doubt = numpy_reference.first_hit(self.tape, self.parameters, BOX, tuple(o.T), tuple(d.T), *everywhere)
        wrong = int(((np.isfinite(true) != np.isfinite(t[pick])) & ~doubt).sum())
        both = np.isfinite(true) & np.isfinite(t[pick])
        if wrong or np.abs(true[both] - t[pick][both]).max(initial=0.0) > 1e-8:
            raise Disagreement(f"{wrong} of {CHECKED} rays are not as the definition has them")
        said = [f"{np.isfinite(t).mean():.1%} hit"]
        for name, other in answers.items():
            apart = float((np.isfinite(t) != np.isfinite(other)).mean())
            if apart > MAX_DIFFERING / self.size:
                raise Disagreement(f"{name} hits {apart:.1%} of the pixels otherwise")
            if name != OURS:
                said.append(f"{name} {apart:.2%} otherwise")
        return ", ".join(said)


def _order(size: int) -> np.ndarray:
    """The pixels of a picture in nested squares of 64 × 64, 16 × 16 and 4 × 4."""
    y, x = (part.ravel() for part in np.mgrid[:size, :size])
    return np.lexsort((x % 4, y % 4, x % 16 // 4, y % 16 // 4, x % 64 // 16, y % 64 // 16, x // 64, y // 64))


@kernel
def trace(forms, address, origin, direction, t, spacing, u, v):
    """Intersect rays with the only surface."""
    n = len(t)
    for start in range(0, n, crosslane.WIDTH):
        o, d = ray_queries.load_vectors(origin, start, n), ray_queries.load_vectors(direction, start, n)
        zero = 0.0 * o[0]
        distance, units, a, b, _ = intersect.call(address, (forms, np.int64(0), o, d, zero, zero + np.inf))
        ray_queries.store_numbers(t, start, n, distance)
        ray_queries.store_numbers(spacing, start, n, units)
        ray_queries.store_numbers(u, start, n, a)
        ray_queries.store_numbers(v, start, n, b)


def _linked() -> int:
    nothing = Handle(scene_surfaces.of_surfaces([]))
    return intersect.first_hit.link(nothing.type, INT64, VEC, VEC, FLOAT, FLOAT)


def _view_rotation() -> np.ndarray:
    pitch, yaw = np.radians(-25), np.radians(30)
    about_x = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    return about_y @ about_x


# --- models, in −1 … 1 --------------------------------------------------------------------------------------------------


def models() -> dict[str, Tape]:
    """Tapes by model name."""
    makers = {
        "torus": _torus, "heart": _heart, "gyroid shell": _gyroid, "Barth sextic": _barth, "metaballs": _metaballs,
        "smooth union": _smooth, "100 balls": _balls, "perforated plate": _plate, "colonnade": _colonnade, "bear": _bear,
    }  # fmt: skip
    tapes = {}
    for name, maker in makers.items():
        b = Builder()
        tapes[name] = b.finish(maker(b))
    return tapes


def _torus(b: Builder) -> int:
    return SHAPES[8].field(b, (0.6, 0.25), POINT)


def _heart(b: Builder) -> int:
    x, y, z = (b.op(Op.SQUARE, b.scale(name, 1.35)) for name in POINT)
    body = b.power(b.linear([(1.0, x), (2.25, y), (1.0, z)], -1.0), b.constant(3.0))
    cube = b.power(b.scale(2, 1.35), b.constant(3.0))
    return b.subtract(body, b.multiply(cube, b.linear([(1.0, x), (9 / 80, y)])))


def _gyroid(b: Builder) -> int:
    p = [b.scale(name, 12.0) for name in POINT]
    waves = [b.multiply(b.op(Op.SIN, p[k]), b.op(Op.COS, p[(k + 1) % 3])) for k in range(3)]
    shell = b.scale(b.offset(b.op(Op.ABS, b.add(b.add(waves[0], waves[1]), waves[2])), -0.2), 1 / 12)
    return b.op(Op.MAX, b.offset(solid_fields.length(b, POINT), -0.9), shell)


def _barth(b: Builder) -> int:
    phi = (1 + 5**0.5) / 2
    x, y, z = (b.op(Op.SQUARE, b.scale(name, 2.0)) for name in POINT)
    pairs = [b.linear([(phi**2, p), (-1.0, q)]) for p, q in ((x, y), (y, z), (z, x))]
    ball = b.op(Op.SQUARE, b.linear([(1.0, x), (1.0, y), (1.0, z)], -1.0))
    product = b.multiply(b.multiply(pairs[0], pairs[1]), pairs[2])
    return b.op(Op.MAX, b.linear([(-0.08, product), (0.02 * (1 + 2 * phi), ball)]), b.offset(solid_fields.length(b, POINT), -0.95))


def _distance_vector(b: Builder, center: np.ndarray) -> tuple[int, int, int]:
    x, y, z = (b.offset(name, -float(c)) for name, c in zip(POINT, center, strict=True))
    return x, y, z


def _metaballs(b: Builder) -> int:
    random, total = np.random.default_rng(3), b.constant(0.0)
    for center, sharp in zip(random.uniform(-0.55, 0.55, (8, 3)), random.uniform(12, 30, 8), strict=True):
        square = b.op(Op.SQUARE, solid_fields.length(b, _distance_vector(b, center)))
        total = b.add(total, b.op(Op.EXP, b.scale(square, -float(sharp))))
    return b.subtract(b.constant(0.4), total)


def _spheres(b: Builder, count: int, spread: float, low: float, high: float) -> list[int]:
    random = np.random.default_rng(7)
    centers, radii = random.uniform(-spread, spread, (count, 3)), random.uniform(low, high, count)
    return [b.offset(solid_fields.length(b, _distance_vector(b, c)), -float(r)) for c, r in zip(centers, radii, strict=True)]


def _blend(b: Builder, first: int, second: int, radius: float) -> int:
    """The union of two fields, filled by an arc as if their surfaces met at right angles."""
    first_gap, second_gap = (b.linear([(-1.0, name)], radius) for name in (first, second))
    return b.linear([(-1.0, b.op(Op.ARC, first_gap, second_gap, b.constant(0.0)))], radius)


def _smooth(b: Builder) -> int:
    first, *others = _spheres(b, 8, 0.5, 0.1, 0.25)
    for other in others:
        first = _blend(b, first, other, 0.1)
    return first


def _balls(b: Builder) -> int:
    parts = _spheres(b, 100, 0.5, 0.05, 0.12)
    while len(parts) > 1:
        parts = [b.reduce(Op.MIN, parts[k : k + 2]) for k in range(0, len(parts), 2)]
    return parts[0]


def _plate(b: Builder) -> int:
    """A thick plate with 64 holes and a rim: a large engineering tape."""
    plate = SHAPES[2].field(b, (0.6, 0.15, 0.6), POINT)
    for i in range(8):
        for k in range(8):
            point = (b.offset(0, 0.14 * (i - 3.5)), 1, b.offset(2, 0.14 * (k - 3.5)))
            plate = b.op(Op.MAX, plate, b.op(Op.NEGATE, SHAPES[6].field(b, (0.045, 0.3, 1.0), point)))
    return plate


def _colonnade(b: Builder) -> int:
    """Two rows of twelve columns with bases, capitals and rings, on steps and under a roof."""
    parts = []
    for x in np.linspace(-0.66, 0.66, 12):
        for z in (-0.3, 0.3):
            parts.append(SHAPES[6].field(b, (0.04, 0.7, 1.0), _distance_vector(b, np.array([x, 0.0, z]))))
            parts += [SHAPES[2].field(b, (0.055, 0.02, 0.055), _distance_vector(b, np.array([x, y, z]))) for y in (-0.34, 0.34)]
            parts += [SHAPES[8].field(b, (0.04, 0.01), _distance_vector(b, np.array([x, y, z]))) for y in (-0.31, 0.29, 0.31)]
    for k in range(3):
        parts.append(
            SHAPES[2].field(
                b, (0.74 + 0.05 * k, 0.02, 0.42 + 0.05 * k), _distance_vector(b, np.array([0.0, -0.38 - 0.04 * k, 0.0]))
            )
        )
    roof = [SHAPES[2].field(b, (0.76, 0.03, 0.44), _distance_vector(b, np.array([0.0, 0.39, 0.0])))]
    slopes = [b.linear([(0.55, 2), (1.0, 1)], -0.64), b.linear([(-0.55, 2), (1.0, 1)], -0.64)]
    roof.append(b.reduce(Op.MAX, [*slopes, b.linear([(-1.0, 1)], 0.42), b.offset(b.op(Op.ABS, 0), -0.74)]))
    parts += roof
    return b.reduce(Op.MIN, parts)


def _bear(b: Builder) -> int:
    """Ellipsoids that blend into each other: body, head, limbs, ears, snout."""
    blobs = [((0, -0.2, 0), (0.36, 0.42, 0.3)), ((0, 0.38, 0.03), (0.27, 0.25, 0.24)), ((0, 0.3, 0.24), (0.11, 0.09, 0.12))]
    for side in (-1, 1):
        blobs += [((0.2 * side, 0.58, 0), (0.09, 0.1, 0.05)), ((0.2 * side, 0.58, 0.04), (0.05, 0.06, 0.03))]
        blobs += [((0.34 * side + 0.05 * k * side, -0.02 - 0.06 * k, 0.06 * k), (0.1, 0.11, 0.1)) for k in range(5)]
        blobs += [((0.2 * side + 0.02 * k * side, -0.5 - 0.03 * k, 0.08 * k), (0.13, 0.14, 0.13)) for k in range(6)]
        blobs += [((0.1 * side, 0.44, 0.22), (0.03, 0.035, 0.02)), ((0.28 * side, -0.64, 0.42), (0.1, 0.09, 0.06))]
    union = -1
    for center, radii in blobs:
        point = [b.scale(name, 1 / r) for name, r in zip(_distance_vector(b, np.array(center, float)), radii, strict=True)]
        ellipsoid = b.scale(b.offset(solid_fields.length(b, point), -1.0), min(radii))
        union = ellipsoid if union < 0 else _blend(b, union, ellipsoid, 0.04)
    return union


_WORDS = {
    Op.ADD: "add", Op.SUBTRACT: "sub", Op.MULTIPLY: "mul", Op.DIVIDE: "div", Op.NEGATE: "neg", Op.ABS: "abs", Op.SQUARE: "square",
    Op.SQRT: "sqrt", Op.MIN: "min", Op.MAX: "max", Op.EXP: "exp", Op.LOG: "ln", Op.SIN: "sin", Op.COS: "cos", Op.COPY: "copy",
}  # fmt: skip


def povray_formula(tape: Tape) -> str:
    """A tape as one POV-Ray expression, with shared values repeated; truncated if it is long."""
    values = ["x", "y", "z"]

    def named(name: int) -> str:
        return values[name] if name >= 0 else f"({float(tape.constants[~name])!r})"

    for op, *operands in tape.code.tolist():
        operand_texts = [named(name) for name in operands[: arity(op)]]
        values.append(_POVRAY[Op(op)].format(*operand_texts)[: 2 * MAX_FORMULA])
    return named(tape.results[0])


_POVRAY = {
    Op.ADD: "({}+{})", Op.SUBTRACT: "({}-{})", Op.MULTIPLY: "({}*{})", Op.DIVIDE: "({}/{})", Op.NEGATE: "(-{})", Op.ABS: "abs({})",
    Op.SQUARE: "pow({},2)", Op.CUBE: "pow({},3)",
    Op.SQRT: "sqrt({})", Op.MIN: "min({},{})", Op.MAX: "max({},{})", Op.EXP: "exp({})", Op.SIN: "sin({})",
    Op.COS: "cos({})", Op.COPY: "{}", Op.HYPOT: "sqrt(pow({},2)+pow({},2))",
    Op.QUARTER_ARC: "max(max({0},{1}),sqrt(pow(max({0},0),2)+pow(max({1},0),2)))",
}  # fmt: skip


def _vector(v: Any) -> str:
    return "<" + ",".join(f"{float(c):.12g}" for c in v) + ">"


def _max_gradient(tape: Tape) -> float:
    """The largest sampled gradient of a model in its box, which POV-Ray needs. Smaller values leave holes, as in the heart."""
    p = np.random.default_rng(2).uniform(-1, 1, (3, 100_000))
    _, gradient = numpy_interpreter.gradients(tape, *p)
    return round(float(np.nanmax(np.linalg.norm(gradient, axis=0))), 2)


def fidget_text(tape: Tape) -> str:
    """A tape in fidget's text form."""
    lines = [f"_v{k} var-{axis}" for k, axis in enumerate("xyz")]
    lines += [f"_c{k} const {number!r}" for k, number in enumerate(tape.constants.tolist())]

    def named(name: int) -> str:
        return f"_v{name}" if name >= 0 else f"_c{~name}"

    for i, (op, *operands) in enumerate(tape.code.tolist()):
        names = [named(name) for name in operands[: arity(op)]]
        out = f"_v{INPUTS + i}"
        if op == Op.HYPOT:
            lines += [f"{out}a square {names[0]}", f"{out}b square {names[1]}", f"{out}s add {out}a {out}b", f"{out} sqrt {out}s"]
        elif op == Op.CUBE:
            lines += [f"{out}s square {names[0]}", f"{out} mul {out}s {names[0]}"]
        elif op == Op.QUARTER_ARC:
            lines += [f"{out}z const 0.0", f"{out}r max {names[0]} {out}z", f"{out}s max {names[1]} {out}z", f"{out}t square {out}r"]
            lines += [f"{out}u square {out}s", f"{out}v add {out}t {out}u", f"{out}h sqrt {out}v"]
            lines += [f"{out}m max {names[0]} {names[1]}", f"{out} max {out}m {out}h"]
        else:
            lines.append(f"{out} {_WORDS[Op(op)]} {' '.join(names)}")
    return "\n".join(lines) + "\n"
