"""Every example loads without a word, is drawn by both quick backends, has its picture and is told of; what the docs show works."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.lang.diagnostics import Diagnostics, SceneError, render_text
from maquette.materials import traits
from maquette.render.render_scene import draw

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"
FILES = sorted(p for p in EXAMPLES.iterdir() if p.suffix in (".scene", ".obj", ".usda"))
NAMES = [p.name for p in FILES]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *EXAMPLES.glob("*.md")]

_loaded: dict[Path, tuple[ir.Scene, Diagnostics]] = {}


def _load(path: Path) -> tuple[ir.Scene, Diagnostics]:
    if path not in _loaded:
        found = Diagnostics()
        _loaded[path] = load.load(path, diagnostics=found), found
    return _loaded[path]


def test_there_are_examples():
    assert len(FILES) >= 15


@pytest.mark.long
@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_an_example_loads_without_a_diagnostic(path):
    _, found = _load(path)
    assert [d.message for d in found.items] == []


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_an_example_is_drawn(path, backend):
    """Small and coarse, every camera of it: all numbers finite, something seen and lit."""
    scene, _ = _load(path)
    for camera in range(len(scene.names.cameras)):
        asked = ir.Settings(size=(64, 48), samples=1, backend=backend, aov=("depth", "normal"), camera=scene.names.cameras[camera])
        if len(scene.names.cameras) == 1:
            asked = ir.Settings(size=(64, 48), samples=1, backend=backend, aov=("depth", "normal"))
        if backend == "raster" and scene.tables.cameras.projection[camera] == ir.Projection.PANORAMIC:
            with pytest.raises(planner.PlanError, match="the raster backend draws no panoramic pictures: write --backend ray"):
                planner.make_plan(scene, asked)
            continue
        image = draw(scene, planner.make_plan(scene, asked))
        assert image.metadata["issues"] == 0
        rgba = image.channels["rgba"]
        assert np.isfinite(rgba).all()
        assert np.isfinite(image.channels["normal"]).all()
        assert (rgba[..., 3] > 0).mean() > 0.1
        assert rgba[..., :3].mean() > 1e-3
        spectral = backend == "ray" and traits.disperses(scene.tables)  # colours of the spectrum lie outside of Rec.709
        assert spectral or rgba[..., :3].min() >= 0


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_an_example_has_its_picture(path):
    picture = path.with_suffix(".png")
    assert picture.is_file(), f"make examples draws {picture.name}"
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_the_readme_speaks_of_an_example(path):
    text = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert f"]({path.name})" in text
    assert f"({path.stem}.png)" in text


def _links() -> list[tuple[str, str]]:
    found = []
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        found += [(str(page.relative_to(ROOT)), link) for link in re.findall(r"\]\(([^)\s]+)\)", text)]
    return found


@pytest.mark.parametrize(("page", "link"), _links())
def test_what_the_pages_link_to_is_there(page, link):
    if "://" not in link:
        target = link.split("#")[0]
        assert not target or ((ROOT / page).parent / target).exists()


# --- the code in the pages --------------------------------------------------------------------------------------------------


def _blocks(page: Path) -> list[str]:
    """Fenced blocks that hold the language: neither shell commands nor messages."""
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    plain = [text for language, text in blocks if language in ("", "scene")]
    return [t for t in plain if not re.match(r"(make|pip|maquette|import|git|\S+:\d+:\d+:|\s*\S+ *[─▶])", t) and "▶" not in t]


SNIPPETS = [(page, k, text) for page in (ROOT / "README.md", ROOT / "docs" / "language.md") for k, text in enumerate(_blocks(page))]


def test_the_pages_show_scenes():
    assert len(SNIPPETS) >= 5


@pytest.mark.parametrize(("page", "k", "text"), SNIPPETS, ids=[f"{page.name}-{k}" for page, k, _ in SNIPPETS])
def test_a_scene_in_the_pages_works(page, k, text, tmp_path):
    """Each block by itself; one without a shape, which goes with those before it, with a ball."""
    path = tmp_path / "first.scene"
    shapes = re.search(r"\b(sphere|box|plane|mesh|cylinder|usd)\(", text)
    path.write_text(text if shapes else text + "\nsphere(1)\n", encoding="utf-8")
    found = Diagnostics()
    try:
        load.load(path, diagnostics=found)
    except SceneError as error:
        found = Diagnostics(list(error.diagnostics))
    assert [render_text(d, lambda _: path.read_text(encoding="utf-8")) for d in found.items] == []


@pytest.mark.long
def test_the_blocks_of_the_language_page_make_one_scene(tmp_path):
    """What is written into one file, block after block, is a scene; only the first ball, of which a fuller one follows, is left out."""
    blocks = _blocks(ROOT / "docs" / "language.md")
    path = tmp_path / "first.scene"
    path.write_text("\n".join(blocks[1:]), encoding="utf-8")
    found = Diagnostics()
    scene = load.load(path, diagnostics=found)
    assert [d.message for d in found.items] == ["two shapes `plane` have faces in one place, at y = 0: which of them is seen is chance"]
    assert len(scene.tables.instances.geometry) == 2 + 7 + 9 + 2 + 7 + 2 + 5 + 1


def test_pictures_name_no_folder_of_a_machine() -> None:
    """The command in a picture's metadata has paths of the project alone."""
    for path in EXAMPLES.glob("*.png"):
        assert not re.search(rb"(?:-o|render) +/[a-z]", path.read_bytes()), path.name
