"""Scene text to syntax tree with Lark: grammar, parser, recovery after errors, AST, formatter.

May import: lang (diagnostics, units).
Begin with `parser.py`.
"""
