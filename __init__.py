"""maquette: a scene-description language compiler and renderer. The public door: load, render, compare."""
