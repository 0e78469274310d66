"""Params as controls, and their values written back into the source."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler import load
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.syntax.parser import parse
from maquette.live import params

SOURCE = """\
unit cm
param radius = 1 in 0.2..2  "of the ball"
param height: length = 5mm in 1mm..2cm
param turn = 20deg in 0deg..90deg
param teeth: int = 18 in 6..60
param open: bool = true
param tint: color = #d0402a
param kind = "ball" in ["ball", "box"]
param title: string = "a \\"b\\""
param free = 3
param offset = [1, 2]
sphere(radius)
"""


def controls(tmp_path: Path, text: str = SOURCE, **sets: str) -> dict[str, dict[str, object]]:
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    found = params.controls(load.load(path, sets=sets))
    return {str(control["name"]): control for control in found}


def test_each_type_has_its_control(tmp_path: Path) -> None:
    found = controls(tmp_path)
    assert {name: control["kind"] for name, control in found.items()} == {
        "radius": "slider", "height": "slider", "turn": "slider", "teeth": "slider", "open": "switch", "tint": "color", "kind": "choice",
        "title": "text", "free": "number", "offset": "fixed",
    }  # fmt: skip
    radius = [found["radius"][key] for key in ("value", "low", "high", "step", "unit", "doc", "line")]
    assert radius == [1, 0.2, 2, 0.005, "", "of the ball", 2]
    assert [found["height"][key] for key in ("value", "low", "high", "unit", "text")] == pytest.approx([5, 1, 20, "mm", "5mm"])
    assert [found["turn"][key] for key in ("value", "unit", "text")] == [pytest.approx(20), "deg", "20deg"]
    assert [found["teeth"][key] for key in ("value", "step", "text")] == [18, 1, "18"]
    assert found["tint"]["value"] == "#d0402a"
    assert found["kind"]["choices"] == [{"label": "ball", "text": "ball"}, {"label": "box", "text": "box"}]


def test_the_text_of_a_control_sets_its_value(tmp_path: Path) -> None:
    found = controls(tmp_path)
    texts = {name: str(control["text"]) for name, control in found.items() if control["kind"] != "fixed"}
    again = controls(tmp_path, **texts)
    for name in texts:
        assert again[name]["value"] == (pytest.approx(found[name]["value"]) if name in ("height", "turn") else found[name]["value"])


def test_values_are_written_over_the_defaults() -> None:
    values = {"radius": "1.5", "turn": "45deg", "open": "false", "tint": "#00ff00", "kind": "box", "title": 'c"d', "teeth": "20"}
    text = params.write_back(SOURCE, "a.scene", values)
    changed = [(a, b) for a, b in zip(SOURCE.splitlines(), text.splitlines(), strict=True) if a != b]
    assert [b for _, b in changed] == [
        'param radius = 1.5 in 0.2..2  "of the ball"', "param turn = 45deg in 0deg..90deg", "param teeth: int = 20 in 6..60",
        "param open: bool = false", "param tint: color = #00ff00", 'param kind = "box" in ["ball", "box"]', 'param title: string = "c\\"d"',
    ]  # fmt: skip


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_ends_and_the_byte_order_mark_stay(end: str, mark: str) -> None:
    text = f"{mark}param a = 1{end}param b = (2 +{end}  3) in 0..9{end}// é\u2028 param c = 1{end}param c = 4{end}"
    assert params.write_back(text, "a", {"a": "7", "b": "8", "c": "9"}) == text.replace("= 1" + end, "= 7" + end, 1).replace(
        f"(2 +{end}  3)", "8"
    ).replace("= 4", "= 9")


def test_a_param_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError) as caught:
        params.write_back("param a = 1\n", "a.scene", {"b": "2"})
    assert str(caught.value) == "a.scene has no param `b` that can be read"


@given(st.text(max_size=40).filter(lambda text: '"' not in text[:1] and "\0" not in text))
def test_any_text_of_a_string_param_survives(value: str) -> None:
    if value.lstrip().startswith('"'):
        return
    text = params.write_back('param a: string = "x"\nparam b = 1\n', "a.scene", {"a": value})
    found = Diagnostics()
    tree = parse(text, "a.scene", found)
    if "\n" in value or "\r" in value:
        return  # strings of the language have one line
    assert [item.name.id for item in tree.items] == ["a", "b"], text  # type: ignore[union-attr]
    assert tree.items[0].default.value == value  # type: ignore[union-attr]
