"""Checkers and stripes, at a point or as their mean over the parallelogram of a pixel, in closed form.

With S(x) = 1 in even cells and -1 in odd ones, stripes are S(x) and a checker is S(x) S(y). The projection of a parallelogram on an axis is
a trapezoid, over which the mean of S comes from its second integral. The mean of an axis-aligned checker is exactly the product of two such
means. For an oblique one the axes are coupled. There S is replaced by its Fourier series, whose terms over a parallelogram are products of
two sin(t)/t; a pixel leaves few of them.
"""

from __future__ import annotations

import math
from typing import Any

from ...compiler import ir
from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..types import Lane, Vec

CHECKER = int(ir.TextureKind.CHECKER)
CELLS = 8.0  # cells of a checker without a size, over u and over v
ASKEW = 0.2  # cells: change of both axes along one side from which on the series is used
THIN, LONG = 0.14, 4.5  # cells: not for a shorter other side, |x| + |y|, unless this side is longer: the series of a line converges slowly
BOTH = 0.11  # the same where the other side changes half as much
SLANTED = 0.002  # cells: change from which on a side is divided into PARTS
PARTS = 8  # twice as many where both axes change by ASKEW, four times as many where they change by a cell
ORDER = 7  # of the highest wave
_LONGEST = 4096.0  # length to which a side is clipped, in cells
_LEAST = 1e-30


@helper
def color(tables: Any, row: Lane, s: Lane, t: Lane, du: Lane, dv: Lane, spans: Any) -> Vec:
    """The color of row `row` at s, t, whose units are du, dv metres; cells are half open.

    `spans` is the change of s and t along the two sides of the footprint, (s, t, s, t), or None at a point.
    """
    textures = tables.textures
    size = textures.size[row]
    sized = size > 0.0
    safe = ops.where(sized, size, 1.0)
    wide, high = ops.where(sized, du / safe, CELLS), ops.where(sized, dv / safe, CELLS)
    share = _first_color_share(textures.kind[row] == CHECKER, s * wide, t * high, _scale_spans(spans, wide, high))
    a, b, other_share = textures.color_a, textures.color_b, 1.0 - share
    return (
        share * a[row, 0] + other_share * b[row, 0], share * a[row, 1] + other_share * b[row, 1],
        share * a[row, 2] + other_share * b[row, 2],
    )  # fmt: skip


@helper
def _scale_spans(spans: Any, wide: Lane, high: Lane) -> Any:
    if spans is None:
        return None
    return spans[0] * wide, spans[1] * high, spans[2] * wide, spans[3] * high


@helper
def _first_color_share(checker: Lane, x: Lane, y: Lane, spans: Any) -> Lane:
    """Share of the first color at x, y in cells."""
    if spans is None:
        return _share_at_point(checker, x, y)
    return mean_share(checker, x, y, spans)


@helper
def _share_at_point(checker: Lane, x: Lane, y: Lane) -> Lane:
    """1 in cells of the first color, else 0."""
    across, up = ops.floor_int(x), ops.floor_int(y)
    cell = ops.where(checker, across + up, across)
    return ops.where((cell & 1) == 0, 1.0 + 0.0 * x, 0.0)


@noinline_helper
def mean_share(checker: Lane, x: Lane, y: Lane, spans: Any) -> Lane:
    """Mean share over a parallelogram around x, y."""
    px, py, qx, qy = spans
    p_long, q_long = ops.absolute(px) + ops.absolute(py), ops.absolute(qx) + ops.absolute(qy)
    longest = ops.maximum(p_long, q_long)
    at_point = _share_at_point(checker, x, y)
    shrink = _LONGEST / ops.maximum(longest, _LONGEST)
    px, py, qx, qy = px * shrink, py * shrink, qx * shrink, qy * shrink
    x, y = x - 2.0 * ops.floor(0.5 * x), y - 2.0 * ops.floor(0.5 * y)
    p_slant = ops.where(checker, ops.minimum(ops.absolute(px), ops.absolute(py)), 0.0)
    q_slant = ops.where(checker, ops.minimum(ops.absolute(qx), ops.absolute(qy)), 0.0)
    thin = ops.where(p_slant > q_slant, q_long, p_long) < THIN
    slant = ops.maximum(p_slant, q_slant)
    alone = slant > 2.0 * ops.minimum(p_slant, q_slant)
    askew = (slant > ops.where(alone, ASKEW, BOTH)) & ops.not_(thin & (slant < LONG))
    mean = _mean_by_axes(checker, x, y, px, py, qx, qy, ops.where(askew, 0.0, p_slant), ops.where(askew, 0.0, q_slant))
    if ops.any_lane(askew):
        mean = ops.where(askew, ops.clip(_mean_by_series(x, y, px, py, qx, qy), -1.0, 1.0), mean)
    return ops.where(longest > 0.0, 0.5 + 0.5 * mean, at_point)


