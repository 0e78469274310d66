"""Integrators: Whitted, path tracing, wavefront, photon mapping.

May import: render.accel, material, light, camera.
Begin with `whitted.py`.
"""
