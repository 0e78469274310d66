"""Photon maps of surfaces and media, density estimates from them, and what light of paths they replace. Begin with `photon_map.py`.

May import: render.integrator.state and what that imports. ../photons traces the photons.
"""
