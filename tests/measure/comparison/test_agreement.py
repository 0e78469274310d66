"""The examples on two backends: agreement to a thousandth inside outlines in direct light; features that raster lacks are found."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.measure.comparison import compare, object_errors, sides

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SIZE = (80, 60)
LIMIT = 1e-3
# Pixels inside that may differ by more: where a sample falls within 1/256 pixel of an edge between two facets of a flat-shaded mesh.
FACETS = {"materials.scene": 2}


def both(name: str, samples: int = 4, plan: dict[str, str] | None = None) -> compare.Comparison:
    """An example in direct light, drawn by raster, as `plan` says, and by ray."""
    scene = maquette.load(EXAMPLES / name)
    settings = [ir.Settings(backend=b, size=SIZE, samples=samples, bounces=0) for b in ("raster", "ray")]
    raster, ray = (sides.render(scene, sides.make_plan(scene, a, p)) for a, p in zip(settings, (plan, None), strict=True))
    return compare.compare(raster, ray)


DRAWN_BY_BOTH = (
    "hello.scene", "shapes.scene", "lights.scene", "falloff.scene", "textures.scene", "clipping.scene", "spotlights.scene",
    "materials.scene", "transforms.scene", "pavilion.usda",
)  # fmt: skip


MIRRORED = ("pavilion.usda",)
REFLECTS = "raster draws highlights of lights and the sky only: objects are not reflected"


@pytest.mark.parametrize("name", DRAWN_BY_BOTH)
def test_inside_outlines_raster_and_ray_agree(name: str) -> None:
    # Both at the pixel's centre: of more, the rasterizer has its own places. What mirrors is traced: else the ground's mean light stands
    # for all that lies below the horizon.
    found = both(name, 1, {"raster.secondary_rays": "trace"} if name in MIRRORED else None)
    assert found.a.notes == ()
    assert found.b.notes == ()
    one, other = (object_errors.outline_mask(side) for side in (found.a, found.b))
    assert one is not None
    assert other is not None
    outline = one | other
    assert found.interior is not None
    assert found.interior.pixels == np.count_nonzero(~outline) > 0.2 * found.pixels
    size = np.maximum(np.abs(found.b.rgb).max(axis=2), 1e-3 * np.abs(found.b.rgb).max())
    different = (np.abs(found.a.rgb - found.b.rgb).max(axis=2) > LIMIT * size) & ~outline
    assert np.count_nonzero(different) <= FACETS.get(name, 0), np.argwhere(different)[:10].tolist()
    if name not in FACETS:
        assert found.interior.error <= LIMIT


@pytest.mark.parametrize("name", ["refraction.scene", "reflection.scene"])
def test_the_difference_lies_on_what_raster_does_not_draw(name: str) -> None:
    """Objects whose material has a note carry nearly all of it."""
    found = both(name)
    scene = found.a.scene
    assert scene is not None
    assert found.b.notes == ()
    noted = {note.span for note in found.a.notes}
    materials = scene.tables.instances.material
    places = {scene.spans.get("instances", i) for i in range(len(materials)) if scene.spans.get("materials", int(materials[i])) in noted}
    assert sum(entry.share for entry in found.objects if entry.place in places) > 0.95
    assert found.interior is not None
    assert found.interior.share > 0.5
    assert found.biased is True


@pytest.mark.parametrize("name", MIRRORED)
def test_what_is_not_mirrored_is_told(name: str) -> None:
    assert [note.message for note in both(name, 1).a.notes] == [REFLECTS]
