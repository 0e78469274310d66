"""Instances of USD stages: point instancers, and prototypes of native instances.

May import: compiler.scene, lang.
Begin with `instancers.py`.
"""
