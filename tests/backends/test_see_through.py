"""Light that passes sheets straight: every way to say so, through camera rays and shadow rays, in every backend.

A sheet of opacity a between a light and a floor leaves 1 − a of the light, and as much of what is behind it for the camera.
"""

from __future__ import annotations

import json
from pathlib import Path

import maquette
import numpy as np
import pytest

FLOOR = "plane(y: 0, material: lambert(0.5))\n"
SUN = "directional([0, 1, 0])\n"
ASIDE = "camera(position: [3, 1, 0], look_at: [0, 0, 0], fov: 5deg)\n"  # sees the shadow beside the sheet
ABOVE = "camera(position: [0, 9, 0.01], look_at: [0, 0, 0], fov: 5deg)\n"  # sees the floor through the sheet
SHEET = "v -0.5 1 -0.5\nv -0.5 1 0.5\nv 0.5 1 0.5\nv 0.5 1 -0.5\nusemtl veil\nf 1 2 3 4\n"
POINTS = [(-0.5, 1, -0.5), (-0.5, 1, 0.5), (0.5, 1, 0.5), (0.5, 1, -0.5)]


def light(folder: Path, backend: str, text: str, **settings: object) -> np.ndarray:
    """Linear r, g, b at the middle of a small picture."""
    (folder / "a.scene").write_text(text, encoding="utf-8")
    found = maquette.render(folder / "a.scene", size=(9, 9), samples=settings.pop("samples", 1), backend=backend, **settings)  # type: ignore[arg-type]
    return found.channels["rgba"][4, 4, :3].astype(float)


def of_language(folder: Path, opacity: float) -> str:
    return f"box([1, 0.01, 1], center: [0, 1, 0], material: lambert(0, opacity: {1.0 - (1.0 - opacity) ** 0.5}))\n"  # two faces


def of_mtl(folder: Path, opacity: float) -> str:
    (folder / "a.mtl").write_text(f"newmtl veil\nKd 0 0 0\nd {opacity}\n")
    (folder / "a.obj").write_text("mtllib a.mtl\n" + SHEET)
    return 'mesh("a.obj")\n'


def of_tr(folder: Path, opacity: float) -> str:
    (folder / "a.mtl").write_text(f"newmtl veil\nKd 0 0 0\nTr {1.0 - opacity}\n")
    (folder / "a.obj").write_text("mtllib a.mtl\n" + SHEET)
    return 'mesh("a.obj")\n'


def of_usd(folder: Path, opacity: float, more: str, bound: str) -> str:
    (folder / "a.usda").write_text(f"""#usda 1.0
(
    defaultPrim = "W"
    upAxis = "Y"
)
def Xform "W"
{{
    def Mesh "Sheet" ( prepend apiSchemas = ["MaterialBindingAPI"] )
    {{
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = {POINTS}
        {bound}
    }}
    {more}
}}
""")
    return 'usd("a.usda")\n'


def of_preview(folder: Path, opacity: float, ior: float = 1.0) -> str:
    surface = f"""def Material "M"
    {{
        token outputs:surface.connect = </W/M/P.outputs:surface>
        def Shader "P"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 0, 0)
            float inputs:opacity = {opacity}
            float inputs:ior = {ior}
            token outputs:surface
        }}
    }}"""
    return of_usd(folder, opacity, surface, "rel material:binding = </W/M>")


def of_display(folder: Path, opacity: float) -> str:
    colors = f"color3f[] primvars:displayColor = [(0, 0, 0)]\nfloat[] primvars:displayOpacity = [{opacity}]"
    return of_usd(folder, opacity, "", colors)


def of_gltf(folder: Path, opacity: float, extensions: dict[str, object] | None = None) -> str:
    data = np.array(POINTS, np.float32).tobytes() + np.array([0, 1, 2, 0, 2, 3], np.uint32).tobytes()
    (folder / "a.bin").write_bytes(data)
    surface = {"baseColorFactor": [0, 0, 0, opacity], "metallicFactor": 0.0}
    (folder / "a.gltf").write_text(json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "materials": [{"alphaMode": "BLEND", "doubleSided": True, "pbrMetallicRoughness": surface, "extensions": extensions or {}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-0.5, 1, -0.5], "max": [0.5, 1, 0.5]},
            {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "buffers": [{"uri": "a.bin", "byteLength": 72}],
    }))  # fmt: skip
    return 'mesh("a.gltf")\n'


def of_unlit(folder: Path, opacity: float) -> str:
    return of_gltf(folder, opacity, {"KHR_materials_unlit": {}})


WAYS = {
    "language": of_language, "mtl": of_mtl, "tr": of_tr, "preview": of_preview, "display": of_display, "gltf": of_gltf, "unlit": of_unlit,
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_a_sheet_leaves_one_less_its_opacity(tmp_path: Path, backend: str, way: str) -> None:
    whole = light(tmp_path, backend, FLOOR + SUN + ASIDE)
    for opacity in (0.25, 0.75):
        sheet = WAYS[way](tmp_path, opacity)
        assert light(tmp_path, backend, FLOOR + sheet + SUN + ASIDE) == pytest.approx((1.0 - opacity) * whole, rel=1e-3)
        seen = light(tmp_path, backend, FLOOR + sheet + SUN + ABOVE)  # through the sheet, in its shadow
        highlight = 0.02 if way == "gltf" else 0.0
        assert seen == pytest.approx((1.0 - opacity) ** 2 * whole, rel=1e-3, abs=highlight)


def test_layers_multiply(tmp_path: Path, backend: str) -> None:
    """Five sheets in a row, of which each leaves three quarters."""
    whole = light(tmp_path, backend, FLOOR + SUN + ASIDE)
    sheet = of_mtl(tmp_path, 0.25).strip()
    stack = "".join(f"{sheet[:-1]}, translate: [0, {0.1 * k}, 0])\n" for k in range(5))
    assert light(tmp_path, backend, FLOOR + stack + SUN + ASIDE) == pytest.approx(0.75**5 * whole, rel=1e-3)


def test_a_clear_pane_keeps_its_highlight_and_its_light(tmp_path: Path) -> None:
    """UsdPreviewSurface of opacity 0 and an index of refraction of 1.5 covers what it reflects, a twenty-fifth."""
    whole = light(tmp_path, "ray", FLOOR + SUN + ASIDE)
    pane = of_preview(tmp_path, 0.0, 1.5)
    assert light(tmp_path, "ray", FLOOR + pane + SUN + ASIDE) == pytest.approx(0.96 * whole, rel=1e-3)


def test_a_coloured_filter_tints_what_is_seen_and_darkens_as_its_darkest_colour(tmp_path: Path) -> None:
    whole = light(tmp_path, "ray", FLOOR + SUN + ASIDE)
    sheet = of_mtl(tmp_path, 0.5)
    (tmp_path / "a.mtl").write_text("newmtl veil\nKd 0 0 0\nd 0.5\nTf 1 0.5 0.5\n")
    assert light(tmp_path, "ray", FLOOR + sheet + SUN + ASIDE) == pytest.approx(0.25 * whole, rel=1e-3)
    seen = light(tmp_path, "ray", FLOOR + sheet + SUN + ABOVE)
    assert seen == pytest.approx(0.25 * whole * np.array([0.5, 0.25, 0.25]), rel=1e-3)
