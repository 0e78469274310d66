"""Layers that are devices or pipes: they are named and left out, and the rest is drawn."""

import os
from pathlib import Path

import pytest

from ..stages import kinds, load


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_pipes_and_devices_are_not_opened(tmp_path):
    """Opening the pipe would wait for a writer, and reading the device would not end."""
    os.mkfifo(tmp_path / "pipe.usda")
    (tmp_path / "x.usda").write_text(
        '#usda 1.0\n(\n    subLayers = [@pipe.usda@]\n)\ndef "r" (\n    references = @/dev/zero@\n)\n{\n}\ndef Cone "c"\n{\n}\n'
    )
    scene, messages = load(tmp_path / "x.usda", [Path("/dev")])
    assert kinds(scene) == ["CONE"]
    assert "pipe.usda: warning: this layer is not an ordinary file: it is left out" in messages
    assert "/dev/zero: warning: this layer is not an ordinary file: it is left out" in messages
