"""Voxels: arrays and pictures of densities against the integral along a ray, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli

VIEWS = {"x": "[9, 0, 0]", "y": "[0, 9, 0.0001]", "z": "[0, 0, 9]"}


def seen(tmp_path: Path, voxels: str, axis: str = "z", inside: str = "box(2, {})", where: str = "[0, 0, 0]") -> np.ndarray:
    text = f"camera(position: {VIEWS[axis]}, look_at: {where}, fov: 0.1deg)\nsky(radiance: 1)\n"
    text += inside.format(f"medium: medium(absorption: [1, 2, 3], density: {voxels})")
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    picture = maquette.load(path).render(size=(4, 4), samples=4096, denoise=False, backend="ray")
    return picture.channels["rgba"].mean(axis=(0, 1))[:3]


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_an_array_is_z_y_x(tmp_path: Path, axis: str) -> None:
    """Densities that grow along one axis: a ray along it meets their mean, a ray across it those of the middle."""
    grows = np.arange(8) / 8 + 1 / 16  # its mean is 1/2
    shape = {"x": (1, 1, 8), "y": (1, 8, 1), "z": (8, 1, 1)}[axis]
    np.save(tmp_path / "a.npy", np.broadcast_to(grows.reshape(shape), (8, 8, 8)))
    assert seen(tmp_path, 'volume("a.npy")', axis) == pytest.approx(np.exp([-1.0, -2.0, -3.0]), abs=8e-3)


def test_low_z_is_first_and_low_y_is_low(tmp_path: Path) -> None:
    voxels = np.zeros((2, 2, 2))
    voxels[0, 0, 1] = 1.0  # low z, low y, high x
    np.save(tmp_path / "a.npy", voxels)
    text = "camera(position: [0.95, -0.95, 9], look_at: [0.95, -0.95, 0], fov: 0.1deg)\nsky(radiance: 1)\n"
    for box, passed in (("box(2, {})", True), ("scale([1, -1, 1]) {{ box(2, {}) }}", False)):
        path = tmp_path / "a.scene"
        path.write_text(text + box.format('medium: medium(absorption: 1, density: volume("a.npy"))'), encoding="utf-8")
        passed_light = maquette.load(path).render(size=(4, 4), samples=1024, denoise=False).channels["rgba"].mean(axis=(0, 1))[0]
        assert (passed_light < math.exp(-0.8)) == passed


def test_a_picture_has_slices(tmp_path: Path) -> None:
    """Its slices lie below each other from low z on, each with its high y at the top."""
    strip = np.zeros((8, 3, 3), np.float32)
    strip[:4] = 1.0  # the first two of four slices: low z
    _write(tmp_path / "a.exr", strip)
    assert seen(tmp_path, 'volume("a.exr", slices: 4)') == pytest.approx(np.exp([-1.0, -2.0, -3.0]), abs=8e-3)


def _write(path: Path, texels: np.ndarray) -> None:
    import OpenImageIO as oiio

    file = oiio.ImageBuf(oiio.ImageSpec(texels.shape[1], texels.shape[0], 3, "float"))
    file.set_pixels(oiio.ROI(), texels)
    assert file.write(str(path)), file.geterror()


REFUSED = {
    'volume("a.npy", slices: 2)': "an array has its own number of slices",
    'volume("b.npy")': "b.npy is an array of float64 with 2 dimensions",
    'volume("c.npy")': "c.npy is no array of numpy",
    'volume("d.npy")': "d.npy has voxels that are infinite or no numbers",
    'volume("e.npy")': "e.npy has densities below 0",
    'volume("smoke.vdb")': ".vdb files are not read",
    'volume("a.exr")': "a.exr is a picture: its number of slices is missing",
    'volume("a.exr", slices: 3)': "a.exr is 8 pixels high, which is no multiple of 3 slices",
    'volume("f.npy")': "f.npy is an array without items",
    'volume("g.npy")': "g.npy is an array of object with 3 dimensions",
    'volume("nowhere.npy")': "there is no file of voxels `nowhere.npy`",
}


@pytest.mark.parametrize("voxels", REFUSED)
def test_what_is_no_density_is_refused(tmp_path: Path, voxels: str) -> None:
    np.save(tmp_path / "a.npy", np.ones((2, 2, 2)))
    np.save(tmp_path / "b.npy", np.ones((2, 2)))
    (tmp_path / "c.npy").write_bytes(b"\x93NUMPY\x01\x00 cut")
    (tmp_path / "smoke.vdb").write_bytes(b"vdb")
    np.save(tmp_path / "d.npy", np.full((2, 2, 2), np.inf))
    np.save(tmp_path / "e.npy", np.full((2, 2, 2), -1))
    np.save(tmp_path / "f.npy", np.ones((2, 0, 2)))
    np.save(tmp_path / "g.npy", np.full((2, 2, 2), None), allow_pickle=True)
    _write(tmp_path / "a.exr", np.zeros((8, 3, 3), np.float32))
    path = tmp_path / "a.scene"
    path.write_text(f"sky()\nbox(2, medium: medium(density: {voxels}))\n", encoding="utf-8")
    result = CliRunner().invoke(cli, ["check", str(path)])
    assert result.exit_code == 1
    assert REFUSED[voxels] in " ".join(result.output.split()), result.output
