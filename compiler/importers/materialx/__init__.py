"""Node graphs of MaterialX 1.39: definitions of its library, and graphs compiled to tapes of textures.

May import: compiler.texture_graph.
Begin with `graph.py` and `evaluator.py`.
"""
