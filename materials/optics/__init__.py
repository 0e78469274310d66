"""Measured optics: spectra as colours, and complex indices of metals.

May import: compiler.scene. Begin with `spectrum.py`.
"""
