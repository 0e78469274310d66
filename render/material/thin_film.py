"""Thin films: the reflectance of a boundary under one, in red, green and blue, and OpenPBR's film between coat and base.

Airy's sum of all reflections in the film is a Fourier series of the phase. Each term is integrated over the visible spectrum by Gaussian
fits of the colour matching functions (Belcour and Barla 2017, A Practical Extension to Microfacet Theory for the Modeling of Varying
Iridescence). Both polarizations count, with real indices of refraction. The spectrum is flat, and flat reflectances are grey.

Scenes without films compile nothing of it: the `film` of their Slabs is None, which is a type.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec
from . import dielectric_albedo

TERMS = 3
# Gaussian fits of the colour matching functions, by wave number in 1/µm: height at an integral of 1, centre, width.
_X, _X2, _Y, _Z = (0.8461, 1.6810, 4.3278e-3), (0.1539, 2.2399, 4.5282e-3), (1.0, 1.7953, 9.3046e-3), (1.0, 2.2084, 6.6121e-3)
# XYZ to linear Rec. 709, with rows divided by their sums: a flat spectrum is grey.
_RED, _GREEN = (3.2404542 / 1.2047843, -1.5371385 / 1.2047843, -0.4985314 / 1.2047843), (-0.969266, 1.8760108, 0.041556)
_GREEN = tuple(c / 0.9483008 for c in _GREEN)
_BLUE = (0.0556434 / 0.9088427, -0.2040259 / 0.9088427, 1.0572252 / 0.9088427)
LEAST = 1e-4
LEAST_PASSING = 1e-7


@helper
def _wave(phase: Lane, height: float, centre: float, width: float) -> Lane:
    return height * ops.cos(centre * phase) * ops.exp(-width * phase * phase)


@helper
def _color(phase: Lane) -> Vec:
    """∫ cos(phase · wave number) over the spectrum, in red, green and blue; `phase` is 2 π times a path in µm."""
    x = _wave(phase, _X[0], _X[1], _X[2]) + _wave(phase, _X2[0], _X2[1], _X2[2])
    y, z = _wave(phase, _Y[0], _Y[1], _Y[2]), _wave(phase, _Z[0], _Z[1], _Z[2])
    return (
        _RED[0] * x + _RED[1] * y + _RED[2] * z, _GREEN[0] * x + _GREEN[1] * y + _GREEN[2] * z, _BLUE[0] * x + _BLUE[1] * y + _BLUE[2] * z
    )  # fmt: skip


@helper
def reflectance(cosine: Lane, film: Lane, thickness: Lane, base: Vec) -> Vec:
    """Reflectance at a cosine of a base under a film, both by their indices relative to the outside, at least 1; thickness in µm."""
    sine = ops.maximum(1.0 - cosine * cosine, 0.0)
    inside = ops.sqrt(ops.maximum(1.0 - sine / (film * film), LEAST))
    path = (4.0 * math.pi) * film * thickness * inside
    unity, two, three = _color(path), _color(2.0 * path), _color(3.0 * path)
    along, across = (film * cosine - inside) / (film * cosine + inside), (cosine - film * inside) / (cosine + film * inside)
    return (
        _channel((inside, along, across), film, base[0], sine, (unity[0], two[0], three[0])),
        _channel((inside, along, across), film, base[1], sine, (unity[1], two[1], three[1])),
        _channel((inside, along, across), film, base[2], sine, (unity[2], two[2], three[2])),
    )  # fmt: skip


@helper
def _channel(first: Vec, film: Lane, base: Lane, sine: Lane, waves: Vec) -> Lane:
    """One channel: `first` has the cosine in the film and both amplitudes of its upper boundary."""
    inside, along, across = first
    bent = ops.sqrt(ops.maximum(1.0 - sine / (base * base), LEAST))
    lower_along = (base * inside - film * bent) / (base * inside + film * bent)
    lower_across = (film * inside - base * bent) / (film * inside + base * bent)
    return ops.clip(0.5 * (_sum(along, lower_along, waves) + _sum(across, lower_across, waves)), 0.0, 1.0)


@helper
def _sum(upper: Lane, lower: Lane, waves: Vec) -> Lane:
    """Airy's series of one polarization, from the amplitudes of both boundaries."""
    top, bottom = upper * upper, lower * lower
    passed, loop = 1.0 - top, -upper * lower
    back = passed * passed * bottom / (1.0 - top * bottom)
    return top + back + 2.0 * (back - passed) * loop * (waves[0] + loop * (waves[1] + loop * waves[2]))


