"""Arguments that materials share."""

from __future__ import annotations

from ..lang.schema.argument_types import Arg

SHADING = Arg(
    "shading",
    "choice",
    "phong",
    "phong: per point with interpolated normals; gouraud: per vertex; flat: with the normal of the face",
    choices=("phong", "gouraud", "flat"),
    keyword=True,
)
OPACITY = (
    Arg(
        "opacity", "number_map", 1.0, "opacity, 0 to 1; of an image its alpha, or its first channel without alpha",
        minimum=0.0, maximum=1.0, keyword=True,
    ),
    Arg(
        "opacity_threshold", "number", 0.0, "above 0: cutout, opaque where its opacity is at least this, else absent",
        minimum=0.0, maximum=1.0, keyword=True,
    ),
)  # fmt: skip
SURFACE = (
    *OPACITY,
    Arg(
        "normal_map", "texture", None,
        "perturbs its normals: red along u, green along v, blue outwards, 0..255 for −1..1 (as in OpenGL); or flakes(…)",
        keyword=True,
    ),
    Arg("normal_strength", "number", None, "strength of the normal map; default 1", minimum=0.0, keyword=True),
    Arg("bump_map", "texture", None, "perturbs its normals as a height field does", keyword=True),
    Arg("bump_height", "length", None, "height where the bump map is 1; default 1 cm", keyword=True),
)  # fmt: skip
EMISSION = (
    Arg("emission", "color_map", (0.0, 0.0, 0.0), "emitted colour", keyword=True),
    Arg("luminance", "luminance", 1.0, "nit where `emission` is 1", aliases=("radiance",), minimum=0.0, keyword=True),
)


def roughness(default: float) -> Arg:
    """The roughness of microfacets."""
    return Arg("roughness", "number_map", default, "0: polished, 1: fully rough", minimum=0.0, maximum=1.0, keyword=True)
