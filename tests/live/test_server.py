"""The server: who gets an answer, what pages are told, and what they may change."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import stat
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.live import address, server
from maquette.render.image import image_reader
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from . import windows
from .windows import PART, SCENE, client, served


def get(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", path, headers={"Host": f"127.0.0.1:{port}", **headers})
    answer = connection.getresponse()
    return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()


def test_only_the_right_host_origin_and_token_get_an_answer(tmp_path: Path) -> None:
    with served(windows.write(tmp_path)) as shown:
        port, token = shown.address.port, shown.address.token
        own = f"http://127.0.0.1:{port}"
        status, headers, body = get(port, f"/{token}/")
        assert (status, b"<title>maquette</title>" in body) == (200, True)
        assert "script-src 'self'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert get(port, f"/{token}/app.js", Host=f"localhost:{port}", Origin=f"http://localhost:{port}")[0] == 200
        for path, wrong in (
            ("/", {}), (f"/{token[:-1]}/", {}), (f"/{token}x/app.js", {}), (f"/{token}/", {"Host": "evil.example"}),
            (f"/{token}/", {"Host": f"evil.example:{port}"}), (f"/{token}/", {"Origin": "http://evil.example"}),
            (f"/{token}/app.js", {"Origin": "null"}),
        ):  # fmt: skip
            assert get(port, path, **wrong)[0] == 404, (path, wrong)
        for path in ("../pyproject.toml", "..%2f..%2fpyproject.toml", "%2e%2e/studio.py", "studio.py", "//etc/passwd"):
            assert get(port, f"/{token}/{path}")[0] == 404, path
        socket = f"ws://127.0.0.1:{port}/{token}/socket"
        for url, origin in ((socket, None), (socket, "http://evil.example"), (socket.replace(token, "x"), own)):
            with pytest.raises(InvalidStatus), connect(url, origin=origin):  # type: ignore[arg-type]
                pass


def test_the_server_listens_on_the_loopback_interface_alone(tmp_path: Path) -> None:
    bound, _ = address.listen(tmp_path / "a.scene", None)
    with bound:
        assert bound.getsockname()[0] == "127.0.0.1"


def test_the_address_of_a_scene_stays(tmp_path: Path) -> None:
    scene = tmp_path / "a.scene"
    bound, first = address.listen(scene, None)
    busy, second = address.listen(scene, None)
    bound.close()
    busy.close()
    again, third = address.listen(scene, second.port)
    again.close()
    assert first.token == second.token == third.token
    assert first.port != second.port == third.port
    mode = stat.S_IMODE((tmp_path / "addresses" / "a.scene.json").stat().st_mode)
    assert mode == 0o600 or os.name != "posix"
    assert address.listen(tmp_path / "b.scene", None)[1].token != first.token


def test_a_port_in_use_is_an_error(tmp_path: Path) -> None:
    bound, taken = address.listen(tmp_path / "a.scene", None)
    with bound, pytest.raises(OSError) as caught:
        address.listen(tmp_path / "a.scene", taken.port)
    assert str(caught.value) == f"port {taken.port} of 127.0.0.1 is in use: choose another --port"


def test_a_page_gets_the_picture_and_all_about_it(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        about = page.finished()
        assert (about["full"], about["channel"], about["exposure"], about["metered"]) == ([32, 24], "color", 0.0, False)
        assert page.pixels.shape == (24, 32, 4)
        assert page.center()[0] > 20 > page.center()[1]
        assert page.pixels[0, 0].tolist() == [0x20, 0x30, 0x40, 255]
        page.wait(lambda: page.last.get("progress", {}).get("stage") == "done")
        assert page.last["progress"]["samples"] == 2
        assert page.last["diagnostics"]["failed"] is False
        assert [item["name"] for item in page.last["params"]["items"]] == ["radius"]
        assert [item["name"] for item in page.last["files"]["items"]] == ["a.scene", "part.scene"]
        assert [item["text"] for item in page.last["files"]["items"]] == [SCENE, PART]
        assert page.last["view"]["position"] == pytest.approx([0, 0, 5])
        assert page.last["view"]["look_at"] == pytest.approx([0, 0, 1], abs=0.01)
        assert {row["name"] for row in page.last["plan"]["rows"]} >= {"backend", "samples", "size"}


@pytest.mark.long
def test_the_window_shows_what_render_writes(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        status, headers, data = get(shown.address.port, f"/{shown.address.token}/picture.png")
        assert (status, headers["content-disposition"]) == (200, 'attachment; filename="a.png"')
        (tmp_path / "shown.png").write_bytes(data)
        exr = get(shown.address.port, f"/{shown.address.token}/picture.exr")[2]
        (tmp_path / "shown.exr").write_bytes(exr)
        assert get(shown.address.port, f"/{shown.address.token}/picture.gif")[0] == 404
        current = shown.session.studio.current
        assert current is not None
        assert current.finished is not None
        linear = image_reader.read(tmp_path / "shown.exr").channels["rgba"]
        assert (linear == current.finished.channels["rgba"]).all()
        assert server.encoded(current, "png") == data


@pytest.mark.long
def test_an_unsaved_text_is_drawn_and_a_broken_one_keeps_the_picture(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    part = str(tmp_path / "part.scene")
    with served(scene) as shown, client(shown) as page:
        page.finished()
        page.send("text", path=part, text=PART.replace("#ff0000", "#00ff00"))
        page.finished(page.version)
        assert page.center()[1] > 20 > page.center()[0]
        before = page.pixels.tobytes()
        page.send("text", path=part, text=PART.replace("lambert", "lamber"))
        page.wait(page.errors)
        assert page.errors()[0] == (
            f"{part}:1:45: error: there is no `lamber` here; did you mean `lambert`?\n"
            "   1 | let ball(radius) = sphere(radius, material: lamber(#ff0000))\n"
            "     |                                             ^^^^^^\n"
            f"  in {part}, called at {scene}:1:1"
        )
        assert page.last["diagnostics"]["items"][0]["place"]["path"] == part
        assert page.pixels.tobytes() == before
        version = page.version
        page.send("text", path=part, text=PART)
        page.finished(version)
        assert not page.errors()
        assert page.center()[0] > 20 > page.center()[1]
    assert (tmp_path / "part.scene").read_text(encoding="utf-8") == PART


@pytest.mark.long
def test_saves_of_every_file_are_followed(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    part = tmp_path / "part.scene"
    with served(scene) as shown, client(shown) as page:
        page.finished()
        time.sleep(0.4)
        new = tmp_path / ".part.new"
        new.write_text(PART.replace("#ff0000", "#0000ff"), encoding="utf-8")
        new.replace(part)
        page.wait(lambda: page.center()[2] > 20 > page.center()[0])
        page.wait(lambda: "#0000ff" in page.last["files"]["items"][1]["text"])
        part.unlink()
        page.wait(page.errors)
        assert "there is no scene `part.scene`" in page.errors()[0]
        part.write_text(PART, encoding="utf-8")
        page.wait(lambda: not page.errors() and page.center()[0] > 20)


@pytest.mark.long
def test_a_page_saves_files_of_the_scene_alone(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    other = tmp_path / "other.scene"
    other.write_text("sphere(1)\n", encoding="utf-8")
    with served(scene) as shown, client(shown) as page:
        page.finished()
        for path in (str(other), "/etc/passwd", "part.scene", str(tmp_path / "new.scene"), None, 3):
            refused = page.ask("save", "refused", path=path, text="", saved="")
            known = "that is not a file of the scene" if isinstance(path, str) else "a text to save has a path and a text"
            assert refused["message"] == known
        assert other.read_text(encoding="utf-8") == "sphere(1)\n"
        saved = page.last["files"]["items"][0]["saved"]
        text = SCENE.replace("35deg", "30deg")
        page.send("text", path=str(scene), text=text)
        done = page.ask("save", "saved", path=str(scene), text=text, saved=saved)
        assert scene.read_text(encoding="utf-8") == text
        assert page.ask("save", "conflict", path=str(scene), text=SCENE, saved=saved)["path"] == str(scene)
        assert scene.read_text(encoding="utf-8") == text
        page.ask("save", "saved", path=str(scene), text=SCENE, saved=done["saved"])
        page.ask("save", "saved", path=str(scene), text=text, saved="", force=True)
        assert scene.read_text(encoding="utf-8") == text


@pytest.mark.long
def test_a_saved_text_is_not_drawn_again(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        text = SCENE.replace("35deg", "30deg")
        page.send("text", path=str(scene), text=text)
        page.finished(page.version)
        version = page.version
        page.ask("save", "saved", path=str(scene), text=text, saved=page.last["files"]["items"][0]["saved"])
        time.sleep(0.6)  # the watch of files
        page.ask("pick", "pick", x=0.5, y=0.5)
        assert page.version == version


@pytest.mark.long
def test_values_of_params_are_drawn_and_written_into_the_source(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page, client(shown) as other:
        page.finished()
        corner = page.pixels[12, 4].tolist()
        page.send("change", state={"sets": {"radius": "1.8"}})
        page.finished(page.version)
        assert page.pixels[12, 4].tolist() != corner
        other.wait(lambda: other.last["state"]["state"]["sets"] == {"radius": "1.8"})
        page.ask("write_params", "written")
        assert scene.read_text(encoding="utf-8") == SCENE.replace("radius = 1 in", "radius = 1.8 in")
        other.wait(lambda: other.last["state"]["state"]["sets"] == {})
        other.wait(lambda: "radius = 1.8" in other.last["files"]["items"][0]["text"])


@pytest.mark.long
def test_values_go_into_an_unsaved_text(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        page.send("text", path=str(scene), text="// mine\n" + SCENE)
        page.send("change", state={"sets": {"radius": "0.5"}})
        assert page.ask("write_params", "written")["saved"] is False
        page.wait(lambda: page.last.get("text", {}).get("text") == "// mine\n" + SCENE.replace("= 1 in", "= 0.5 in"))
    assert scene.read_text(encoding="utf-8") == SCENE


@pytest.mark.long
def test_the_camera_moves_and_is_copied_as_source(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        pose = {"position": [5, 0, 0], "look_at": [0, 0, 0], "up": [0, 1, 0]}
        page.send("change", state={"pose": pose})
        page.finished(page.version)
        moved = page.pixels.copy()
        copied = page.ask("camera", "camera")["text"]
        assert copied == "camera(position: [5m, 0m, 0m], look_at: [0m, 0m, 0m], fov: 35deg)"
        page.send("change", state={"pose": None})
        text = SCENE.replace("camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)", copied)
        page.send("text", path=str(scene), text=text)
        page.wait(lambda: page.pictures[-1]["finished"] and (page.pixels == moved).all())


@pytest.mark.long
def test_a_click_names_what_is_there(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        found = page.ask("pick", "pick", x=0.5, y=0.5)
        assert (found["hit"], found["shape"], found["model"]) == (True, "sphere", "lambert")
        assert found["depth"] == pytest.approx(4, abs=0.01)
        assert found["place"]["name"].endswith(("a.scene:3:1", "part.scene:1:20"))
        assert found["material_place"]["path"] == str(tmp_path / "part.scene")
        assert page.ask("pick", "pick", x=0.01, y=0.01)["hit"] is False
        assert page.ask("pick", "refused", x="a", y=0)["message"] == "a click has x and y"


@pytest.mark.long
def test_a_line_outlines_what_it_makes(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    scene.write_text(SCENE + "sphere(0.3,\n  center: [-1, 1, 1])\n", encoding="utf-8")
    with served(scene) as shown, client(shown) as page:
        page.finished()
        found = page.ask("outline", "outline", path=str(scene), line=3)
        assert (found["width"], found["height"], found["names"]) == (32, 24, ["part.ball"])
        mask = np.zeros((24, 32), bool)
        for row, first, count in np.reshape(found["runs"], (-1, 3)):
            mask[row, first : first + count] = True
        ids = shown.session.studio.current.shown.channels["id"][..., 0]  # type: ignore[union-attr]
        ball = ids == ids[12, 16]
        assert mask.any()
        assert not mask[12, 16]
        assert (ball | ~mask).all()
        assert [bool(mask[12, x]) for x in (0, np.flatnonzero(ball[12])[0], 31)] == [False, True, False]
        lines = {line: page.ask("outline", "outline", path=str(scene), line=line)["names"] for line in (1, 4, 7, 8)}
        assert lines == {1: [], 4: [], 7: ["sphere"], 8: ["sphere"]}
        assert page.ask("outline", "refused", path="/etc/passwd", line=1)["message"] == "that is not a file of the scene"
        assert page.ask("outline", "refused", path=str(scene), line="a")["message"] == "an outline has a line"


@pytest.mark.long
@pytest.mark.parametrize("channel", ["depth", "normal", "albedo", "uv", "id", "samples"])
def test_channels(tmp_path: Path, channel: str) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        page.send("change", state={"channel": channel})
        assert page.finished(page.version)["channel"] == channel
        center, corner = page.pixels[12, 16, :3].tolist(), page.pixels[0, 0, :3].tolist()
        if channel == "albedo":
            assert center == [255, 0, 0]
        if channel == "normal":
            assert center == pytest.approx([128, 128, 255], abs=8)
        assert (center == corner) == (channel == "samples")


@pytest.mark.long
def test_exposure_changes_the_picture_without_drawing_it_again(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        version, red = page.version, page.center()[0]
        page.send("change", state={"exposure": 1.0})
        page.wait(lambda: page.pictures[-1]["exposure"] == 1.0)
        assert page.center()[0] > red + 10
        assert page.version == version


def test_what_is_no_message_is_refused(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.socket.send("{")
        page.wait(lambda: page.last.get("refused", {}).get("message", "").startswith("the message is not JSON: Expecting property name"))
        assert page.ask("delete", "refused", path="/")["message"] == "there is no message 'delete'"
        assert page.ask("change", "refused", state={"backend": "gpu"})["message"] == "there is no backend 'gpu'"
        page.socket.send(b"\0")
        page.wait(lambda: page.last["refused"]["message"] == "a message is text, not bytes")


def raw(kind: str, **fields: str) -> str:
    """A message whose fields are written as JSON, or as none."""
    return f'{{"type": "{kind}"' + "".join(f', "{name}": {value}' for name, value in fields.items()) + "}"


HUGE, HALF = "1" + "0" * 400, '"\\ud800"'  # above all floats; half of a surrogate pair
POSE = f'{{"pose": {{"position": [{HUGE}, 0, 0], "look_at": [0, 0, 0], "up": [0, 1, 0]}}}}'
BAD = [
    *("[]", "null", "3", "NaN", '{"type": NaN}', '{"type": []}', '{"type": {}}', "[" * 100_000, '{"type":' * 50_000, "9" * 5000, HALF, ""),
    *(raw("text", path=value, text='""') for value in ("[]", "{}", "null", "3", HUGE, HALF)),
    *(raw("save", path='"x"', text=value) for value in ("[]", "null", "false", HALF)),
    *(raw("pick", x=value, y="0") for value in (HUGE, "-1e999", "Infinity", "true", "[]", '"1"', "null")),
    *(raw("outline", path='"x"', line=value) for value in (HUGE, "-1", "1.5", "true", "[]", "null", "NaN")),
    *(raw("change", state=value) for value in ("[]", "null", "3", f'{{"exposure": {HUGE}}}', '{"moment": 1e999}', POSE)),
    *(raw("change", state=f'{{"{name}": {value}}}') for name in ("pose", "camera", "channel", "sets") for value in ("[]", "3")),
    raw("change", state=f'{{"sets": {{"radius": {HALF}}}}}'),
    *(raw("write_params", names=value) for value in ("3", "{}", '"radius"', "[[]]", "[3]")),
    *(raw("hello", **{name: value}) for name in ("boot", "state", "texts") for value in ("3", "[]")),
]


@pytest.mark.long
def test_each_bad_message_has_an_answer(tmp_path: Path) -> None:
    """The connection stays."""
    with served(windows.write(tmp_path)) as shown, client(shown) as page:
        page.finished()
        for text in BAD:
            page.last.pop("refused", None)
            page.socket.send(text)
            page.wait(lambda: "refused" in page.last)
            assert "internal error" not in page.last["refused"]["message"], text[:80]
        assert page.ask("pick", "pick", x=0.5, y=0.5)["hit"]


@pytest.mark.long
@pytest.mark.parametrize("text", ["{", '{"type": "outline", "path": "x", "line": 1}', '{"type": "camera"}'])
def test_a_flood_leaves_other_messages_their_answer(tmp_path: Path, text: str) -> None:
    with served(windows.write(tmp_path)) as shown, client(shown) as page, client(shown) as other:
        other.finished()
        for _ in range(5000):
            page.socket.send(text)
        assert other.ask("pick", "pick", x=0.5, y=0.5)["hit"]
        assert page.ask("pick", "pick", x=0.5, y=0.5)["hit"]

@pytest.mark.long
def test_a_restarted_server_takes_the_state_of_a_page(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown, client(shown) as page:
        page.finished()
        boot, first = page.last["hello"]["boot"], shown.address
    state = {"sets": {"radius": "1.8"}, "exposure": 2.0, "channel": "color", "later": 1}
    text = SCENE.replace("35deg", "30deg")
    with served(scene) as shown:
        assert shown.address == first
        texts = {str(scene): text, "/etc/passwd": "x", "/etc/other.scene": "x"}
        with client(shown, boot=boot, state=state, texts=texts) as page:
            page.wait(lambda: page.last.get("state", {}).get("state", {}).get("sets") == {"radius": "1.8"})
            assert page.last["state"]["state"]["exposure"] == 2.0
            page.wait(lambda: page.last["files"]["items"][0]["unsaved"] == text)
            assert shown.session.studio.state.texts == {str(scene): text}
            with client(shown, boot=boot, state={"sets": {"radius": "0.3"}}) as late:  # comes second: the state is there
                late.wait(lambda: "state" in late.last)
                assert late.last["state"]["state"]["sets"] == {"radius": "1.8"}
    assert scene.read_text(encoding="utf-8") == SCENE


@pytest.mark.long
def test_a_scene_with_an_animation_has_a_timeline(tmp_path: Path) -> None:
    scene = windows.write(tmp_path)
    ball = "sphere(radius, center: [time / 1s, 0, 0], material: lambert(#ff0000))\nanimate(duration: 4s)"
    moving = SCENE.replace("part.ball(radius)", ball)
    scene.write_text(moving.replace('use "part.scene"\n', ""), encoding="utf-8")
    with served(scene) as shown, client(shown) as page:
        page.finished()
        assert page.last["scene"]["timeline"] == {"first": 0.0, "last": 4.0, "unit": "s", "rate": 1.0}
        assert page.center()[0] > 60
        page.send("change", state={"moment": 4.0})
        page.finished(page.version)
        assert page.center() == [0x20, 0x30, 0x40]


STAGE = """#usda 1.0
( startTimeCode = 1
  endTimeCode = 24
  upAxis = "Y" )
