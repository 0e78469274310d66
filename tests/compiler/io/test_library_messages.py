"""Lines of C libraries are left out; others reach the standard error output, in order."""

from __future__ import annotations

import os
import threading

import pytest
from maquette.compiler.io import library_messages


def test_others_stay(capfd: pytest.CaptureFixture[str]) -> None:
    with library_messages.left_out():
        os.write(2, b"first\nlibpng error: IDAT: invalid code\nsecond\n")
    os.write(2, b"libpng error: outside\n")
    assert capfd.readouterr().err == "first\nsecond\nlibpng error: outside\n"


def test_several_threads_are_in_it(capfd: pytest.CaptureFixture[str]) -> None:
    both = threading.Barrier(2)

    def work(name: str) -> None:
        with library_messages.left_out():
            both.wait()
            os.write(2, f"libpng error: {name}\n{name}\n".encode())
            both.wait()

    threads = [threading.Thread(target=work, args=(name,)) for name in ("one", "two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(capfd.readouterr().err.split()) == ["one", "two"]


def test_errors_pass(capfd: pytest.CaptureFixture[str]) -> None:
    @library_messages.left_out()
    def read() -> None:
        os.write(2, b"libpng error: x\n")
        raise ValueError("wrong")

    with pytest.raises(ValueError, match="wrong"):
        read()
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "after\n"
