"""File access policy, cache directories, scene file reader.

May import: lang.
Begin with `sandbox.py`.
"""
