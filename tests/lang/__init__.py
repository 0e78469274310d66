"""Tests of the language: parsing, evaluation, the library."""
