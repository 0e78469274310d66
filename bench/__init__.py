"""Benchmarks: maquette beside its peers, on the same work, in one run. `python -m maquette.bench --help`; results in RESULTS.md."""