@helper
def _mean_by_axes(checker: Lane, x: Lane, y: Lane, px: Lane, py: Lane, qx: Lane, qy: Lane, p_slant: Lane, q_slant: Lane) -> Lane:
    """The mean from both axes separately. A side along both axes is divided into parts, unless S is constant along one axis."""
    slant = ops.maximum(p_slant, q_slant)
    divided = (slant > SLANTED) & _meets_edge(x, px, qx) & _meets_edge(y, py, qy)
    by_p, by_q = divided & (p_slant >= q_slant), divided & (p_slant < q_slant)
    parts = ops.where(slant > 1.0, 4.0 * PARTS, ops.where(slant > ASKEW, 2.0 * PARTS, 1.0 * PARTS))
    count = ops.where(by_p | by_q, parts, 1.0)
    share = 1.0 / count
    step_x, step_y = ops.where(by_p, px, qx) * share, ops.where(by_p, py, qy) * share
    px, py = ops.where(by_p, px * share, px), ops.where(by_p, py * share, py)
    qx, qy = ops.where(by_q, qx * share, qx), ops.where(by_q, qy * share, qy)
    total = 0.0 * x
    k = 0
    while ops.any_lane(count > k):
        away = k - 0.5 * (count - 1.0)
        part = along_axis(x + away * step_x, ops.absolute(px), ops.absolute(qx))
        if ops.any_lane(checker):
            part = part * ops.where(checker, along_axis(y + away * step_y, ops.absolute(py), ops.absolute(qy)), 1.0)
        total = ops.where(count > k, total + part, total)
        k += 1
    return total * share


@helper
def _meets_edge(x: Lane, width: Lane, other_width: Lane) -> Lane:
    """Whether an edge between cells is within the two intervals around x."""
    off = x - ops.floor(x)
    return ops.minimum(off, 1.0 - off) < 0.5 * (ops.absolute(width) + ops.absolute(other_width))


# --- along an axis ------------------------------------------------------------------------------------------------------


@helper
def along_axis(x: Lane, width: Lane, other_width: Lane) -> Lane:
    """The mean of S over the trapezoid around x, the convolution of two intervals.

    A trapezoid of at most a cell crosses one edge, and its part beyond that is computed without cancellation. Otherwise the mean is the
    second difference of the second integral of S, S(x) r (r - 1)/2 with r the position in the cell. For a single interval it is the first
    difference of the first integral.
    """
    long, short = ops.maximum(width, other_width), ops.minimum(width, other_width)
    reach, level = 0.5 * (long + short), 0.5 * (long - short)
    cell = ops.floor(x)
    off = ops.minimum(x - cell, 1.0 - (x - cell))  # distance from the nearest edge
    beyond = ops.maximum(reach - off, 0.0)
    slanted = 1.0 - beyond * beyond / ops.maximum(long * short, _LEAST)
    within = ops.where(off < level, 2.0 * off / ops.maximum(long, _LEAST), slanted)
    mean = _sign(cell) * within
    many = reach > 0.5
    if ops.any_lane(many):
        narrow = short < long * (4.0 * math.sqrt(ops.roundoff(x)))  # the second difference would be rounding error
        outer, inner = _second_integral(x + reach) + _second_integral(x - reach), _second_integral(x + level) + _second_integral(x - level)
        once = (_first_integral(x + 0.5 * long) - _first_integral(x - 0.5 * long)) / ops.maximum(long, _LEAST)
        twice = (outer - inner) / ops.where(narrow, 1.0, ops.maximum(long * short, _LEAST))
        mean = ops.where(many, ops.where(narrow, once, twice), mean)
    return mean


