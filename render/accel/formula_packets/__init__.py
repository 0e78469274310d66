"""Packets of camera and shadow rays against implicit surfaces.

May import: render.accel, camera, light, formula.
Begin with `camera_rays.py`.
"""
