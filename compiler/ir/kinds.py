"""Enumerations of the IR: kinds of geometries, materials, textures, lights and cameras."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Kind(IntEnum):
    """Integers with names. `__array_ufunc__` makes comparison with a column three times as fast."""

    __array_ufunc__ = np.ndarray.__array_ufunc__


class GeometryKind(Kind):
    """Kind of a geometry, in its own frame. The module of shapes/ with the name of a kind says what its `parameters` are."""

    MESH = 0  # a range of triangles; largest distance from the surface that they stand for
    SPHERE = 1
    BOX = 2
    PLANE = 3
    RECTANGLE = 4
    DISK = 5
    CYLINDER = 6
    CONE = 7
    TORUS = 8
    CAPSULE = 9
    QUADRIC = 10
    FORMULA = 11  # sheet (0: solid where the tape is ≤ 0, 1: sheet), x, y, z, radius of the clipping sphere (0: none), largest coordinate


PARAMETERS = 13  # columns of Geometries.parameters
CLIP_PLANES = 8  # most clipping planes of a camera, as in OpenGL


class Interpolation(Kind):
    """Which elements of a mesh an attribute has values for; `first + index` is the row of a value."""

    CONSTANT = 0  # one value
    FACE = 1  # one a triangle (copied from polygons at import)
    VERTEX = 2  # one a vertex
    CORNER = 3  # one a triangle corner: 3 · triangle + corner


class MaterialModel(Kind):
    LAMBERT = 0
    PHONG = 1
    BLINN_PHONG = 2
    MIRROR = 3
    GLASS = 4
    EMISSIVE = 5
    PRINCIPLED = 6  # UsdPreviewSurface, metallic workflow
    PRINCIPLED_SPECULAR = 7  # the same, specular workflow
    METAL = 8  # microfacets of a metal; SPECULAR and EDGE are its reflectance
    BLEND = 9  # two materials, the second weighted by WEIGHT
    TRANSLUCENT = 10  # diffuse reflection and transmission of a sheet
    SUBSURFACE = 11  # diffuse transmission into a body with a medium; AMBIENT is its colour where it is drawn as a surface
    OPENPBR = 12  # slabs of OpenPBR Surface: fuzz over a coat over a metal or a dielectric


class Shading(Kind):
    SMOOTH = 0  # interpolated normals, shaded at the point ("phong")
    GOURAUD = 1  # shaded at vertices, interpolated colours
    FLAT = 2  # the face's normal


class Slot(Kind):
    """Material inputs that take a constant or a texture; the value is the column of Materials.textures."""

    AMBIENT = 0  # k_a, colour; of principled ones occlusion, a number
    DIFFUSE = 1  # k_d, colour
    SPECULAR = 2  # k_s, colour; of metals and the specular workflow the reflectance at normal incidence
    SHININESS = 3  # n, number
    REFLECTION = 4  # k_r, colour (mirror's colour)
    TRANSMISSION = 5  # k_t, colour (glass's colour)
    IOR = 6  # number
    EMISSION = 7  # radiance, colour
    OPACITY = 8  # number; 0 is fully transparent
    ROUGHNESS = 9  # number; its square is the microfacets' α
    METALLIC = 10  # number
    EDGE = 11  # colour: share of Schlick's reflectance at 81.8°
    COAT = 12  # number: weight of a clear coat
    COAT_ROUGHNESS = 13  # number
    NORMAL = 14  # tangent-space normal (u, v, outward); a texture alone
    BUMP = 15  # height in metres; a texture alone
    ABSORPTION = 16  # colour, absorption coefficient of glass per metre; no texture
    PRIORITY = 17  # number: where glass overlaps, the higher priority counts; no texture
    WEIGHT = 18  # number: weight of a blend's second material
    SHEEN = 19  # colour of the sheen of cloth
    SHEEN_ROUGHNESS = 20  # number
    DIFFUSE_TRANSMISSION = 21  # colour: share of the light that leaves a sheet diffusely on the other side
    RADIUS = 22  # number: factor of how far light goes below the surface of a body
    BASE_WEIGHT = 23  # number: factor of the colour of OpenPBR's base; DIFFUSE is that colour, SPECULAR specular_color
    DIFFUSE_ROUGHNESS = 24  # number
    SPECULAR_WEIGHT = 25  # number: factor of the reflectance at normal incidence
    ANISOTROPY = 26  # number: 0 round highlights, 1 lines
    ROTATION = 27  # number: turns from the tangent along u to the long side of the highlight
    COAT_COLOR = 28  # colour
    COAT_IOR = 29  # number
    COAT_ANISOTROPY = 30  # number
    COAT_ROTATION = 31  # number: turns
    COAT_DARKENING = 32  # number
    FUZZ = 33  # number: weight
    FUZZ_COLOR = 34  # colour
    FUZZ_ROUGHNESS = 35  # number
    FILM = 36  # number: weight of a thin film
    FILM_THICKNESS = 37  # number: micrometres
    FILM_IOR = 38  # number
    TRANSMISSION_WEIGHT = 39  # number: share of a dielectric that light passes
    TRANSMISSION_COLOR = 40  # colour: factor of light that passes the surface
    SUBSURFACE_WEIGHT = 41  # number: share of the opaque dielectric that light scatters in
    SUBSURFACE_COLOR = 42  # colour
    THIN_WALLED = 43  # number, 0 or 1; no texture
    DISPERSION = 44  # number: 20 over the Abbe number of glass; 0: one index for all wavelengths; no texture
    SUBSURFACE_ANISOTROPY = 45  # number, −1 to 1; no texture
    FLAKE_SIZE = 46  # number: metres in the geometry's frame; 0: no flakes; no texture
    FLAKE_TILT = 47  # number: as a roughness
    FLAKE_COVERAGE = 48  # number: share of the cells that have a flake
    FLAKE_SEED = 49  # number; no texture
    COAT_NORMAL = 50  # as NORMAL, of the coat alone; without a texture (0, 0, 1): the coat is smooth, 0: its normal is that of the base


SLOTS = len(Slot)
COLOR_SLOTS = frozenset((
    Slot.AMBIENT, Slot.DIFFUSE, Slot.SPECULAR, Slot.REFLECTION, Slot.TRANSMISSION, Slot.EMISSION, Slot.EDGE, Slot.SHEEN,
    Slot.DIFFUSE_TRANSMISSION, Slot.COAT_COLOR, Slot.FUZZ_COLOR, Slot.TRANSMISSION_COLOR, Slot.SUBSURFACE_COLOR,
))  # colours of light or reflectance; AMBIENT of principled materials is a number


class TextureKind(Kind):
    IMAGE = 0
    CHECKER = 1
    STRIPES = 2
    FORMULA = 3  # a tape of the point in the instance's own frame: one result is grey, three are red, green, blue
    VOXELS = 4  # densities of a medium: `slices` pictures below each other, from low to high z; row 0 of each has the lowest y


class TextureMapping(Kind):
    """How a surface point gets texture coordinates. p is the point in the geometry's own frame."""

    UV = 0  # the surface's own coordinates (mesh attribute, or the shape's parametrisation)
    LATLONG = 1  # longitude and latitude of p
    PROJECTED = 2  # u = x/|p|, v = y/|p|
    BOX = 3  # the image on each face of the bounding box, chosen by the normal
    NET = 4  # cube map: one image of an unfolded box, a cross of 4 by 3 cells


class Wrap(Kind):
    REPEAT = 0
    CLAMP = 1
    MIRROR = 2
    BLACK = 3


class LightKind(Kind):
    POINT = 0
    SPOT = 1
    DIRECTIONAL = 2
    SUN = 3
    SKY = 4
    DOME = 5
    AMBIENT = 6
    RECTANGLE = 7
    DISK = 8
    SPHERE = 9


class FalloffKind(Kind):
    INVERSE_SQUARE = 0
    POLYNOMIAL = 1  # 1 / (a + b d + c d²)
    RAMP = 2  # 1 up to a, then linear to 0 at b


class Projection(Kind):
    PERSPECTIVE = 0
    ORTHOGRAPHIC = 1
    PANORAMIC = 2  # equirectangular: longitude across the image, latitude down it


class Fit(Kind):
    """The film extent that stays when the aspect ratios of image and film differ."""

    VERTICAL = 0
    HORIZONTAL = 1


class Visibility(Kind):
    """Bits of Instances.visible."""

    CAMERA = 1  # primary rays
    SHADOW = 2  # blocks light
    REFLECTION = 4  # reflected, refracted and diffuse rays
