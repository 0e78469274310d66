"""Shells round the stages: watching files."""