def Sphere "ball" {
    double radius = 1
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 24: (5, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "main" {
    double3 xformOp:translate = (0, 0, 8)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "lamp" {
    double3 xformOp:translate = (2, 4, 6)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


@pytest.mark.long
def test_a_stage_opens_without_a_source_and_moves(tmp_path: Path) -> None:
    stage = tmp_path / "a.usda"
    stage.write_text(STAGE, encoding="utf-8")
    settings = ir.Settings(size=(32, 18), samples=1, backend="reference")
    with served(stage, settings=settings) as shown, client(shown) as page:
        page.finished()
        assert page.last["scene"]["timeline"] == {"first": 1.0, "last": 24.0, "unit": "frame", "rate": 24.0}
        assert page.last["files"]["items"] == []
        assert page.last["params"]["items"] == []
        assert page.ask("pick", "pick", x=0.5, y=0.5)["name"] == "/ball"
        page.send("change", state={"moment": 24.0})
        page.finished(page.version)
        current = shown.session.studio.current
        assert current is not None
        tables = current.scene.tables
        assert tables.transforms.matrix[tables.instances.transform[0], :, 3].tolist() == [5, 0, 0]
        assert page.ask("save", "refused", path=str(stage), text="", saved="")["message"] == "that is not a file of the scene"
    assert stage.read_text(encoding="utf-8") == STAGE


@pytest.mark.long
def test_the_end_does_not_wait_for_a_thumbnail(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    windows.write(folder)
    drawing = threading.Event()

    def thumbnail(_: Path) -> bytes:
        drawing.set()
        time.sleep(8)
        return b""

    with served(folder, thumbnail=thumbnail) as shown:
        port, token = shown.address.port, shown.address.token
        listed = json.loads(get(port, f"/{token}/list.json")[2])
        assert [scene["name"] for scene in listed["scenes"]] == ["a.scene", "part.scene"]
        assert get(port, f"/{token}/thumbnail/0")[0] == 404
        path = f"/{token}/thumbnail/{listed['scenes'][0]['key']}"

        def ask() -> None:
            with contextlib.suppress(OSError, http.client.HTTPException):  # the connection ends with the server
                get(port, path)

        asking = threading.Thread(target=ask)
        asking.start()
        assert drawing.wait(10)
        began = time.monotonic()
    assert time.monotonic() - began < 5
    asking.join()
