"""The `test` command: scenes with asserts, and pictures that are compared with kept ones.

May import: everything.
"""
