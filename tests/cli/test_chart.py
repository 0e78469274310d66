"""The `chart` command: files, output, exit codes, messages, redrawing, imported modules."""

from __future__ import annotations

import dataclasses
import json
import signal
import statistics
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.measure.chart import engine
from maquette.measure.records import Answer, Chart, NothingMeasured, Setting, Wanted
from maquette.measure.report import json_format

from ..files import standing_by
from ..measure import charts

SCENE = """\
param radius = 1 in 0.2..2
sphere(center: [0, radius, 0], radius: radius, material: lambert(#d0402a))
plane(y: 0, material: lambert(#e8e8e8))
sun(from: [2, 4, 3], illuminance: 20lx)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
"""


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, [str(a) for a in arguments])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a.scene."""
    return standing_by(tmp_path, monkeypatch, SCENE)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The requests to the engine, which is replaced by one that returns the chart of the room."""
    found: list[Any] = []

    def measure(scene: ir.Scene, wanted: Wanted, progress: Callable[..., None], cancel: threading.Event) -> Chart:
        found.extend((scene, wanted, cancel))
        progress(1, 2)
        return dataclasses.replace(charts.room(), scene=wanted.name, metric=wanted.metric)

    monkeypatch.setattr(engine, "measure", measure)
    return found


@pytest.mark.long
def test_a_chart_its_numbers_and_the_table(folder: Path, asked: list[Any]) -> None:
    code, out, err = run("chart", "a.scene", "-o", "a.svg")
    assert (code, err) == (0, "in a.svg, a.json\n")
    assert ET.parse(folder / "a.svg").getroot().tag.endswith("svg")
    assert json_format.read((folder / "a.json").read_text(encoding="utf-8")).scene == "a.scene"
    assert (
        out
        == """\
2 %: ray, 256 samples, about 2.6 s (2.1 s to 2.8 s); 5 %: raster, 16 samples, about 120 ms (81 ms to 120 ms); \
10 %: raster, 4 samples, about 60 ms; 1 %: ray, 1,024 samples, about 10 s (8.4 s to 11 s)
error  time    command
2 %    2.6 s   maquette render a.scene --size 400x300 --backend ray --samples 256
5 %    120 ms  maquette render a.scene --size 400x300 --backend raster --samples 16
10 %   60 ms   maquette render a.scene --size 400x300 --backend raster --samples 4
1 %    10 s    maquette render a.scene --size 400x300 --backend ray --samples 1024
error  take               time   measured  settings to copy
30 %   raster, 1 sample   35 ms  12 %      --backend raster --samples 1
10 %   raster, 4 samples  50 ms  6.8 %     --backend raster --samples 4
3 %    ray, 256 samples   2.6 s  1.9 %     --backend ray --samples 256
1 %    ray, 1024 samples  10 s   0.97 %    --backend ray --samples 1024
0.3 %  not reached               0.48 %
knee: ray, 256 samples: 1.9 % in 2.6 s: --backend ray --samples 256
raster stops at 3.4 %: no interreflection: bias 3.1 %
at 10 %, between measured points: raster 40 ms, ray 98 ms (2.5 times as long), mitsuba 510 ms (13 times as long),\
 reference 20 s (490 times as long)
not charted: povray: not installed: apt install povray
"""
    )


