"""The small records that pass between stages of rendering, in lanes: each field is a numpy array or, in kernels, a scalar."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir

Lane = Any  # float64 or int64 lanes: numpy arrays in the reference backend, scalars in kernels
Vec = tuple[Lane, Lane, Lane]


class Ray(NamedTuple):
    """origin + t · direction for t_min < t < t_max. In world space the direction has unit length."""

    origin: Vec
    direction: Vec
    t_min: Lane
    t_max: Lane
    time: Any = None  # lanes from 0, the shutter's opening, to 1; None where nothing moves (to be given in kernels)


class Hit(NamedTuple):
    """What a ray meets first."""

    t: Lane  # distance along the ray, inf: nothing
    instance: Lane  # row of Instances, -1: nothing
    primitive: Lane  # MESH: row of Pools.triangles; other kinds: which part of the shape (see shapes.py)
    u: Lane  # MESH: weight of the triangle's second corner
    v: Lane  # MESH: weight of its third corner


class First(NamedTuple):
    """What camera rays meet first, of which things."""

    tables: ir.Tables
    ray: Ray
    hit: Hit


class Surface(NamedTuple):
    """A point of a surface, ready to be shaded. Normals are unit and face the side the ray came from."""

    position: Vec  # world
    local: Vec  # in the geometry's own frame
    geometric: Vec  # the true normal
    normal: Vec  # the one light is computed with (interpolated where smooth)
    local_normal: Vec  # true normal in the geometry's own frame, facing outside
    uv: Any  # two lanes; None (in kernels) where nothing has a pattern
    metric: tuple[Lane, Lane]  # metres that one unit of u and of v spans (1 where unknown)
    front: Lane  # bool: the ray came from outside
    instance: Lane
    material: Lane
    color: Vec  # the mesh's own colour (1 where it has none)
    offset: Lane  # how far a new ray's origin must be moved along ±geometric so as not to meet this surface again
    time: Any = None  # when it was met, as in Ray
    spread: Any = None  # how far u, v go from a pixel to the next right (two lanes) and below (two), and, where there are patterns, how
    # far `local` goes (three and three); None: not known
    lift: Any = None  # Vec to where light is looked for from, off coarse triangles whose normals are interpolated: surface.lit_from
    known: Any = None  # what is known of lamps' shadows here, as hidden.py has it; None: nothing


class Triple(NamedTuple):
    """A colour or direction that is the same for all lanes."""

    x: float
    y: float
    z: float


class Followed(NamedTuple):
    """Rays go on from what mirrors, refracts or lets through."""


class Around(NamedTuple):
    """No rays go on: what mirrors or lets through shows the sky as if nothing stood before it, and a ground's mean light below."""

    up: Triple  # unit normal of the ground; zero without one
    ground: Triple  # radiance


class Traced(NamedTuple):
    """Shadows are looked for by rays."""


class Unmet(NamedTuple):
    """No lamp is looked for along highlights."""


class Options(NamedTuple):
    """The plan as kernels read it."""

    seed: int
    bounces: int  # surface interactions after the first hit
    interreflection: bool  # diffuse rays are followed, not only mirrors and glass
    shadows: bool
    background: int  # 0: sky and domes, 1: black, 2: `color`
    color: Triple
    horizon: Triple = Triple(0.0, 0.0, 0.0)  # unit normal of the plane that bounds the scene, or zero
    ground: int = -1  # the instance that is this plane
    layers: int = 0  # of what is less than wholly there, that rays may pass before chance decides; 0: everything is wholly there
    environment: Any = Followed()  # or Around
    maps: Any = Traced()  # or shadow_maps.Maps
    lamps: Any = Unmet()  # or highlights.Lamps


class GouraudLight(NamedTuple):
    """Light computed at vertices: color[first[instance] + vertex - first_vertex] on their outside, for instances with first >= 0;
    the table's second half has their inside."""

    first: NDArray[np.int64]
    color: NDArray[np.float64]  # (2 k, 3)


class View(NamedTuple):
    """A camera and the picture it makes, as kernels read it."""

    camera: int  # row of Cameras
    width: int  # pixels of the whole picture, crop or not
    height: int


class Still(NamedTuple):
    """Nothing moves while the shutter is open."""


class Open(NamedTuple):
    """When the shutter is open, of the time that keys go over."""

    start: float  # a share of that time
    share: float


class Pinhole(NamedTuple):
    """Each place of the picture has one ray."""


class Thin(NamedTuple):
    """Rays to a place of the picture come from all over a lens and meet in the plane it is focused on."""

    radius: float  # of its aperture, metres
    focus: float  # depth of the plane


class Panorama(NamedTuple):
    """The picture is all that is around."""

    middle: float  # the longitude in the picture's middle, as a share of a turn to the right


class Frame(NamedTuple):
    """What all samples of a picture share, as kernels read it."""

    picture: View
    options: Options
    filter: NDArray[np.float64]  # sampler.filter_table
    shutter: Any = Still()
    order: int = -1  # sampler.order_of
    lens: Any = Pinhole()  # or Thin or Panorama
    radiance: int = 0  # address of integrate.linked, for kernels


class Tile(NamedTuple):
    """Pixels x0 <= x < x1, y0 <= y < y1 of the picture."""

    x0: int
    y0: int
    x1: int
    y1: int


class Film(NamedTuple):
    """Sums over the samples of a tile's pixels, (height, width, …) float64; renderers add to them."""

    color: NDArray[np.float64]  # (h, w, 3) radiance
    alpha: NDArray[np.float64]  # (h, w) coverage
    issues: NDArray[np.int64]  # (h, w) samples left out because they were not finite


Tables = ir.Tables
