"""Charts of error against time: settings, runs, the reference, bias and noise, the Pareto front.

May import: measure, measure.peers, and the renderer.
Begin with `engine.py`.
"""
