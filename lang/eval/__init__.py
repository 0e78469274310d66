"""Syntax tree to elements with checked units: evaluator, builtins, modules, lint.

May import: lang, lang.syntax, lang.schema.
Begin with `evaluator.py`.
"""
