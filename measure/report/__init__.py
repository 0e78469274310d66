"""Output of a measured chart: SVG and PNG, HTML, terminal text, JSON.

May import: measure.
Begin with `plot.py`.
"""
