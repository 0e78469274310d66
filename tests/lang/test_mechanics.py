"""Machine elements and measured materials of the library, against their definitions and published values."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from .test_stdlib import evaluated, material


def gear_profile(call: str) -> np.ndarray:
    """(n, 2) points of the profile of a gear, in metres."""
    (element,) = evaluated(f'unit mm\nuse "std/mechanics"\nmechanics.{call}').elements
    return np.array(element.args["profile"])


@pytest.mark.parametrize(("teeth", "module", "pressure"), [(18, 2, 20), (40, 1, 20), (25, 3, 14.5), (60, 2, 25)])
def test_flanks_of_a_gear_are_involutes_of_its_base_circle(teeth: int, module: float, pressure: float) -> None:
    """A tangent of the base circle to a point of the flank is as long as the arc that has been unwound (ISO 21771)."""
    points = gear_profile(f"gear({teeth}, {module}, pressure: {pressure}deg)") * 1000
    alpha = math.radians(pressure)
    pitch = module * teeth / 2
    base = pitch * math.cos(alpha)
    assert len(points) == 12 * teeth
    for tooth in range(teeth):
        for side, flank in ((-1, points[12 * tooth + 1 : 12 * tooth + 6]), (1, points[12 * tooth + 6 : 12 * tooth + 11])):
            radius, angle = np.hypot(*flank.T), np.arctan2(flank[:, 1], flank[:, 0]) - 2 * math.pi * tooth / teeth
            unwound = np.sqrt(np.maximum(radius**2 - base**2, 0)) / base - np.arccos(np.minimum(base / radius, 1))
            start = (side * angle + unwound + math.pi) % (2 * math.pi) - math.pi  # of the involute, from the middle of the tooth
            on_pitch = math.pi / (2 * teeth)  # half a tooth: as wide as a gap
            assert start == pytest.approx(on_pitch + math.tan(alpha) - alpha, abs=1e-7)


def test_a_gear_has_the_diameters_of_the_standard() -> None:
    radius = np.hypot(*(gear_profile("gear(30, 2)") * 1000).T)
    assert radius.max() == pytest.approx(30 + 2)
    assert radius.min() == pytest.approx(30 - 2.5)


@pytest.mark.parametrize(
    ("size", "pitch", "across", "head", "nut"), [(3, 0.5, 5.5, 2, 2.4), (8, 1.25, 13, 5.3, 6.8), (20, 2.5, 30, 12.5, 18)]
)
def test_measures_of_screws_are_those_of_the_standards(size: float, pitch: float, across: float, head: float, nut: float) -> None:
    for column, wanted in enumerate((pitch, across, head, nut), 1):
        (ball,) = evaluated(f'use "std/mechanics"\nsphere(mechanics.iso({size}mm, {column}))').elements
        assert ball.args["radius"] == pytest.approx(wanted / 1000)


def thread_mesh(call: str) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    (element,) = evaluated(f'unit mm\nuse "std/mechanics"\nmechanics.{call}').elements
    while element.kind != "mesh":
        (element,) = element.children
    return np.array(element.args["points"]) * 1000, [tuple(int(i) for i in face) for face in element.args["faces"]]


@pytest.mark.long
@pytest.mark.parametrize(("size", "length", "pitch"), [(8, 30, 1.25), (3, 10, 0.5), (10, 7.3, 1.5), (6, 2.2, 1)])
def test_a_thread_is_closed_and_has_the_volume_of_its_profile(size: float, length: float, pitch: float) -> None:
    """Crest P/8 and root P/4 wide, flanks between: the volume of a turn is the integral of pi r^2 (ISO 68-1)."""
    points, faces = thread_mesh(f"thread({size}, {length})")
    edges: dict[tuple[int, int], int] = {}
    volume = 0.0
    for face in faces:
        for a, b in zip(face, (*face[1:], face[0]), strict=True):
            edges[a, b] = edges.get((a, b), 0) + 1
        for b, c in itertools.pairwise(face[1:]):
            volume += float(np.dot(points[face[0]], np.cross(points[b], points[c]))) / 6
    assert all(count == 1 and edges.get((b, a)) == 1 for (a, b), count in edges.items())
    major, minor = size / 2, size / 2 - 0.54127 * pitch
    flank = (major**2 + major * minor + minor**2) / 3
    turn = math.pi * (major**2 / 8 + minor**2 / 4 + flank * 5 / 8)
    polygon = math.sin(2 * math.pi / 40) / (2 * math.pi / 40)
    assert volume == pytest.approx(turn * polygon * length, rel=0.02 * pitch / length * 8)
    heights = points[[i for face in faces for i in face], 1]
    assert (heights.min(), heights.max()) == (pytest.approx(-length / 2), pytest.approx(length / 2))


@pytest.mark.parametrize(
    ("name", "color"),
    [("cobalt", (0.692, 0.703, 0.673)), ("lead", (0.632, 0.626, 0.641)),
     ("mercury", (0.781, 0.779, 0.779)), ("tungsten", (0.504, 0.498, 0.478)),
     ("vanadium", (0.520, 0.532, 0.541)), ("silicon", (0.344, 0.367, 0.419)), ("polished_brass", (0.887, 0.789, 0.434))],
)  # fmt: skip
def test_metals_by_their_indices_have_the_published_reflectance(name: str, color: tuple[float, float, float]) -> None:
    """Reflectances as physicallybased.info publishes them for these indices."""
    (ball,) = evaluated(f'use "std/materials"\nsphere(1, material: materials.{name}())').elements
    assert ball.args["material"].args["color"] == pytest.approx(color, abs=6e-4)


def test_water_absorbs_as_measured() -> None:
    """Pope and Fry 1997: 0.264, 0.0565 and 0.0092 per metre at 610, 550 and 450 nm."""
    (ball,) = evaluated('use "std/materials"\nsphere(1, material: materials.water())').elements
    found = ball.args["material"].args
    absorbed = [-math.log(c) / found["depth"] for c in found["inside"]]
    assert absorbed == pytest.approx([0.264, 0.0565, 0.0092], rel=0.01)
    assert material("glass(ior: 1.333)")["ior"] == found["ior"]
