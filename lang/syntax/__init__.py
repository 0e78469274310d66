"""Scene text to syntax tree: lexer, parser, AST, formatter.

May import: lang (diagnostics, units).
Begin with `parser.py`.
"""
