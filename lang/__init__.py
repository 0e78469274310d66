"""The scene language: text to syntax tree to elements with checked units. Imports no numpy, reads no files.

May import: Nothing of ours.
Begin with `syntax/parser.py`.
"""
