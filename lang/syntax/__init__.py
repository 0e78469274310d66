"""Scene text to syntax tree: lexer, parser, AST, formatter.

May import: lang's ground (diagnostics, limits).
Begin with `parser.py`.
"""
