"""The live window against hostile pages and files: each message has an answer, and the window goes on drawing."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import pytest

from . import windows
from .windows import SCENE, client, served

TOO_MANY = "more than 1,000 errors"


def test_long_and_wrong_messages_are_refused(tmp_path: Path) -> None:
    with served(windows.write(tmp_path)) as shown, client(shown) as page:
        page.finished()
        long = "x" * 1_000_000
        for text in (
            long,
            '{"type": "' + long + '"}',
            "[" * 1_000_000,
            '{"type": "pick"',
            '{"type": "change", "state": {"' + long + '": 1}}',
        ):
            page.last.pop("refused", None)
            page.socket.send(text)
            page.wait(lambda: "refused" in page.last)
            assert len(page.last["refused"]["message"]) < 1000
        assert "text" in page.ask("camera", "camera")


@pytest.mark.long
def test_a_scene_of_many_errors_is_told_and_mended(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        scene.write_text("".join(f"sphere(name{i})\n" for i in range(100_000)), encoding="utf-8")
        page.wait(lambda: any(TOO_MANY in text for text in page.errors()), 120.0)
        started = time.monotonic()
        page.ask("camera", "camera")
        assert time.monotonic() - started < 10.0
        version = page.version
        scene.write_text(SCENE, encoding="utf-8")
        page.finished(version, 60.0)


@pytest.mark.long
def test_a_scene_that_becomes_a_link_a_folder_a_pipe_or_nothing(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    (tmp_path / "linked.scene").write_text(SCENE.replace("#203040", "#304020"), encoding="utf-8")
    with served(scene) as shown, client(shown) as page:
        page.finished()

        def put(make: object) -> None:
            scene.rmdir() if scene.is_dir() and not scene.is_symlink() else scene.unlink(missing_ok=True)
            make()  # type: ignore[operator]

        for make in (
            scene.mkdir, lambda: os.mkfifo(scene), lambda: scene.symlink_to("/dev/zero"), lambda: scene.symlink_to(scene), lambda: None,
        ):  # fmt: skip
            page.last.pop("diagnostics", None)
            put(make)
            page.wait(page.errors, 30.0)
            page.ask("camera", "camera")
            version = page.version
            put(lambda: scene.write_text(SCENE, encoding="utf-8"))
            page.finished(version, 30.0)
        version = page.version
        put(lambda: scene.symlink_to(tmp_path / "linked.scene"))
        page.finished(version, 30.0)


@pytest.mark.long
def test_a_scene_that_is_made_again_fifty_times_a_second_in_two_windows(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as first, served(scene) as second, client(first) as page, client(second) as beside:
        for window in (page, beside):
            window.finished()
        for k in range(100):
            scene.unlink()
            scene.write_text(SCENE.replace("#203040", f"#2030{k:02d}"), encoding="utf-8")
            time.sleep(0.02)
        shutil.copy(scene, tmp_path / "copy.scene")
        scene.write_text(SCENE.replace("#203040", "#ff0000"), encoding="utf-8")
        for window in (page, beside):
            window.wait(lambda window=window: window.pixels[0, 0, 0] > 200 and window.pixels[0, 0, 1] < 50, 60.0)
            assert not window.errors()
            window.ask("camera", "camera")


@pytest.mark.long
@pytest.mark.parametrize("size", [(1, 1), (16000, 16000)])
def test_the_least_and_a_huge_picture(tmp_path: Path, size: tuple[int, int]) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        version = page.version
        scene.write_text(SCENE.replace("[32, 24]", f"[{size[0]}, {size[1]}]"), encoding="utf-8")
        page.wait(lambda: page.version > version or page.errors(), 60.0)
        page.ask("camera", "camera")
        scene.write_text(SCENE, encoding="utf-8")
        page.wait(lambda: page.pixels.shape[:2] == (24, 32), 60.0)
