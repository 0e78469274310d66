"""The process of the command: its supervisor, which ends it at a signal and tells of crashes.

May import: `lang`.
"""
