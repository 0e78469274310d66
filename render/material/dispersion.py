"""Dispersion of glass: an index of refraction by wavelength, and one wavelength for each path.

Paths carry red, green and blue. At the first dispersive boundary that bends a path, it takes one wavelength for the rest of its way, and
its throughput is multiplied by the response of red, green and blue at this wavelength over its density. The mean of this factor is 1, so
that white light that is not split stays white. The response is that of the CIE 1931 observer under D65, in the working
space; it has negative parts, as pure colours lie outside of it. Wavelengths are drawn in proportion to the sum of its absolute values.
Indices follow Cauchy's equation with two terms, n = A + B / λ², by the index at 587.56 nm and the Abbe number. A sample of a pixel has one
wavelength, and the samples of a pixel are stratified. Pharr, Jakob, Humphreys 2023, Physically Based Rendering, §4.5 and §9.3.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...lang import color_spaces
from ...materials import glass, traits
from ...materials.optics import spectrum
from ..jit.kernel import helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops, row_gather
from ..sampling import sobol
from ..simd.registration import overload
from ..types import Lane, Surface, Tables, Vec
from . import rough_dielectric

CELLS = 256  # of the spectrum, equally likely
NUMBER = (1 << 18) + 7  # dimension of the random number that chooses the wavelength of a path

F64 = NDArray[np.float64]


class NoDispersion(NamedTuple):
    """A scene without dispersive glass, or a transport that does not draw it."""


class Dispersion(NamedTuple):
    """The dispersive glass of a scene."""

    of: F64  # (materials,) change of n over n − 1 by 1 / λ², µm²
    around: F64  # (media + 1,) likewise, by the number of a medium
    spectrum: F64  # (CELLS + 1, 4) response of red, green, blue over the density; 1 / λ² − 1 / λ_d² at the start of a cell, 1 / µm²


class Component(NamedTuple):
    """The wavelength of paths."""

    shift: Lane  # 1 / λ² − 1 / λ_d²
    response: Vec  # of red, green, blue, over the density of the wavelength


def tables_of(tables: ir.Tables, media: Any, space: str = "rec709", always: bool = False) -> Dispersion | NoDispersion:
    """The dispersive glass of a scene with these medium_stack.Media or Air, for paths in a working space.

    With `always`, scenes without any have tables that change no index.
    """
    if not always and not traits.disperses(tables):
        return NoDispersion()
    of = np.where(traits.dispersive(tables), glass.slope(tables.materials.values[:, ir.Slot.DISPERSION, 0]), 0.0)
    around = np.zeros(len(media.index) if media else 1)
    if media:
        np.maximum.at(around, media.number, np.where(media.number > 0, of, 0.0))
    return Dispersion(of, around, cells(space))


@cache
def cells(space: str = "rec709") -> F64:
    """(CELLS + 1, 4) equally likely parts of the spectrum, see Dispersion, in a working space. The mean of each response is 1."""
    waves = np.arange(spectrum.FIRST, spectrum.LAST + 0.01, 0.25)  # nm
    response = np.array(color_spaces.matrix(color_spaces.REC709, color_spaces.WORKING[space])) @ spectrum.response(waves)
    weight = np.abs(response).sum(axis=0)
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (weight[1:] + weight[:-1]))])
    edges = np.interp(np.linspace(0.0, summed[-1], CELLS + 1), summed, waves)
    parts = np.concatenate([np.zeros((3, 1)), np.cumsum(0.5 * (response[:, 1:] + response[:, :-1]), axis=1)], axis=1)
    share = np.array([np.diff(np.interp(edges, waves, row)) / row[-1] for row in parts]).T * CELLS
    rows = np.zeros((CELLS + 1, 4))
    rows[:CELLS, :3], rows[:, 3] = share, (edges * 1e-3) ** -2 - glass.LINES[1] ** -2
    return rows


def of(tables: Tables) -> Any:
    """The Dispersion of a scene; None without any."""
    return getattr(tables.materials, "dispersion", None) or None


@overload(of)
def _of_in_kernels(tables):
    record = tables.field("materials.dispersion") if isinstance(tables, HandleType) else None
    if record is not None and record[1] != ():
        return lambda tables: tables.materials.dispersion
    return lambda tables: None


@helper
def _undivided(table: Dispersion, plain: Any, like: Lane) -> Lane:
    return 0.0 * like


@helper
def _of_sample(table: Dispersion, plain: Any, pixel: Lane, sample: Lane, seed: int) -> Component:
    number = sobol.pair(pixel, sample, ops.int_like(pixel, NUMBER), seed)[0]
    at = number * CELLS
    cell = ops.minimum(ops.floor_int(at), CELLS - 1)
    red, green, blue, start = row_gather.four_at(table.spectrum, cell)
    end = row_gather.four_at(table.spectrum, cell + 1)[3]
    return Component(ops.lerp(start, end, at - ops.to_float(cell)), (red, green, blue))


@helper
def _index(component: Component, plain: Lane, tables: Tables, surface: Surface) -> Lane:
    table: Any = tables.materials.dispersion  # pyright: ignore[reportAttributeAccessIssue]
    return plain + (plain - 1.0) * component.shift * table.of[surface.material]


@helper
def _index_of_medium(component: Component, plain: Lane, tables: Tables, number: Lane) -> Lane:
    table: Any = tables.materials.dispersion  # pyright: ignore[reportAttributeAccessIssue]
    return plain + (plain - 1.0) * component.shift * table.around[number]


@helper
def _divide(component: Component, plain: tuple[Vec, Lane], tables: Tables, surface: Surface, bent: Lane) -> tuple[Vec, Lane]:
    table: Any = tables.materials.dispersion  # pyright: ignore[reportAttributeAccessIssue]
    throughput, divided = plain
    chosen = bent & (divided < 0.5) & (table.of[surface.material] > 0.0)
    return ops.where3(chosen, ops.mul(throughput, component.response), throughput), ops.where(chosen, 1.0, divided)


@helper
def _divide_before(
    component: Component, plain: tuple[Vec, Lane], tables: Tables, surface: Surface, shader: Any, hit: Lane
) -> tuple[Vec, Lane]:  # fmt: skip
    rough = rough_dielectric.or_rough(shader.frost, ops.bool_like(plain[1], False))
    return _divide(component, plain, tables, surface, hit & (rough | ops.not_(surface.front)))


@helper
def _divide_after(
    component: Component, plain: tuple[Vec, Lane], tables: Tables, surface: Surface, direction: Vec, hit: Lane
) -> tuple[Vec, Lane]:  # fmt: skip
    return _divide(component, plain, tables, surface, hit & (ops.dot(direction, surface.geometric) < 0.0))


@helper
def _keep(divided: Lane, plain: Any, before: Lane, passes: Lane) -> Lane:
    return ops.where(passes, before, divided)


@helper
def _marked(table: Dispersion, plain: Any, marks: Lane) -> Lane:
    return ops.where(marks, 1.0, 0.0)


@helper
def _mark(divided: Lane, plain: Lane, mark: int) -> Lane:
    return plain | ops.where(divided > 0.5, mark, 0)


undivided = specialize_if_present(_undivided)
"""(Dispersion, None, lanes): 0, of paths without a wavelength; None in scenes without dispersion."""
of_sample = specialize_if_present(_of_sample)
"""(Dispersion, None, pixel, sample, seed): the wavelength of a path, the Component at all of its surfaces."""
index = specialize_if_present(_index)
"""(Component, index at the line d, tables, surface): the index inside of a surface's glass at this wavelength."""
index_of_medium = specialize_if_present(_index_of_medium)
"""(Component, index at the line d, tables, number): likewise of a medium."""
divide_before = specialize_if_present(_divide_before)
"""(Component, (throughput, divided), tables, surface, shader, hit): both, of paths that arrive at rough glass, or at glass from inside."""
divide_after = specialize_if_present(_divide_after)
"""(Component, (throughput, divided), tables, surface, direction, hit): both, of paths that leave a surface; refracted ones are divided."""
marked = specialize_if_present(_marked)
"""(Dispersion, None, mask): 1 where the mask holds; None in scenes without dispersion."""
mark = specialize_if_present(_mark)
"""(divided, flags, flag): the flags, with this one where a wavelength is chosen."""
keep = specialize_if_present(_keep)
"""(divided, None, that before, mask): that before where the mask holds."""
