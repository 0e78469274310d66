"""Photons in participating media: the media where they start, their flights, and where they are stored.

Before a mirror or glass photons only lose power on the way: paths carry the light that scatters first. After one, flights end in collisions
as those of paths do, and each is stored with its power over the scattering coefficient. In scenes without scattering media kernels compile
nothing of this.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...jit.kernel import helper, specialize_if_present
from ...lanes import ops
from ...light.emitter_table import Emitters
from ...light.form_samples import DISTANT, SKY
from ...material import medium_stack
from ...medium import free_flight, tracking
from ...sampling import sobol
from ...types import Lane, Ray, Tables, Vec
from ..photon_maps import photon_volume
from ..state.flights import Event, Flown
from ..state.path_state import PathState
from .aims import Aims
from .emission import emitter_of

DEEP = tracking.SEGMENTS * (tracking.MOST_SEGMENTS + 2)  # depth that numbers the first flight of a photon; those of paths are below it
KEPT = 3 << 18  # first dimension of the numbers that choose which photons are stored
MOST_PLACES = 64  # lights whose surrounding media are searched
EACH, MOST_STORED = 8.0, 1 << 23  # most collisions that are stored for each photon, on average, and of a round


def stacks(table: Emitters, chosen: NDArray[np.bool_], outside: int, search: Any) -> NDArray[np.int64]:
    """(emitters,) medium stacks where emitters are: `search(place)` of chosen ones with a place, `outside` of others."""
    inside = np.full(len(table.kind), outside, np.int64)
    near = chosen & ~np.isin(table.kind, (DISTANT, SKY))
    for row in np.flatnonzero(near)[:MOST_PLACES].tolist():
        inside[row] = search(table.place[row])
    return inside


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def _start(
    table: Any, default: tuple[Vec, Any, Any], tables: Tables, emitters: Emitters, aims: Aims, number: Lane, index: Lane, ray: Ray,
    seed: int
) -> tuple[Vec, Lane, Lane]:  # fmt: skip
    power, zero = default[0], 0.0 * ray.origin[0]
    row = emitter_of(aims, number, index, seed)
    inside = ops.int_like(zero, 0) + ops.to_int(aims.inside[row])
    kind = emitters.kind[row]
    far = (kind == DISTANT) | (kind == SKY)
    around = ops.where(far, medium_stack.top(inside), 0)
    if ops.any_lane(around > 0):
        white = (zero + 1.0, zero + 1.0, zero + 1.0)
        key = tracking.Key(number, index, DEEP - 1, seed, 1, medium_stack.initial_body(tables, zero), None, None)
        passed = free_flight.transmit(table, white, tables, around, ray.origin, ops.negate(ray.direction), zero, zero + np.inf, key)
        power = ops.where3(around > 0, ops.mul(power, passed), power)
    return power, inside, zero


start = specialize_if_present(_start)
"""(media, (power, None, None), tables, emitters, aims, map, photon, ray, seed): (power that reaches the start of a ray from infinity,
medium stack, distance at which the ray begins)."""


@helper
def _stored_depth(table: Any, default: int) -> int:
    return 1


stored_depth = specialize_if_present(_stored_depth)  # (media, depth): a depth of which medium stacks are in memory


@helper
def _fly(
    table: Any, default: Any, tables: Tables, path: PathState, active: Lane, scatters: Lane, t: Lane, photon_key: tracking.Key
) -> Flown:
    """Photons after their flight to the next hit; those not of `scatters` only lose power. `photon_key` is (map, photon, depth, seed)."""
    zero = 0.0 * path.near
    number = ops.where(active, medium_stack.top(path.inside), 0)
    weight, scattered, distance = path.weight, ops.bool_like(zero, False), t
    none = (zero, zero, zero)
    fading = (number > 0) & ops.not_(scatters)
    if ops.any_lane(fading):
        white = (zero + 1.0, zero + 1.0, zero + 1.0)
        key = tracking.Key(photon_key.pixel, photon_key.sample, DEEP + photon_key.depth, photon_key.seed, 1, photon_key.body, None, None)
        through = ops.where(fading, number, 0)
        passed = free_flight.transmit(table, white, tables, through, path.origin, path.direction, path.near, t, key)
        weight = ops.where3(fading, ops.mul(weight, passed), weight)
    flying = (number > 0) & scatters
    if ops.any_lane(flying):
        depth = DEEP + photon_key.depth
        key = tracking.Key(photon_key.pixel, photon_key.sample, depth, photon_key.seed, tracking.PHOTON, photon_key.body, None, None)
        still = tracking.Flight(scattered, t, (zero + 1.0, zero + 1.0, zero + 1.0), none)
        through = ops.where(flying, number, 0)
        flight = free_flight.fly(table, still, tables, through, path.origin, path.direction, path.near, t, weight, key)
        weight = ops.where3(flying, ops.mul(weight, flight.factor), weight)
        scattered, distance = flying & flight.scattered, ops.where(flying, flight.t, distance)
    return Flown(weight, scattered, distance, none)


fly = specialize_if_present(_fly)  # (media, None, tables, path, active, scatters, t of hits or inf, key) → Flown


@helper
def _power(flown: Flown, default: Vec) -> Vec:
    return flown.weight


power_after = specialize_if_present(_power)  # (flown, power)


@helper
def _chance(event: Event, default: Lane, power: Vec, before: Vec) -> Lane:
    share = ops.largest(power) / ops.maximum(ops.largest(before), 1e-30)
    return ops.where(event.scattered, ops.minimum(share, 1.0), default)


chance = specialize_if_present(_chance)  # (event, probability to go on, power, power before the flight) → with that of collisions


@helper
def _collision(event: Event, default: Any, tables: Tables, path: PathState, power: Vec, share: float, photon_key: tracking.Key) -> Any:
    table: Any = medium_stack.scattering(tables)
    medium = ops.where(event.scattered, medium_stack.top(path.inside), 0)
    number = sobol.hashed_pair(
        photon_key.pixel, photon_key.sample, ops.int_like(photon_key.pixel, KEPT + photon_key.depth), photon_key.seed
    )[0]
    is_stored = event.scattered & (number < share)
    back = free_flight.scattering_at(table, tables, medium, event.position, photon_key.body)
    scale = 1.0 / share
    fluence = (
        ops.where(back[0] > 0.0, power[0] * scale / ops.maximum(back[0], 1e-30), 0.0),
        ops.where(back[1] > 0.0, power[1] * scale / ops.maximum(back[1], 1e-30), 0.0),
        ops.where(back[2] > 0.0, power[2] * scale / ops.maximum(back[2], 1e-30), 0.0),
    )  # fmt: skip
    return is_stored & (ops.largest(fluence) > 0.0), fluence, ops.to_float(medium) + photon_volume.CODE


collision = specialize_if_present(_collision)
"""(event, None, tables, path, power, share stored, key): (photons to store, their power over the coefficient, their code)."""
