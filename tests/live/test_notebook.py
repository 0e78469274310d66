"""The widget of notebooks, through its messages and its representation in a notebook's JSON."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.live import notebook

from . import windows
from .windows import SCENE, until

pytest.importorskip("anywidget", reason="anywidget is not installed: pip install maquette-render[notebook]")


class Front:
    """The notebook's side of a widget: takes messages and answers as widget.js does."""

    def __init__(self, scene: Path, **settings: Any) -> None:
        self.last: dict[str, dict[str, Any]] = {}
        self.pictures: list[tuple[dict[str, Any], np.ndarray]] = []
        self.widget = maquette.show(scene, **settings)
        self.widget.send = self.take  # type: ignore[method-assign]
        self.say({"type": "hello", "boot": None})

    def say(self, message: dict[str, Any]) -> None:
        self.widget._handle_custom_msg(message, [])

    def take(self, message: dict[str, Any], buffers: list[bytes] | None = None) -> None:
        if message["type"] == "picture":
            assert buffers is not None
            about = message["about"]
            self.pictures.append((about, np.frombuffer(buffers[0], np.uint8).reshape(about["height"], about["width"], 4)))
            self.say({"type": "shown"})
        self.last[message["type"]] = message

    def finished(self, after: int = 0) -> np.ndarray:
        until(lambda: bool(self.pictures) and self.pictures[-1][0]["finished"] and self.pictures[-1][0]["version"] > after)
        return self.pictures[-1][1]

    @property
    def version(self) -> int:
        return self.pictures[-1][0]["version"]


@pytest.mark.long
def test_a_widget_shows_edits_params_and_errors(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    front = Front(scene, size=(40, 30))
    try:
        picture = front.finished()
        assert picture.shape == (30, 40, 4)
        assert picture[15, 20, 0] > 20 > picture[15, 20, 1]
        assert [item["name"] for item in front.last["params"]["items"]] == ["radius"]
        before = front.version
        front.say({"type": "change", "state": {"sets": {"radius": "0.2"}}})
        assert (front.finished(before)[15, 12] == picture[0, 0]).all()
        before = front.version
        scene.write_text(SCENE.replace("#203040", "#00ff00"), encoding="utf-8")
        assert front.finished(before)[0, 0].tolist() == [0, 255, 0, 255]
        scene.write_text("sphre(1)\n", encoding="utf-8")
        until(lambda: front.last["diagnostics"]["failed"])
        assert "did you mean `sphere`?" in front.last["diagnostics"]["items"][0]["text"]
    finally:
        front.widget.close()


def test_the_json_of_a_notebook_has_the_widget_and_a_picture(tmp_path: Path) -> None:
    front = Front(windows.write(tmp_path))
    try:
        front.finished()
        made = front.widget._repr_mimebundle_()
        data = made[0] if isinstance(made, tuple) else made
        cell = {"output_type": "display_data", "data": data, "metadata": {}}
        read = json.loads(json.dumps(cell))["data"]
        view = read["application/vnd.jupyter.widget-view+json"]
        assert view["model_id"] == front.widget.model_id
        assert read["image/png"].startswith("iVBORw0KGgo")
        state = front.widget.get_state()
        assert "class Picture" in state["_esm"]
        assert "export default" in state["_esm"]
    finally:
        front.widget.close()


def test_in_a_notebook_messages_come_in_its_loop(tmp_path: Path) -> None:
    async def cell() -> int:
        front = Front(windows.write(tmp_path))
        for _ in range(400):
            await asyncio.sleep(0.05)
            if front.pictures and front.pictures[-1][0]["finished"]:
                break
        front.widget.close()
        return len(front.pictures)

    assert asyncio.run(cell()) > 0


def test_a_file_that_is_missing(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"there is no file .*b\.scene"):
        maquette.show(tmp_path / "b.scene")


@pytest.mark.long
def test_without_anywidget_the_fix_is_named() -> None:
    code = (
        "import sys; sys.modules['anywidget'] = None\nimport maquette\n"
        "try: maquette.show('a.scene')\nexcept ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout == "the widget of notebooks needs anywidget: pip install maquette-render[notebook]\n", done.stderr


@pytest.mark.long
@pytest.mark.skipif(shutil.which("node") is None, reason="no node: the script of the widget is not parsed")
def test_the_script_is_one_module(tmp_path: Path) -> None:
    file = tmp_path / "widget.mjs"
    file.write_text(notebook.module(), encoding="utf-8")
    subprocess.run(["node", "--check", str(file)], check=True, timeout=60)