@pytest.mark.long
def test_options_reach_the_engine(folder: Path, asked: list[Any]) -> None:
    options = "--set radius=0.5 --size 24x16 --backends raster,ray --peers povray --metric flip --budget 5min --seeds 4 --repeats 2"
    more = "--threads 1 --bounces 2 --keep raw --json n.json --camera default -q"
    code, _, err = run("chart", "a.scene", "-o", "c.png", *options.split(), *more.split())
    assert (code, err) == (0, "")
    scene, wanted, _ = asked
    assert [p.name for p in scene.params] == ["radius"]
    settings = ir.Settings(size=(24, 16), camera="default", threads=1, bounces=2)
    named = "a.scene --set radius=0.5"
    assert wanted == Wanted(named, settings, ("raster", "ray"), ("povray",), "flip", 300.0, 4, 2, Path("raw"))
    assert (folder / "c.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "n.json").is_file()
    assert not (folder / "c.json").exists()


@pytest.mark.long
@pytest.mark.parametrize(("options", "bounces"), [([], 4), (["--vary", "bounces"], None), (["--bounces", "2"], 2)])
def test_the_bounces_of_the_scene_are_held(folder: Path, asked: list[Any], options: list[str], bounces: int | None) -> None:
    (folder / "a.scene").write_text(SCENE + "render(bounces: 4)\n", encoding="utf-8")
    assert run("chart", "a.scene", "-q", *options)[0] == 0
    assert asked[1].settings.bounces == bounces


def test_bounces_are_fixed_or_varied(folder: Path, asked: list[Any]) -> None:
    code, _, err = run("chart", "a.scene", "--bounces", "2", "--vary", "bounces")
    assert code == 2
    assert "--bounces fixes the number of bounces and --vary bounces varies it: give one of them" in err


@pytest.mark.long
def test_without_options_all_backends_are_measured_for_a_minute(folder: Path, asked: list[Any]) -> None:
    assert run("chart", "a.scene", "-q")[0] == 0
    everything = Wanted("a.scene", ir.Settings(), ("ray", "raster", "reference"), (), "relmse", 60.0, None, None, None, 0.02, False)
    assert asked[1] == everything
    assert sorted(p.name for p in folder.iterdir()) == ["a.chart.json", "a.chart.svg", "a.scene"]


@pytest.mark.long
def test_one_measurement_several_files(folder: Path, asked: list[Any]) -> None:
    code, _, err = run("chart", "a.scene", "-o", "a.html", "-o", "a.svg")
    assert (code, err) == (0, "in a.html, a.svg, a.json\n")
    assert "<svg" in (folder / "a.html").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_chart_is_drawn_again_from_its_numbers(folder: Path) -> None:
    (folder / "room.json").write_text(json_format.dump(charts.room()), encoding="utf-8")
    code, out, err = run("chart", "room.json", "-o", "again.svg")
    assert (code, err) == (0, "in again.svg\n")
    assert out.startswith("2 %: ")
    assert out.splitlines()[1].startswith("error  take")
    assert (folder / "again.svg").is_file()
    assert run("chart", "room.json", "-o", "again.svg", "--seeds", "4") == (
        2, "", "Usage: cli chart [OPTIONS] SCENE\nTry 'cli chart --help' for help.\n\n"
        "Error: --seeds is for measuring, but room.json is a finished chart, which is only redrawn\n",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-o", "a.jpg"), "a chart is written as .svg, .png or .html: a.jpg is none of them"),
        (("-o", "a.svg", "-o", "a.svg"), "a.svg is given twice"),
        (
            ("--backends", "rays"),
            "Invalid value for '--backends': no backend is called `rays`; there are ray, raster, reference; did you mean `ray`?",
        ),
        (("--backends", ","), "Invalid value for '--backends': separate names by commas, as in ray,raster"),
        (("--peers", "povray,povray"), "Invalid value for '--peers': `povray` is given twice"),
        (("--metric", "mse"), "Invalid value for '--metric': 'mse' is not one of 'relmse', 'blocks', 'flip', 'max', 'silhouette'."),
        (("--budget", "0s"), "Invalid value for '--budget': '0s': a budget is more than 0 seconds"),
        (("--seeds", "1"), "Invalid value for '--seeds': 1 is not in the range 2<=x<=1024."),
    ],
)
def test_wrong_usage(folder: Path, options: tuple[str, ...], message: str) -> None:
    code, out, err = run("chart", "a.scene", *options)
    assert (code, out) == (2, "")
    assert err.endswith(f"\nError: {message}\n")


