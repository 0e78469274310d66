"""The `maquette` command: options, printing, exit codes.

May import: every other package.
Begin with `main.py`.
"""
