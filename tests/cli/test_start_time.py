"""The start of a budget is that of the process."""

from __future__ import annotations

import subprocess
import sys
import time

from maquette.cli.job import start_time

PROGRAM = """
import time
time.sleep(0.5)
from maquette.cli.job import start_time
start_time.begin()
print(time.perf_counter() - start_time.take(), time.perf_counter() - start_time.take())
"""


def test_the_first_picture_begins_with_the_process_and_others_when_they_are_read() -> None:
    began = time.monotonic()
    said = subprocess.run([sys.executable, "-P", "-c", PROGRAM], capture_output=True, text=True, check=True).stdout
    first, second = map(float, said.split())
    assert 0.5 <= first <= time.monotonic() - began + 0.02
    assert abs(second) < first


def test_a_picture_outside_of_a_command_begins_now() -> None:
    before = time.perf_counter()
    assert before <= start_time.take() <= time.perf_counter()