@pytest.mark.long
def test_a_json_that_is_no_chart_is_not_overwritten(folder: Path, asked: list[Any]) -> None:
    (folder / "a.json").write_text('{"mine": 1}', encoding="utf-8")
    code, _, err = run("chart", "a.scene", "-o", "a.svg")
    assert code == 2
    assert err.endswith("Error: a.json exists and is not a chart: choose a file for the numbers with --json FILE\n")
    assert json.loads((folder / "a.json").read_text(encoding="utf-8")) == {"mine": 1}
    assert run("chart", "a.scene", "-o", "a.svg", "--json", "b.json")[0] == 0
    assert run("chart", "a.scene", "-o", "b.svg")[0] == 0  # b.json is a chart, and is replaced


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "Error: x.json: this is not a chart: its `format` is not `maquette chart 1`\n"),
        ("{", "Error: x.json: this is not JSON: Expecting property name enclosed in double quotes: line 1 column 2 (char 1)\n"),
    ],
)
def test_a_json_that_is_no_chart_is_an_error(folder: Path, text: str, message: str) -> None:
    (folder / "x.json").write_text(text, encoding="utf-8")
    assert run("chart", "x.json", "-o", "x.svg") == (1, "", message)


def test_errors_of_the_scene_are_as_everywhere(folder: Path) -> None:
    (folder / "wrong.scene").write_text("sphere(radius: -1)\n", encoding="utf-8")
    code, out, err = run("chart", "wrong.scene", "-o", "a.svg")
    assert (code, out) == (1, "")
    assert err.startswith("wrong.scene:1:16: error: `radius` must be more than 0, got -1m\n")
    assert not (folder / "a.svg").exists()


