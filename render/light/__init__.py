"""Lights and emitters: sampling, pdf, light tree, environment map.

May import: lights, render.image, sampling, surface, compiler.plan.
Begin with `emitters.py`.
"""
