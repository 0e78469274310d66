"""Flakes: facets of slabs that each cell of a lattice tilts, as in car paint, and their filter over a pixel.

Cells are those of jittered points in the instance's frame (Worley 1996), each with a hashed tilt. A flake shifts the slopes of the
base's facets; masking, albedos and the coat are those of all facets together (as in LEADR, Dupuy and others 2013). So the mean over flakes
of the shifted distribution is the distribution of all facets, which is GGX of α² = αᵣ² + αₜ².

The filter: where a sample's footprint holds N > 1 flakes, tilts shrink such that the square of their spread is 1/N of what it was, and the
facets of a flake widen (flake_tilts). The mean over flakes stays the same at any N, for each pair of directions. Footprints go by the
distance from the camera; a picture in a mirror may show more detail, with the same mean.

Scenes without flakes compile nothing of it: the `flake` of their Slabs is None, which is a type.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...materials import traits
from .. import camera
from ..geometry import instance_transform
from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import affine, ops
from ..sampling import flake_tilts
from ..surface import interaction
from ..surface.material_inputs import number_of
from ..types import Lane, Surface, Tables, Vec, View
from . import anisotropic_facets
from .anisotropic_facets import Facets

SIZE, TILT, COVERAGE, SEED = (int(s) for s in (ir.Slot.FLAKE_SIZE, ir.Slot.FLAKE_TILT, ir.Slot.FLAKE_COVERAGE, ir.Slot.FLAKE_SEED))
JITTER = 0.8  # of a cell's width: how far points lie from the middles of cells, from end to end
FARTHEST = 1e8  # cells from the origin
STEEPEST = 30.0  # greatest slope of a flake
LEAST_COSINE = 0.05  # of footprints
_PX, _PY, _PZ, _PS = 73856093, 19349663, 83492791, 40503 * 9973
_BITS, _M1, _M2, _AGAIN = 0x7FFFFFFF, 0x2C1B3C6D, 0x297A2D39, 0x3C6EF372
_TEN = 1023


class NoFlakes(NamedTuple):
    """No material has flakes."""


class Flakes(NamedTuple):
    """Some material has flakes."""

    tilts: NDArray[np.float64]  # see flake_tilts.table
    eye: NDArray[np.float64]  # (3,) where camera rays begin
    widths: NDArray[np.float64]  # (2,) of a sample: at the eye, growth per metre


class Flake(NamedTuple):
    """The flake at a point."""

    here: Lane  # bool
    along: Lane  # its slope along the facets' first axis
    across: Lane
    first: Lane  # α of its own facets
    second: Lane
    all_first: Lane  # α of all facets
    all_second: Lane
    all_alpha: Lane


def tables_of(tables: ir.Tables, general: bool = False) -> Flakes | NoFlakes:
    """The tables if a material of an instance has flakes; footprints are 0 until `with_view`."""
    if not general and not (traits.flaked(tables) & traits.used(tables)).any():
        return NoFlakes()
    return Flakes(flake_tilts.table(), np.zeros(3), np.zeros(2))


def with_view(tables: ir.Tables, view: View, samples: int) -> ir.Tables:
    """Tables whose flakes know the footprint of each of `samples` samples of a pixel; those of scenes without flakes as they are."""
    materials: Any = tables.materials
    part = getattr(getattr(materials, "slabs", None), "flakes", None)
    if not isinstance(part, Flakes):
        return tables
    matrix = tables.transforms.matrix[tables.cameras.transform[view.camera]]
    kind, step = int(tables.cameras.projection[view.camera]), 1.0 / math.sqrt(max(samples, 1))
    if kind == ir.Projection.PANORAMIC:
        widths = 0.0, math.pi / view.height
    else:
        x, y = 0.5 * view.width, 0.5 * view.height
        ray = camera.generate_pinhole_ray(tables, view, np.array([x, x + 1.0, x]), np.array([y, y, y + 1.0]))
        moved = np.stack([np.broadcast_to(c, 3) for c in (ray.direction if kind == ir.Projection.PERSPECTIVE else ray.origin)], axis=1)
        width = math.sqrt(float(np.linalg.norm(np.cross(moved[1] - moved[0], moved[2] - moved[0]))))
        widths = (0.0, width) if kind == ir.Projection.PERSPECTIVE else (width, 0.0)
    seen = part._replace(eye=matrix[:, 3].copy(), widths=step * np.array(widths))
    return tables._replace(materials=materials._replace(slabs=materials.slabs._replace(flakes=seen)))


# --- at a point ----------------------------------------------------------------------------------------------------------


@helper
def _mixed(key: Lane) -> Lane:
    """A hash of 31 bits, which are the same in 32-bit and 64-bit arithmetic."""
    key = ((key ^ (key >> 15)) * _M1) & _BITS
    key = ((key ^ (key >> 13)) * _M2) & _BITS
    return key ^ (key >> 16)


@helper
def _number(key: Lane) -> Lane:
    """0 to 1, of a hash's lowest bits."""
    return (ops.to_float(key & 0xFFFFF) + 0.5) * (1.0 / 1048576.0)


