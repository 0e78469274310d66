"""The scene language: text to syntax tree to elements with checked units. Imports no numpy, reads no files."""
