"""What light a picture leaves out by its plan, in words: its size is measured for the limit on bounces alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...materials import traits
from ...shapes import SHAPES
from .. import ir
from .decision import Plan

SHOWN = 5e-4  # share of light from which words tell that a picture lacks it
_FLAT = [kind for kind, shape in SHAPES.items() if shape.FLAT]


def limit_clause(plan: Plan) -> str:
    """The clause about light beyond the limit on bounces."""
    times = "once" if plan["bounces"] == 1 else f"{plan['bounces']} times"
    return f"light that bounces more than {times} is left out"


def clauses(scene: ir.Scene, plan: Plan) -> tuple[str, ...]:
    """Clauses about light that the plan leaves out whatever the number of samples; none where all light is drawn.

    That of `limit_clause` is first, and not among them where diffuse surfaces send no light on at all.
    """
    tables = scene.tables
    lit = bool((tables.lights.color > 0.0).any()) or bool(traits.emissive(tables)[tables.instances.material].any())
    if not lit or not len(tables.instances.geometry):
        return ()
    used = traits.used(tables)
    diffuse = bool((traits.diffuse(tables) & used).any())
    specular = bool((traits.specular(scene.tables) & used).any())
    alone = len(tables.instances.geometry) == 1 and tables.geometries.kind[tables.instances.geometry[0]] in _FLAT
    texts = []
    if plan["bounces"] > 0 and (specular or plan["interreflection"]):
        texts.append(limit_clause(plan))
    if plan["bounces"] == 0 and specular:
        texts.append("reflections of other objects are left out")
    if diffuse and not plan["interreflection"] and not alone:
        texts.append("light that diffuse surfaces send on is left out")
    if plan["transport"] != "path" and traits.disperses(tables):
        texts.append("the dispersion of glass is left out")
    if plan["transport.caustics"] == "none":
        texts.append("caustics are left out")
    return tuple(texts)


def unmeasured(scene: ir.Scene, plan: Plan, measured: bool) -> tuple[str, ...]:
    """The clauses whose light no figure holds; `measured`: that beyond the limit on bounces is known."""
    return tuple(clause for clause in clauses(scene, plan) if not (measured and clause == limit_clause(plan)))



def with_bias(error: float | None, bias: float | None) -> float | None:
    """The √relMSE of a picture, from that of its noise and the share of light that it lacks, None where this is unknown."""
    return error if error is None or bias is None else math.hypot(error, max(bias, 0.0))


def phrase(error: float | None, bias: float | None, left_out: Sequence[str], bounces: int) -> str:
    """The words after a picture's `with_bias`: what of it is noise, and what light is left out; "" where noise is all."""
    parts = "" if error is None or bias is None or bias < SHOWN else f"{error:.2%} of noise, {bias:.1%} of light beyond {bounces} bounces"
    if not left_out:
        return parts
    rest = "; ".join(left_out)
    return f"{parts}; {rest}" if parts else f"of noise alone; {rest}"
