"""Records that stages of rendering exchange. Their lanes are numpy arrays or, in kernels, scalars or vectors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir

Lane = Any  # float64 or int64 lanes: numpy arrays in the reference backend, scalars or vectors in kernels
Vec = tuple[Lane, Lane, Lane]


class Ray(NamedTuple):
    """Points origin + t · direction, t_min < t < t_max. In world space the direction has unit length."""

    origin: Vec
    direction: Vec
    t_min: Lane
    t_max: Lane
    time: Any = None  # lanes from 0, the shutter's opening, to 1; None without motion (kernels must pass it)


class Hit(NamedTuple):
    """The first hit of a ray."""

    t: Lane  # distance along the ray; inf: no hit
    instance: Lane  # row of Instances; -1: no hit
    primitive: Lane  # MESH: row of Pools.triangles; other kinds: part of the shape, see geometry/analytic_shapes.py
    u: Lane  # MESH: weight of the triangle's second corner
    v: Lane  # MESH: weight of its third corner


class FirstHits(NamedTuple):
    """First hits of camera rays, and the tables they refer to."""

    tables: ir.Tables
    ray: Ray
    hit: Hit
    media: Any = None  # a function without arguments that returns their StraightMedia; None in scenes without media


class StraightMedia(NamedTuple):
    """What media between n camera rays and what they hit do to its light."""

    transmittance: Any  # (3, n) share of the light that passes without scattering
    distance: Any  # (n,) mean distance of the first scattering, or of the surface; without a surface the mean of light that scatters
    albedo: Any  # (3, n) albedo of the media on the way, times the share of the light that they keep from the camera


class Surface(NamedTuple):
    """A surface interaction: a point to shade. Normals are unit and face the ray's origin."""

    position: Vec  # world
    local: Vec  # in the geometry's frame
    geometric: Vec  # geometric normal
    normal: Vec  # shading normal
    local_normal: Vec  # outward geometric normal in the geometry's frame
    uv: Any  # two lanes; None (in kernels) without textures
    metric: tuple[Lane, Lane]  # metres a unit of u and of v; 1 where unknown
    front: Lane  # bool: hit from outside
    instance: Lane
    material: Lane
    color: Vec  # the mesh's vertex colour; 1 without
    offset: Lane  # distance along ±geometric to a new ray's origin, which avoids self-intersection
    time: Any = None  # of the ray
    spread: Any = None  # differences of (u, v) to the next pixel right and below, with procedural textures also of `local`; None: unknown
    lift: Any = None  # Vec to the origin of shadow rays, off coarse triangles with interpolated normals, see surface.lit_from
    known: Any = None  # known shadows of lights here, see formula_packets/shadow_rays.py; None: unknown
    tangent: Any = None  # Vec along u, see surface/tangent_frame.py; None where no material needs it


class Float3(NamedTuple):
    """A colour or direction equal in all lanes."""

    x: float
    y: float
    z: float


class SecondaryRays(NamedTuple):
    """Mirrors, glass and partly transparent surfaces spawn secondary rays."""


class AmbientEnvironment(NamedTuple):
    """No secondary rays: mirrors and glass show the unoccluded sky and the ground's mean radiance below."""

    up: Float3  # unit normal of the ground; zero without one
    ground: Float3  # radiance


class ShadowRays(NamedTuple):
    """Shadows are traced by rays."""


class NoGlossyLights(NamedTuple):
    """Glossy lobes do not sample lights."""


class NoDomeMap(NamedTuple):
    """Skies are sampled by directions of lobes alone."""


class Unlinked(NamedTuple):
    """Every light lights all surfaces, and all shadow casters cast its shadows."""


class NoAirlight(NamedTuple):
    """No fog, or paths, which scatter in it."""


class Options(NamedTuple):
    """The plan's decisions that kernels read."""

    seed: int
    bounces: int  # surface interactions after the first hit
    interreflection: bool  # diffuse surfaces spawn secondary rays, too
    shadows: bool
    background: int  # 0: sky and domes, 1: black, 2: `color`
    color: Float3
    horizon: Float3 = Float3(0.0, 0.0, 0.0)  # unit normal of the ground plane, or zero
    ground: int = -1  # that plane's instance
    layers: int = 0  # partly transparent surfaces a ray passes before stochastic alpha; 0: all surfaces are opaque
    environment: Any = SecondaryRays()  # or AmbientEnvironment
    maps: Any = ShadowRays()  # or shadow_map.Maps
    glossy_lights: Any = NoGlossyLights()  # or glossy_lights.GlossyLights
    links: Any = Unlinked()  # or links.Links
    airlight: Any = NoAirlight()  # or airlight.Airlight
    dome_map: Any = NoDomeMap()  # or sky_sampling.DomeMap


class VertexLight(NamedTuple):
    """Light computed at vertices (Gouraud): color[first[instance] + vertex - first_vertex] outside, for instances with first >= 0.

    The table's second half holds light on the inside.
    """

    first: NDArray[np.int64]
    color: NDArray[np.float64]  # (2 k, 3)


class View(NamedTuple):
    """A camera and the size of its picture."""

    camera: int  # row of Cameras
    width: int  # pixels of the whole picture, without crop
    height: int


class StillScene(NamedTuple):
    """No motion while the shutter is open."""


class Shutter(NamedTuple):
    """The interval in which the shutter is open, as shares of the time that motion keys span."""

    start: float
    share: float


class Unclipped(NamedTuple):
    """A camera without clipping planes."""


class ClippingPlanes(NamedTuple):
    """The first `count` of a camera's planes bound its rays."""

    count: int


class Lens(NamedTuple):
    """How a camera forms rays."""

    kind: int = 0  # PINHOLE, THIN_LENS or PANORAMA of camera.py
    radius: float = 0.0  # of a thin lens's aperture, metres
    focus: float = 1.0  # depth of the plane of focus, metres
    middle: float = 0.0  # longitude of a panorama's centre, in turns to the right
    planes: Any = Unclipped()  # or ClippingPlanes


class Frame(NamedTuple):
    """Data of a picture that all samples share."""

    picture: View
    options: Options
    filter: NDArray[np.float64]  # sobol.filter_table
    shutter: Any = StillScene()
    order: int = -1  # sobol.order_of
    lens: Lens = Lens()
    radiance: int = 0  # address of whitted.linked


class Tile(NamedTuple):
    """Pixels x0 <= x < x1, y0 <= y < y1 of the picture."""

    x0: int
    y0: int
    x1: int
    y1: int


class Film(NamedTuple):
    """Sums over the samples of a tile's pixels, (height, width, …) float64."""

    color: NDArray[np.float64]  # (h, w, 3) radiance
    alpha: NDArray[np.float64]  # (h, w) coverage
    issues: NDArray[np.int64]  # (h, w) samples omitted because they are not finite


Tables = ir.Tables
