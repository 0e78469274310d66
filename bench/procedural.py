"""Big procedural scenes: the calls a second of the evaluation, and each stage up to the picture."""

from __future__ import annotations

import functools
import resource
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..compiler import ir
from ..compiler.catalogue import CATALOGUE
from ..compiler.io import source_files
from ..compiler.io.sandbox import Files
from ..compiler.lower import lowering
from ..compiler.plan import plan as planner
from ..compiler.scene import validate
from ..compiler.scene.builder import SceneBuilder
from ..lang import collector
from ..lang.diagnostics import Diagnostics
from ..lang.elements import Document
from ..lang.eval import evaluator
from ..render import render_scene
from ..render.accel import scene_bvh
from . import report
from .harness import OURS, Case, Contender, Effort, Result, measure

SCENES = Path(__file__).resolve().parent / "scenes"
SIDES = {"houses": (20, 316), "spheres": (10, 100)}  # quick, else
CALLS = {"houses": lambda side: 11 * side**2, "spheres": lambda side: side**3}
TEXT = """
`bench/scenes/houses.scene` and `spheres.scene`: 100,000 houses of two boxes, made by part calls in loops, with a material each; a million
spheres. *Evaluation* counts every call of the source: parts, elements, materials and functions. Lowering, validation and the build of the
BVH count instances. The picture is 480 × 320 with 4 samples a pixel and includes its own build.
"""


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure every stage of both scenes."""
    result = report.Section("procedural", "Big procedural scenes", TEXT)
    for name, sides in SIDES.items():
        side = sides[0 if quick else 1]
        results = _stages(name, side, effort)
        result.add(f"{name}, side {side}", results[:1], "Mcalls/s")
        result.add(f"{name}, side {side}: further stages", results[1:], "Minstances/s")
    result.blocks.append(f"Largest memory of the process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB.")
    return result


def _stages(name: str, side: int, effort: Effort) -> list[Result]:
    evaluate = functools.partial(_evaluate, SCENES / f"{name}.scene", side)
    document = evaluate()
    scene = lower(document)
    checked, _ = validate.validate(scene)
    count = len(scene.tables.instances.geometry)
    plan = planner.make_plan(checked, ir.Settings(size=(480, 320), samples=4))
    stages = (
        ("evaluation", evaluate, CALLS[name](side)),
        ("lowering", lambda: lower(document), count),
        ("validation", lambda: validate.validate(scene), count),
        ("BVH", lambda: scene_bvh.build(checked.tables, keep=False), count),
        ("picture", lambda: render_scene.draw(checked, plan), count),
    )
    return [measure(Case(stage, [Contender(OURS, run, lambda drawn: None)], _alone, amount), effort) for stage, run, amount in stages]


@collector.fewer_collections()
def _evaluate(path: Path, side: int) -> Document:
    reader = source_files.SceneReader(Files(path.parent, ()))
    diagnostics = Diagnostics()
    document = evaluator.evaluate(reader.main(path.name, path), CATALOGUE, reader, diagnostics, sets={"side": str(side)})
    diagnostics.raise_if_failed()
    return document


@collector.fewer_collections()
def lower(document: Document) -> ir.Scene:
    """The scene of a document without files."""
    return lowering.lower(document, SceneBuilder())


def _alone(answers: Mapping[str, Any]) -> str:
    return "no peer"
