"""Samples to pixels: tiles, rounds, adaptive sampling, AOVs, denoising.

May import: render.material, camera, formula, image, compiler.plan.
Begin with `film.py`.
"""
