"""BVH traversal: single rays, interleaved rays, packets.

May import: render.geometry, formula, surface, accel.bvh_build.
Begin with `two_level.py`.
"""
