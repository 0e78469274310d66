"""State of rays and paths: records that integrators pass between their stages, random numbers, and flights through media.

May import: render.material, render.accel and what these import. Begin with `path_state.py`.
"""
