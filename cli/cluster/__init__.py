"""The option --cluster: pictures and frames of `render` on a Dask cluster.

May import: cli and what that may. Begin with `session.py`.
"""
