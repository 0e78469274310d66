"""A ball of OpenPBR's slabs beside one of `principled`: CPU time of a picture, error of noise, and the time at equal error."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import load_text, render
from ..compiler import ir
from ..measure.errors import Pair
from . import report
from .harness import OURS, Case, Contender, Disagreement, Effort, measure

TEXT = """
A ball under a sky and an area light, on a matt floor, by paths of 8 bounces on one thread. *maquette* is `openpbr` with a partial metal, a
rough diffuse base, lines, a thin film, a coat and fuzz; *principled* has a partial metal, a coat and sheen. The last line has the error of
each against its own picture with 16 times the samples of another seed, and the ratio of times at equal error: the ratio of CPU times times
that of squared errors.
"""
SCENE = """
camera(position: [0, 1.2, -4], look_at: [0, 0.9, 0])
sky()
area(position: [2, 4, -2], look_at: [0, 0.9, 0], size: 1.5, luminance: 9)
plane(y: 0, material: lambert(#808080))
sphere(0.9, center: [0, 0.9, 0], material: {})
"""
COMMON = "rgb(0.7, 0.3, 0.2)"
BALLS = {
    OURS: f"openpbr({COMMON}, specular_roughness: 0.4, base_metalness: 0.3, base_diffuse_roughness: 0.5, coat_weight: 0.5, "
    "coat_roughness: 0.2, fuzz_weight: 0.5, thin_film_weight: 0.5, specular_roughness_anisotropy: 0.5)",
    "principled": f"principled({COMMON}, roughness: 0.4, metallic: 0.3, clearcoat: 0.5, clearcoat_roughness: 0.2, sheen: #808080)",
}
MOST = 1.5  # times the time of `principled` at equal error


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure both balls."""
    result = report.Section("slabs", "Slabs of OpenPBR", TEXT)
    size, samples = ((24, 24), 4) if quick else ((96, 96), 32)
    scenes = {name: load_text(SCENE.format(ball)) for name, ball in BALLS.items()}
    references = {name: _picture(scene, size, 16 * samples, 1) for name, scene in scenes.items()}
    contenders = [
        Contender(name, functools.partial(_picture, scene, size, samples, 0), functools.partial(_error, references[name]))
        for name, scene in scenes.items()
    ]
    measured = measure(Case("a ball with all lobes", contenders, _agree), effort)
    result.add("By CPU time", [measured], "")
    if not measured.refused:
        errors = {c.name: c.read(c.run()) for c in contenders}
        cost = errors[OURS] ** 2 / errors["principled"] ** 2 / measured.ratio("principled")
        result.blocks.append(f"At equal error the slabs take {cost:.2f} times the time; the limit is {MOST}.")
    return result


def _picture(scene: ir.Scene, size: tuple[int, int], samples: int, seed: int) -> NDArray[np.float64]:
    """(height, width, 3) radiance."""
    image = render(scene, size=size, samples=samples, seed=seed, bounces=8, threads=1)
    return np.asarray(image, np.float64)[..., :3]


def _error(reference: NDArray[np.float64], picture: NDArray[np.float64]) -> float:
    return Pair(picture, None, reference, None, 0.0).relmse()


def _agree(errors: Mapping[str, Any]) -> str:
    """Check that both pictures are near their references, and say their errors."""
    if not all(0.0 < error < 1.0 for error in errors.values()):
        raise Disagreement(f"errors against more samples are {errors}")
    return ", ".join(f"√relMSE of {name} {error:.2%}" for name, error in errors.items())
