"""Rasterizer: meshlets, bands, coverage, deferred shading, shadow maps.

May import: render.integrator, tessellation, texture, image.
Begin with `band_renderer.py`.
"""
