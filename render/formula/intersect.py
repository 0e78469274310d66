"""Where rays meet formula surfaces: the first root along each ray, proved to be the first by bounds of the formula.

Rays go through the grid of cells.py side by side, each to its next cell that may hold a part of the surface. There the values at both
ends and the bounds of the slope along the ray mostly decide: one root, or none. What they leave open `search.first` cuts into pieces.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.function_pointer import DeclaredKernel
from ..jit.kernel import helper
from ..jit.kernel import noinline_helper as apart_
from ..lanes import crosslane, ops
from ..simd.atomics import count_up
from ..types import Lane, Vec
from . import discontinuities, root_isolation
from .evaluate import Room, error_at, room, turns_at, value_at
from .interval_grid import PENDING, ensure_block
from .tables import MET

ULP = 2.0**-52
MOST_TURNS = 80  # of the root's bracketing; bisection alone needs 52
PATIENCE = 24  # turns after which it does: of a value that is 1e-19 before a face and 0.1 behind it no line tells where that is
_FAR = 1e30
STEPS, SHORTEST = 16, 0.02  # of marching through a cell: how many at the most, and how short, as a share of the stretch
STEEPEST = 1e90
SMALLEST = 1e-290  # products of a unit vector's parts that have all their digits
BACK = 2.0**-42  # of the largest coordinate: how far before a root at which a gradient vanishes it is looked at
MANIFOLD = 4.0  # roots that fall together: of so many a place may be as many times as far off as value and gradient say


def _meet(forms, g, origin, direction, t_min, t_max):
    """(t, spacing, u, v, unproved) of the first meeting of rays with formula surface `g`, in its own frame; t is inf where there is none.

    u, v hold the normal (see `packed`); spacing is by how many ulps of its largest coordinate the point may be off the surface.
    """
    k = np.int64(forms.of[g])
    size = ops.length(direction)
    size = ops.where(size > 0.0, size, 1.0)
    way = ops.scale(direction, 1.0 / size)
    enter, leave = clipped(forms, k, origin, way, t_min * size, t_max * size)
    active = enter < leave
    zero = ops.full_like(t_min, 0.0)
    begin = ops.where(active, enter, zero)
    start = ops.along(origin, way, begin)
    memory = room()
    found, tape, inside, unproved = zero + np.inf, ops.int_like(zero, 0), active & ops.not_(active), zero
    if ops.any_lane(active):
        found, tape, inside, unproved = _through(forms, k, memory, start, way, ops.where(active, leave - begin, zero), begin, active)
    hit = found < np.inf
    spacing, u, v, t = ops.int_like(zero, 0), zero, zero, zero + np.inf
    if ops.any_lane(hit):
        at = ops.where(hit, found, zero)
        distance, spacing, u, v = _finished(forms, k, tape, memory, origin, start, way, begin, at, inside, hit)
        t = ops.where(hit, distance / size, t)
        u, v = ops.where(hit, u, zero), ops.where(hit, v, zero)
    return t, spacing, u, v, ops.to_int(unproved)


meet = DeclaredKernel(_meet, MET)
call = meet.call


@helper
def clipped(forms: Any, k: int, o: Vec, d: Vec, low: Lane, high: Lane) -> tuple[Lane, Lane]:
    """The part of low … high that lies in a surface's box, and in its ball if it has one."""
    numbers, inverses = forms.numbers, _inverses(d)
    for axis in range(3):
        x, dx, inverse = (o[0], d[0], inverses[0]) if axis == 0 else (o[1], d[1], inverses[1]) if axis == 1 else (o[2], d[2], inverses[2])
        near, far = numbers[k, axis] - x, numbers[k, 3 + axis] - x
        still = dx == 0.0
        first, second = near * inverse, far * inverse
        within = (near <= 0.0) & (far >= 0.0)
        first = ops.where(still, ops.where(within, -np.inf, np.inf), first)
        second = ops.where(still, ops.where(within, np.inf, -np.inf), second)
        low, high = ops.maximum(low, ops.minimum(first, second)), ops.minimum(high, ops.maximum(first, second))
    radius = numbers[k, 12]
    if radius > 0.0:
        f = ops.sub((0.0 * o[0] + numbers[k, 9], 0.0 * o[1] + numbers[k, 10], 0.0 * o[2] + numbers[k, 11]), o)
        along = ops.dot(f, d)
        off = ops.sub(f, ops.scale(d, along))
        rest = radius * radius - ops.dot(off, off)
        half = ops.sqrt(ops.maximum(rest, 0.0))
        low = ops.where(rest > 0.0, ops.maximum(low, along - half), np.inf)
        high = ops.minimum(high, along + half)
    return low, high


