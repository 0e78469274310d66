"""Renders the IR under a plan to an Image.

May import: lang; of compiler the IR, plan, formulas, meshes and caches.
Begin with `render_scene.py`.
"""
