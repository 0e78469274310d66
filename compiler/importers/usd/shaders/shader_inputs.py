"""Tables of surface shaders: for each input of OpenPBR the name and default of the shader's own.

Sources: the definitions of MaterialX 1.39; UsdPreviewSurface Specification 2.6.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .....materials import openpbr

THIN = "geometry_thin_walled"
DEFAULTS: Mapping[str, Any] = {
    **{name: default for name, (_, default, _, _) in openpbr.NUMBERS.items()},
    **{name: (grey,) * 3 for name, (_, grey, _) in openpbr.COLORS.items()},
    "emission_luminance": 0.0, "emission_color": (1.0,) * 3, "geometry_opacity": 1.0, "geometry_normal": None, "geometry_coat_normal": None,
    THIN: False,
    "transmission_depth": 0.0, "transmission_scatter": (0.0,) * 3, "transmission_scatter_anisotropy": 0.0,
    "subsurface_radius": 1.0, "subsurface_radius_scale": (1.0, 0.5, 0.25),
    "subsurface_scatter_anisotropy": 0.0, "transmission_dispersion_scale": 0.0, "transmission_dispersion_abbe_number": 20.0,
}  # fmt: skip
STANDARD = {  # names and defaults of standard_surface
    "base_weight": ("base", 1.0), "base_color": ("base_color", (0.8,) * 3), "base_diffuse_roughness": ("diffuse_roughness", 0.0),
    "base_metalness": ("metalness", 0.0), "specular_weight": ("specular", 1.0), "specular_color": ("specular_color", (1.0,) * 3),
    "specular_roughness": ("specular_roughness", 0.2), "specular_ior": ("specular_IOR", 1.5),
    "specular_roughness_anisotropy": ("specular_anisotropy", 0.0), "specular_rotation": ("specular_rotation", 0.0),
    "coat_weight": ("coat", 0.0), "coat_color": ("coat_color", (1.0,) * 3), "coat_roughness": ("coat_roughness", 0.1),
    "coat_roughness_anisotropy": ("coat_anisotropy", 0.0), "coat_rotation": ("coat_rotation", 0.0), "coat_ior": ("coat_IOR", 1.5),
    "coat_darkening": ("coat_affect_color", 0.0), "fuzz_weight": ("sheen", 0.0), "fuzz_color": ("sheen_color", (1.0,) * 3),
    "fuzz_roughness": ("sheen_roughness", 0.3), "emission_luminance": ("emission", 0.0), "emission_color": ("emission_color", (1.0,) * 3),
    "geometry_opacity": ("opacity", (1.0,) * 3), "geometry_normal": ("normal", None), "geometry_coat_normal": ("coat_normal", None),
    THIN: ("thin_walled", False),
    "transmission_weight": ("transmission", 0.0), "transmission_color": ("transmission_color", (1.0,) * 3),
    "transmission_depth": ("transmission_depth", 0.0), "transmission_scatter": ("transmission_scatter", (0.0,) * 3),
    "transmission_scatter_anisotropy": ("transmission_scatter_anisotropy", 0.0), "subsurface_weight": ("subsurface", 0.0),
    "subsurface_color": ("subsurface_color", (1.0,) * 3), "subsurface_radius": ("subsurface_scale", 1.0),
    "subsurface_radius_scale": ("subsurface_radius", (1.0,) * 3), "subsurface_scatter_anisotropy": ("subsurface_anisotropy", 0.0),
    "thin_film_thickness": ("thin_film_thickness", 0.0), "thin_film_ior": ("thin_film_IOR", 1.5),
    "transmission_dispersion_abbe_number": ("transmission_dispersion", 0.0),
}  # fmt: skip
DISNEY = {
    "base_color": ("baseColor", (0.16,) * 3), "base_metalness": ("metallic", 0.0), "specular_roughness": ("roughness", 0.5),
    "specular_roughness_anisotropy": ("anisotropic", 0.0), "fuzz_weight": ("sheen", 0.0), "coat_weight": ("clearcoat", 0.0),
    "transmission_weight": ("specTrans", 0.0), "subsurface_weight": ("subsurface", 0.0),
    "subsurface_radius_scale": ("subsurfaceDistance", (1.0,) * 3),
}  # fmt: skip
GLTF = {
    "base_color": ("base_color", (1.0,) * 3), "base_metalness": ("metallic", 1.0), "specular_roughness": ("roughness", 1.0),
    "specular_weight": ("specular", 1.0), "specular_color": ("specular_color", (1.0,) * 3), "specular_ior": ("ior", 1.5),
    "specular_roughness_anisotropy": ("anisotropy_strength", 0.0), "specular_rotation": ("anisotropy_rotation", 0.0),
    "coat_weight": ("clearcoat", 0.0), "coat_roughness": ("clearcoat_roughness", 0.0), "fuzz_color": ("sheen_color", (0.0,) * 3),
    "fuzz_roughness": ("sheen_roughness", 0.0), "emission_color": ("emissive", (0.0,) * 3),
    "emission_luminance": ("emissive_strength", 1.0), "geometry_normal": ("normal", None), "transmission_weight": ("transmission", 0.0),
    "geometry_coat_normal": ("clearcoat_normal", None),
    "transmission_color": ("attenuation_color", (1.0,) * 3), "transmission_depth": ("attenuation_distance", 0.0),
    "transmission_dispersion_scale": ("dispersion", 0.0), "thin_film_weight": ("iridescence", 0.0),
    "thin_film_thickness": ("iridescence_thickness", 100.0), "thin_film_ior": ("iridescence_ior", 1.3),
}  # fmt: skip
MORE_THAN_PRINCIPLED = ("transmission", "iridescence", "anisotropy_strength", "specular", "specular_color")
OPEN: Mapping[str, tuple[str, Any]] = {
    name: (name, default) for name, default in DEFAULTS.items() if name not in ("specular_rotation", "coat_rotation")
}
DEPENDENT = {  # inputs that do nothing while another one is 0
    "thin_film": "thin_film_thickness thin_film_weight", "coat": "coat coat_weight", "transmission": "transmission transmission_weight",
    "subsurface": "subsurface subsurface_weight",
}  # fmt: skip
PREVIEW = {
    "base_color": ("diffuseColor", (0.18,) * 3), "base_metalness": ("metallic", 0.0), "specular_roughness": ("roughness", 0.5),
    "specular_ior": ("ior", 1.5), "coat_weight": ("clearcoat", 0.0), "coat_roughness": ("clearcoatRoughness", 0.01),
    "emission_color": ("emissiveColor", (0.0,) * 3), "geometry_opacity": ("opacity", 1.0), "geometry_normal": ("normal", None),
}  # fmt: skip
SHADERS: Mapping[str, Mapping[str, tuple[str, Any]]] = {
    "ND_standard_surface_surfaceshader": STANDARD, "ND_standard_surface_surfaceshader_100": {
        **STANDARD, "base_weight": ("base", 0.8), "base_color": ("base_color", (1.0,) * 3)},
    "arnold:standard_surface": STANDARD, "ND_open_pbr_surface_surfaceshader": OPEN, "ND_disney_principled": DISNEY,
    "ND_gltf_pbr_surfaceshader": GLTF,
}  # fmt: skip

PARTS: Mapping[str, Mapping[str, tuple[str, Any]]] = {
    **SHADERS, "UsdPreviewSurface": PREVIEW, "ND_UsdPreviewSurface_surfaceshader": PREVIEW,
}  # fmt: skip
"""Those and the surface shaders that are slabs only as parts of mixtures."""
EXTRA = {
    "ND_disney_principled": {"specular", "ior", "specularTint", "sheenTint", "clearcoatGloss"},
    "ND_gltf_pbr_surfaceshader": {"alpha", "alpha_mode", "alpha_cutoff", "thickness", "occlusion"},
}
