"""File watching for `maquette watch`."""
