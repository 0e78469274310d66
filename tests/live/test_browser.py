"""The page in a headless Chromium: what a user does, and what the user then sees."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from maquette.bench import chromium as browser
from maquette.bench.chromium import Browser, Tab
from maquette.live.window import Window

from . import windows
from .windows import PART, SCENE, served

pytestmark = pytest.mark.skipif(browser.executable() is None, reason="no Chromium: install one, or name it in MAQUETTE_CHROMIUM")
CANVAS = "document.querySelector('#picture')"
FAILED = "document.querySelector('#stage').classList.contains('failed')"
MODIFIER = 4 if sys.platform == "darwin" else 2


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser.running(tmp_path_factory.mktemp("profile")) as running:
        yield running


def opened(chromium: Browser, url: str) -> Tab:
    """A page that shows a finished picture."""
    tab = chromium.tab(url)
    tab.wait(f"{CANVAS}?.dataset.finished === 'true'", 60)
    return tab


def pixel(tab: Tab, x: float = 0.5, y: float = 0.5) -> list[int]:
    """A pixel of the picture as it is shown; x and y are shares of its sides."""
    at = f"{x} * {CANVAS}.width | 0, {y} * {CANVAS}.height | 0"
    return tab.js(f"[...{CANVAS}.getContext('2d').getImageData({at}, 1, 1).data].slice(0, 3)")


def version(tab: Tab) -> int:
    return int(tab.js(f"{CANVAS}.dataset.version"))


def drawn(tab: Tab, after: int) -> None:
    """Wait for a finished picture of a later version."""
    tab.wait(f"{CANVAS}.dataset.finished === 'true' && +{CANVAS}.dataset.version > {after}")


def text(tab: Tab, selector: str) -> str:
    return tab.js(f"document.querySelector('{selector}').innerText")


def replace_all(tab: Tab, source: str) -> None:
    """Type a text over the whole source."""
    tab.wait("document.querySelector('#code .cm-content')?.innerText.trim()")  # a picture may be shown before the source
    tab.js("document.querySelector('#code .cm-content').focus()")
    tab.wait("document.activeElement === document.querySelector('#code .cm-content')")
    tab.key("a", MODIFIER)
    tab.type(source)


def drag_slider(tab: Tab, shown: Window) -> str:
    """Drag the slider of `radius` to the right; its value, which the server has."""
    tab.drag("[data-name=radius] input[type=range]", 70, 0)
    field = "document.querySelector('[data-name=radius] input[type=number]').value"
    windows.until(lambda: float(tab.js(field)) > 1.5 and shown.session.studio.state.sets == {"radius": tab.js(field)})
    return tab.js(field)


def close(tab: Tab) -> None:
    """Close a page, which had no errors."""
    tab.js("1")
    assert tab.errors == []
    tab.close()


@pytest.mark.long
def test_edit_break_and_mend(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        red = pixel(tab)
        assert red[0] > 20 > red[1]
        before = version(tab)
        replace_all(tab, SCENE.replace("#203040", "#00ff00"))
        drawn(tab, before)
        assert pixel(tab, 0.02, 0.02) == [0, 255, 0]
        replace_all(tab, SCENE + "box(<b>1</b>)\n")
        tab.wait(FAILED)
        assert text(tab, "#messages .first").startswith(f"{scene}:7:")
        assert "^" in text(tab, "#messages pre")
        assert tab.js("document.querySelector('#messages b')") is None  # the source is text, not HTML
        assert pixel(tab, 0.02, 0.02) == [0, 255, 0]
        assert tab.js("document.querySelectorAll('.cm-lint-marker-error').length") > 0
        replace_all(tab, SCENE)
        tab.wait(f"!{FAILED}")
        tab.wait(f"[...{CANVAS}.getContext('2d').getImageData(0, 0, 1, 1).data].join() === '32,48,64,255'")
        assert tab.js("document.querySelector('#messages').childElementCount") == 0
        close(tab)
    assert scene.read_text(encoding="utf-8") == SCENE


@pytest.mark.long
def test_saving_writes_the_file_and_a_save_elsewhere_comes_in(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        before = version(tab)
        changed = SCENE.replace("#203040", "#0000ff")
        replace_all(tab, changed)
        drawn(tab, before)
        assert tab.js("document.querySelector('#tabs .dirty').textContent") == "a.scene"
        tab.key("s", MODIFIER)
        tab.wait("!document.querySelector('#tabs .dirty')")
        assert scene.read_text(encoding="utf-8") == changed
        new = tmp_path / "new"
        new.write_text(SCENE.replace("#203040", "#ffffff"), encoding="utf-8")
        new.replace(scene)  # as many editors save
        tab.wait(f"[...{CANVAS}.getContext('2d').getImageData(0, 0, 1, 1).data].join() === '255,255,255,255'")
        assert "#ffffff" in tab.js("document.querySelector('.cm-content').innerText")
        scene.unlink()
        tab.wait("!document.querySelector('#conflict').hidden")
        assert text(tab, "#conflict-text") == "a.scene is missing on disk. Save writes it again."
        scene.write_text(SCENE, encoding="utf-8")
        tab.wait(f"!{FAILED} && document.querySelector('#conflict').hidden")
        replace_all(tab, changed)
        tab.wait("document.querySelector('#tabs .dirty') !== null")
        scene.write_text(SCENE + "// elsewhere\n", encoding="utf-8")
        tab.wait("!document.querySelector('#conflict').hidden")
        assert text(tab, "#conflict-text") == "a.scene was changed on disk, and here too."
        tab.click("#keep-mine")
        tab.wait("document.querySelector('#conflict').hidden")
        windows.until(lambda: scene.read_text(encoding="utf-8") == changed)
        close(tab)


@pytest.mark.long
def test_a_slider_redraws_and_its_value_is_written(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        assert pixel(tab, 0.8)[0] < 40
        value = drag_slider(tab, shown)
        tab.wait(f"[...{CANVAS}.getContext('2d').getImageData(0.8 * {CANVAS}.width | 0, {CANVAS}.height / 2 | 0, 1, 1).data][0] > 40")
        tab.call("Page.reload")
        tab.wait(f"{CANVAS}?.dataset.finished === 'true'")
        assert tab.wait("document.querySelector('[data-name=radius] input[type=number]')?.value") == value
        tab.click("#write")
        tab.wait(f"document.querySelector('.cm-content').innerText.includes('radius = {value} in')")
        assert scene.read_text(encoding="utf-8") == SCENE.replace("radius = 1 in", f"radius = {value} in")
        tab.wait("document.querySelector('#write').disabled")
        close(tab)


@pytest.mark.long
def test_orbit_pan_zoom_and_click(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        tab.click("#picture")
        tab.wait("!document.querySelector('#picked').hidden")
        about = r"part\.ball luminance [0-9.]+ cd/m² shape sphere material lambert depth 4\.003 m line"
        assert re.match(about, re.sub(r"\s+", " ", text(tab, "#picked")))
        for move in ("orbit", "pan", "zoom"):
            tab.js(f"window.before = {CANVAS}.toDataURL()")
            if move == "zoom":
                tab.wheel("#picture", 240)
            else:
                tab.drag("#picture", 30, 12, modifiers=8 if move == "pan" else 0)
            tab.wait(f"{CANVAS}.dataset.finished === 'true' && {CANVAS}.toDataURL() !== window.before")
        pose = shown.session.studio.state.pose
        assert pose is not None
        assert abs(pose.position[0]) > 0.2
        before = version(tab)
        tab.click("#reset-view")
        drawn(tab, before)
        assert shown.session.studio.state.pose is None
        close(tab)


def test_the_line_of_the_cursor_is_outlined(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    outline = "document.querySelector('#outline')"
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        tab.js("document.querySelector('#code .cm-content').focus()")
        tab.key("Home", MODIFIER)
        assert tab.js(f"{outline}.hidden")
        for _ in range(2):
            tab.key("ArrowDown")
        tab.wait(f"!{outline}.hidden && {outline}.getContext('2d').getImageData(0, 0, 32, 24).data.some(code => code > 0)")
        place = "(b => [b.left, b.top, b.width, b.height].map(Math.round).join())"
        assert tab.js(f"{place}({outline}.getBoundingClientRect()) === {place}({CANVAS}.getBoundingClientRect())")
        tab.type("x")  # typing hides it
        tab.wait(f"{outline}.hidden")
        tab.key("Backspace")
        close(tab)


@pytest.mark.long
def test_two_pages_show_the_same(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown:
        one, two = opened(chromium, shown.address.url), opened(chromium, shown.address.url)
        replace_all(one, SCENE.replace("#203040", "#00ff00"))
        two.wait(f"[...{CANVAS}.getContext('2d').getImageData(0, 0, 1, 1).data].join() === '0,255,0,255'")
        two.wait("document.querySelector('.cm-content').innerText.includes('#00ff00')")
        two.js("document.querySelector('#channel').value = 'depth'; document.querySelector('#channel').dispatchEvent(new Event('change'))")
        one.wait(f"{CANVAS}.dataset.channel === 'depth' && document.querySelector('#channel').value === 'depth'")
        close(one)
        close(two)


@pytest.mark.long
def test_a_page_reconnects_to_a_restarted_server_with_its_state(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    green = SCENE.replace("#203040", "#00ff00")
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        before = version(tab)
        replace_all(tab, green)
        drawn(tab, before)
        value = drag_slider(tab, shown)
    tab.wait("document.querySelector('#link').className === 'lost'")
    with served(scene) as shown:
        tab.wait("document.querySelector('#link').className === 'open'")
        tab.wait(f"[...{CANVAS}.getContext('2d').getImageData(0, 0, 1, 1).data].join() === '0,255,0,255'")
        assert shown.session.studio.state.sets == {"radius": value}
        assert shown.session.studio.state.texts == {str(scene): green}
        assert tab.js("document.querySelector('.cm-content').innerText.includes('#00ff00')")
        close(tab)
    assert scene.read_text(encoding="utf-8") == SCENE


@pytest.mark.long
def test_a_slow_picture_is_cancelled_at_once(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    slow = SCENE.replace("size: [32, 24], samples: 2", "size: [32, 24], samples: 1000000")
    scene.write_text(slow, encoding="utf-8")
    with served(scene) as shown:
        tab = chromium.tab(shown.address.url)
        tab.wait("document.querySelector('#status')?.dataset.stage === 'rendering'")
        assert tab.js(f"{CANVAS}.dataset.finished") == "false"
        tab.wait(f"{CANVAS}.dataset.count > 0")
        before, began = version(tab), time.monotonic()
        replace_all(tab, slow.replace("#203040", "#00ff00"))
        tab.wait(f"+{CANVAS}.dataset.version > {before}")
        tab.wait(f"[...{CANVAS}.getContext('2d').getImageData(0, 0, 1, 1).data].join() === '0,255,0,255'")
        assert time.monotonic() - began < 3.0
        before = version(tab)
        for k in range(10):  # the newest edit wins
            replace_all(tab, slow.replace("#203040", f"#0000{k}f"))
        tab.wait(f"[...{CANVAS}.getContext('2d').getImageData(0, 0, 1, 1).data].join() === '0,0,159,255'")
        close(tab)


@pytest.mark.long
def test_files_of_the_scene_have_tabs(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        tab.wait("document.querySelectorAll('#tabs button').length === 2")
        tab.click("#tabs button:nth-child(2)")
        tab.wait(f"document.querySelector('.cm-content').innerText.trim() === {PART.strip()!r}")
        before = version(tab)
        replace_all(tab, PART.replace("#ff0000", "#0000ff"))
        drawn(tab, before)
        assert pixel(tab)[2] > 20 > pixel(tab)[0]
        close(tab)


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(1600, 1000), (1280, 720), (390, 844)])
def test_the_page_fits_its_window(tmp_path: Path, chromium: Browser, width: int, height: int) -> None:
    scene = windows.write(tmp_path)
    scene.write_text(SCENE + "// long\n" * 300, encoding="utf-8")
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        tab.size(width, height)
        tab.click("#picture")
        tab.wait("!document.querySelector('#picked').hidden")
        sizes = tab.js("[document.documentElement.scrollWidth, document.documentElement.scrollHeight, innerWidth, innerHeight, scrollY]")
        assert sizes == [width, height, width, height, 0]
        inside = "(b => b.top >= 0 && b.left >= 0 && b.right <= innerWidth && b.bottom <= innerHeight)"
        for selector in ("header", "#picture", "#picked", "footer"):
            assert tab.js(f"{inside}(document.querySelector('{selector}').getBoundingClientRect())"), selector
        close(tab)


@pytest.mark.long
def test_dark_and_light(tmp_path: Path, chromium: Browser) -> None:
    scene = windows.write(tmp_path)
    with served(scene) as shown:
        tab = opened(chromium, shown.address.url)
        light = "(c => c.match(/\\d+/g).slice(0, 3).reduce((a, b) => a + +b, 0))(getComputedStyle(document.body).backgroundColor)"
        tab.size(1000, 700, dark=True)
        tab.wait(f"{light} < 150")
        tab.js("document.body.focus()")
        tab.key("t")
        tab.wait(f"{light} > 600")
        tab.js("localStorage.clear()")
        close(tab)


@pytest.mark.long
def test_a_folder_shows_its_scenes(tmp_path: Path, chromium: Browser) -> None:
    folder = tmp_path / "scenes"
    (folder / "more").mkdir(parents=True)
    windows.write(folder)
    (folder / "more" / "<b>.scene").write_text(SCENE.replace('use "part.scene"\n', "").replace("part.ball", "sphere"), encoding="utf-8")
    (folder / ".hidden.scene").write_text("", encoding="utf-8")
    drawn_of: list[str] = []

    def thumbnail(path: Path) -> bytes:
        drawn_of.append(path.name)
        if path.name == "part.scene":
            raise ValueError("nothing <i>is</i> placed")
        return (Path(__file__).resolve().parents[2] / "examples" / "hello.png").read_bytes()

    with served(folder, thumbnail=thumbnail) as shown:
        tab = chromium.tab(shown.address.url)
        tab.wait("document.querySelectorAll('#scenes a').length === 3 && document.querySelector('.broken') !== null")
        assert tab.js("[...document.querySelectorAll('#scenes b')].map(b => b.textContent)") == ["a.scene", "more/<b>.scene", "part.scene"]
        assert text(tab, ".broken") == "nothing <i>is</i> placed"
        tab.click("#scenes a:nth-child(2)")
        tab.wait(f"location.pathname.includes('/scene/') && {CANVAS}?.dataset.finished === 'true'")
        tab.wait("document.querySelector('#name').textContent === '<b>.scene'")
        assert len(shown.rooms.rooms) == 1
        tab.click("#all")
        tab.wait("document.querySelectorAll('#scenes a').length === 3")
        windows.until(lambda: not shown.rooms.rooms)
        assert sorted(drawn_of[:3]) == ["<b>.scene", "a.scene", "part.scene"]
        tab.js("1")
        tab.close()
