"""What is kept in the cache folder: parser tables are kept on disk, and whatever is found there, files are parsed the same."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
from maquette.compiler.io import cache_dirs
from maquette.lang import diagnostics
from maquette.lang.syntax import lexer, parser
lexer.grammar(cache_dirs.parser_tables())
found = diagnostics.Diagnostics()
file = parser.parse("let a = [1, 2]\\nsphere(radius: a[0])\\nbox(", "t", found)
print(len(file.items), [d.message for d in found.items])
"""


def run(folder: Path) -> tuple[str, str]:
    environment = {**os.environ, "MAQUETTE_CACHE": str(folder)}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


def test_tables_are_kept_and_taken_from_there(tmp_path: Path) -> None:
    first = run(tmp_path)
    assert first[0].startswith("2 ['")
    kept = list(tmp_path.iterdir())
    assert [path.name.partition("-")[0] for path in kept] == ["grammar"]
    written = kept[0].stat().st_mtime_ns
    assert run(tmp_path) == first
    assert kept[0].stat().st_mtime_ns == written


@pytest.mark.parametrize("found", [b"", b"no tables\n", b"0" * 64 + b"\nnothing"], ids=["empty", "foreign", "broken"])
def test_what_is_broken_there_is_made_again(tmp_path: Path, found: bytes) -> None:
    first = run(tmp_path)
    kept = next(tmp_path.iterdir())
    kept.write_bytes(found)
    assert run(tmp_path) == first
    assert kept.stat().st_size > 1000


def test_nowhere_to_keep_them_is_no_mistake(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    assert run(blocked / "cache") == run(tmp_path / "free")
