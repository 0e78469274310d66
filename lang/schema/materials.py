"""The schema's materials."""

from __future__ import annotations

from .argument_types import REQUIRED, Arg, Entry

METALS = ("gold", "silver", "copper", "aluminium", "iron", "steel", "titanium", "chromium", "chrome", "nickel")

_SHADING = Arg(
    "shading",
    "choice",
    "phong",
    "phong: per point with interpolated normals; gouraud: per vertex; flat: with the normal of the face",
    choices=("phong", "gouraud", "flat"),
    keyword=True,
)
_OPACITY = (
    Arg(
        "opacity", "number_map", 1.0, "opacity, 0 to 1; of an image its alpha, or its first channel without alpha",
        minimum=0.0, maximum=1.0, keyword=True,
    ),
    Arg(
        "opacity_threshold", "number", 0.0, "above 0: cutout, opaque where its opacity is at least this, else absent",
        minimum=0.0, maximum=1.0, keyword=True,
    ),
)  # fmt: skip
_SURFACE = (
    *_OPACITY,
    Arg(
        "normal_map", "texture", None, "perturbs its normals: red along u, green along v, blue outwards, 0..255 for −1..1 (as in OpenGL)",
        keyword=True,
    ),
    Arg("normal_strength", "number", None, "strength of the normal map; default 1", minimum=0.0, keyword=True),
    Arg("bump_map", "texture", None, "perturbs its normals as a height field does", keyword=True),
    Arg("bump_height", "length", None, "height where the bump map is 1; default 1 cm", keyword=True),
)  # fmt: skip
_ROUGHNESS = Arg("roughness", "number_map", 0.5, "0: polished, 1: fully rough", minimum=0.0, maximum=1.0, keyword=True)


def _course_material(name: str, lobe: str) -> Entry:
    return Entry(
        name,
        "material",
        f"the course's {lobe}: k_a L_a + Σ I (k_d max(0, N·L) + k_s lobe^n) + k_r reflected + k_t refracted",
        (
            Arg("color", "color_map", (0.8, 0.8, 0.8), "diffuse coefficient k_d", aliases=("k_d", "diffuse")),
            Arg("specular", "color_map", (0.5, 0.5, 0.5), "specular coefficient k_s", aliases=("k_s",)),
            Arg("shininess", "number_map", 32.0, "exponent n of the highlight", minimum=0.0),
            Arg("ambient", "color_map", None, "ambient coefficient k_a; default k_d", aliases=("k_a",), keyword=True),
            Arg("reflection", "color_map", (0.0, 0.0, 0.0), "mirror coefficient k_r", aliases=("k_r",), keyword=True),
            Arg("transmission", "color_map", (0.0, 0.0, 0.0), "refraction coefficient k_t", aliases=("k_t",), keyword=True),
            Arg("ior", "number_map", 1.5, "index of refraction for k_t", above=0.0, keyword=True),
            Arg("normalized", "bool", False, "scales the lobe so that it conserves energy", keyword=True),
            *_SURFACE,
            _SHADING,
        ),
        example=f"sphere(1, material: {name}(#d0402a, specular: 0.4, shininess: 60))",
    )


