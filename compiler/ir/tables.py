"""Tables of the IR: NamedTuples of contiguous numpy arrays, with one row an entry.

Numba kernels take a table, or all of them (`Tables`), as it is. Index columns are int32; -1 means none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]


class Transforms(NamedTuple):
    """Object to world. Row 0 is the identity."""

    matrix: F64  # (n, 3, 4)
    inverse: F64  # (n, 3, 4)
    flips: Bool  # (n,) determinant < 0
    first_key: I32  # (n,) row of Keys; -1: static
    keys: I32  # (n,) number of keys, evenly from the first opening of a shutter to the last closing; matrix is that of the scene's time


class Keys(NamedTuple):
    """Keys of moving transforms, decomposed: matrix = [R S | move]. move and stretch are interpolated linearly, R spherically."""

    move: F64  # (n, 3)
    turn: F64  # (n, 4) unit quaternion x, y, z, w of R; at most half a turn from the previous key
    stretch: F64  # (n, 3, 3) S


class Pools(NamedTuple):
    """Flat arrays; geometries, attributes and tapes are ranges of them."""

    positions: F32  # (v, 3) relative to the mesh's origin
    triangles: I32  # (t, 3) rows of positions
    values: F32  # (k,) attribute values, flat
    loops: I32  # (l, 2) first corner, corner count: outlines and holes
    corners: I32  # (c,) rows of positions
    code: I32  # (r, 4) rows of tapes: operation (formula.opcodes.Op) and operands
    constants: F64  # (q,) constants of tapes


class Attributes(NamedTuple):
    """Named data of meshes (names in Scene.names): values[first + width · index + k]."""

    interpolation: I32  # (n,) Interpolation
    width: I32  # (n,)
    first: I64  # (n,) into Pools.values
    count: I32  # (n,) number of values (not of floats)


class Tapes(NamedTuple):
    """Formulas (formula/tape.py). Operands are relative to the tape: 0, 1, 2 are x, y, z; 3 + i is row i; ~k is constant k."""

    first: I64  # (n,) row of Pools.code
    count: I32  # (n,)
    first_constant: I64  # (n,)
    constant_count: I32  # (n,)
    results: I32  # (n, 4) names of the results
    result_count: I32  # (n,)


class Polygons(NamedTuple):
    """Faces before triangulation. Meshes of triangles alone have none."""

    first_loop: I32  # (n,) the outline; holes follow
    loop_count: I32  # (n,)
    first_triangle: I32  # (n,) rows of Pools.triangles
    triangle_count: I32  # (n,)


class Geometries(NamedTuple):
    kind: I32  # (n,) GeometryKind
    parameters: F64  # (n, PARAMETERS)
    bounds: F64  # (n, 2, 3) lowest and highest corner in its own frame; ±inf where unbounded
    origin: F64  # (n, 3) added to a mesh's positions; 0 for other kinds
    first_vertex: I32  # (n,)
    vertex_count: I32  # (n,)
    first_triangle: I32  # (n,)
    triangle_count: I32  # (n,)
    first_polygon: I32  # (n,)
    polygon_count: I32  # (n,) 0: each triangle is a face of its own
    normals: I32  # (n,) row of Attributes or -1 (faces' own normals)
    uvs: I32  # (n,) row of Attributes or -1
    colors: I32  # (n,) row of Attributes or -1; multiplies k_d (and k_a)
    tape: I32  # (n,) row of Tapes of a FORMULA, else -1


class Instances(NamedTuple):
    """Geometries in the world, with a material."""

    geometry: I32
    transform: I32
    material: I32
    light: I32  # row of Lights whose shape it is, or -1
    visible: I32  # Visibility bits; from 1 << 5 on the sets of instances that light links name


class Materials(NamedTuple):
    model: I32  # (n,) MaterialModel
    shading: I32  # (n,) Shading
    normalized: Bool  # (n,)
    threshold: F64  # (n,) opacity threshold: opaque from it on, else fully transparent; 0: none
    values: F64  # (n, SLOTS, 3) constants; numbers are in column 0. 1 under a texture
    textures: I32  # (n, SLOTS) row of Textures, a factor of the constant, or -1
    textured: Bool  # (n,) whether a slot, or a part of a blend, has a texture
    first: I32  # (n,) rows of the two materials of a BLEND, lower than its own; -1
    second: I32
    medium: I32  # (n,) row of Media inside of closed shapes, or -1


class Media(NamedTuple):
    """Participating media: coefficients per metre, times `density` where there is one. Radiance of emission is per metre, too."""

    scattering: F64  # (n, 3)
    absorption: F64  # (n, 3)
    emission: F64  # (n, 3) radiance that a metre emits, W/(m³ sr) in the units of lights
    anisotropy: F64  # (n,) mean cosine of the angle of deflection, -1 to 1: g of Henyey and Greenstein 1941
    draine: F64  # (n, 4) in place of that: its g, g and α of Draine 2003, and the weight of the latter; a weight of 0: none
    priority: F64  # (n,) where media overlap, the higher one counts
    everywhere: Bool  # (n,) it fills the whole scene, around all shapes; at most one row
    top: F64  # (n,) height y in the world up to which the density is 1; inf: no top
    falloff: F64  # (n,) metres above `top` in which the density falls to 1/e; 0: it ends there
    density: I32  # (n,) row of Textures: a FORMULA of the point in the frame `transform`, VOXELS of the box `bounds`; -1: 1 everywhere
    transform: I32  # (n,) frame of `density` and `bounds` (world = transform · local)
    bounds: F64  # (n, 2, 3) lowest and highest corner of the box in that frame outside of which the density is 0; ±inf: unbounded


class Textures(NamedTuple):
    """value = gain · texel + bias, texel from the image or the two colours; uv' = frame · (u, v, 1)."""

    kind: I32
    mapping: I32  # TextureMapping
    wrap_u: I32  # Wrap
    wrap_v: I32
    nearest: Bool  # nearest texel, no interpolation
    image: I32  # row of Images or -1
    tape: I32  # row of Tapes of a FORMULA, else -1
    channel: I32  # -1: colour; 0-3: this channel for r, g and b
    frame: F64  # (n, 2, 3)
    size: F64  # (n,) cell of a checker or stripes along the surface in metres; 0: 8 cells over u and over v
    color_a: F64  # (n, 3)
    color_b: F64  # (n, 3)
    gain: F64  # (n, 3)
    bias: F64  # (n, 3)
    slices: I32  # (n,) of VOXELS


