"""Tests of the USD door, with the help they share in stages.py."""
