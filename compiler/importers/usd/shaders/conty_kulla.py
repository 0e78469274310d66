"""Sheen of Conty and Kulla as fuzz: the roughness and the weight of fuzz whose directional albedo is nearest.

Production Friendly Microfacet Sheen BRDF, 2017: the sheen of standard_surface, gltf_pbr, disney_principled and of sheen_bsdf by default.
The table has the least squares over the disc of a ball, of the fits of both albedos in MaterialX's mx_microfacet_sheen.glsl. The root
of the mean square is 0.055 at a roughness of 0.05, 0.034 at 0.15, and at most 0.012 from 0.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .arithmetic import Arithmetic, numbers

_TABLE = np.array((  # roughness of the sheen; roughness and weight of the fuzz
    (0.02, 0.366, 1.0), (0.047, 0.444, 1.0), (0.1, 0.511, 1.0), (0.15, 0.544, 1.0), (0.2, 0.568, 1.0), (0.3, 0.603, 1.0),
    (0.4, 0.648, 0.94), (0.5, 0.694, 0.87), (0.6, 0.733, 0.82), (0.7, 0.768, 0.79), (0.8, 0.802, 0.75), (0.9, 0.829, 0.73),
    (1.0, 0.857, 0.71),
))  # fmt: skip
_LINE = (0.37, 0.5, 0.82)  # of a roughness that varies: slope and start of that of the fuzz; its weight


def fuzz(rough: Any, weight: Any, arithmetic: Arithmetic, place: Any) -> dict[str, Any]:
    """The inputs `fuzz_roughness` and `fuzz_weight` of OpenPBR for a sheen; of a roughness that varies by a line."""
    value = numbers(rough)
    if value is None:
        slope, start, share = _LINE
        scaled = arithmetic.times(rough, slope, place)
        rough = arithmetic.apply("ND_add_float", start, place, in1=scaled, in2=start)
        return {"fuzz_roughness": rough, "fuzz_weight": arithmetic.times(weight, share, place)}
    near = [float(np.interp(value.mean(), _TABLE[:, 0], column)) for column in _TABLE.T[1:]]
    return {"fuzz_roughness": near[0], "fuzz_weight": arithmetic.times(weight, near[1], place)}


def of_mode(mode: str, rough: Any, weight: Any, arithmetic: Arithmetic, place: Any) -> dict[str, Any]:
    """Those of ND_sheen_bsdf: fuzz itself in the mode `zeltner`."""
    return {"fuzz_roughness": rough, "fuzz_weight": weight} if mode == "zeltner" else fuzz(rough, weight, arithmetic, place)
