"""BVH builders: binned SAH, wide nodes, refit, the cache of meshes' BVHs.

May import: render.formula and below, compiler.ir.
Begin with `wide_bvh.py`.
"""
