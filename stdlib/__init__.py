"""The library: *.scene files written in the language itself, and the fonts of `text` (fonts/LICENSE.txt). No Python code."""
