"""Renders on a Dask cluster: its workers draw tiles or whole frames, and the client adds up their samples.

Messages are bytes: JSON and arrays. May import: render.render_scene and what that may. Begin with `draw.py`; `worker.py` runs on workers.
"""
