"""Scene.to_usd: the stage that `convert` writes, in memory."""

# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.lang.diagnostics import Diagnostics, SceneWarning
from pxr import Usd

SCENE = """let ball = openpbr(#a02818, specular_roughness: 0.2, specular_roughness_anisotropy: 0.5, coat_weight: 1)
sphere(1, material: ball)
box(0.5, translate: [2, 0, 0], material: principled(#404040))
camera([0, 1, 5], look_at: [0, 0, 0])
sun([1, 2, 3], illuminance: 2)
render(size: [32, 16])
"""


def test_the_stage_is_the_one_of_convert(tmp_path: Path) -> None:
    (tmp_path / "a.scene").write_text(SCENE, encoding="utf-8")
    stage = maquette.load(tmp_path / "a.scene").to_usd()
    assert isinstance(stage, Usd.Stage)
    done = CliRunner().invoke(cli, ["convert", str(tmp_path / "a.scene"), str(tmp_path / "a.usda")])
    assert done.exit_code == 0, done.stderr
    assert stage.GetRootLayer().ExportToString() == (tmp_path / "a.usda").read_text(encoding="utf-8")


def test_pictures_are_there(tmp_path: Path) -> None:
    scene = maquette.load_text("plane(y: 0, material: lambert(checker(#ffffff, #000000, size: 1)))\nsphere(1)\nsky()\n", folder=tmp_path)
    messages = Diagnostics()
    for folder in (None, tmp_path):
        stage = scene.to_usd(folder, diagnostics=messages)
        files = [
            attribute.Get().path for prim in stage.Traverse() for attribute in prim.GetAttributes() if attribute.GetName() == "inputs:file"
        ]
        assert files
        assert all(Path(file).is_absolute() and Path(file).is_file() for file in files)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["text.0.png"]
    assert messages.items


def test_losses_are_warnings(tmp_path: Path) -> None:
    scene = maquette.load_text("sphere(1)\nfog(visibility: 10m)\nsky()\n", folder=tmp_path)
    with pytest.warns(SceneWarning, match="fog is not carried"):
        scene.to_usd()


def test_a_folder_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    scene = maquette.load_text("box(1, material: lambert(checker(#ffffff, #000000)))\nsky()\n", folder=tmp_path)
    with pytest.raises(OSError, match="nowhere"):
        scene.to_usd(tmp_path / "nowhere")
