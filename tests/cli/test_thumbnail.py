"""The `thumbnail` command: pictures of a folder's assets, what is kept, the index and failures."""

import json
import multiprocessing
import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.commands import thumbnail
from maquette.cli.main import cli
from maquette.render.image import image_reader

CUBE = '#usda 1.0\ndef Cube "c" {\n}\ndef Volume "t" {\n}\n'
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def assets(tmp_path: Path) -> Path:
    folder = tmp_path / "assets"
    (folder / "sub").mkdir(parents=True)
    (folder / "cube.usda").write_text(CUBE)
    (folder / "sub" / "flat.obj").write_text(TRIANGLE)
    (folder / "bad.obj").write_text("nothing\n")
    (folder / "notes.txt").write_text("no asset")
    return folder


def run(*words):
    done = CliRunner().invoke(cli, ["thumbnail", *map(str, words), "--size", "24", "--jobs", "1", "--json"])
    return done.exit_code, json.loads(done.stdout)


def test_thumbnails_of_a_folder(assets, tmp_path):
    out = tmp_path / "thumbs"
    code, made = run(assets, "-o", out)
    assert code == 1  # bad.obj
    assert [row["name"] for row in made] == ["bad.obj", "cube.usda", "sub/flat.obj"]
    assert [row["error"] for row in made] == ["this is not an OBJ file: it has neither vertices nor faces", "", ""]
    assert (made[1]["instances"], made[2]["triangles"]) == (1, 1)
    (warning,) = made[1]["warnings"]
    assert warning.startswith(f"{assets}/cube.usda</t>: Volume is not drawn: write its grid as an array")
    picture = image_reader.read(out / "cube.usda.png").channels["rgba"]
    assert picture.shape == (24, 24, 4)
    covered = picture[..., 3] > 0.5
    assert 0.3 < covered.mean() < 0.9  # it fills the picture, and not all of it
    sides = np.unique(picture[covered][:, 0].round(2))
    assert len(sides) >= 3  # three sides of the cube, differently lit
    page = (out / "index.html").read_text()
    assert '<img src="sub/flat.obj.png"' in page
    assert "Volume is not drawn" in page
    assert "neither vertices nor faces" in page


def test_what_is_up_to_date_is_kept(assets, tmp_path):
    out = tmp_path / "thumbs"
    (assets / "bad.obj").unlink()
    assert run(assets, "-o", out)[0] == 0
    before = (out / "cube.usda.png").stat().st_mtime_ns
    code, made = run(assets, "-o", out)
    assert (code, [one["skipped"] for one in made]) == (0, [True, True])
    assert (out / "cube.usda.png").stat().st_mtime_ns == before
    os.utime(assets / "cube.usda", (1, 1))
    assert [one["skipped"] for one in run(assets, "-o", out)[1]] == [False, True]
    assert [one["skipped"] for one in run(assets, "-o", out, "--force")[1]] == [False, False]
    (out / "thumbnails.json").write_text("damaged")
    assert [one["skipped"] for one in run(assets, "-o", out)[1]] == [False, False]


def test_names_are_unique_and_escaped(tmp_path):
    one = thumbnail.Thumbnail("<b>.obj", "x/<b>.obj", "<b>.obj.png", (8, 8), warnings=["a & b"])
    page = thumbnail.index_page([one])
    assert "<b>.obj" not in page.replace("<b>&lt;", "")
    assert "a &amp; b" in page


def test_an_empty_folder_is_an_empty_index(tmp_path):
    (tmp_path / "none").mkdir()
    assert run(tmp_path / "none", "-o", tmp_path / "out") == (0, [])
    assert "0 assets" in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.skipif(not hasattr(signal, "SIGSEGV") or os.name != "posix", reason="processes end otherwise here")
def test_a_crash_is_that_of_one_asset(assets, tmp_path):
    """Each process is ended while it starts: each asset has the message, and the index is written."""
    ended = threading.Event()

    def crash() -> None:
        while not ended.is_set():
            for process in multiprocessing.active_children():
                if process.pid:
                    os.kill(process.pid, signal.SIGSEGV)
            ended.wait(0.01)

    killer = threading.Thread(target=crash)
    killer.start()
    try:
        words = ["thumbnail", str(assets), "-o", str(tmp_path / "thumbs"), "--size", "24", "--jobs", "2", "--json"]
        done = CliRunner().invoke(cli, words)
    finally:
        ended.set()
        killer.join()
    assert done.exit_code == 1
    message = "the process that drew it crashed, which is a bug in maquette: `maquette render {}` tells what to send"
    files = [assets / "bad.obj", assets / "cube.usda", assets / "sub" / "flat.obj"]
    assert [one["error"] for one in json.loads(done.stdout)] == [message.format(file) for file in files]
    assert (tmp_path / "thumbs" / "index.html").is_file()
