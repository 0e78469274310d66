"""The times that charts answer with, against those of the printed commands, for eight scenes, in CPU seconds of whole processes.

`pytest --long -s tests/measure/chart/test_answer_times.py` prints the table.
"""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path

import pytest
from maquette.measure.records import Answer, Chart
from maquette.measure.report import json_format

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
BUDGET = "60s"
WITHIN = 0.3  # of the time
LONGEST = 100.0  # CPU seconds of a command that is run
SCENES = ("hello", "room", "glass", "caustic", "lights", "materials", "metals", "evening")

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform == "win32", reason="CPU time of processes"),
]


def cpu_seconds(words: list[str]) -> float:
    """CPU seconds of a command and the processes that it waits for."""
    program = [sys.executable, "-c", "from maquette.cli.main import main; main()", *words]
    process = os.posix_spawn(program[0], program, os.environ)
    _, status, usage = os.wait4(process, 0)
    assert status == 0, shlex.join(words)
    return usage.ru_utime + usage.ru_stime


def slowest(chart: Chart) -> Answer:
    """The answer of most time, of those that LONGEST allows: in it the start of the process counts least."""
    return max((answer for answer in chart.answers if answer.setting is not None and answer.cpu < LONGEST), key=lambda answer: answer.cpu)


@pytest.mark.parametrize("name", SCENES)
def test_a_command_takes_the_time_that_its_chart_tells(name: str, tmp_path: Path) -> None:
    scene = str(EXAMPLES / f"{name}.scene")
    cpu_seconds(["render", scene, "--size", "32x24", "--samples", "2", "-q", "-o", str(tmp_path / "a.png")])  # compiles kernels
    cpu_seconds(["chart", scene, "--budget", BUDGET, "-q", "-o", str(tmp_path / "a.svg")])
    chart = json_format.read((tmp_path / "a.json").read_text(encoding="utf-8"))
    answer = slowest(chart)
    assert answer.setting is not None
    size = "x".join(map(str, chart.size))
    real = cpu_seconds(["render", scene, "--size", size, *shlex.split(answer.setting.arguments()), "-q", "-o", str(tmp_path / "a.png")])
    told = f"{answer.cpu:.1f} s ({answer.least_cpu:.1f} to {answer.most_cpu:.1f})"
    print(f"\n{name}: {answer.target:.0%}: {answer.how}: told {told}, takes {real:.1f} s of CPU: {answer.cpu / real:.2f}")
    assert answer.cpu == pytest.approx(real, rel=WITHIN)
