"""The commands: the module NAME.py holds the click command `command`, and `COMMANDS` in main.py has its row.

May import: every other package.
Begin with `check.py`.
"""
