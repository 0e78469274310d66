"""Participating media: coefficients and densities, free flight, phase function.

May import: render.texture and what that imports. Begin with `scattering_table.py`.
"""
