"""Diffuse transmission: Lambert's law for the side that the light does not arrive on (pbrt 4, DiffuseTransmissionBxDF)."""

from __future__ import annotations

import math

from ..compiler import ir
from .contract import Lane, Vec
from .lanes import helper, ops

SLOTS = (ir.Slot.DIFFUSE_TRANSMISSION,)
THROUGH = True


@helper
def value(inputs: tuple[Vec], normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """π f |cos| of light from behind."""
    return ops.scale(inputs[0], ops.maximum(-ops.dot(normal, to_light), 0.0))


@helper
def density(inputs: tuple[Vec], normal: Vec, to_light: Vec, to_viewer: Vec) -> Lane:
    return ops.maximum(-ops.dot(normal, to_light), 0.0) * (1.0 / math.pi)


@helper
def sample(inputs: tuple[Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> Vec:
    a, b = ops.basis(normal)
    radius, turn = ops.sqrt(u), (2.0 * math.pi) * v
    height = ops.sqrt(ops.maximum(1.0 - u, 0.0))
    return ops.in_basis(a, b, normal, radius * ops.cos(turn), radius * ops.sin(turn), -height)


@helper
def albedo(inputs: tuple[Vec], normal: Vec, to_viewer: Vec) -> Vec:
    return inputs[0]
