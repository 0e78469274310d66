"""Measurements of the backends: charts of error against time, comparisons of pictures and scenes.

May import: lang, compiler, render.
Begin with `records.py`.
"""