@helper
def _sign(cell: Lane) -> Lane:
    """1 in even cells, -1 in odd ones."""
    return 1.0 - 2.0 * (cell - 2.0 * ops.floor(0.5 * cell))


@helper
def _first_integral(x: Lane) -> Lane:
    """The integral of S minus a half."""
    cell = ops.floor(x)
    return _sign(cell) * (x - cell - 0.5)


@helper
def _second_integral(x: Lane) -> Lane:
    """The second integral of S without its linear part."""
    cell = ops.floor(x)
    offset = x - cell
    return 0.5 * _sign(cell) * offset * (offset - 1.0)


# --- along both ---------------------------------------------------------------------------------------------------------


@noinline_helper
def _mean_by_series(x: Lane, y: Lane, px: Lane, py: Lane, qx: Lane, qy: Lane) -> Lane:
    """The mean of S(x) S(y) over a parallelogram by the Fourier series of S, (4/π) sin(π m x)/m for odd m up to ORDER.

    sin(a) sin(b) = (cos(a - b) - cos(a + b))/2; the mean of a wave over a side is sin(t)/t with t half of its phase change.
    """
    zero = 0.0 * x
    total = zero
    at_x, step_x, along_px, step_px, along_qx, step_qx = _phases(x, px, qx)
    first_y, step_y, first_py, step_py, first_qy, step_qy = _phases(y, py, qy)
    m = 1
    while m <= ORDER:
        at_y, along_py, along_qy = first_y, first_py, first_qy
        n = 1
        while n <= ORDER:
            together = _sinc(along_px, along_py, m * px, n * py, 1.0) * _sinc(along_qx, along_qy, m * qx, n * qy, 1.0)
            apart_ = _sinc(along_px, along_py, m * px, n * py, -1.0) * _sinc(along_qx, along_qy, m * qx, n * qy, -1.0)
            cosines, sines = at_x[0] * at_y[0], at_x[1] * at_y[1]
            wave = (cosines + sines) * apart_ - (cosines - sines) * together
            total = total + wave * (8.0 / (math.pi * math.pi) / (m * n))
            at_y, along_py, along_qy = _add_angles(at_y, step_y), _add_angles(along_py, step_py), _add_angles(along_qy, step_qy)
            n += 2
        at_x, along_px, along_qx = _add_angles(at_x, step_x), _add_angles(along_px, step_px), _add_angles(along_qx, step_qx)
        m += 2
    return total


@helper
def _phases(x: Lane, p: Lane, q: Lane) -> Any:
    """Cosines and sines of π x, π p/2 and π q/2, each followed by those of the step between odd multiples."""
    a = _cosine_and_sine(math.pi * x)
    b = _cosine_and_sine((0.5 * math.pi) * (p - 4.0 * ops.floor(0.25 * p)))
    c = _cosine_and_sine((0.5 * math.pi) * (q - 4.0 * ops.floor(0.25 * q)))
    return a, _add_angles(a, a), b, _add_angles(b, b), c, _add_angles(c, c)


@helper
def _cosine_and_sine(angle: Lane) -> tuple[Lane, Lane]:
    return ops.cos(angle), ops.sin(angle)


@helper
def _add_angles(a: tuple[Lane, Lane], b: tuple[Lane, Lane]) -> tuple[Lane, Lane]:
    """Cosine and sine of the sum of two angles."""
    return a[0] * b[0] - a[1] * b[1], a[1] * b[0] + a[0] * b[1]


@helper
def _sinc(a: tuple[Lane, Lane], b: tuple[Lane, Lane], x: Lane, y: Lane, side: float) -> Lane:
    """sin(t)/t for t = π/2 (x + side y), from the cosines and sines of both parts."""
    t = (0.5 * math.pi) * (x + side * y)
    small = ops.absolute(t) < 0.05
    sine = a[1] * b[0] + side * a[0] * b[1]
    return ops.where(small, 1.0 - t * t * (1.0 / 6.0), sine / ops.where(small, 1.0, t))
