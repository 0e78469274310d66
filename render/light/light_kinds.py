"""Tests of kinds of lights in lanes, and the share of their emission by the angle from their axis: generated from lights/."""

from __future__ import annotations

from typing import Any

from ...lights import AMBIENT, DISKS, DISTANT, LIGHTS, PICTURED, POINTS, PROFILED, RECTANGLES, SKIES, SOFT, SPHERES, SUNS, SURFACES
from ..jit.kernel import helper
from ..lanes import ops


def _test(name: str, kinds: tuple[int, ...]) -> Any:
    """A helper: whether a kind is one of these."""
    scope: dict[str, Any] = {}
    exec(f"def {name}(kind):\n    return {' | '.join(f'(kind == {kind})' for kind in kinds) or 'kind < 0'}", scope)
    return helper(scope[name])


is_point, is_distant, is_surface = _test("is_point", POINTS), _test("is_distant", DISTANT), _test("is_surface", SURFACES)
is_rectangle, is_disk, is_sphere = _test("is_rectangle", RECTANGLES), _test("is_disk", DISKS), _test("is_sphere", SPHERES)
is_sun, is_sky, is_ambient = _test("is_sun", SUNS), _test("is_sky", SKIES), _test("is_ambient", AMBIENT)
is_pictured, is_profiled, is_soft = _test("is_pictured", PICTURED), _test("is_profiled", PROFILED), _test("is_soft", SOFT)


def _make_profile() -> Any:
    lines = ["def any_profile(lights, kind, row, cosine):", "share = 1.0 + 0.0 * cosine"]
    scope: dict[str, Any] = {"ops": ops}
    for kind in PROFILED:
        scope[f"profile_{kind}"] = LIGHTS[kind].profile
        lines += [
            f"own = kind == {kind}", "if ops.any_lane(own):",
            f"    share = ops.where(own, profile_{kind}(lights, row, cosine), share)",
        ]  # fmt: skip
    exec("\n    ".join([*lines, "return share"]), scope)
    return helper(scope["any_profile"])


profile = _make_profile()
"""(lights, kind, row, cosine): the share of a light's emission at an angle from its axis; 1 for kinds without a profile."""
