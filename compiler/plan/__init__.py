"""Render plan: facts about a scene and decisions drawn from them.

May import: compiler.ir, formula.
Begin with `plan.py`.
"""
