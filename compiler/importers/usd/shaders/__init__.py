"""Shaders of MaterialX in USD: surfaces and nodes, and light that scatters inside or passes.

May import: compiler.importers, materials.
Begin with `materialx.py`.
"""
