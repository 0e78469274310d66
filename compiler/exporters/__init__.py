"""Writes a scene as files of other programs.

May import: compiler.ir, scene, plan.
Begin with `common.py`.
"""
