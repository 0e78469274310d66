"""Elements, USD and meshes to the IR; the validator; the plan. The IR is defined here.

May import: lang.
Begin with `load.py`.
"""
