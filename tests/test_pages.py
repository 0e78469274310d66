"""The site of the documentation builds strictly, and each scene of the tutorial and of the how-to page loads and has its picture."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import maquette
import pytest
from maquette.lang.diagnostics import Diagnostics

ROOT = Path(maquette.__file__).parent
GALLERY = sorted((ROOT / "examples" / "gallery").glob("*.scene"))
FENCED = re.compile(r"^```\n(.*?)^```", re.MULTILINE | re.DOTALL)


def tool(name: str) -> ModuleType:
    """A module of tools/."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PICTURES = tool("page_pictures")
SCENES = [(page, k, text) for page in PICTURES.PAGES for k, text in enumerate(FENCED.findall((ROOT / "docs" / page).read_text("utf-8")), 1)]


@pytest.mark.parametrize(("page", "k", "text"), SCENES, ids=[f"{page}-{k}" for page, k, _ in SCENES])
def test_a_scene_of_a_page_loads_without_a_diagnostic(page: str, k: int, text: str) -> None:
    found = Diagnostics()
    maquette.load_text(text, folder=str(ROOT / "examples"), diagnostics=found)
    assert [d.message for d in found.items] == []


@pytest.mark.parametrize(("picture", "scene"), PICTURES.blocks().items())
def test_a_picture_was_drawn_from_the_scene_above_it(picture: str, scene: str) -> None:
    assert PICTURES.is_new(picture, scene), "run: make library"


def test_the_tutorial_has_ten_steps_with_pictures() -> None:
    assert [f"tutorial/{k}.jpg" in PICTURES.blocks() for k in range(1, 11)] == [True] * 10


@pytest.mark.long
def test_the_site_builds_without_a_warning(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Also: pages load nothing from elsewhere."""
    pytest.importorskip("mkdocs", reason="no mkdocs: pip install maquette-render[docs]")
    pytest.importorskip("material", reason="no mkdocs-material: pip install maquette-render[docs]")
    code = tool("site").build(tmp_path / "site")
    assert capfd.readouterr().out == ""
    assert code == 0
    pages = list((tmp_path / "site" / "html").rglob("*.html"))
    assert len(pages) >= 25
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r'<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)="(?:https?:)?//', text), page.name


# --- the gallery ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_a_scene_of_the_gallery_is_short_and_has_its_picture(path: Path) -> None:
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert len(path.read_text(encoding="utf-8").splitlines()) < 100
    assert path.with_suffix(".jpg").read_bytes()[:2] == b"\xff\xd8"
    assert f"](../examples/gallery/{path.stem}.jpg)" in page
    assert f"](../examples/gallery/{path.name})" in page


@pytest.mark.long
@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_a_scene_of_the_gallery_loads_without_a_diagnostic(path: Path) -> None:
    found = Diagnostics()
    maquette.load(path, diagnostics=found)
    assert [d.message for d in found.items] == []


@pytest.mark.long
@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_a_scene_of_the_gallery_is_drawn(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAQUETTE_KERNELS", "general")
    image = maquette.render(maquette.load(path), size=(36, 24), samples=1, bounces=2)
    assert image.metadata["issues"] == 0
    assert image.channels["rgba"][..., :3].mean() > 1e-3


def test_there_are_ten_scenes_in_the_gallery() -> None:
    assert len(GALLERY) == 10