@helper
def _nearest(p: Vec, seed: Lane) -> Lane:
    """The hash of the cell around a point: of the nearest of the points of eight cubes."""
    i, j, k = ops.floor_int(p[0] - 0.5), ops.floor_int(p[1] - 0.5), ops.floor_int(p[2] - 0.5)
    least, nearest = 0.0 * p[0] + 99.0, 0 * i
    for corner in range(8):
        a, b, c = i + (corner & 1), j + ((corner >> 1) & 1), k + (corner >> 2)
        key = _mixed(((a * _PX) ^ (b * _PY) ^ (c * _PZ) ^ (seed * _PS)) & _BITS)
        x = p[0] - ops.to_float(a) - 0.5 - (ops.to_float(key & _TEN) * (1.0 / _TEN) - 0.5) * JITTER
        y = p[1] - ops.to_float(b) - 0.5 - (ops.to_float((key >> 10) & _TEN) * (1.0 / _TEN) - 0.5) * JITTER
        z = p[2] - ops.to_float(c) - 0.5 - (ops.to_float((key >> 20) & _TEN) * (1.0 / _TEN) - 0.5) * JITTER
        size = x * x + y * y + z * z
        nearer = size < least
        least, nearest = ops.where(nearer, size, least), ops.where(nearer, key, nearest)
    return nearest


@separate_helper
def _flake_at(flakes: Flakes, default: Any, tables: Tables, surface: Surface, facets: Facets) -> Flake:
    size, zero = number_of(tables, surface, SIZE), 0.0 * surface.offset
    here = ops.bool_like(zero, False) | (size > 0.0)
    if ops.not_(ops.any_lane(here)):
        return Flake(here, zero, zero, facets.first, facets.second, facets.first, facets.second, facets.alpha)
    size = ops.where(here, size, 1.0)
    x, y, z = ops.scale(surface.local, 1.0 / size)
    place = ops.clip(x, -FARTHEST, FARTHEST), ops.clip(y, -FARTHEST, FARTHEST), ops.clip(z, -FARTHEST, FARTHEST)
    key = _mixed(_nearest(place, ops.floor_int(number_of(tables, surface, SEED) + 0.5 + zero)) ^ _AGAIN)
    again = _mixed(key ^ _AGAIN)
    third = _mixed(again ^ _AGAIN)
    here = here & (_number(third) < number_of(tables, surface, COVERAGE))
    tilt = ops.clip(number_of(tables, surface, TILT), 0.0, 1.0)
    tilt = ops.where(here, tilt * tilt, 0.0)
    factor = ops.maximum(facets.alpha / ops.sqrt(facets.alpha * facets.alpha + tilt * tilt), ops.minimum(facets.alpha, 1.0))
    frame = instance_transform.transform_at(tables, ops.to_int(tables.instances.transform[surface.instance]), surface.time)
    many = ops.maximum(_flakes_of_sample(flakes, surface, size * interaction.mean_scale(frame.matrix)), 1.0)
    share = ops.sqrt(ops.maximum(1.0 - (1.0 - factor * factor) / many, 0.0))
    height, turn = 2.0 * _number(again) - 1.0, (2.0 * math.pi / 2048.0) * ops.to_float((again >> 20) & 2047)
    flat = ops.sqrt(ops.maximum(1.0 - height * height, 0.0))
    way = affine.transform_vector12(frame.matrix, (flat * ops.cos(turn), flat * ops.sin(turn), height))
    dx, dy = ops.dot(way, facets.along), ops.dot(way, facets.across)
    length = ops.sqrt(ops.maximum(dx * dx + dy * dy, 1e-30))
    slope = ops.where(here, flake_tilts.size_of_tilt(flakes.tilts, share, _number(key)), 0.0) / length
    first, second = facets.first / factor, facets.second / factor
    return Flake(
        here, ops.clip(slope * dx * first, -STEEPEST, STEEPEST), ops.clip(slope * dy * second, -STEEPEST, STEEPEST),
        ops.where(here, first * share, facets.first), ops.where(here, second * share, facets.second),
        ops.where(here, first, facets.first), ops.where(here, second, facets.second), ops.where(here, facets.alpha / factor, facets.alpha),
    )  # fmt: skip


