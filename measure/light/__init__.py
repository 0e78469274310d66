"""Light meters: illuminance, luminance, daylight factors, glare and false-colour pictures, each number with its error.

May import: All packages but live and cli, and measure itself.
Begin with `illuminance.py`.
"""
