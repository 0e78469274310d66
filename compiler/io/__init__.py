"""File access policy, cache directories, reading of scene files.

May import: lang.
Begin with `sandbox.py`.
"""
