"""Benchmarks of maquette against other programs on the same work. `python -m maquette.bench --help`; results in RESULTS.md."""
