"""Rasterizer: meshlets, bands, coverage, deferred shading, shadow maps.

May import: render.integrator, render.tessellation, render.texture, render.image.
Begin with `raster_scene.py`, then `band_renderer.py`: fill (`triangle_setup.py`), then shade (`deferred_shading.py`).
"""
