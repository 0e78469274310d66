"""OpenPBR materials at a point, for tests of their lobes in numpy."""

from __future__ import annotations

import math

import numpy as np
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input
from maquette.materials import openpbr as element
from maquette.render.material import bsdf, principled
from maquette.render.material.shader import Uses, evaluate_shader
from maquette.render.sampling import sobol
from maquette.render.surface import interaction

from .. import tables as make

UP = (0.0, 1.0, 0.0)
USES = Uses(glossy=True, sharp=False, shines=True, ambient=True, sky=True)
_SLOTS = {name: slot for name, (slot, *_) in {**element.NUMBERS, **element.COLORS}.items()}


def given(**arguments):
    """A row by the names of the element's arguments: numbers, greys or colours."""
    inputs = {}
    for name, value in arguments.items():
        red, green, blue = value if isinstance(value, tuple) else (float(value),) * 3
        inputs[_SLOTS.get(name) or ir.Slot[name.upper()]] = Input((red, green, blue))
    return element.data(inputs)


def point_of(material, inside=False):
    """(Surface, Shader) of a plane of a material, seen from above; `inside`: a plane that is turned over."""
    placed = make.matrix(linear=np.diag([1.0, -1.0, -1.0])) if inside else make.matrix()
    tables = principled.tables_for(make.scene([(ir.GeometryKind.PLANE, (), placed, 0)], materials=[material]))
    ray = make.rays((0.3, 1, 0.2), (0, -1, 0))
    point = interaction.make_interaction(tables, ray, make.first_hit(tables, ray))
    return point, evaluate_shader(tables, point)


def towards(angle, turn=0.0):
    return (math.sin(angle) * math.cos(turn), math.cos(angle), math.sin(angle) * math.sin(turn))


def lanes(direction, like):
    return tuple(np.broadcast_to(x, like.shape) for x in direction)


def numbers(n):
    """n·n pairs of Sobol points and a third number each, as columns."""
    pixel, sample = np.zeros(n * n, np.int64), np.arange(n * n)
    u, v = sobol.pair(pixel, sample, np.int64(1), 3)
    return u, v, sobol.pair(pixel, sample, np.int64(2), 3)[0]


def scattered(material, angle, n=90, turn=0.0, random=False, inside=False):
    """BSDF samples to a viewer at an angle, and the shader."""
    point, shader = point_of(material, inside)
    u, v, which = np.random.default_rng(1).random((3, n * n)) if random else numbers(n)
    wide = point._replace(**{k: lanes(getattr(point, k), u) for k in ("geometric", "normal")}, front=np.broadcast_to(point.front, u.shape))
    return bsdf.sample_bsdf(shader, USES, wide, lanes(towards(angle, turn), u), u, v, which), shader


def energy(material, angle, n=120, turn=0.0, inside=False):
    """(share of white light that it sends to a viewer, standard error of as many independent samples)."""
    weight = scattered(material, angle, n, turn, inside=inside)[0].weight[0]
    return float(np.mean(weight)), float(np.std(weight)) / n
