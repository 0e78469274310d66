"""Text to syntax tree to elements with checked units. Knows no arrays, reads no disk."""