@helper
def _flakes_of_sample(flakes: Flakes, surface: Surface, size: Lane) -> Lane:
    """Flakes of a size in the footprint of a sample."""
    away = ops.sub(surface.position, (flakes.eye[0], flakes.eye[1], flakes.eye[2]))
    distance = ops.length(away)
    wide = (flakes.widths[0] + flakes.widths[1] * distance) / size
    cosine = ops.absolute(ops.dot(away, surface.geometric)) / ops.maximum(distance, 1e-12)
    return wide * wide / ops.maximum(cosine, LEAST_COSINE)


@helper
def _all_facets(flake: Flake, facets: Facets) -> Facets:
    return Facets(facets.along, facets.across, flake.all_first, flake.all_second, flake.all_alpha)


at = specialize_if_present(_flake_at)  # flakes, None, tables, surface, facets of the base: Flake or None
all_facets = specialize_if_present(_all_facets)  # flake, the facets of the base: those of all flakes together


# --- shifted facets ------------------------------------------------------------------------------------------------------


@helper
def is_active(flake: Flake) -> bool:
    """Whether some lane has a flake."""
    return ops.any_lane(flake.here)


@helper
def _flake_facets(flake: Flake, facets: Facets) -> Facets:
    return Facets(facets.along, facets.across, flake.first, flake.second, flake.all_alpha)


@helper
def _shifted(flake: Flake, plain: tuple[Lane, Lane], facets: Facets, normal: Vec, half: Vec, to_viewer: Vec) -> tuple[Lane, Lane]:
    x, y, z = anisotropic_facets.to_frame(facets, normal, half)
    flake_facets = _flake_facets(flake, facets)
    strength = anisotropic_facets.distribution(flake_facets, (x - flake.along * z, y - flake.across * z, z))
    seen = _seen_from(flake, anisotropic_facets.to_frame(facets, normal, to_viewer))
    size = ops.maximum(seen[2] + anisotropic_facets.reach(flake_facets, seen), anisotropic_facets.LEAST)
    return ops.where(flake.here, strength, plain[0]), ops.where(flake.here, size, plain[1])


@helper
def _seen_from(flake: Flake, direction: Vec) -> Vec:
    """The direction in which the facets of a flake are seen as those without a tilt are seen in `direction`."""
    return direction[0], direction[1], direction[2] + direction[0] * flake.along + direction[1] * flake.across


@helper
def _tilted(flake: Flake, plain: Vec, facets: Facets, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, straight: Lane) -> Vec:
    flake_facets, (x, y, z) = _flake_facets(flake, facets), _seen_from(flake, anisotropic_facets.to_frame(facets, normal, to_viewer))
    x, y, z = ops.normalize((flake_facets.first * x, flake_facets.second * y, z))
    turn = (2.0 * math.pi) * v
    height = (1.0 - u) * (1.0 + z) - z
    flat = ops.sqrt(ops.maximum(1.0 - height * height, 0.0))
    x, y = flake_facets.first * (flat * ops.cos(turn) + x), flake_facets.second * (flat * ops.sin(turn) + y)
    z = ops.maximum(height + z, anisotropic_facets.LEAST)
    half = ops.normalize(ops.in_basis(facets.along, facets.across, normal, x + flake.along * z, y + flake.across * z, z))
    return ops.where3(flake.here & ops.not_(straight), half, plain)


shifted = specialize_if_present(_shifted, is_active)
"""flake, (distribution, twice the area of facets that the viewer sees), facets, normal, half vector, viewer: likewise of the flake."""
tilted = specialize_if_present(_tilted, is_active)
"""flake, a sampled normal, facets, normal, viewer, u, v, lanes that keep it: a visible normal of the flake."""
