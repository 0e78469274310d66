"""Each benchmark runs, tiny, against the peers that are installed, and its answers agree; those that are not are said to be missing."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from maquette.bench import __main__ as command

PEERS = {
    "rays": {"embreex": ("embreex", "Embree"), "mitsuba": ("Mitsuba llvm",)},
    "build": {"embreex": ("Embree",)},
    "paths": {"mitsuba": ("Mitsuba llvm", "Mitsuba scalar")},
    "raster": {"moderngl": ("llvmpipe",)},
    "formulas": {"fidget-once": ("fidget jit", "fidget vm")},
    "edits": {},
    "threads": {},
    "cores": {},
    "procedural": {},
    "slabs": {},
    "imports": {},
    "cluster": {},
    "live": {"chromium": ("material, file", "orbit")},
    "start": {"povray": ("POV-Ray",), "mitsuba": ("Mitsuba llvm",)},
}


LONG = ("live", "imports", "cluster")  # 20 seconds and more


def installed(peer: str) -> bool:
    return bool(shutil.which(peer)) if peer in ("povray", "fidget-once", "chromium") else importlib.util.find_spec(peer) is not None


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in command.NAMES])
def test_a_benchmark_runs_and_its_answers_agree(name: str, tmp_path: Path) -> None:
    missing = [peer for peer in PEERS[name] if not installed(peer)]
    if missing:
        pytest.skip(f"{', '.join(missing)} not installed: make bench installs what pip can")
    results = tmp_path / "RESULTS.md"
    run = [sys.executable, "-m", "maquette.bench", name, "--quick", "--results", str(results)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    text = results.read_text(encoding="utf-8")
    assert f"<!-- section {name} -->" in text
    assert "maquette" in text
    for peer, rows in PEERS[name].items():
        for row in rows:
            assert row in text or f"Not measured: {peer}" in text.lower(), f"{row} is neither measured nor said to be missing:\n{text}"


@pytest.mark.long
def test_without_peers_ours_is_measured_alone(tmp_path: Path) -> None:
    """As where nothing is installed: the import of every peer fails."""
    code = (
        "import sys\n"
        "for peer in ('embreex', 'mitsuba', 'moderngl'): sys.modules[peer] = None\n"
        "from pathlib import Path\n"
        "from maquette.bench.__main__ import run\n"
        f"sys.exit(run('build', True, Path({str(tmp_path / 'R.md')!r})) or run('raster', True, Path({str(tmp_path / 'R.md')!r})))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "R.md").read_text(encoding="utf-8")
    assert "Not measured: embreex is not installed (pip install embreex)." in text
    assert "Not measured: moderngl is not installed" in text
    assert "× ours |" not in text
    assert "| 2k triangles | maquette |" in text


@pytest.mark.long
def test_vectors_can_be_limited_for_all(tmp_path: Path) -> None:
    """Those that cannot be are left out, and the section stands beside the one without limits."""
    results = tmp_path / "R.md"
    run = [sys.executable, "-m", "maquette.bench", "rays", "--quick", "--simd", "sse", "--results", str(results)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    text = results.read_text(encoding="utf-8")
    assert "<!-- section rays sse -->\n## Rays, SSE for all" in text
    assert "Not measured: Mitsuba cannot be kept to SSE." in text
    assert "| maquette |" in text


def test_names_that_are_none_are_answered(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(["speed"])
    assert "no benchmark is called speed; there are: rays, build, paths, raster, formulas, edits, start" in capsys.readouterr().err
