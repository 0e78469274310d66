"""Scene intersection: BVH queries for closest hit, occlusion, transmittance.

May import: render.accel.traverse and below.
Begin with `intersect.py`.
"""
