"""The language server, as an editor meets it: whole answers over its pipes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from .editor import Editor, Failure

PARTS = """\
// Parts of a table.
unit cm
param gap: length = 2cm  "between two posts"

// A post.
let post(h: length = 1m, wood = lambert(#805030)) = cylinder(5cm, h, material: wood)
"""
HEAD = """\
use "parts.scene"
param big: length = 2m in 1m..3m  "the height"
// Its radius.
let r = 0.5 * big
"""


@pytest.fixture(scope="module")
def editor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    folder = tmp_path_factory.mktemp("scenes").resolve()
    (folder / "parts.scene").write_text(PARTS, encoding="utf-8")
    (folder / "wood.png").touch()
    (folder / "meshes").mkdir()
    (folder / "meshes" / "cup.obj").touch()
    editor = Editor(folder)
    yield editor
    assert editor.end() == 0


def span(line: int, first: int, last: int) -> dict[str, Any]:
    """A range in one line."""
    return {"start": {"line": line, "character": first}, "end": {"line": line, "character": last}}


def markdown(text: str) -> dict[str, str]:
    return {"kind": "markdown", "value": text}


def labels(found: list[dict[str, Any]]) -> list[str]:
    return [item["label"] for item in found]


# --- diagnostics ------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_errors_come_with_each_change_and_go_when_they_are_mended(editor: Editor) -> None:
    editor.open("a.scene", 'sphre(1)\nsphere(1, material: lambert("😀", #ff0000), raduis: 2)\n')
    found = editor.checked("a.scene")
    assert found[0] == {
        "range": span(0, 0, 5), "message": "there is no `sphre` here; did you mean `sphere`?", "severity": 1, "source": "maquette",
    }  # fmt: skip
    assert [each["range"] for each in found if "raduis" in each["message"]] == [span(1, 44, 50)]  # in UTF-16 code units: the emoji has two
    editor.open("a.scene", "sphere(1)\n")
    assert editor.checked("a.scene") == []


def test_an_unused_name_is_a_warning_that_editors_fade(editor: Editor) -> None:
    editor.open("a.scene", "let a = 1\nsphere(1)\n")
    (found,) = editor.checked("a.scene")
    assert found == {"range": span(0, 4, 5), "message": "`a` is never used", "severity": 2, "source": "maquette", "tags": [1]}


@pytest.mark.long
def test_errors_of_a_used_file_stand_in_that_file(editor: Editor) -> None:
    editor.open("a.scene", 'use "parts.scene"\nparts.post()\n')
    assert editor.checked("a.scene") == []
    editor.open("parts.scene", PARTS + "let bad = 1 + 2deg\n")
    (found,) = editor.checked("parts.scene")
    assert (found["range"], found["message"]) == (span(6, 10, 18), "expected angle, got the bare number 1\nwrite 1deg or 1rad")
    editor.open("parts.scene", PARTS)
    assert editor.checked("parts.scene") == []
    editor.close("parts.scene")


def test_an_error_of_a_closed_file_is_cleared_when_it_is_mended(editor: Editor) -> None:
    broken = editor.folder / "broken.scene"
    broken.write_text("let post() = sphre(1)\n", encoding="utf-8")
    editor.open("a.scene", 'use "broken.scene"\nbroken.post()\n')
    (found,) = editor.next("broken.scene")
    assert found["message"] == "there is no `sphre` here; did you mean `sphere`?"
    assert found["relatedInformation"] == [
        {"location": {"uri": editor.uri("a.scene"), "range": span(0, 0, 18)}, "message": "broken.scene is used here"}
    ]
    broken.write_text("let post() = sphere(1)\n", encoding="utf-8")
    editor.tell("textDocument/didSave", {"textDocument": {"uri": editor.uri("broken.scene")}})
    assert editor.next("broken.scene") == []


def test_the_chain_of_calls_is_related_information(editor: Editor) -> None:
    editor.open("a.scene", "let f(x) = sphere(mesh(x))\nlet g(x) = f(x)\ng(2cm)\n")
    (found,) = editor.checked("a.scene")
    uri = editor.uri("a.scene")
    assert (found["range"], found["message"]) == (span(0, 23, 24), "expected string, got the length 0.02m")
    assert found["relatedInformation"] == [
        {"location": {"uri": uri, "range": span(1, 11, 12)}, "message": "in f, called here"},
        {"location": {"uri": uri, "range": span(2, 0, 1)}, "message": "in g, called here"},
    ]


def test_a_file_that_is_not_saved_yet_is_checked(editor: Editor) -> None:
    editor.open("new.scene", "sphre(1)\n")
    assert [each["message"] for each in editor.checked("new.scene")] == ["there is no `sphre` here; did you mean `sphere`?"]
    editor.close("new.scene")
    assert editor.next("new.scene") == []


def test_a_text_that_is_no_scene_is_ignored(editor: Editor) -> None:
    document = {"uri": editor.uri("notes.txt"), "languageId": "plaintext", "version": 1, "text": "sphre(1)"}
    editor.tell("textDocument/didOpen", {"textDocument": document})
    changed = {"textDocument": {"uri": document["uri"], "version": 2}, "contentChanges": [{"text": "sphre(2)"}]}
    editor.tell("textDocument/didChange", changed)
    editor.tell("textDocument/didClose", {"textDocument": {"uri": document["uri"]}})
    editor.open("a.scene", "sphere(2)\n")
    assert editor.checked("a.scene") == []
    assert document["uri"] not in editor.diagnostics


@pytest.mark.long
def test_columns_are_in_the_encoding_that_the_editor_asks_for(tmp_path: Path) -> None:
    text = 'text("ä😀")\r\ntext("ä😀", sise: 1)\r\n'
    other = tmp_path / "other"
    other.mkdir()
    (tmp_path / "scenes").mkdir()
    (other / "parts.scene").write_text("let post() = sphere(1)\n", encoding="utf-8")
    for encoding, column in (("utf-8", 15), ("utf-16", 12), ("utf-32", 11)):
        editor = Editor(tmp_path / "scenes", "--allow", str(other), general={"positionEncodings": [encoding]})
        assert editor.server["capabilities"]["positionEncoding"] == encoding
        editor.open("a.scene", text)
        (found,) = editor.checked("a.scene")
        assert (found["range"], found["message"]) == (span(1, column, column + 4), "text has no `sise`; did you mean `size`?")
        editor.open("a.scene", 'use "../other/parts.scene"\nparts.post()\n')
        assert editor.checked("a.scene") == []  # by --allow
        assert editor.end() == 0


@pytest.mark.long
def test_the_server_ends_with_its_editor(tmp_path: Path) -> None:
    editor = Editor(tmp_path)
    assert editor.process.stdin is not None
    editor.process.stdin.close()
    assert editor.process.wait(timeout=30) == 0
    assert editor.process.stdout is not None
    editor.process.stdout.close()


# --- completion -------------------------------------------------------------------------------------------------------


def test_arguments_of_an_element_come_first(editor: Editor) -> None:
    found = editor.at("a.scene", "completion", HEAD + "disk(1, ‸")
    assert found[0] == {
        "label": "radius", "kind": 10, "detail": "radius: length > 0 = 1m", "insertText": "radius: ", "sortText": "0radius",
        "documentation": markdown("`radius`: length > 0, default `1m`. Radius."),
    }  # fmt: skip
    assert labels(found)[:8] == ["radius", "center", "normal", "material", "name", "translate", "rotate", "scale"]
    assert {"parts", "big", "r", "plastic", "sphere", "sin", "pi", "time"} <= {*labels(found)}
    left = editor.at("a.scene", "completion", HEAD + "disk(radius: 1, ‸)")
    assert "radius" not in labels(left)


def test_names_in_scope_are_offered_where_they_are_visible(editor: Editor) -> None:
    text = HEAD + "let part(width) = group() {{\n  let inner = 1\n  for (k in 0..2) {{ sphere({}) }}\n}}\nbox({})\n"
    inside = labels(editor.at("a.scene", "completion", text.format("‸", "")))
    outside = labels(editor.at("a.scene", "completion", text.format("", "‸")))
    assert {"width", "inner", "k", "part"} <= {*inside}
    assert {"width", "inner", "k"}.isdisjoint(outside)
    assert "part" in outside


def test_names_of_a_block_expression_are_offered_in_it_alone(editor: Editor) -> None:
    text = HEAD + "let tone = pattern(|x, y, z| {{\n  let row = floor(z)\n  {}\n  row\n}})\nbox({})\n"
    inside = labels(editor.at("a.scene", "completion", text.format("let b = ‸1", "")))
    outside = labels(editor.at("a.scene", "completion", text.format("", "‸")))
    assert {"x", "row", "tone", "if"} <= {*inside}
    assert {"x", "row"}.isdisjoint(outside)
    assert "let" in labels(editor.at("a.scene", "completion", text.format("l‸", "")))


def test_names_stay_while_a_line_is_broken(editor: Editor) -> None:
    text = HEAD + "let part(width) = group() {{ sphere({} }}\nlet last = 3\n"
    editor.open("a.scene", text.format("width)"))
    assert {"width", "r", "last"} <= {*labels(editor.at("a.scene", "completion", text.format("wi‸")))}
    symbols = editor.ask("textDocument/documentSymbol", {"textDocument": {"uri": editor.uri("a.scene")}})
    assert [symbol["name"] for symbol in symbols] == ["parts", "big", "r", "part", "last"]


def test_members_of_a_used_file(editor: Editor) -> None:
    found = editor.at("a.scene", "completion", HEAD + "parts.‸")
    assert labels(found) == ["gap", "post"]
    assert found[1]["detail"] == "post(h: length = 1m, wood = lambert(#805030))"
    assert labels(editor.at("a.scene", "completion", HEAD + "parts.post(‸)"))[:2] == ["h", "wood"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('use "std/s‸', ["std/cameras", "std/furniture", "std/lights", "std/materials", "std/mechanics", "std/media", "std/patterns",
                         "std/profiles", "std/room", "std/shapes", "std/surfaces", "broken.scene", "parts.scene", "meshes/cup.obj"]),
        ('mesh("‸")', ["meshes/cup.obj"]),
        ('sphere(1, material: lambert(image(file: "w‸")))', ["wood.png"]),
        ('camera(projection: "‸")', ["perspective", "orthographic", "panoramic"]),
        ("unit ‸", ["m", "cm", "mm", "km", "um", "nm", "inch", "ft"]),
        ("// sp‸", []),
        ("let ‸", []),
    ],
)  # fmt: skip
def test_what_a_string_or_a_declaration_can_hold(editor: Editor, text: str, expected: list[str]) -> None:
    assert sorted(labels(editor.at("a.scene", "completion", text))) == sorted(expected)


def test_a_name_of_a_file_replaces_the_string(editor: Editor) -> None:
    (found,) = editor.at("a.scene", "completion", 'mesh("me‸")')
    assert found == {"label": "meshes/cup.obj", "kind": 17, "textEdit": {"range": span(0, 6, 8), "newText": "meshes/cup.obj"}}


# --- hover and signatures ---------------------------------------------------------------------------------------------


def test_hover_shows_a_definition_and_its_value(editor: Editor) -> None:
    editor.open("a.scene", HEAD + "sphere(r)\nparts.post()\n")
    editor.checked("a.scene")
    found = editor.at("a.scene", "hover", HEAD + "sphere(‸r)\nparts.post()\n")
    assert found == {"contents": markdown("```scene\nlet r = 0.5 * big\n```\n\nIts radius.\n\nValue: `1m`"), "range": span(4, 7, 8)}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("spot(c‸one: 3deg)", "`cone`: angle > 0, ≤ 180deg, default `30deg`. Half angle of the cone."),
        ("parts.po‸st(1)", "```scene\nlet post(h: length = 1m, wood = lambert(#805030))\n```\n\nA post.\n\nIn `parts.scene`"),
        ("parts.post(h‸: 1)", "```scene\nh: length = 1m\n```\n\na length; a bare number is in the file's unit\n\nIn `parts.scene`"),
        ("pa‸rts.post()", '```scene\nuse "parts.scene"\n```\n\nParts of a table.'),
        ("let a = cl‸amp(1, 0, 2)", "```scene\nclamp(value, low, high)\n```\n\nValue limited to low..high."),
        ("let a = ti‸me", "The time of the frame, in seconds."),
        ("param a: le‸ngth = 3", "`length`: a length; a bare number is in the file's unit."),
        ("let a = 12‸3", None),
        ("let a = {\n  // Half of it.\n  let half = 1\n  h‸alf\n}", "```scene\nlet half = 1\n```\n\nHalf of it."),
    ],
)
def test_hover(editor: Editor, text: str, expected: str | None) -> None:
    found = editor.at("a.scene", "hover", HEAD + text)
    assert (found and found["contents"]["value"]) == expected


def test_signature_help_follows_the_argument(editor: Editor) -> None:
    found = editor.at("a.scene", "signatureHelp", HEAD + "parts.post(1, ‸")
    assert found["signatures"] == [{
        "label": "post(h: length = 1m, wood = lambert(#805030))", "documentation": markdown("A post."), "activeParameter": None,
        "parameters": [{"label": "h: length = 1m"}, {"label": "wood = lambert(#805030)"}],
    }]  # fmt: skip
    assert found["activeParameter"] == 1
    assert editor.at("a.scene", "signatureHelp", HEAD + "parts.post(wood: gold(), h: ‸")["activeParameter"] == 0
    assert editor.at("a.scene", "signatureHelp", HEAD + "‸") is None


# --- definition, references, rename, symbols --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "file", "where"),
    [
        ("sphere(r‸)", "a.scene", span(3, 4, 5)),
        ("sphere(‸big)", "a.scene", span(1, 6, 9)),
        ("parts.po‸st()", "parts.scene", span(5, 4, 8)),
        ("parts.post(w‸ood: gold())", "parts.scene", span(5, 25, 29)),
        ("pa‸rts.post()", "a.scene", span(0, 4, 17)),
        ('use "par‸ts.scene" as p', "parts.scene", span(0, 0, 0)),
        ("let f(k) = [k + i‸ for i in 0..2]", "a.scene", span(4, 22, 23)),
        ("let f(k) = { let r = k; let s(q) = r‸ + q; s(1) }", "a.scene", span(4, 17, 18)),
        ("let f(k) = { let r = k; let s(q) = r + q; s‸(1) }", "a.scene", span(4, 28, 29)),
    ],
)
def test_definition(editor: Editor, text: str, file: str, where: dict[str, Any]) -> None:
    assert editor.at("a.scene", "definition", HEAD + text) == {"uri": editor.uri(file), "range": where}


@pytest.mark.long
def test_definition_in_the_library(editor: Editor) -> None:
    found = editor.at("a.scene", "definition", 'use "std/room"\nroom.b‸ox()')
    assert found["uri"].endswith("/stdlib/room.scene")
    assert editor.at("a.scene", "definition", "sph‸ere(1)") is None


def test_rename_in_a_block_expression(editor: Editor) -> None:
    text = "let a = 1\nlet f(x) = { let a‸ = x; let b(a) = a; a + b(a) }\nsphere(f(a))\n"
    found = editor.at("a.scene", "rename", text, newName="size")
    edits = [(edit["range"], edit["newText"]) for edit in found["changes"][editor.uri("a.scene")]]
    assert sorted(edits, key=str) == sorted([(span(1, column, column + 1), "size") for column in (17, 38, 44)], key=str)


def test_references_are_found_across_files(editor: Editor) -> None:
    found = editor.at("a.scene", "references", HEAD + "parts.post(h‸: r)\nparts.post(h: 2)", context={"includeDeclaration": True})
    assert found == [
        {"uri": editor.uri("parts.scene"), "range": span(5, 9, 10)},
        {"uri": editor.uri("parts.scene"), "range": span(5, 66, 67)},
        {"uri": editor.uri("a.scene"), "range": span(4, 11, 12)},
        {"uri": editor.uri("a.scene"), "range": span(5, 11, 12)},
    ]


def test_rename_changes_each_use_and_no_other_name(editor: Editor) -> None:
    text = "let a = 1\nlet f(a) = a + 1\nsphere(a‸ + f(a: 2))\n"
    found = editor.at("a.scene", "rename", text, newName="size")
    edits = [(edit["range"], edit["newText"]) for edit in found["changes"][editor.uri("a.scene")]]
    assert sorted(edits, key=str) == sorted([(span(0, 4, 5), "size"), (span(2, 7, 8), "size")], key=str)
    parameter = editor.at("a.scene", "rename", text.replace("‸", "").replace("f(a) = a", "f(a) = a‸"), newName="size")
    assert len(parameter["changes"][editor.uri("a.scene")]) == 3


def test_rename_tells_equal_pieces_apart(editor: Editor) -> None:
    loop = "for (k in 0..2) { sphere(k) }\n"
    found = editor.at("a.scene", "rename", loop + loop.replace("sphere(k", "sphere(k‸"), newName="i")
    assert [edit["range"]["start"]["line"] for edit in found["changes"][editor.uri("a.scene")]] == [1, 1]


def test_rename_of_a_used_file_gives_it_an_alias(editor: Editor) -> None:
    found = editor.at("a.scene", "rename", HEAD + "par‸ts.post()", newName="table")
    assert found["changes"][editor.uri("a.scene")] == [
        {"range": span(4, 0, 5), "newText": "table"}, {"range": span(0, 17, 17), "newText": " as table"},
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "new", "message"),
    [
        ("let q = 1\nsphere(q‸)", "r", "`r` is the name of something else here"),
        ("let q = 1\nlet f(x) = x + q‸", "x", "`x` is the name of something else here"),
        ("let q = 1\nsphere(q‸)", "sphere", "`sphere` is the name of something else here"),
        ("let q = 1\nsphere(q‸)", "let", "`let` cannot be a name"),
        ("let q = 1\nsphere(q‸)", "2a", "`2a` cannot be a name"),
        ("sph‸ere(1)", "ball", "there is no name of this file here"),
        ("parts.po‸st()", "leg", "`post` is defined in another file, parts.scene"),
        ("sphere(‸r", "s", "the file has syntax errors: mend them first"),
    ],
)
def test_a_rename_that_would_change_the_scene_is_refused(editor: Editor, text: str, new: str, message: str) -> None:
    with pytest.raises(Failure) as failure:
        editor.at("a.scene", "rename", HEAD + text, newName=new)
    assert str(failure.value) == message


def test_a_name_that_another_file_uses_is_not_renamed(editor: Editor) -> None:
    editor.open("a.scene", HEAD + "parts.post()\n")
    with pytest.raises(Failure) as failure:
        editor.at("parts.scene", "rename", PARTS.replace("let po", "let po‸"), newName="leg")
    assert str(failure.value) == "`post` is used by a.scene as well"
    editor.close("parts.scene")


def test_symbols(editor: Editor) -> None:
    editor.open("a.scene", HEAD + "let f(a) =\n  sphere(a)\n")
    found = editor.ask("textDocument/documentSymbol", {"textDocument": {"uri": editor.uri("a.scene")}})
    assert [(symbol["name"], symbol["kind"]) for symbol in found] == [("parts", 2), ("big", 7), ("r", 13), ("f", 12)]
    whole = {"start": {"line": 4, "character": 0}, "end": {"line": 5, "character": 11}}
    assert found[3] == {"name": "f", "kind": 12, "range": whole, "selectionRange": span(4, 4, 5)}


# --- edits ------------------------------------------------------------------------------------------------------------


def test_formatting_is_that_of_the_command(editor: Editor) -> None:
    options = {"tabSize": 2, "insertSpaces": True}
    found = editor.at("a.scene", "formatting", "sphere( 1 )‸", options=options)
    assert found == [{"range": span(0, 0, 11), "newText": "sphere(1)\n"}]
    assert editor.at("a.scene", "formatting", "sphere(1)\n‸", options=options) == []
    assert editor.at("a.scene", "formatting", "sphere((1‸", options=options) == []


@pytest.mark.parametrize(
    ("line", "fixed"),
    [
        ("sphre(1)", ["sphere(1)"]),
        ("spot(position: [0, 1, 2], cone: 35)", ["spot(position: [0, 1, 2], cone: 35deg)"]),
        ("assert(1 > 0 && 2 > 1)", ["assert(1 > 0 and 2 > 1)"]),
        ("assert(1 ≤ 2)", ["assert(1 <= 2)"]),
        ("sphere(1 m)", ["sphere(1m)"]),
        ("sphere(sin(3))", ["sphere(sin(3deg))", "sphere(sin(3rad))"]),
        ('let s = "abc', ['let s = "abc"']),
        ('use "std/rom"', ['use "std/room"']),
        ("camera(eye: [0, 1, 5])", ["camera(position: [0, 1, 5])"]),
        ("sphere(1, 2, 3)", []),
    ],
)
def test_fixes_of_the_messages_are_offered(editor: Editor, line: str, fixed: list[str]) -> None:
    editor.open("a.scene", line + "\n")
    editor.checked("a.scene")
    about = {"textDocument": {"uri": editor.uri("a.scene")}, "range": span(0, 0, 1), "context": {"diagnostics": []}}
    found = []
    for action in editor.ask("textDocument/codeAction", about):
        (edit,) = action["edit"]["changes"][editor.uri("a.scene")]
        first, last = (edit["range"][end]["character"] for end in ("start", "end"))
        found.append(line[:first] + edit["newText"] + line[last:])
    assert found == fixed


def test_colors_have_swatches(editor: Editor) -> None:
    text = "sphere(1, material: lambert(#f80))\n"
    editor.open("a.scene", text)
    (found,) = editor.ask("textDocument/documentColor", {"textDocument": {"uri": editor.uri("a.scene")}})
    assert found == {"range": span(0, 28, 32), "color": {"red": 1.0, "green": 0x88 / 255, "blue": 0.0, "alpha": 1.0}}
    about = {"textDocument": {"uri": editor.uri("a.scene")}, "color": found["color"], "range": found["range"]}
    written = editor.ask("textDocument/colorPresentation", about)
    assert labels(written) == ["#ff8800", "rgb(1, 0.246, 0)"]


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_files_that_are_no_ordinary_files_are_left_out(tmp_path: Path) -> None:
    """A pipe that nobody writes to, an endless device and a link out of the folder: in the workspace, and as the open file."""
    folder = tmp_path / "scenes"
    folder.mkdir()
    os.mkfifo(folder / "pipe.scene")
    (folder / "zero.scene").symlink_to("/dev/zero")
    (tmp_path / "secret.scene").write_text("sphere(leg)\n", encoding="utf-8")
    (folder / "link.scene").symlink_to("../secret.scene")
    editor = Editor(folder)
    for name in ("a.scene", "pipe.scene", "zero.scene"):
        found = editor.at(name, "references", 'use "pipe.scene"\nlet leg = 1\nsphere(leg‸)\n', context={"includeDeclaration": True})
        assert [place["range"] for place in found] == [span(1, 4, 7), span(2, 7, 10)]
        editor.close(name)
    assert editor.end() == 0


# --- wrong requests ---------------------------------------------------------------------------------------------------

PLACE = {"line": 0, "character": 0}
RANGE = {"start": PLACE, "end": PLACE}
GREY = {"red": 0.5, "green": 0.5, "blue": 0.5, "alpha": 1}
HUGE = 10**400


@pytest.mark.parametrize("number", [-1, 1 << 31, HUGE, 1.5, float("nan"), float("inf"), True, None, "1", [], {}])
@pytest.mark.parametrize("name", ["line", "character"])
def test_wrong_numbers_have_an_answer(editor: Editor, name: str, number: object) -> None:
    with pytest.raises(Failure):
        editor.ask("textDocument/hover", {"textDocument": {"uri": editor.uri("x.scene")}, "position": {**PLACE, name: number}})
    assert editor.ask("textDocument/hover", {"textDocument": {"uri": editor.uri("none.scene")}, "position": PLACE}) is None


def test_what_is_wrong_is_told(editor: Editor) -> None:
    document = {"uri": editor.uri("x.scene")}
    with pytest.raises(Failure, match=r"^`line` is a whole number from 0 to 2147483647$"):
        editor.ask("textDocument/definition", {"textDocument": document, "position": {"line": -3, "character": 0}})
    with pytest.raises(Failure, match=r"^`red` is a number from 0 to 1$"):
        editor.ask("textDocument/colorPresentation", {"textDocument": document, "range": RANGE, "color": {**GREY, "red": HUGE}})
    with pytest.raises(Failure, match=r"^the params of textDocument/hover cannot be read: "):
        editor.ask("textDocument/hover", {"textDocument": document})
    assert editor.ask("textDocument/colorPresentation", {"textDocument": document, "range": RANGE, "color": GREY})