@helper
def _inverses(d: Vec) -> Vec:
    """1 / d of each axis of unit vectors, anything where that is 0: by one division, which takes longer than all else here."""
    x, y, z = ops.where(d[0] == 0.0, 1.0, d[0]), ops.where(d[1] == 0.0, 1.0, d[1]), ops.where(d[2] == 0.0, 1.0, d[2])
    whole = x * y * z
    inverse = 1.0 / whole
    first, second, third = y * z * inverse, x * z * inverse, x * y * inverse
    small = abs(whole) < SMALLEST
    if ops.any_lane(small):
        first, second, third = ops.where3(small, (1.0 / x, 1.0 / y, 1.0 / z), (first, second, third))
    return first, second, third


# --- through the grid ---------------------------------------------------------------------------------------------------


class Course(NamedTuple):
    """Rays on their way through the grid of surface `k`."""

    k: int
    memory: Room
    start: Vec
    way: Vec
    end: Lane
    begin: Lane  # how far from the rays' origins `start` is
    cells: Vec  # `start` in cells
    pace: Vec  # `way` in cells


class Place(NamedTuple):
    """A cell, and the distance at which a ray enters it."""

    x: Lane
    y: Lane
    z: Lane
    at: Lane


class Stretch(NamedTuple):
    """The part of a ray from a to b that lies in a leaf, and where the ray is then."""

    leaf: Lane
    a: Lane
    b: Lane
    after: Place


class Roots(NamedTuple):
    """What is known of rays: their first roots' distances (inf: none so far) and tapes, whether they are inside before it, 1 where not all
    is proved, and rounds of search.py spent."""

    at: Lane
    tape: Lane
    inside: Lane
    unproved: Lane
    spent: Lane


class Ends(NamedTuple):
    """Values at both ends of a stretch, and bounds of the slope in between."""

    near: Lane
    far: Lane
    low: Lane
    high: Lane


