"""`maquette test`: asserts, kept pictures, updates and the report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from maquette.cli.main import cli

BALL = """param r = 1
assert(r > 0.5, "too small")
sphere(r, center: [0, 1, 0], material: lambert(#c04030))
box([6, 0.2, 6], center: [0, -0.1, 0], material: lambert(#808080))
area(position: [0, 5, 2], look_at: [0, 0, 0], size: 1, luminance: 60)
camera(position: [0, 2, 6], look_at: [0, 1, 0])
"""
OPTIONS = ("--backend", "reference", "--size", "96x72", "--samples", "16")


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = Path("ball.scene")
    path.write_text(BALL, encoding="utf-8")
    return path


def run(*arguments: str | Path) -> tuple[int, list[str], list[str]]:
    done = CliRunner().invoke(cli, ["test", *map(str, arguments), *OPTIONS])
    return done.exit_code, done.stdout.splitlines(), done.stderr.splitlines()


@pytest.mark.long
def test_a_new_scene_fails_until_its_picture_is_kept(scene: Path) -> None:
    code, out, err = run(".")
    assert (code, out) == (1, ["new     ball.scene: there is no kept/ball.exr", "1 scenes: 1 new"])
    assert err == ["--update keeps the pictures of new scenes"]
    assert run(".", "--update")[:2] == (0, ["updated ball.scene: kept kept/ball.exr", "1 scenes: 1 updated"])
    assert run(".") == (0, ["passed  ball.scene", "1 scenes: 1 passed"], [])
    assert run(".", "-q") == (0, ["1 scenes: 1 passed"], [])


@pytest.mark.long
def test_another_seed_is_within_the_noise_and_another_color_is_not(scene: Path) -> None:
    run(scene, "--update")
    assert run(scene, "--seed", "7")[0] == 0
    scene.write_text(BALL.replace("#c04030", "#b04030"), encoding="utf-8")
    code, out, err = run(scene, "--seed", "3")
    assert code == 1
    assert out[0].startswith("failed  ball.scene: ")
    assert "standard errors" in out[0]
    assert err == ["-o FOLDER shows the differences; --update keeps the new pictures"]
    assert run(scene, "--update")[0] == 0
    assert run(scene)[0] == 0


@pytest.mark.long
def test_a_failing_assert_and_a_damaged_picture_are_errors(scene: Path) -> None:
    run(scene, "--update")
    code, out, err = run(scene, "--set", "r=0.4")
    assert (code, out) == (1, ["error   ball.scene: the assertion fails: too small", "1 scenes: 1 error"])
    assert err[0] == "ball.scene:2:8: error: the assertion fails: too small"
    Path("kept/ball.exr").write_bytes(b"no picture")
    code, out, _ = run(scene)
    assert code == 1
    assert out[0].startswith("error   ball.scene: ")


@pytest.mark.long
def test_a_report_shows_the_difference(scene: Path) -> None:
    run(scene, "--update")
    Path("box.scene").write_text(BALL, encoding="utf-8")
    scene.write_text(BALL.replace("r = 1", "r = 0.8"), encoding="utf-8")
    code, out, _ = run(".", "-o", "report")
    assert code == 1
    assert out[-1] == "2 scenes: 1 failed, 1 new"
    page = Path("report/index.html").read_text(encoding="utf-8")
    assert page.index("ball.scene") < page.index("box.scene")
    assert '<img src="ball.scene.png"' in page
    assert Path("report/ball.scene.png").is_file()


@pytest.mark.long
def test_records_are_json(scene: Path) -> None:
    done = CliRunner().invoke(cli, ["test", str(scene), "--json", "--update", "-q", *OPTIONS])
    (record,) = json.loads(done.stdout)
    assert (record["name"], record["status"], record["text"]) == ("ball.scene", "updated", "kept kept/ball.exr")


@pytest.mark.long
def test_a_kept_picture_decides_the_size(scene: Path) -> None:
    run(scene, "--update")
    done = CliRunner().invoke(cli, ["test", str(scene), "--backend", "reference"])
    assert (done.exit_code, done.stdout.splitlines()) == (0, ["passed  ball.scene", "1 scenes: 1 passed"])
    done = CliRunner().invoke(cli, ["test", str(scene), "--backend", "reference", "--size", "64x48"])
    assert done.stdout.splitlines()[0] == "failed  ball.scene: it has 64x48 pixels, and ball.exr has others"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("empty",), "Error: there is no .scene file in empty"),
        (("a.txt",), "Error: a.txt is not a scene: it ends in "),
    ],
)
def test_wrong_usage(scene: Path, arguments: tuple[str, ...], message: str) -> None:
    Path("empty").mkdir()
    Path("a.txt").touch()
    code, _, err = run(*arguments)
    assert code == 2
    assert err[-1].startswith(message)
