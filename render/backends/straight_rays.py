"""Camera rays that go straight through media: the first surface behind invisible boundaries, and what the media on the way do to its light.

Nothing is sampled: columns have closed forms, and densities by formulas or voxels are summed in steps. Channels have no noise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..film.guide_kernels import plain_tables
from ..integrator.state import flights
from ..jit.kernel import kernel
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..material import medium_stack
from ..medium import column, tracking
from ..surface import interaction
from ..types import FirstHits, Hit, NoAirlight, Ray, StraightMedia

MOST = 256  # boundaries that a ray passes
STEPS = 64  # along a density of a segment, for channels
GUIDE_STEPS = 16  # for the guides of the denoiser, which average several rays a pixel
NODES, WEIGHTS = np.polynomial.legendre.leggauss(32)
FARTHEST = 80.0  # optical depth beyond which exp is 0

F64 = NDArray[np.float64]
March = Callable[[NDArray[np.int64], F64, F64, F64, F64, int], tuple[F64, F64]]
"""(numbers, origins (3, n), directions, near, far, steps) → (columns (n,), integrals (3, n)), see tracking.march."""


class Segment(NamedTuple):
    """Parts of rays in media."""

    rows: NDArray[np.intp]
    number: NDArray[np.int64]
    near: F64
    far: F64  # inf: without end


class Way:
    """The media on the way of n camera rays to what they hit."""

    def __init__(self, table: Any, march: March, rays: tuple[F64, F64]) -> None:
        self._table, self._march = table, march
        self._origin, self._direction = rays
        self._segments: list[Segment] = []

    def add(self, rows: NDArray[np.intp], stack: NDArray[np.int64], near: F64, far: F64) -> None:
        """Add the part between two distances of rays `rows` with these medium stacks."""
        number = np.asarray(medium_stack.top(stack))
        some = number > 0
        if some.any():
            self._segments.append(Segment(rows[some], number[some], near[some], far[some]))

    def seen(self, end: F64, steps: int = STEPS) -> StraightMedia:
        """What the media do to the light of the surfaces at distances `end` (n,), inf without one."""
        shape = (3, len(end))
        passed, straight, reached, shade = np.ones(shape), np.ones(shape), np.zeros(shape), np.zeros(shape)
        for rows, number, near, far in self._segments:
            scattering, extinction = (rates[number, :3].T for rates in (self._table.scattering, self._table.extinction))
            length, first = self._column(rows, number, (near, far), scattering, steps)
            share = _attenuated(extinction, length)
            albedo = np.where(extinction > 0.0, scattering / np.maximum(extinction, 1e-300), 0.0)
            albedo[:, self._table.emission[number].max(axis=1) > 0.0] = 1.0  # as of surfaces that shine
            shade[:, rows] += passed[:, rows] * (1.0 - share) * albedo
            reached[:, rows] += straight[:, rows] * first
            passed[:, rows] *= share
            straight[:, rows] *= _attenuated(scattering, length)
        before = straight > 0.0
        total = reached + np.where(before, straight, 0.0) * np.where(np.isfinite(end), end, 0.0)
        scattered = np.maximum((1.0 - straight).sum(axis=0), 0.0)
        alone = np.where(scattered > 1e-12, reached.sum(axis=0) / np.maximum(scattered, 1e-300), np.inf)
        return StraightMedia(passed, np.where(np.isfinite(end), total.mean(axis=0), alone), shade)

    def _column(self, rows: Any, number: Any, ends: tuple[F64, F64], rate: F64, steps: int) -> tuple[F64, F64]:
        """(column, integral of distance · probability density of the first scattering, (3, n)) of parts of rays."""
        table, (near, far) = self._table, ends
        length, first = far - near, np.zeros((3, len(rows)))
        layered, varies = np.isfinite(table.top[number]), np.zeros(len(rows), bool)
        if not isinstance(table.fields, tracking.NoFields):
            varies = table.fields.density[number] >= 0
        uniform = ~(layered | varies)
        first[:, uniform] = _of_uniform(rate[:, uniform], near[uniform], length[uniform])
        if layered.any():
            o, d = self._origin[1, rows[layered]], self._direction[1, rows[layered]]
            shape = o + near[layered] * d, d, table.top[number[layered]], table.falloff[number[layered]]
            with np.errstate(all="ignore"):
                length[layered] = column.column(*shape, length[layered])
                first[:, layered] = _of_layer(rate[:, layered], near[layered], length[layered], shape)
        if varies.any():
            varying_rows = rows[varies]
            rays = np.ascontiguousarray(self._origin[:, varying_rows]), np.ascontiguousarray(self._direction[:, varying_rows])
            length[varies], first[:, varies] = self._march(number[varies], *rays, near[varies], far[varies], steps)
        return length, first


def _attenuated(rate: F64, length: F64) -> F64:
    return np.exp(-np.minimum(np.where(rate > 0.0, rate * length, 0.0), FARTHEST))


def _of_uniform(rate: F64, near: F64, length: F64) -> F64:
    """∫ (near + x) σ exp(-σ x) dx over a length, which may have no end."""
    passed, finite = _attenuated(rate, length), np.where(np.isfinite(length), length, 0.0)
    mean = np.where(rate > 0.0, (1.0 - passed) / np.maximum(rate, 1e-300) - finite * passed, 0.0)
    return near * (1.0 - passed) + mean


def _of_layer(rate: F64, near: F64, length: F64, shape: Any) -> F64:
    """Likewise in fog, by Gauss and Legendre over the probability, whose distances have a closed form."""
    scattered = 1.0 - _attenuated(rate, length)
    total = np.zeros_like(rate)
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        depth = -np.log1p(-scattered * (0.5 + 0.5 * node)) / np.maximum(rate, 1e-300)
        for k in range(3):
            t = column.distance_of(*shape, np.minimum(depth[k], length))
            total[k] += 0.5 * weight * (near + np.where(np.isfinite(t), t, 0.0))
    return scattered * total


def pass_boundaries(
    tables: ir.Tables, ray: Ray, hit: Hit, closest: Callable[[Ray], Hit], march: March | None = None
) -> tuple[Hit, Way | None]:  # fmt: skip
    """(hits of n rays behind invisible boundaries, the media on the way); the hits themselves and None in scenes without media.

    `closest` finds the hits of rays, `march` sums densities: by default in numpy.
    """
    table = medium_stack.scattering(tables)
    if table is None:
        return hit, None
    n = len(hit.t)
    origin, direction = (np.stack([np.broadcast_to(c, n) for c in v]) for v in (ray.origin, ray.direction))
    near, end = np.array(np.broadcast_to(ray.t_min, n), float), np.broadcast_to(ray.t_max, n)
    stack, hit, rows = np.full(n, int(table.outside[0])), Hit(*(np.array(part) for part in hit)), np.arange(n)
    way = Way(table, march or _march_in_numpy(table, tables), (origin, direction))
    clear = table.clear[tables.instances.material]
    for _ in range(MOST):
        is_hit = hit.instance[rows] >= 0
        way.add(rows, stack[rows], near[rows], np.where(is_hit, np.maximum(hit.t[rows], near[rows]), np.inf))
        rows = rows[is_hit]
        rows = rows[clear[hit.instance[rows]]]
        if not len(rows):
            break
        part = Ray((*origin[:, rows],), (*direction[:, rows],), 0.0, np.inf, None)
        with np.errstate(all="ignore"):
            point = interaction.make_interaction(tables, part, Hit(*(values[rows] for values in hit)))
        stack[rows] = medium_stack.cross_boundary(stack[rows], None, tables, point, part.direction)
        near[rows] = flights.behind(point, part.direction, hit.t[rows])
        beyond = closest(Ray(part.origin, part.direction, near[rows], end[rows], None))
        for values, behind in zip(hit, beyond, strict=True):
            values[rows] = behind
    return hit, way


def first_hits(
    inputs: tuple[ir.Tables, Any], ray: Ray, hit: Hit, closest: Callable[[Ray], Hit], steps: int, march: March | None = None
) -> FirstHits:  # fmt: skip
    """The first hits of rays behind invisible boundaries, with the media on the way; arguments as for `pass_boundaries`.

    `inputs` are the tables and Options.airlight, the fog where paths do not scatter in it.
    """
    tables, air = inputs
    hit, way = pass_boundaries(tables, ray, hit, closest, march)
    end = np.where(hit.instance >= 0, hit.t, np.inf)
    if not isinstance(air, NoAirlight):
        return FirstHits(tables, ray, hit, lambda: through_fog(air, ray, end))
    if way is None:
        return FirstHits(tables, ray, hit)
    return FirstHits(tables, ray, hit, lambda: way.seen(end, steps))


class _Fog(NamedTuple):
    """The columns of scattering_table.Scattering that a Way reads, of air and fog."""

    extinction: F64
    scattering: F64
    emission: F64
    top: F64
    falloff: F64
    fields: tracking.NoFields


def through_fog(air: Any, ray: Ray, end: F64) -> StraightMedia:
    """What fog does to the light of surfaces at distances `end` (n,), inf without one; `air` is an airlight.Airlight."""
    n = len(end)
    origin, direction = (np.stack([np.broadcast_to(c, n) for c in v]).astype(float) for v in (ray.origin, ray.direction))
    extinction, scattering = (np.stack([np.zeros(3), rate[:3]]) for rate in (air.extinction, air.scattering))
    tops, falloffs = np.array([np.inf, air.top]), np.array([0.0, air.falloff])
    fog = _Fog(extinction, scattering, np.zeros((2, 3)), tops, falloffs, tracking.NoFields())
    way = Way(fog, _march_in_numpy(fog, None), (origin, direction))
    way.add(np.arange(n), np.ones(n, np.int64), np.zeros(n), end)
    return way.seen(end)


def _march_in_numpy(table: Any, tables: ir.Tables | None) -> March:
    """Sum densities in numpy; `tables` may be absent where no density varies."""
    def march(number: Any, origin: F64, direction: F64, near: F64, far: F64, steps: int) -> tuple[F64, F64]:
        rate = (*table.scattering[number, :3].T,)
        with np.errstate(all="ignore"):
            total, first = tracking.march(table.fields, tables, number, ((*origin,), (*direction,), near, far), rate, steps)
        return np.asarray(total), np.stack(first)

    return march


class _Densities(NamedTuple):
    """Inputs of `_march`."""

    tables: Any
    media: Any  # scattering_table.Scattering


def march_by_kernel(tables: ir.Tables) -> March | None:
    """Sum densities by a kernel, which all scenes share; None in scenes without such media."""
    table = medium_stack.scattering(tables)
    if table is None or isinstance(table.fields, tracking.NoFields):
        return None
    inputs = Handle(_Densities(plain_tables(tables).tables, table))

    def march(number: Any, origin: F64, direction: F64, near: F64, far: F64, steps: int) -> tuple[F64, F64]:
        out = np.empty((4, len(near)))
        if len(near):
            _march(inputs, np.ascontiguousarray(number, np.int64), origin, direction, near, far, steps, out)
        return out[0], out[1:]

    return march


@kernel
def _march(inputs, number, origin, direction, near, far, steps, out):
    """Write the columns and integrals of tracking.march to the rows of `out`."""
    n = len(near)
    for start in range(0, n, crosslane.WIDTH):
        k = ops.minimum(crosslane.lane_indices(start), n - 1)
        row = ops.to_int(number[k])
        ray = (
            (origin[0, k], origin[1, k], origin[2, k]), (direction[0, k], direction[1, k], direction[2, k]), near[k], far[k],
        )  # fmt: skip
        rates = inputs.media.scattering
        rate = (rates[row, 0], rates[row, 1], rates[row, 2])
        total, first = tracking.march(inputs.media.fields, inputs.tables, row, ray, rate, steps)
        for j in range(min(crosslane.WIDTH, n - start)):
            out[0, start + j] = crosslane.lane(total, j)
            for c in range(3):
                out[1 + c, start + j] = crosslane.lane(first[c], j)
