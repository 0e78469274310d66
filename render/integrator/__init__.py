"""Integrators: Whitted, path tracing, wavefront, photon mapping.

May import: render.accel, material, light, camera, and the state of rays and the photon maps inside.
Begin with `whitted.py`.
"""
