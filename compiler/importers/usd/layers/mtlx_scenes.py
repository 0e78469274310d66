"""A MaterialX document as a scene: a ball for each material, on a grey floor in neutral light."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade, Vt

from .....lang.diagnostics import Diagnostics, Span
from . import mtlx_files

GAP = 2.5  # metres from ball to ball; a ball has a radius of 1
MOST_BALLS = 400
_FLOOR, _TILES = (0.2, 0.35), 40  # reflectances of the floor's tiles, and their number along a side
_DOWN = (12.0, 24.0, 40.0)  # degrees by which the camera looks down on one row, on two or three, on more


def layer(path: Path, diagnostics: Diagnostics) -> Any:
    """A layer that shows the materials of a document; None, with an error, for one without."""
    result = mtlx_files.layer(path, diagnostics)
    stage = Usd.Stage.Open(result) if result is not None else None
    materials = [prim for prim in stage.Traverse() if prim.IsA(UsdShade.Material)] if stage else []
    if stage is None or not materials:
        diagnostics.error(f"`{path.name}` has no material that could be drawn", Span(path.name))
        return None
    if len(materials) > MOST_BALLS:
        diagnostics.warning(f"{len(materials)} materials are too many for a picture: {MOST_BALLS} are drawn", Span(path.name))
    materials = materials[:MOST_BALLS]
    columns = math.ceil(math.sqrt(len(materials) * 1.6)) if len(materials) > 1 else 1
    rows = math.ceil(len(materials) / columns)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for k, prim in enumerate(materials):
        ball = UsdGeom.Sphere.Define(stage, f"/MaterialX/Balls/{prim.GetName()}")
        ball.CreateRadiusAttr(1.0)
        column, row = k % columns, k // columns
        ball.AddTranslateOp().Set(Gf.Vec3d(GAP * (column - 0.5 * (columns - 1)), 1.0, GAP * (row - 0.5 * (rows - 1))))
        UsdShade.MaterialBindingAPI.Apply(ball.GetPrim()).Bind(UsdShade.Material(prim))
    _floor(stage, GAP * max(columns, rows))
    _lights(stage, GAP * max(columns, rows))
    _camera(stage, columns, rows)
    return result


def _floor(stage: Any, size: float) -> None:
    """Squares of two greys, one a metre and more, by which glass and mirrors show what they do."""
    n, side = _TILES, (size + 12.0) / _TILES
    points = [Gf.Vec3f(side * (i - n / 2), 0.0, side * (j - n / 2)) for j in range(n + 1) for i in range(n + 1)]
    corners = [(j * (n + 1) + i, (j + 1) * (n + 1) + i, (j + 1) * (n + 1) + i + 1, j * (n + 1) + i + 1) for j in range(n) for i in range(n)]
    greys = [Gf.Vec3f(_FLOOR[(i + j) % 2]) for j in range(n) for i in range(n)]
    mesh = UsdGeom.Mesh.Define(stage, "/MaterialX/Floor")
    mesh.CreatePointsAttr(Vt.Vec3fArray(points))
    mesh.CreateFaceVertexCountsAttr([4] * len(corners))
    mesh.CreateFaceVertexIndicesAttr([index for corner in corners for index in corner])
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateDisplayColorPrimvar("uniform").Set(Vt.Vec3fArray(greys))


def _lights(stage: Any, size: float) -> None:
    dome = UsdLux.DomeLight.Define(stage, "/MaterialX/Sky")
    dome.CreateIntensityAttr(0.4)
    for name, turn, width, intensity in (("Key", (-45.0, 35.0, 0.0), 4.0, 4.0), ("Fill", (-20.0, -60.0, 0.0), 3.0, 1.5)):
        light = UsdLux.RectLight.Define(stage, f"/MaterialX/{name}")
        light.CreateWidthAttr(width * (0.6 + 0.16 * size))
        light.CreateHeightAttr(width * (0.6 + 0.16 * size))
        light.CreateIntensityAttr(intensity)
        light.AddRotateYOp().Set(turn[1])
        light.AddRotateXOp().Set(turn[0])
        light.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, 4.0 + size))


def _camera(stage: Any, columns: int, rows: int) -> None:
    camera = UsdGeom.Camera.Define(stage, "/MaterialX/main_cam")
    down = math.radians(_DOWN[0] if rows == 1 else _DOWN[1] if rows < 4 else _DOWN[2])
    wide, deep = GAP * (columns - 1) + 2.4, GAP * (rows - 1)
    distance = max(wide * 0.5 / 0.36 + deep * 0.5 * math.cos(down), (2.6 + deep * math.sin(down)) * 0.5 / 0.2)
    camera.CreateFocalLengthAttr(28.0)
    camera.CreateHorizontalApertureAttr(20.955)
    camera.CreateVerticalApertureAttr(20.955 * 9 / 16)
    eye = Gf.Vec3d(0.0, 0.95 + distance * math.sin(down), distance * math.cos(down))
    camera.AddTranslateOp().Set(eye)
    camera.AddRotateXOp().Set(-math.degrees(down))


