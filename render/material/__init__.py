"""BSDFs and participating media: evaluate, sample, pdf.

May import: render.sampling, surface, light, compiler.plan.
Begin with `bsdf.py`.
"""
