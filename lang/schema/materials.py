"""The schema's materials."""

from __future__ import annotations

from .argument_types import REQUIRED, Arg, Entry

METALS = ("gold", "silver", "copper", "aluminium", "iron", "steel", "titanium", "chromium", "chrome", "nickel")

_SHADING = Arg(
    "shading",
    "choice",
    "phong",
    "where light is computed: at every point with smooth normals, at vertices, or with the face's normal",
    choices=("phong", "gouraud", "flat"),
    keyword=True,
)
_OPACITY = (
    Arg(
        "opacity", "number_map", 1.0, "how much of it is there, 0 to 1; of a picture its alpha, or its first channel where it has none",
        minimum=0.0, maximum=1.0, keyword=True,
    ),
    Arg(
        "opacity_threshold", "number", 0.0, "above 0: it is there where its opacity is at least this, and elsewhere not at all",
        minimum=0.0, maximum=1.0, keyword=True,
    ),
)  # fmt: skip
_SURFACE = (
    *_OPACITY,
    Arg(
        "normal_map", "texture", None, "turns its normals: red along u, green along v, blue outwards, from −1 to 1 as 0 to 255 (OpenGL's)",
        keyword=True,
    ),
    Arg("normal_strength", "number", None, "of the normal map; 1 when not given", minimum=0.0, keyword=True),
    Arg("bump_map", "texture", None, "turns its normals as if it were so high", keyword=True),
    Arg("bump_height", "length", None, "how high where the bump map is 1; 1 cm when not given", keyword=True),
)  # fmt: skip
_ROUGHNESS = Arg("roughness", "number_map", 0.5, "0: polished, 1: as rough as can be", minimum=0.0, maximum=1.0, keyword=True)


def _course_material(name: str, lobe: str) -> Entry:
    return Entry(
        name,
        "material",
        f"the course's {lobe}: k_a L_a + Σ I (k_d max(0, N·L) + k_s lobe^n) + k_r reflected + k_t refracted",
        (
            Arg("color", "color_map", (0.8, 0.8, 0.8), "diffuse coefficient k_d", aliases=("k_d", "diffuse")),
            Arg("specular", "color_map", (0.5, 0.5, 0.5), "specular coefficient k_s", aliases=("k_s",)),
            Arg("shininess", "number_map", 32.0, "exponent n of the highlight", minimum=0.0),
            Arg("ambient", "color_map", None, "ambient coefficient k_a; k_d when not given", aliases=("k_a",), keyword=True),
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
    Entry("mirror", "material", "a perfect mirror", (Arg("color", "color_map", (1.0, 1.0, 1.0), "how much it reflects"), *_SURFACE)),
    Entry(
        "glass",
        "material",
        "glass: reflects and refracts by Fresnel's and Snell's laws, polished or rough",
        (
            Arg("color", "color_map", (1.0, 1.0, 1.0), "how much it lets through"),
            Arg("ior", "number_map", 1.5, "index of refraction", above=0.0, keyword=True),
            Arg("roughness", "number_map", 0.0, "0: polished, 1: ground as roughly as can be", minimum=0.0, maximum=1.0, keyword=True),
            Arg("inside", "color", None, "what is left of white light after `depth` inside of it (Beer and Lambert)", keyword=True),
            Arg("depth", "length", None, "see `inside`; 10 cm when not given", above=0.0, keyword=True),
            Arg("priority", "number", 0.0, "where glasses overlap, the one of the higher priority is there", minimum=0.0, keyword=True),
            *_SURFACE,
        ),
    ),
    Entry(
        "emissive",
        "material",
        "shines of its own",
        (
            Arg("color", "color_map", (1.0, 1.0, 1.0), "its colour"),
            Arg("luminance", "luminance", 1.0, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            *_OPACITY,
        ),
    ),
    Entry(
        "principled",
        "material",
        "UsdPreviewSurface: a matt or metallic base, a highlight of microfacets, a clear coat; reflects no more than it gets",
        (
            Arg("color", "color_map", (0.18, 0.18, 0.18), "of the base; of metals, what they reflect", aliases=("diffuse",)),
            Arg("metallic", "number_map", 0.0, "0: matt under a highlight, 1: metal", minimum=0.0, maximum=1.0, keyword=True),
            _ROUGHNESS,
            Arg("ior", "number_map", 1.5, "index of refraction: how strong the highlight of what is no metal is", above=0.0, keyword=True),
            Arg("specular", "color_map", None, "what it reflects along the normal, in place of `ior` and `metallic`", keyword=True),
            Arg("clearcoat", "number_map", 0.0, "how much of a clear coat there is", minimum=0.0, maximum=1.0, keyword=True),
            Arg("clearcoat_roughness", "number_map", 0.01, "of the coat", minimum=0.0, maximum=1.0, keyword=True),
            Arg("occlusion", "number_map", 1.0, "how much of the ambient light reaches it", minimum=0.0, maximum=1.0, keyword=True),
            Arg("emission", "color_map", (0.0, 0.0, 0.0), "colour that it shines in", aliases=("emissive",), keyword=True),
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
            Arg("kind", "choice", REQUIRED, "which; steel is drawn as iron", choices=METALS),
            Arg("roughness", "number_map", 0.1, "0: polished, 1: as rough as can be", minimum=0.0, maximum=1.0, keyword=True),
            Arg("color", "color_map", (1.0, 1.0, 1.0), "multiplies what it reflects", keyword=True),
            *_SURFACE,
            _SHADING,
        ),
        example='sphere(1, material: metal("gold", roughness: 0.2))',
    ),
    Entry(
        "blend",
        "material",
        "two materials, one here and the other there, or both in part",
        (
            Arg("first", "material", REQUIRED, "what is there where the weight is 0"),
            Arg("second", "material", REQUIRED, "what is there where the weight is 1"),
            Arg("weight", "number_map", 0.5, "how much of the second there is", minimum=0.0, maximum=1.0),
            *_OPACITY,
        ),
        example='sphere(1, material: blend(metal("copper"), lambert(#5a9a80), pattern(|x, y, z| smoothstep(-0.2, 0.2, y))))',
    ),
)
