"""The `maquette` command: options, printing, exit codes.

May import: Everything below.
Begin with `main.py`.
"""
