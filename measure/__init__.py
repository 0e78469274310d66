"""Instruments over the backends: charts of error against time, comparisons of pictures and scenes."""