MATERIALS = (
    Entry(
        "lambert",
        "material",
        "matt: L = ρE/π",
        (Arg("color", "color_map", (0.8, 0.8, 0.8), "albedo ρ"), *_SURFACE, _SHADING),
        example="lambert(#c9c4bb)",
    ),
    _course_material("phong", "Phong model (lobe R·V)"),
    _course_material("blinn_phong", "Blinn-Phong model (lobe N·H)"),
    Entry("mirror", "material", "a perfect mirror", (Arg("color", "color_map", (1.0, 1.0, 1.0), "its reflectance"), *_SURFACE)),
    Entry(
        "glass",
        "material",
        "glass: reflects and refracts by Fresnel's and Snell's laws, polished or rough",
        (
            Arg("color", "color_map", (1.0, 1.0, 1.0), "its transmittance"),
            Arg("ior", "number_map", 1.5, "index of refraction", above=0.0, keyword=True),
            Arg("roughness", "number_map", 0.0, "0: polished, 1: fully rough", minimum=0.0, maximum=1.0, keyword=True),
            Arg("inside", "color", None, "transmittance of the length `depth` inside of it (Beer-Lambert law)", keyword=True),
            Arg("depth", "length", None, "length that `inside` refers to; default 10 cm", above=0.0, keyword=True),
            Arg("priority", "number", 0.0, "where glasses overlap, the one of the highest priority counts", minimum=0.0, keyword=True),
            *_SURFACE,
        ),
    ),
    Entry(
        "emissive",
        "material",
        "emits light",
        (
            Arg("color", "color_map", (1.0, 1.0, 1.0), "its colour"),
            Arg("luminance", "luminance", 1.0, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            *_OPACITY,
        ),
    ),
    Entry(
        "principled",
        "material",
        "UsdPreviewSurface: a diffuse or metallic base, a microfacet specular lobe, a clear coat; conserves energy",
        (
            Arg("color", "color_map", (0.18, 0.18, 0.18), "base colour; of metals, their reflectance", aliases=("diffuse",)),
            Arg("metallic", "number_map", 0.0, "0: dielectric, 1: metal", minimum=0.0, maximum=1.0, keyword=True),
            _ROUGHNESS,
            Arg("ior", "number_map", 1.5, "index of refraction, which sets the reflectance of a dielectric", above=0.0, keyword=True),
            Arg("specular", "color_map", None, "reflectance at normal incidence, in place of `ior` and `metallic`", keyword=True),
            Arg("clearcoat", "number_map", 0.0, "weight of the clear coat", minimum=0.0, maximum=1.0, keyword=True),
            Arg("sheen", "color_map", (0.0, 0.0, 0.0), "colour of the sheen of cloth, at grazing angles", keyword=True),
            Arg("sheen_roughness", "number_map", 0.3, "roughness of the sheen", minimum=0.0, maximum=1.0, keyword=True),
            Arg("clearcoat_roughness", "number_map", 0.01, "roughness of the clear coat", minimum=0.0, maximum=1.0, keyword=True),
            Arg("occlusion", "number_map", 1.0, "share of the ambient light that reaches it", minimum=0.0, maximum=1.0, keyword=True),
            Arg("emission", "color_map", (0.0, 0.0, 0.0), "emitted colour", aliases=("emissive",), keyword=True),
            Arg("luminance", "luminance", 1.0, "nit where `emission` is 1", aliases=("radiance",), minimum=0.0, keyword=True),
            *_SURFACE,
            _SHADING,
        ),
        exclusive=(("specular", "metallic"), ("specular", "ior")),
        example="sphere(1, material: principled(#a02818, roughness: 0.4, clearcoat: 1))",
    ),
    Entry(
        "metal",
        "material",
        "a metal by its measured index of refraction, polished or rough",
        (
            Arg("kind", "choice", REQUIRED, "the metal; steel has the values of iron", choices=METALS),
            Arg("roughness", "number_map", 0.1, "0: polished, 1: fully rough", minimum=0.0, maximum=1.0, keyword=True),
            Arg("color", "color_map", (1.0, 1.0, 1.0), "multiplies its reflectance", keyword=True),
            *_SURFACE,
            _SHADING,
        ),
        example='sphere(1, material: metal("gold", roughness: 0.2))',
    ),
    Entry(
        "blend",
        "material",
        "a mix of two materials",
        (
            Arg("first", "material", REQUIRED, "the material at weight 0"),
            Arg("second", "material", REQUIRED, "the material at weight 1"),
            Arg("weight", "number_map", 0.5, "weight of the second material", minimum=0.0, maximum=1.0),
            *_OPACITY,
        ),
        example='sphere(1, material: blend(metal("copper"), lambert(#5a9a80), pattern(|x, y, z| smoothstep(-0.2, 0.2, y))))',
    ),
)
