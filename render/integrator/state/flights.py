"""Flights of paths through participating media: where light scatters, and boundaries that it passes straight.

A path vertex is a surface, a point of a medium where light scatters, or an invisible boundary. In scenes without such media, `Flown` and
`Event` are None, which is a type: kernels compile nothing of this.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...jit.kernel import helper, specialize_if_present
from ...lanes import ops
from ...material import dispersion, medium_stack
from ...material.bsdf import Scattered
from ...medium import bodies, free_flight, guides, phase, phase_table, tracking
from ...types import Lane, Surface, Tables, Vec
from .path_state import FAR, PathSample, PathState

LEAST_COSINE = 1e-2  # at a boundary; rays that are more grazing begin no farther behind it


class Flown(NamedTuple):
    """Paths after their flight to the next hit."""

    weight: Vec  # throughput, attenuated
    scattered: Lane  # bool: light scatters before the hit
    t: Lane  # where it scatters
    emitted: Vec  # radiance that the media on the way add to the pixel


class Event(NamedTuple):
    """Vertices of paths that are no surfaces."""

    scattered: Lane  # bool: in a medium
    passes: Lane  # bool: an invisible boundary
    position: Vec
    anisotropy: Lane  # g of the phase function
    draine: Any  # phase_table.Draine, or NoDraine
    number: Lane  # of the medium
    guide: Any  # guides.Guide; None of photons, and in scenes without thick bodies


@helper
def _fly(table: Any, default: Any, tables: Tables, path: PathState, active: Lane, t: Lane, index: PathSample, time: Any) -> Flown:
    zero = 0.0 * path.density
    number = ops.where(active, medium_stack.top(path.inside), 0)
    none = tracking.Flight(ops.bool_like(zero, False), t, (zero + 1.0, zero + 1.0, zero + 1.0), (zero, zero, zero))
    if ops.not_(ops.any_lane(number > 0)):
        return Flown(path.weight, none.scattered, t, none.emitted)
    key = tracking.Key(index.pixel, index.sample, index.depth, index.seed, 0, path.body, time, path.axis)
    flight = free_flight.fly(table, none, tables, number, path.origin, path.direction, path.near, t, path.weight, key)
    return Flown(
        ops.mul(path.weight, flight.factor), active & (number > 0) & flight.scattered, flight.t, ops.mul(path.weight, flight.emitted)
    )


@helper
def _weighted(flown: Flown, path: PathState) -> PathState:
    return PathState(
        path.origin, path.direction, flown.weight, path.density, path.straight, path.inside, path.phase, path.facing, path.links, path.near,
        path.body, path.leaving, path.divided, path.axis,
    )  # fmt: skip


@helper
def _without_scattered(flown: Flown, mask: Lane) -> Lane:
    return mask & ops.not_(flown.scattered)


@helper
def _any_vertex(flown: Flown, surfaces: Lane) -> Lane:
    return surfaces | flown.scattered


@helper
def _event(flown: Flown, default: Any, tables: Tables, path: PathState, point: Surface, surfaces: Lane) -> Event:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    inside = medium_stack.top(path.inside)
    t = ops.where(flown.scattered, flown.t, 0.0)
    back = free_flight.coefficients_of(table.scatter, inside)[1]
    return Event(
        flown.scattered, surfaces & table.scatter.clear[point.material], ops.along(path.origin, path.direction, t),
        0.0 * path.density + table.scatter.anisotropy[inside], table.scatter.draine, inside,
        guides.of(path.axis, None, table.scatter, inside, path.weight, back, flown.scattered),
    )  # fmt: skip


@helper
def _vertices(event: Event, surfaces: Lane) -> Lane:
    return (surfaces & ops.not_(event.passes)) | event.scattered


@helper
def _surfaces(event: Event, vertices: Lane) -> Lane:
    return vertices & ops.not_(event.scattered)


@helper
def _place(event: Event, point: Surface, path: PathState) -> Surface:
    """The point with those in media: no surface is there, so that rays need no offset."""
    zero = 0.0 * point.offset
    none, scattered = (zero, zero, zero), event.scattered
    return Surface(
        ops.where3(scattered, event.position, point.position), point.local, ops.where3(scattered, none, point.geometric),
        ops.where3(scattered, ops.negate(path.direction), point.normal), point.local_normal, point.uv, point.metric, point.front,
        point.instance, point.material, point.color, ops.where(scattered, 0.0, point.offset), point.time, point.spread, point.lift,
        point.known, point.tangent,
    )  # fmt: skip


@helper
def _or_scattered(event: Event, default: Lane) -> Lane:
    return default | event.scattered


@helper
def _evaluate(event: Event, default: tuple[Vec, Lane], to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    cosine = -ops.dot(to_light, to_viewer)
    density = phase_table.density(event.draine, phase.density(event.anisotropy, cosine), event.number, cosine)
    share = 3.141592653589793 * density
    density = guides.density(event.guide, density, to_light)
    scattered = event.scattered
    return ops.where3(scattered, (share, share, share), default[0]), ops.where(scattered, density, default[1])


@helper
def _scatter(event: Event, default: Scattered, direction: Vec, u: Lane, v: Lane, which: Lane) -> Scattered:
    if ops.not_(ops.any_lane(event.scattered)):
        return default
    onward, density = phase.sample(event.anisotropy, direction, u, v)
    plain_phase = onward, 0.0 * density + 1.0, density
    onward, weight, density = phase_table.sample(event.draine, plain_phase, event.number, direction, u, v)
    onward, weight, density = guides.sample(event.guide, (onward, weight, density), u, v, which)
    scattered = event.scattered
    return Scattered(
        ops.where3(scattered, onward, default.direction), ops.where3(scattered, (weight, weight, weight), default.weight),
        ops.where(scattered, density, default.density),
        default.through & ops.not_(scattered),
    )  # fmt: skip


@helper
def _survival(event: Event, default: Lane, chance: Lane, before: Lane) -> Lane:
    return ops.where(event.scattered, ops.minimum(guides.before(event.guide, chance, before), 1.0), default)


@helper
def _turn(event: Event, default: Any, axis: Any, point: Surface) -> Any:
    return guides.turn(axis, None, point, event.scattered)


@helper
def _at_start(event: Event, default: Any, like: Lane) -> Lane:
    return 0.0 * like


@helper
def _carried(event: Event, default: Any, inside: Lane) -> Lane:
    return inside


@helper
def _untested(event: Event, default: Lane, reach: Lane) -> Lane:
    return -ops.maximum(reach, 1e-30)


@helper
def behind(point: Surface, direction: Vec, t: Lane) -> Lane:
    """The distance at which a ray goes on behind a surface that it hit at a distance t."""
    cosine = ops.maximum(ops.absolute(ops.dot(direction, point.geometric)), LEAST_COSINE)
    return t + 2.0 * point.offset / cosine + 4.0 * ops.roundoff(t) * t


@helper
def _pass_boundary(event: Event, default: tuple[PathState, Lane], tables: Tables, path: PathState, point: Surface, t: Lane) -> Any:
    """(continuation of paths, whether they go on) with those that pass an invisible boundary: the same ray, from behind it."""
    passes, onward = event.passes, default[0]
    if ops.not_(ops.any_lane(passes)):
        return default
    inside = medium_stack.cross_boundary(path.inside, None, tables, point, path.direction)
    passed = PathState(
        ops.where3(passes, path.origin, onward.origin), ops.where3(passes, path.direction, onward.direction),
        ops.where3(passes, path.weight, onward.weight), ops.where(passes, path.density, onward.density),
        (passes & path.straight) | (ops.not_(passes) & onward.straight), ops.where(passes, inside, onward.inside),
        ops.where(passes, path.phase, onward.phase), choose_facing(path.facing, onward.facing, passes),
        choose_links(path.links, onward.links, passes), ops.where(passes, behind(point, path.direction, t), onward.near),
        bodies.choose(path.body, onward.body, passes), _leave(onward.leaving, None, point, path, inside, passes),
        dispersion.keep(onward.divided, None, path.divided, passes),
        guides.choose(path.axis, onward.axis, passes),
    )  # fmt: skip
    return passed, default[1] | (passes & (ops.largest(path.weight) > 0.0))


@helper
def _leave_boundary(default: Lane, absent: Any, point: Surface, path: PathState, inside: Lane, passes: Lane) -> Lane:
    return ops.where(passes, boundary_cosine(point, path.direction, path.inside, inside), default)


_leave = specialize_if_present(_leave_boundary)


@helper
def boundary_cosine(point: Surface, direction: Vec, before: Lane, after: Lane) -> Lane:
    """The cosine of a ray where the medium changes from that of one stack to that of another; FAR at other surfaces."""
    bounds = medium_stack.top(before) != medium_stack.top(after)
    return ops.where(bounds, ops.absolute(ops.dot(direction, point.geometric)), FAR)


@helper
def _choose3(first: Vec, second: Vec, takes_first: Lane) -> Vec:
    return ops.where3(takes_first, first, second)


@helper
def _choose(first: Lane, second: Lane, takes_first: Lane) -> Lane:
    return ops.where(takes_first, first, second)


choose_facing, choose_links = specialize_if_present(_choose3), specialize_if_present(_choose)
fly = specialize_if_present(_fly)  # (table, None, tables, path, active, t of hits or inf, index, time) → Flown
weighted = specialize_if_present(_weighted)  # (flown, path) → the path after its flight
without_scattered = specialize_if_present(_without_scattered)  # (flown, mask) → the mask without paths that scatter
any_vertex = specialize_if_present(_any_vertex)  # (flown, surfaces) → surfaces and points of media
event_of = specialize_if_present(_event)  # (flown, None, tables, path, point, surfaces) → Event
vertices = specialize_if_present(_vertices)  # (event, surfaces) → surfaces and points of media to shade
surfaces = specialize_if_present(_surfaces)  # (event, vertices) → those that are surfaces
place = specialize_if_present(_place)  # (event, point, path) → points with those in media
or_scattered = specialize_if_present(_or_scattered)  # (event, condition) → the condition, or that it is in a medium
evaluate = specialize_if_present(_evaluate)  # (event, (share, density), to light, to viewer) → with those of the phase function
scatter = specialize_if_present(_scatter)  # (event, Scattered, direction, u, v, which) → with samples of the phase function
survival = specialize_if_present(_survival)  # (event, probability to go on, the same without a limit, of guided walks) → with that in media
turn = specialize_if_present(_turn)  # (event, None, axis, point) → the axis of rays from a vertex, see PathState
at_start = specialize_if_present(_at_start)  # (event, None, like) → 0: where rays from a vertex begin
carried = specialize_if_present(_carried)  # (event, None, stack) → the stack, for shadow rays
untested = specialize_if_present(_untested)  # (event, -1, distance) → distance below 0 of rays without a shadow test, which media attenuate
pass_boundary = specialize_if_present(_pass_boundary)  # (event, (continuation, going), tables, path, point, t)
