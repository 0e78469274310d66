"""The library: *.scene files written in the language itself. No Python code."""
