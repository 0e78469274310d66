"""Entries of elements: arguments, types, limits, defaults, documentation.

May import: Nothing of ours.
Begin with `elements.py`.
"""
