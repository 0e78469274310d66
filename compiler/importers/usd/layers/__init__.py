"""Layers of USD before a stage is opened: repair of damaged ones, MaterialX documents as layers, number of prims.

May import: compiler.io, lang.
Begin with `repair.py`.
"""
