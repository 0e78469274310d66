"""Blender's Cycles as a peer of the paths benchmark, in a Python of its own.

May import: bench.harness, render.
Begin with `peer.py`; `worker.py` runs in the Python that has bpy.
"""