@helper
def _through(forms: Any, k: int, memory: Room, start: Vec, way: Vec, end: Lane, begin: Lane, active: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(distance of the first root or inf, its tape, whether the ray is inside before it, 1 where not proved) of rays from `start` to `end`,
    which lie in the box."""
    course = _course(forms, k, memory, start, way, end, begin)
    zero, never = ops.full_like(end, 0.0), active & ops.not_(active)
    last = forms.places[k, 0] - 1
    place = Place(_cell(course.cells[0], 0, last), _cell(course.cells[1], 0, last), _cell(course.cells[2], 0, last), zero)
    carried, known = zero, never  # the value where a ray is, and where it is known
    roots = Roots(zero + np.inf, ops.int_like(zero, 0), never, zero, zero)
    while ops.any_lane(active):
        place, stretch, here, known, active = _to_leaf(forms, course, place, known, active)
        if ops.any_lane(here):
            carried, roots, active = _in_leaf(forms, course, stretch, carried, known, here, roots, active)
            place, known = _moved(here, stretch.after, place), known | here
            active = active & ops.not_(here & _left(stretch.after, last, end))
    doubts = crosslane.count(roots.unproved > 0.0)
    if doubts > 0:
        count_up(forms.unproved, 0, doubts)
    return roots.at, roots.tape, roots.inside, roots.unproved


@helper
def _course(forms: Any, k: int, memory: Room, start: Vec, way: Vec, end: Lane, begin: Lane) -> Course:
    numbers = forms.numbers
    cells = (
        (start[0] - numbers[k, 0]) * numbers[k, 6], (start[1] - numbers[k, 1]) * numbers[k, 7], (start[2] - numbers[k, 2]) * numbers[k, 8]
    )  # fmt: skip
    pace = (way[0] * numbers[k, 6], way[1] * numbers[k, 7], way[2] * numbers[k, 8])
    return Course(k, memory, start, way, end, begin, cells, pace)


@helper
def _to_leaf(forms: Any, course: Course, place: Place, known: Lane, active: Lane) -> tuple[Place, Stretch, Lane, Lane, Lane]:
    """Each lane on to its next leaf: (places, stretches, which lanes have come to one, where values are still known, which are active)."""
    count, grid = forms.places[course.k, 0], forms.places[course.k, 2]
    zero = ops.full_like(course.end, 0.0)
    looking, here = active, active & ops.not_(active)
    stretch = Stretch(ops.int_like(zero, 0), zero, zero, Place(place.x, place.y, place.z, zero))
    while ops.any_lane(looking):
        mark = ops.to_int(forms.grid[ops.where(looking, grid + (place.x * count + place.y) * count + place.z, 0)])
        if _cut_up(forms, course.k, mark, looking):
            continue
        full = mark >= 0
        extent = ops.int_like(zero, 1) << ops.where(full, 0, 2 * (-1 - ops.maximum(ops.minimum(mark, -1), PENDING)))
        after = _next(course.cells, course.pace, place, extent)
        arrived, passing = looking & full, looking & ops.not_(full)
        stretch = Stretch(
            ops.where(arrived, mark, stretch.leaf), ops.where(arrived, place.at, stretch.a),
            ops.where(arrived, ops.minimum(after.at, course.end), stretch.b), _moved(arrived, after, stretch.after),
        )  # fmt: skip
        here = here | arrived
        place, known = _moved(passing, after, place), known & ops.not_(passing)
        gone = passing & _left(after, count - 1, course.end)
        active, looking = active & ops.not_(gone), passing & ops.not_(gone)
    return place, stretch, here & active, known, active


@helper
def _cut_up(forms: Any, k: int, mark: Lane, looking: Lane) -> bool:
    """Whether any lane has come to a block that nothing was known of; of all these it is known now."""
    left = crosslane.bits(looking & (mark <= PENDING))
    some = left != 0
    while left != 0:
        ensure_block(forms, k, PENDING - crosslane.lane(mark, simd.trailing_zeros(left)))
        left &= left - 1
    return some


@helper
def _moved(mask: Lane, to: Place, place: Place) -> Place:
    """`to` in the lanes of a mask, elsewhere `place`."""
    return Place(
        ops.where(mask, to.x, place.x), ops.where(mask, to.y, place.y),
        ops.where(mask, to.z, place.z), ops.where(mask, to.at, place.at),
    )  # fmt: skip


@helper
def _in_leaf(
    forms: Any, course: Course, stretch: Stretch, carried: Lane, known: Lane, here: Lane, roots: Roots, active: Lane
) -> tuple[Lane, Roots, Lane]:
    """(values at the stretches' far ends, roots, which lanes are active) after what stretches hold, in the lanes `here`."""
    k, memory, start, way, a, b = course.k, course.memory, course.start, course.way, stretch.a, stretch.b
    tape = ops.to_int(forms.leaf_tape[stretch.leaf])
    if ops.any_lane(here & ops.not_(known)):
        carried = ops.where(known, carried, value_at(forms, k, tape, memory, ops.along(start, way, a), here))
    far = value_at(forms, k, tape, memory, ops.along(start, way, b), here)
    low, high = _slope(forms, stretch.leaf, way)
    one_way = (low > 0.0) | (high < 0.0)
    in_a, in_b = carried <= 0.0, far <= 0.0
    change = (in_a & ops.not_(in_b)) | (in_b & ops.not_(in_a))
    none = ops.not_(change) & (one_way | root_isolation.apart(carried, far, low, high, b - a))
    certain = here & change & one_way
    open_ = here & ops.not_(none) & ops.not_(certain)
    if ops.any_lane(certain):
        root = bracketed(forms, k, tape, memory, start, way, a, b, carried, far, course.begin, forms.numbers[k, 13], certain)
        roots, active = _with(roots, certain, root, tape, in_a), active & ops.not_(certain)
    if ops.any_lane(open_):
        roots, active = _searched(forms, course, stretch, Ends(carried, far, low, high), tape, open_, roots, active)
    return ops.where(here, far, carried), roots, active


@helper
def _with(roots: Roots, mask: Lane, at: Lane, tape: Lane, inside: Lane) -> Roots:
    """Roots with others in the lanes of a mask."""
    return Roots(
        ops.where(mask, at, roots.at), ops.where(mask, tape, roots.tape), (roots.inside & ops.not_(mask)) | (mask & inside),
        roots.unproved, roots.spent,
    )  # fmt: skip


@helper
def _searched(
    forms: Any, course: Course, stretch: Stretch, ends: Ends, tape: Lane, mask: Lane, roots: Roots, active: Lane
) -> tuple[Roots, Lane]:
    """Look for the first root in each stretch of a mask, one after the other."""
    k, memory, start, way, a, b = course.k, course.memory, course.start, course.way, stretch.a, stretch.b
    sheet, zero = forms.places[k, 1] != 0, ops.full_like(a, 0.0)
    begins, open_ = _marched(forms, k, tape, memory, start, way, a, b, ends.near, ends.low, ends.high, mask)
    left = crosslane.bits(open_)
    while left != 0:
        j = simd.trailing_zeros(left)
        left &= left - 1
        rounds = max(root_isolation.MOST_ROUNDS - int(crosslane.lane(roots.spent, j)), root_isolation.FEW)
        root, within, doubt, used = root_isolation.isolate_first_root(
            forms, k, crosslane.lane(tape, j), memory, crosslane.lane3(start, j), crosslane.lane3(way, j), crosslane.lane(begins, j),
            crosslane.lane(b, j), 0.0, crosslane.lane(course.begin, j), sheet, zero, rounds,
        )  # fmt: skip
        mine = ops.to_int(crosslane.lane_indices(0)) == j
        unproved = ops.where(mine & (doubt > 0), 1.0, roots.unproved)
        roots = Roots(roots.at, roots.tape, roots.inside, unproved, ops.where(mine, roots.spent + used, roots.spent))
        if root < np.inf:
            roots, active = _with(roots, mine, ops.full_like(a, root), tape, within & mine), active & ops.not_(mine)
    return roots, active


@helper
def _cell(q: Lane, low: Lane, high: Lane) -> Lane:
    return ops.maximum(ops.minimum(ops.to_int(ops.floor(q)), high), low)


@helper
def _left(place: Place, last: int, end: Lane) -> Lane:
    """Whether a ray is out of the grid, or at its end."""
    x, y, z = place.x, place.y, place.z
    return (x < 0) | (y < 0) | (z < 0) | (x > last) | (y > last) | (z > last) | (place.at >= end)


@helper
def _next(q: Vec, d: Vec, place: Place, extent: Lane) -> Place:
    """Where a ray is after a block of `extent` cells along an axis."""
    bx, by, bz = place.x & -extent, place.y & -extent, place.z & -extent
    tx, ty, tz = _plane(q[0], d[0], bx, extent), _plane(q[1], d[1], by, extent), _plane(q[2], d[2], bz, extent)
    out = ops.minimum(tx, ops.minimum(ty, tz))
    by_x = tx <= out
    by_y = (ty <= out) & ops.not_(by_x)
    by_z = ops.not_(by_x) & ops.not_(by_y)
    top = extent - 1
    reach = ops.where(out < _FAR, out, 0.0)
    return Place(
        _stepped(by_x, q[0] + reach * d[0], d[0], bx, top), _stepped(by_y, q[1] + reach * d[1], d[1], by, top),
        _stepped(by_z, q[2] + reach * d[2], d[2], bz, top), ops.maximum(out, place.at),
    )  # fmt: skip


@helper
def _plane(q: Lane, d: Lane, low: Lane, extent: Lane) -> Lane:
    """Where a ray leaves a block along one axis."""
    edge = ops.to_float(ops.where(d > 0.0, low + extent, low))
    return ops.where(d == 0.0, np.inf, (edge - q) / ops.where(d == 0.0, 1.0, d))


@helper
def _stepped(by: Lane, q: Lane, d: Lane, low: Lane, top: Lane) -> Lane:
    return ops.where(by, ops.where(d > 0.0, low + top + 1, low - 1), _cell(q, low, low + top))


@helper
def _slope(forms: Any, leaf: Lane, way: Vec) -> tuple[Lane, Lane]:
    """Bounds of the slope along rays in their leaves."""
    slopes = forms.leaf_slopes
    low, high, all_ = 0.0 * way[0], 0.0 * way[0], 0.0 * way[0]
    for axis in range(3):
        d = way[0] if axis == 0 else way[1] if axis == 1 else way[2]
        p, q = d * slopes[leaf, 2 * axis], d * slopes[leaf, 2 * axis + 1]
        low, high = low + ops.minimum(p, q), high + ops.maximum(p, q)
        all_ = all_ + abs(p) + abs(q)
    slack = 8.0 * ULP * all_
    return low - slack, high + slack


@apart_
def _marched(forms, k, tape, memory, start, way, a, b, fa, low, high, mask):
    """(where to go on, which lanes are still open): on from a by steps in which the formula cannot reach 0, as bounds of its slope say.

    Hart, "Sphere Tracing", The Visual Computer 1996, with a bound that is proved.
    """
    up = fa > 0.0
    steep = ops.where(up, -low, high)
    steep = ops.where(steep > 0.0, steep, 0.0)
    at, f = a, fa
    least = SHORTEST * (b - a)
    working = mask & (steep > 0.0) & (steep < STEEPEST)
    for _ in range(STEPS):
        step = (1.0 - 1e-9) * abs(f) / ops.where(working, steep, 1.0)
        working = working & (step > least)
        if ops.not_(ops.any_lane(working)):
            break
        at = ops.where(working, at + step, at)
        passed = working & (at >= b)
        mask, working = mask & ops.not_(passed), working & ops.not_(passed)
        f = ops.where(working, value_at(forms, k, tape, memory, ops.along(start, way, ops.minimum(at, b)), working), f)
    return at, mask


@helper
def bracketed(
    forms: Any,
    k: int,
    tape: Lane,
    memory: Room,
    start: Vec,
    way: Vec,
    a: Lane,
    b: Lane,
    fa: Lane,
    fb: Lane,
    begin: Lane,
    reach: float,
    mask: Lane,
) -> Lane:
    """The root between a and b, by the Illinois method (Dowell and Jarratt 1971), bisected where that is slow."""
    enough = 4.0 * ULP * (begin + b + reach)
    side = 0.0 * a
    working = mask & (b - a > enough)
    for turn in range(MOST_TURNS):
        if ops.not_(ops.any_lane(working)):
            break
        width = b - a
        share = fa / (fa - fb)
        good = (share > 0.0) & (share < 1.0) & (turn % 8 != 7) & (turn < PATIENCE)
        step = ops.clip(width * ops.where(good, share, 0.5), 0.25 * enough, width - 0.25 * enough)
        middle = a + step
        f = value_at(forms, k, tape, memory, ops.along(start, way, middle), working)
        same = ((f <= 0.0) & (fa <= 0.0)) | (ops.not_(f <= 0.0) & ops.not_(fa <= 0.0))
        on_a, on_b = working & same, working & ops.not_(same)
        fb = ops.where(on_a & (side > 0.0), 0.5 * fb, fb)
        fa = ops.where(on_b & (side < 0.0), 0.5 * fa, fa)
        a, fa = ops.where(on_a, middle, a), ops.where(on_a, f, fa)
        b, fb = ops.where(on_b, middle, b), ops.where(on_b, f, fb)
        side = ops.where(on_a, 1.0, ops.where(on_b, -1.0, side))
        working = working & (b - a > enough) & (f != 0.0)
    return ops.where(fb == 0.0, b, ops.where(fa == 0.0, a, 0.5 * (a + b)))


# --- what else is known of a hit ----------------------------------------------------------------------------------------


@helper
def _finished(
    forms: Any, k: int, tape: Lane, memory: Room, origin: Vec, start: Vec, way: Vec, begin: Lane, at: Lane, inside: Lane, hit: Lane
) -> tuple[Lane, Lane, Lane, Lane]:
    """(distance, spacing, u, v) of hits."""
    point, distance = ops.along(start, way, at), begin + at
    far = distance + forms.numbers[k, 13]
    gradient = gradient_at(forms, k, tape, memory, start, way, at, far, hit)
    off = MANIFOLD * error_at(forms, k, tape, memory, point, way, hit) + closed_in(gradient, far)
    if forms.places[k, 5] != 0:
        found = discontinuities.discontinuity_normal(forms, k, memory, origin, way, distance, inside, gradient, off, hit)
        distance, gradient, off = found.at, found.gradient, found.off
    spacing, u, v = finish_hit(forms, k, way, gradient, inside, off)
    return distance, spacing, u, v


@apart_
def gradient_at(forms, k, tape, memory, start, way, at, far, mask):
    """The gradient at roots, or, where it vanishes, as it is on the side that the ray comes from; `far` is their largest coordinate."""
    _, x, y, z = turns_at(forms, k, tape, memory, ops.along(start, way, at), mask)
    gone = mask & ops.not_(x * x + y * y + z * z > 0.0)
    if ops.any_lane(gone):
        _, bx, by, bz = turns_at(forms, k, tape, memory, ops.along(start, way, at - BACK * far), gone)
        x, y, z = ops.where3(gone, (bx, by, bz), (x, y, z))
    return x, y, z


@helper
def closed_in(gradient: Vec, far: Lane) -> Lane:
    """What a formula may be off 0 amid a stretch in which its sign changes, if that is no longer than search.FINEST."""
    return 0.5 * root_isolation.FINEST * far * ops.length(gradient)


@helper
def finish_hit(forms: Any, k: int, way: Vec, gradient: Vec, inside: Lane, off: Lane) -> tuple[Lane, Lane, Lane]:
    """(spacing, u, v) of hits with this gradient, where the formula is `off` from 0 at the most."""
    x, y, z = gradient
    size = ops.sqrt(x * x + y * y + z * z)
    usable = (size > 0.0) & (size < np.inf)
    inverse = 1.0 / ops.where(usable, size, 1.0)
    toward = ops.where(inside, 1.0, -1.0)
    normal = ops.where3(usable, (x * inverse, y * inverse, z * inverse), ops.scale(way, toward))
    if forms.places[k, 1] == 0:  # of a solid a ray that enters meets the outside, whatever rounding says
        against = toward * ops.dot(normal, way)
        turned = ops.sub(normal, ops.scale(way, 2.0 * ops.dot(normal, way)))
        normal = ops.where3(against < 0.0, turned, normal)
    distance = off * inverse
    reach = forms.numbers[k, 13]
    units = ops.where(usable & (distance < reach), distance / (0.5 * ULP * reach), 0.0)
    u, v = packed(normal)
    return ops.to_int(ops.minimum(units, 1e15)), u, v


@helper
def packed(n: Vec) -> tuple[Lane, Lane]:
    """A unit vector as two numbers: the octahedron's faces unfolded onto a square (Cigolle and others 2014)."""
    inverse = 1.0 / (abs(n[0]) + abs(n[1]) + abs(n[2]))
    u, v = n[0] * inverse, n[1] * inverse
    fold_u, fold_v = (1.0 - abs(v)) * ops.sign_of(u), (1.0 - abs(u)) * ops.sign_of(v)
    return ops.where(n[2] < 0.0, fold_u, u), ops.where(n[2] < 0.0, fold_v, v)
