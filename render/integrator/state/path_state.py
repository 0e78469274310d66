"""Records and random numbers of the path integrator."""

from __future__ import annotations

from typing import Any, NamedTuple

from ....compiler import ir
from ....lights import AMBIENT, SKIES
from ....materials import traits
from ....materials.contract import Lobes
from ...jit.kernel import helper
from ...lanes import ops
from ...light import dome_spots
from ...light.emitter_table import Emitters
from ...material import rough_dielectric
from ...material.bsdf import Scattered
from ...material.shader import ONLY, Uses
from ...sampling import sobol
from ...types import Lane, Vec
from .records import ShadingContext

CAMERA_RAY = int(ir.Visibility.CAMERA)
OTHER_RAY = int(ir.Visibility.REFLECTION)
FIRST = 8  # random dimension of the first surface: those before are the camera's
PAIRS = 4  # of random numbers a surface: light, direction, choices, Russian roulette
LAYERS = 1 << 20  # first dimension of the numbers that let paths pass partly transparent surfaces
SPREAD = 3  # surfaces of a path whose numbers are Sobol points; beyond them stratification gains nothing
WEIGHINGS = ("power", "balance", "light", "bsdf")  # MIS heuristics (Veach 1997), or one strategy alone
BALANCE, LIGHTS_ALONE, SURFACES_ALONE = 1, 2, 3
GATHERED = 4.0 * ONLY  # density of a specular direction after a diffuse surface: photons carry the light of lights there
FAR = 1e9  # in place of a cosine where a ray enters no medium
LIT = 1e-18  # density of a direction from a surface with vertex light: its light has been counted


class PathState(NamedTuple):
    """A ray of a path, and the factor of its radiance in the pixel."""

    origin: Vec
    direction: Vec
    weight: Vec  # throughput
    density: Lane  # solid angle density of its direction
    straight: Lane  # bool: has passed only boundaries of index 1; where it escapes, alpha is lowered
    inside: Any  # medium stack; None in scenes without media
    phase: Lane  # kinds of surfaces before it, see photon_map.phase_after
    facing: Any = None  # its origin's record for light selection, see light_tree.facing
    links: Any = None  # light links of its origin, see links.bits_of; None in scenes without links
    near: Any = None  # distance at which it begins, behind an invisible boundary; None in scenes without scattering media
    body: Any = None  # colour, and factor of the radius, where it entered a body; None in scenes without bodies of varying colour
    leaving: Any = None  # cosine at the boundary of the medium where it began, see photon_volume; None without photons in media
    divided: Any = None  # 1 where it has a wavelength, else 0, see material/dispersion.py; None in scenes without dispersion
    axis: Any = None  # outward normal of its last surface; None in scenes without thick bodies, see guides.py


class PathSample(NamedTuple):
    """The key of the random numbers of one surface of a path."""

    pixel: Lane
    sample: Lane
    depth: int  # surfaces before it
    seed: int


class Connection(NamedTuple):
    """A shadow ray to a sample of an emitter, and the radiance it adds if nothing blocks it."""

    origin: Vec
    direction: Vec
    distance: Lane  # below 0: without a shadow test
    light: Vec
    wanted: Lane  # bool
    share: Any = None  # π f cos of the BSDF towards it
    blockers: Any = None  # mask of the instances that block it, see links.Links; None in scenes without links
    inside: Any = None  # medium stack at its origin; None in scenes without scattering media
    body: Any = None  # see PathState


class Vertex(NamedTuple):
    """A surface of a path with the BSDF sample that goes on from it."""

    shading: ShadingContext
    scattered: Scattered
    gathered: Any  # photon_map.Gathered; None in scenes without photons


class NoVertices(NamedTuple):
    """No light is computed at vertices."""


class NoMaps(NamedTuple):
    """No photons."""


class PathInputs(NamedTuple):
    """Inputs of the path integrator beside the tables."""

    emitters: Emitters
    uses: Uses
    vertices: Any = NoVertices()  # or VertexLight
    weighing: int = 0  # index into WEIGHINGS
    photons: Any = NoMaps()  # or photon_map.Maps
    photon_emitters: Any = NoMaps()  # or (emitters,) bool: emitters whose light photons carry
    caustic_reflectance: Any = NoMaps()  # or (instances,) reflectance of narrow highlights that photons carry
    spots: Any = dome_spots.NoSpots()  # or dome_spots.Spots: the only part of a dome's light that photons carry


def uses_of(tables: ir.Tables) -> Uses:
    """Return which features the materials and lights of a scene use."""
    values, slot = tables.materials.values, ir.Slot

    sky = ir.is_in(tables.lights.kind, SKIES)

    def any_of(*slots: int) -> bool:
        return bool(values[:, list(slots)].max(initial=0.0) > 0.0)

    lobed = traits.facets(tables) | traits.slabs(tables) | traits.added(tables)
    flat = traits.flat_facets(tables) | traits.flat_coats(tables)
    return Uses(
        glossy=any_of(slot.SPECULAR) or bool(lobed.any()) or rough_dielectric.is_rough(tables),
        sharp=any_of(slot.REFLECTION, slot.TRANSMISSION) or bool((traits.has(tables, Lobes.GLASS) | flat).any()),
        shines=any_of(slot.EMISSION),
        ambient=bool(ir.is_in(tables.lights.kind, AMBIENT).any()),
        sky=bool((sky & tables.lights.shadows).any()),
        open_sky=bool((sky & ~tables.lights.shadows).any()),
    )


@helper
def numbers(index: PathSample, pair: int) -> tuple[Lane, Lane]:
    """Return a pair of random numbers of a surface, 0 to PAIRS - 1."""
    dimension = ops.int_like(index.pixel, FIRST + index.depth * PAIRS + pair)
    if index.depth < SPREAD:
        return sobol.pair(index.pixel, index.sample, dimension, index.seed)
    return sobol.hashed_pair(index.pixel, index.sample, dimension, index.seed)


@helper
def alpha_number(index: PathSample, layer: int) -> Lane:
    """Return the random number that lets a ray pass its `layer`-th partly transparent surface."""
    return sobol.hashed_pair(index.pixel, index.sample, ops.int_like(index.pixel, LAYERS + index.depth * 1024 + layer), index.seed)[0]


@helper
def photon_number(index: PathSample) -> Lane:
    """Return the random number that chooses the photon of a surface whose visibility is tested."""
    return sobol.hashed_pair(index.pixel, index.sample, ops.int_like(index.pixel, LAYERS + index.depth * 1024 + 1022), index.seed)[0]


@helper
def medium_number(index: PathSample) -> Lane:
    """Return the random number that places a light sample in a medium, beside a pair of `numbers`."""
    return sobol.hashed_pair(index.pixel, index.sample, ops.int_like(index.pixel, LAYERS + index.depth * 1024 + 1021), index.seed)[0]


@helper
def lobe_number(index: PathSample) -> Lane:
    """Return the random number that chooses the lobe or the base of a surface, see photon_coverage.split_lobe."""
    return sobol.hashed_pair(index.pixel, index.sample, ops.int_like(index.pixel, LAYERS + index.depth * 1024 + 1023), index.seed)[0]
