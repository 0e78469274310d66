"""Images: channels, files, sRGB, metrics, Cryptomatte.

May import: compiler.ir.
Begin with `image.py`.
"""
