"""Thin film of OpenPBR: the reflectance and the transmittance of a film between coat and base, in red, green and blue.

Scenes without films compile nothing of it: the `film` of their Slabs is None, which is a type.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec
from . import dielectric_albedo, thin_film

LEAST = 1e-7


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
    glossy, f0 = thin_film.reflectance(cosine, film.ratio, film.thickness, _indices(film.f0)), slabs.color
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
    return thin_film.reflectance(cosine, film.ratio, film.thickness, _indices((slabs.step, slabs.step, slabs.step)))


@helper
def _film_lets_through(film: Film, plain: Any, slabs: Any, cosine: Lane, alpha: Lane, base: Lane) -> Vec:
    """What passes a film of rough facets to a diffuse base, over 1 − R: the film's reflectance at a middle angle scales R."""
    middle = cosine + 0.5 * alpha * (1.0 - cosine)
    bare = ops.maximum(dielectric_albedo.reflectance(middle, slabs.step), 1e-3)
    tinted = _film_over_dielectric(film, slabs, middle)
    scale, over = ops.maximum(base, 1e-3) / bare, 1.0 / ops.maximum(1.0 - base, LEAST)
    return (
        _let_through(tinted[0] * scale, base, over, film.weight), _let_through(tinted[1] * scale, base, over, film.weight),
        _let_through(tinted[2] * scale, base, over, film.weight),
    )  # fmt: skip


@helper
def _let_through(reflected: Lane, base: Lane, over: Lane, weight: Lane) -> Lane:
    return ops.maximum(1.0 - ops.lerp(base, reflected, weight), 0.0) * over


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
