"""Auxiliary channels (AOVs) at pixel centers, equal for all backends."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...lang.schema.picture_channels import CHANNELS
from ...materials import traits
from .. import camera
from ..image import image
from ..lanes import affine, ops
from ..sampling import sobol
from ..surface import interaction
from ..surface.material_inputs import color_of
from ..types import Frame, Hit, Lane, Ray, StraightMedia, Surface, Tables, Tile, Vec, View

DIFFUSE = int(ir.Slot.DIFFUSE)
EMISSION = int(ir.Slot.EMISSION)
FORMULA = int(ir.GeometryKind.FORMULA)
CAMERA = int(ir.Visibility.CAMERA)


def pixel_centers(tile: Tile) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the picture coordinates x, y of a tile's pixel centers, row by row."""
    y, x = np.mgrid[tile.y0 : tile.y1, tile.x0 : tile.x1]
    return x.ravel() + 0.5, y.ravel() + 0.5


def sample_rays(tables: ir.Tables, view: View, frame: Frame, tile: Tile, samples: range, total: int) -> Ray:
    """Return the camera rays of samples of each pixel of a tile, at shutter opening, in numpy lanes, sample by sample."""
    y, x = (np.tile(c.ravel(), len(samples)) for c in np.mgrid[tile.y0 : tile.y1, tile.x0 : tile.x1])
    pixel, index = sobol.zorder_index(x, y, np.repeat(samples, len(x) // len(samples)), view.width, frame.order)
    dx, dy = sobol.offset(pixel, index, total, frame.options.seed, frame.filter)
    lens = camera.lens_of(tables, view)
    return camera.generate_ray(tables, view, lens, x + 0.5 + dx, y + 0.5 + dy, pixel, index, frame.options.seed, None)


def channels_of(
    tables: Tables, view: View, ray: Ray, hit: Hit, names: tuple[str, ...], out: dict[str, NDArray[np.float32]],
    issues: NDArray[np.bool_] | None = None, media: Callable[[], StraightMedia] | None = None,
) -> None:  # fmt: skip
    """Write the named channels, (h, w, k) each, of h · w rays and what they hit, as image.WIDTHS describes them.

    All lanes are numpy arrays, row by row. `issues` are computed if they are None. `media` are those on the way, as in FirstHits.
    """
    n = len(hit.t)
    all_rays = ray
    seen = np.flatnonzero(hit.instance >= 0)
    flat = {name: rows[0] for name, rows in image.blank(n, 1, names).items()}
    if len(seen):
        ray = Ray(take_lanes(ray.origin, seen, n), take_lanes(ray.direction, seen, n), 0.0, np.inf)
        with np.errstate(all="ignore"):
            points = VisiblePoints(tables, view, ray, Hit(*(column[seen] for column in hit)), "uv" in names)
            for name in names:
                if value := CHANNELS[name].value:
                    flat[name][seen] = np.stack(np.broadcast_arrays(*value(points)), axis=1)
    if "issues" in names:
        flat["issues"][:, 0] = unproven(tables, all_rays, hit) if issues is None else issues
    if media is not None and {"transmittance", "scatter_depth"} & {*names}:
        _write_media(tables, view, all_rays, media(), flat)
    for name in names:
        out[name][...] = flat[name].reshape(out[name].shape)


def _write_media(tables: Tables, view: View, ray: Ray, media: StraightMedia, flat: dict[str, NDArray[np.float32]]) -> None:
    """Write the channels of media on the way, also of rays that hit nothing."""
    if "transmittance" in flat:
        flat["transmittance"][:] = media.transmittance.T
    if "scatter_depth" in flat:
        start, further = (camera.depth(tables, view, ops.along(ray.origin, ray.direction, t)) for t in (0.0, 1.0))
        scatters = np.isfinite(media.distance)
        flat["scatter_depth"][:, 0] = np.where(scatters, start + np.where(scatters, media.distance, 0.0) * (further - start), np.inf)


def unproven(tables: Tables, ray: Ray, hit: Hit) -> NDArray[np.bool_]:
    """Whether rays, (n,), have an unproven root of a formula before their hit, by formula.numpy_reference."""
    from ..formula import numpy_reference, scene_surfaces

    n = len(hit.t)
    unproved = np.zeros(n, bool)
    kinds = tables.geometries.kind[tables.instances.geometry]
    t_min, t_max = np.broadcast_to(ray.t_min, n), np.minimum(np.broadcast_to(ray.t_max, n), hit.t)
    for i in np.flatnonzero((kinds == FORMULA) & (tables.instances.visible & CAMERA != 0)):
        g, row = int(tables.instances.geometry[i]), tables.instances.transform[i]
        o = affine.transform_point(tables.transforms.inverse, row, ray.origin)
        d = affine.transform_vector(tables.transforms.inverse, row, ray.direction)
        bounds, parameters = tables.geometries.bounds[g], tables.geometries.parameters[g]
        unproved |= numpy_reference.first_hit(scene_surfaces.tape_of(tables, g), parameters, bounds, o, d, t_min, t_max)[4]
    return unproved


class VisiblePoints:
    """Points that camera rays hit first, in numpy lanes: what the rows of picture_channels.CHANNELS read. Vectors are three lanes."""

    def __init__(self, tables: Tables, view: View, ray: Ray, hit: Hit, textured: bool) -> None:
        self._tables, self._view, self._ray, self._hit, self._textured = tables, view, ray, hit, textured

    @cached_property
    def surface(self) -> Surface:
        """The surface at each point; its `uv` are unknown unless the channel `uv` is asked for."""
        return interaction.make_interaction(self._tables, self._ray, self._hit, self._textured)

    @property
    def depth(self) -> Lane:
        """Metres along the camera's axis."""
        return camera.depth(self._tables, self._view, self.position)

    @property
    def distance(self) -> Lane:
        """Metres along the ray."""
        return self._hit.t

    @property
    def direction(self) -> Vec:
        """Unit vector along the ray, in world space."""
        return ops.normalize(self._ray.direction)

    @property
    def position(self) -> Vec:
        """Metres in world space."""
        return self.surface.position

    @property
    def normal(self) -> Vec:
        """Shading normal in world space: unit, to the camera's side."""
        return self.surface.normal

    @property
    def albedo(self) -> Vec:
        """Diffuse colour, or the specular colour of metals, mirrors and glass."""
        return _albedo(self._tables, self.surface)

    @property
    def uv(self) -> tuple[Lane, Lane]:
        """Texture coordinates."""
        surface = self.surface if self._textured else interaction.make_interaction(self._tables, self._ray, self._hit, True)
        return surface.uv

    @property
    def instance(self) -> Lane:
        """Rows of Instances."""
        return self._hit.instance

    @property
    def material(self) -> Lane:
        """Rows of Materials."""
        return self.surface.material

    @property
    def transmittance(self) -> Vec:
        """Ones: without media nothing is lost. `channels_of` replaces them where there are media."""
        ones = 0.0 * self._hit.t + 1.0
        return ones, ones, ones

    @property
    def unproven(self) -> Lane:
        """Zeros, for `channels_of` to replace."""
        return 0.0 * self._hit.t


def _albedo(tables: Tables, surface: Surface) -> Vec:
    """The color of a surface: diffuse, or the specular color of metals, mirrors and glass."""
    slots, color = traits.color_slots(tables)[surface.material], color_of(tables, surface, DIFFUSE)
    for slot in sorted({*slots.ravel().tolist()} - {-1, DIFFUSE, EMISSION}):
        color = ops.where3(slots == slot, color_of(tables, surface, slot), color)
    return ops.mul(color, surface.color)


def take_lanes(v: Vec, rows: NDArray[np.intp], n: int) -> Vec:
    """Return the lanes `rows` of a vector of n lanes."""
    x, y, z = (np.broadcast_to(c, n)[rows] for c in v)
    return x, y, z
