"""Inversion of the colour of a thick body into coefficients, in lanes: its albedo of single scattering, and its mean free path.

A half space of even scattering that light enters and leaves diffusely has the albedo 1 − 2 √(1 − ϖ) ∫ μ H(μ) dμ, with Chandrasekhar's H.
Kulla and Conty 2017, Revisiting Physically Based Shading at Imageworks, fit its inverse; a term for dark colours is added here. The
colour is then kept within 0.3 %. The mean free path over the radius is equation 8 of Chiang, Kutz and Burley 2016, Practical and
Controllable Subsurface Scattering for Production Path Tracing. That paper's albedo loses 5 % of a colour of 0.95.
"""

from __future__ import annotations

from .contract import Lane
from .lanes import helper, ops

LEAST_RADIUS = 1e-9  # metres
DARK, FADES = 0.15, 0.0937  # of the term for dark colours
MOST = 0.99999  # albedo of single scattering of a white body: paths in it end


@helper
def single_albedo(color: Lane) -> Lane:
    """The albedo of single scattering of a thick body of a colour from 0 to 1."""
    root = 4.09712 + 4.20863 * color - ops.sqrt(9.59217 + color * (41.6808 + 17.7126 * color))
    root = ops.clip(root, 0.0, 1.0)
    return ops.clip(1.0 - root * root - DARK * color * ops.exp(-color / FADES), 0.0, MOST)


@helper
def mean_free_path(color: Lane) -> Lane:
    """The mean free path over the radius."""
    beside = color - 0.8
    return 1.9 - color + 3.5 * beside * beside


@helper
def channel(color: Lane, radius: Lane) -> tuple[Lane, Lane]:
    """(extinction, scattering) per metre of a body of a colour and a radius in metres."""
    color = ops.clip(color, 0.0, 1.0)
    extinction = 1.0 / (ops.maximum(radius, LEAST_RADIUS) * mean_free_path(color))
    return extinction, single_albedo(color) * extinction
