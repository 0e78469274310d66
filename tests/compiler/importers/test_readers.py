"""Readers: each format has a module with the function that reads it."""

from __future__ import annotations

import importlib

import pytest
from maquette.lang.file_types import READERS, Reader


@pytest.mark.parametrize("reader", [reader for reader in READERS if reader.module], ids=lambda reader: reader.name)
def test_a_reader_has_its_module(reader: Reader) -> None:
    module = importlib.import_module(f"maquette.compiler.importers.{reader.module}")
    assert callable(module.parts)
    assert reader.contents, f"docs/meshes.md says nothing of {reader.name}"


def test_each_ending_has_one_reader() -> None:
    endings = [ending for reader in READERS for ending in reader.endings]
    assert len(set(endings)) == len(endings)