def test_nothing_measured_is_an_error_with_the_fix(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(*given: Any) -> Chart:
        raise NothingMeasured("no setting was measured within 1 s: give a larger --budget, or a smaller --size")

    monkeypatch.setattr(engine, "measure", measure)
    expected = "Error: no setting was measured within 1 s: give a larger --budget, or a smaller --size\n"
    assert run("chart", "a.scene", "-o", "a.svg") == (1, "", expected)
    assert not (folder / "a.svg").exists()


def test_what_is_known_without_measuring_is_the_first_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(scene: ir.Scene, wanted: Wanted, *given: Any) -> Chart:
        assert (wanted.target, wanted.backends_named, wanted.backends) == (0.05, True, ("ray",))
        setting = Setting("ray", "samples", 80, {"samples": 80})
        answers = (Answer(0.05, "ray, 80 samples", setting, 80, 9.0, 4.0, 20.0), Answer(0.02, why="too dark"))
        raise NothingMeasured("runs of the whole picture take about 40 s: give a longer --budget", answers, (64, 48))

    monkeypatch.setattr(engine, "measure", measure)
    found = run("chart", "a.scene", "-o", "a.svg", "--error", "5%", "--backends", "ray")
    assert found == (
        1,
        "5 %: ray, 80 samples, about 9.0 s (4.0 s to 20 s); 2 %: too dark\n"
        "error  time   command\n"
        "5 %    9.0 s  maquette render a.scene --size 64x48 --backend ray --samples 80\n",
        "Error: runs of the whole picture take about 40 s: give a longer --budget\n",
    )


@pytest.mark.long
def test_ctrl_c_draws_the_measurements_so_far(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(scene: ir.Scene, wanted: Wanted, progress: Any, cancel: threading.Event) -> Chart:
        cancel.set()  # as the first Ctrl-C
        return charts.room()

    monkeypatch.setattr(engine, "measure", measure)
    code, _, err = run("chart", "a.scene", "-o", "a.svg")
    assert (code, err) == (130, "in a.svg, a.json\ninterrupted: the chart has the measurements so far\n")
    assert (folder / "a.svg").is_file()


def test_ctrl_c_before_the_first_measurement_writes_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(scene: ir.Scene, wanted: Wanted, progress: Any, cancel: threading.Event) -> Chart:
        cancel.set()
        raise NothingMeasured("interrupted")

    monkeypatch.setattr(engine, "measure", measure)
    assert run("chart", "a.scene", "-o", "a.svg")[0] == 130
    assert not (folder / "a.svg").exists()


@pytest.mark.long
@pytest.mark.parametrize(
    "arguments", [("--help",), ("chart", "--help"), ("check", "a.scene"), ("explain", "a.scene"), ("inspect", "a.scene")]
)
def test_matplotlib_is_loaded_by_no_other_command(folder: Path, arguments: tuple[str, ...]) -> None:
    code = f"import sys; sys.argv = ['maquette', *{arguments!r}]\nfrom maquette.cli.main import cli\ntry: cli()\nexcept SystemExit: pass\n"
    told = "print([m for m in ('matplotlib', 'flip_evaluator', 'numba') if m in sys.modules], file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code + told], capture_output=True, text=True, timeout=60)
    assert done.stderr.splitlines()[-1] == "[]"


# --- with the engine, end to end ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_small_scene_is_measured(folder: Path) -> None:
    code, out, err = run("chart", "a.scene", "-o", "a.svg", "-o", "a.html", "--size", "24x16", "--budget", "40s", "--keep", "raw")
    assert (code, err.splitlines()[:1]) == (0, ["in a.svg, a.html, a.json"])  # on a busy machine a warning tells that it is late
    made = json_format.read((folder / "a.json").read_text(encoding="utf-8"))
    assert (made.scene, made.size, made.metric) == ("a.scene", (24, 16), "relmse")
    told = " ".join([*(curve.backend for curve in made.curves), *made.left_out])  # on a busy machine not all fit, and that is said
    assert all(backend in told for backend in ("ray", "raster", "reference"))
    tree = ET.parse(folder / "a.svg")
    marks = {name for element in tree.iter() if (name := element.get("id") or "").startswith("point-")}
    assert marks == {f"point-{i}" for i in range(len(made.points))}
    assert all(point.seconds.count >= 1 and point.seconds.median > 0 for point in made.points)
    assert made.front
    first, heading, *_ = out.splitlines()
    assert first.startswith("2 %: ")
    assert heading.startswith("error")
    assert all(point.setting.arguments() in (folder / "a.html").read_text(encoding="utf-8") for point in made.points)
    runs = json.loads((folder / "raw" / "index.json").read_text(encoding="utf-8"))["runs"]
    for point in made.points:
        found = [run["errors"]["relmse"] for run in runs if run["arguments"] == point.setting.arguments()]
        assert statistics.median(found) == pytest.approx(point.error.median)


def test_too_little_time_is_an_error_with_the_fix(folder: Path) -> None:
    code, out, err = run("chart", "a.scene", "-o", "a.svg", "--size", "600x400", "--budget", "50ms", "--backends", "ray")
    assert (code, out[:5]) == (1, "2 %: ")
    assert "maquette render a.scene --size 600x400 " in out
    assert err.startswith("Error: ")
    assert err.endswith("give a longer --budget or a smaller --size\n")
    assert list(folder.iterdir()) == [folder / "a.scene"]


def test_an_unknown_camera_is_wrong_usage(folder: Path) -> None:
    code, out, err = run("chart", "a.scene", "-o", "a.svg", "--camera", "nobody")
    assert (code, out) == (2, "")
    assert "Error: " in err


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_of_a_person_leaves_a_chart(folder: Path) -> None:
    command = [sys.executable, "-c", "from maquette.cli.main import main; main()", "chart", "a.scene", "-o", "a.svg", "--size", "24x16"]
    process = subprocess.Popen([*command, "--budget", "40s"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(24)  # the reference takes half of the budget
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    assert err.endswith("interrupted: the chart has the measurements so far\n")
    assert json_format.read((folder / "a.json").read_text(encoding="utf-8")).points