class Images(NamedTuple):
    first: I64  # (n,) row of texels
    width: I32
    height: I32
    texels: F32  # (m, 4) linear r, g, b, a; row-major from the top left


class Lights(NamedTuple):
    """`color` is strength times colour: intensity of POINT and SPOT, perpendicular irradiance of DIRECTIONAL and SUN, else radiance.

    Area lights have the frames of RECTANGLE, DISK and SPHERE geometries, and emit towards +y.
    """

    kind: I32
    color: F64  # (n, 3)
    position: F64  # (n, 3) POINT, SPOT
    direction: F64  # (n, 3) unit; axis of a SPOT, direction towards a DIRECTIONAL or SUN light
    transform: I32  # (n,) frame of area lights and domes (world = transform · local)
    size: F64  # (n, 2) half x, half z of RECTANGLE; radius in column 0 of DISK and SPHERE
    cos_cone: F64  # (n,) cosine at the edge of a spot's cone
    cos_full: F64  # (n,) cosine up to which a spot has full intensity (smoothstep of the cosine between)
    angle: F64  # (n,) angular radius of a SUN
    falloff: I32  # (n,) FalloffKind
    coefficients: F64  # (n, 3)
    image: I32  # (n,) image of a dome; of POINT, SPOT and area lights a factor by direction, latitude-longitude; -1: none
    instance: I32  # (n,) the area light's visible shape, or -1
    shadows: Bool  # (n,)
    receivers: I32  # (n,) bits of Instances.visible: surfaces with one of them are lit; -1: all surfaces
    blockers: I32  # (n,) bits of Instances.visible: instances with one of them cast shadows; Visibility.SHADOW: all casters


class Cameras(NamedTuple):
    """Cameras look down -z of their transform, y up in the image."""

    projection: I32
    transform: I32
    extent: F64  # (n,) tan of half the field of view, or half the extent in metres, along `fit`; π/2 for panoramas
    fit: I32  # Fit
    aspect: F64  # (n,) width / height of the film; 0: any
    near: F64  # 0: at the eye; orthographic cameras may have a negative one, behind it
    far: F64  # inf: none
    shift: F64  # (n, 2) share of the image's width and height
    exposure: F64  # (n,) EV; NaN: not set
    opening: F64  # (n,) seconds from the scene's time to the opening of the shutter
    shutter: F64  # (n,) seconds that the shutter is open
    lens: F64  # (n,) radius of the aperture in metres; 0: a pinhole
    focus: F64  # (n,) depth of the plane of focus, with a lens
    pixel_aspect: F64  # (n,) width / height of a pixel
    planes: F64  # (n, CLIP_PLANES, 4) (a, b, c, d): camera rays see points of the camera's frame with a x + b y + c z + d >= 0; 0: unused


class Tables(NamedTuple):
    """All tables: the scene as kernels get it."""

    transforms: Transforms
    keys: Keys
    pools: Pools
    attributes: Attributes
    polygons: Polygons
    tapes: Tapes
    geometries: Geometries
    instances: Instances
    materials: Materials
    media: Media
    textures: Textures
    images: Images
    lights: Lights
    cameras: Cameras
