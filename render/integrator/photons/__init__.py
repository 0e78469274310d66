"""Photon tracing: targets, emission and the paths of photons. Begin with `tracer.py`; the maps are in ../photon_maps.

May import: render.integrator and what that imports.
"""