# --- the film of slabs -------------------------------------------------------------------------------------------------


class Film(NamedTuple):
    """A thin film between the coat and the base."""

    weight: Lane
    thickness: Lane  # micrometres
    ratio: Lane  # index of refraction relative to what lies over it
    f0: Vec  # √ of the metal's reflectance at normal incidence, below 1


@helper
def _filmed(film: Film, bare: Vec, slabs: Any, cosine: Lane, metal: Vec) -> Vec:
    """The reflectance of the base's facets with a film of a weight."""
    plain = _film_over_dielectric(film, slabs, cosine)
    glossy, f0 = reflectance(cosine, film.ratio, film.thickness, _indices(film.f0)), slabs.color
    fifth = ops.power(ops.maximum(1.0 - cosine, 0.0), 5.0)
    share, tint = slabs.metal * slabs.gleam, slabs.tint
    both = (
        share * glossy[0] * _edge(metal[0], f0[0], fifth) + (1.0 - slabs.metal) * plain[0] * tint[0],
        share * glossy[1] * _edge(metal[1], f0[1], fifth) + (1.0 - slabs.metal) * plain[1] * tint[1],
        share * glossy[2] * _edge(metal[2], f0[2], fifth) + (1.0 - slabs.metal) * plain[2] * tint[2],
    )  # fmt: skip
    return ops.lerp3(bare, both, film.weight)


@helper
def _edge(metal: Lane, f0: Lane, fifth: Lane) -> Lane:
    """What the tint of a metal leaves of Schlick's reflectance."""
    return ops.minimum(metal / ops.maximum(f0 + (1.0 - f0) * fifth, 1e-4), 1.0)


@helper
def _indices(root: Vec) -> Vec:
    """The real index of refraction with a reflectance of root² at normal incidence."""
    return (1.0 + root[0]) / (1.0 - root[0]), (1.0 + root[1]) / (1.0 - root[1]), (1.0 + root[2]) / (1.0 - root[2])


@helper
def _film_over_dielectric(film: Film, slabs: Any, cosine: Lane) -> Vec:
    return reflectance(cosine, film.ratio, film.thickness, _indices((slabs.step, slabs.step, slabs.step)))


@helper
def _film_lets_through(film: Film, plain: Any, slabs: Any, cosine: Lane, alpha: Lane, base: Lane) -> Vec:
    """What passes a film of rough facets to a diffuse base, over 1 − R: the film's reflectance at a middle angle scales R."""
    middle = cosine + 0.5 * alpha * (1.0 - cosine)
    bare = ops.maximum(dielectric_albedo.reflectance(middle, slabs.step), 1e-3)
    tinted = _film_over_dielectric(film, slabs, middle)
    scale, over = ops.maximum(base, 1e-3) / bare, 1.0 / ops.maximum(1.0 - base, LEAST_PASSING)
    return (
        _let_through(tinted[0] * scale, base, over, film.weight), _let_through(tinted[1] * scale, base, over, film.weight),
        _let_through(tinted[2] * scale, base, over, film.weight),
    )  # fmt: skip


@helper
def _let_through(reflected: Lane, base: Lane, over: Lane, weight: Lane) -> Lane:
    """A channel of the share that passes; exactly 1 without a film, as in scenes without films."""
    return ops.where(weight > 0.0, ops.maximum(1.0 - ops.lerp(base, reflected, weight), 0.0) * over, 1.0)


reflected = specialize_if_present(_filmed)  # film, the reflectance without it, slabs, cosine, the metal's reflectance
lets_through = specialize_if_present(_film_lets_through)  # film, None, slabs, cosine, α, R: `Seen.passes`


@helper
def _least_of(passes: Vec, light: Vec, other: Vec) -> Vec:
    least = ops.minimum(passes[0], other[0]), ops.minimum(passes[1], other[1]), ops.minimum(passes[2], other[2])
    return ops.mul(light, least)


@helper
def _rest_under_film(film: Film, rest: Vec, slabs: Any, cosine: Lane) -> Vec:
    """What facets let through under a film."""
    reflected = _film_over_dielectric(film, slabs, cosine)
    return ops.lerp3(rest, (1.0 - reflected[0], 1.0 - reflected[1], 1.0 - reflected[2]), film.weight)


rest = specialize_if_present(_rest_under_film)  # film, 1 − F, slabs, cosine
past = specialize_if_present(_least_of)  # what passes by one direction, light below, what passes by the other
