"""Thresholds of materials, which the plan, exporters and kernels share."""

from __future__ import annotations

SHARP = 1e-3
"""α, the square of roughness, below which microfacets are a perfect mirror."""
MAX_REFLECTION_ROUGHNESS = 0.3
"""Roughness below which the highlight of a dielectric shows recognizable reflections."""
MAX_REFLECTION_ALPHA = MAX_REFLECTION_ROUGHNESS**2
MAX_CAUSTIC_ROUGHNESS = 0.54
"""Greatest roughness of a metal or glass that casts caustics."""
MAX_CAUSTIC_ALPHA = MAX_CAUSTIC_ROUGHNESS**2
COAT = 0.04
"""Reflectance of a clear coat at normal incidence: index 1.5."""
BRIGHT = 0.1
"""Specular reflectance of Phong lobes, below which path tracing suffices: they have no Fresnel increase."""
PEAK, FAINT_PEAK = 8.0, 200.0
"""Least value of a lobe's peak over that of a diffuse lobe, times 8; of faint lobes."""
LEAST_IOR = 1e-3
"""Indices of refraction are at least this."""
LOWEST = 1.0 / 7.0
"""Cosine, that of 81.8°, at which the reflectance of metals is least, and EDGE counts."""
