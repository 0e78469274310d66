"""Other renderers, run as processes: Mitsuba 3 and POV-Ray.

May import: measure, compiler.exporters, render.tessellation.
Begin with `registry.py`.
"""
