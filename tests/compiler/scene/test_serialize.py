"""Saved scenes: equal when read back, whole or not there, and refused with a message when they are not what they should be."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.scene import dump, serialize
from maquette.lang.diagnostics import SceneError

TEXT = """
param tint: color = #ff8800
param n: int = 3 in 1..9 "how many"
unit cm
let painted = lambert(checker(tint))
for (k in 1..n) { mesh(points: [[0,0,0],[1,0,0],[1,1,0],[0,1,0]], faces: [[0,1,2,3]], translate: [2 * k, 0, 0], material: painted) }
spot([0, 200, 0], intensity: 5cd, name: "lamp")
camera([0, 100, 500], exposure: 1, name: "main")
render(size: [64, 48], aov: ["depth"], background: rgb(0, 0, 1))
animate(duration: 2s)
"""


@pytest.fixture
def saved(compiled, tmp_path: Path) -> tuple[ir.Scene, Path]:
    scene, path = compiled(TEXT), tmp_path / "a.npz"
    serialize.save(scene, path)
    return scene, path


def test_a_round_trip_is_equal(saved: tuple[ir.Scene, Path]) -> None:
    scene, path = saved
    again = serialize.load(path)
    for table, column, values in serialize.columns(scene):
        other = getattr(getattr(again.tables, table), column)
        assert other.dtype == values.dtype, (table, column)
        assert np.array_equal(other, values, equal_nan=values.dtype.kind == "f"), (table, column)
        assert not other.flags.writeable
    for name in ("name", "names", "settings", "photometric", "duration", "fps", "defaults", "files", "params"):
        assert getattr(again, name) == getattr(scene, name), name
    assert again.spans.get("instances", 1) == scene.spans.get("instances", 1) is not None
    assert serialize.content_hash(again) == serialize.content_hash(scene)
    assert dump.text(again) == dump.text(scene)


def test_the_hash_is_of_what_is_drawn(compiled, tmp_path: Path) -> None:
    one = compiled("sphere(1)\ncamera([0,0,5])\nsun()")
    assert serialize.content_hash(one) == serialize.content_hash(compiled("\n// a comment\nsphere(1)\n\ncamera([0,0,5])\nsun()"))
    assert serialize.content_hash(one) != serialize.content_hash(compiled("sphere(2)\ncamera([0,0,5])\nsun()"))
    assert serialize.content_hash(one) != serialize.content_hash(compiled("sphere(1)\ncamera([0,0,5])\nsun()\nrender(samples: 2)"))


def test_saving_leaves_nothing_beside_the_file(saved: tuple[ir.Scene, Path]) -> None:
    assert sorted(p.name for p in saved[1].parent.iterdir()) == ["a.npz", "a.scene"]


def test_a_failed_save_keeps_the_old_file(saved: tuple[ir.Scene, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    scene, path = saved
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OSError, match="No space left"):
        serialize.save(scene, path)
    assert path.read_bytes() == before
    assert sorted(p.name for p in path.parent.iterdir()) == ["a.npz", "a.scene"]


def reason(path: Path) -> str:
    with pytest.raises(SceneError) as caught:
        serialize.load(path)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.span is not None
    assert diagnostic.span.file == str(path)
    return diagnostic.message


def rewritten(path: Path, **change: object) -> Path:
    """The saved scene with arrays replaced (None: left out)."""
    with np.load(path) as arrays:
        kept = {name: arrays[name] for name in arrays.files}
    about = json.loads(kept["about"].tobytes())
    about.update(change.pop("about", {}))  # type: ignore[call-overload]
    kept["about"] = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
    kept.update({name.replace("__", "."): value for name, value in change.items()})  # type: ignore[arg-type]
    np.savez(path, **{name: value for name, value in kept.items() if value is not None})
    return path


DAMAGED = "cannot read the saved scene: it is damaged, or something else"


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_cut_file(saved: tuple[ir.Scene, Path], share: float) -> None:
    path = saved[1]
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert reason(path) == DAMAGED


@pytest.mark.parametrize("seed", range(20))
def test_a_file_with_a_wrong_byte_is_refused_or_validated(saved: tuple[ir.Scene, Path], seed: int) -> None:
    path = saved[1]
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    for at in rng.integers(0, len(data), 3):
        data[at] ^= int(rng.integers(1, 256))
    path.write_bytes(bytes(data))
    with suppress(SceneError):  # anything else is a fault
        assert isinstance(load.load(path), ir.Scene)


def test_other_files(saved: tuple[ir.Scene, Path], tmp_path: Path) -> None:
    path = saved[1]
    assert reason(tmp_path / "none.npz") == "cannot read the saved scene: No such file or directory"
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    assert reason(tmp_path / "other.npz") == DAMAGED
    assert reason(rewritten(path, about={"version": 99})) == (
        "cannot read the saved scene: it is of version 99, and this program reads 7: compile the scene again"
    )
    assert reason(rewritten(path, about={"format": "x"})) == "cannot read the saved scene: it is not maquette's"


@pytest.mark.parametrize(
    "change",
    [
        {"instances__geometry": None},
        {"instances__geometry": np.zeros(3)},
        {"materials__values": np.zeros((1, 2, 3))},
        {"spans__instances": np.zeros((3, 4), np.int32)},
        {"about": {"names": {"nonsense": []}}},
        {"about": {"params": [{"name": "x"}]}},
        {"about": {"fps": "fast"}},
    ],
)
def test_wrong_columns(saved: tuple[ir.Scene, Path], change: dict[str, object]) -> None:
    assert reason(rewritten(saved[1], **change)) == DAMAGED


def test_nothing_is_unpickled(saved: tuple[ir.Scene, Path]) -> None:
    """An array of objects would run code when read: it is refused."""
    assert reason(rewritten(saved[1], instances__geometry=np.array([print, None], dtype=object))) == DAMAGED


@pytest.mark.long
def test_a_file_that_grows_when_it_is_read(saved: tuple[ir.Scene, Path]) -> None:
    """50 kB of zeros, compressed: read, they would take 50 MB."""
    np.savez_compressed(saved[1], about=np.zeros(50 << 20, np.uint8))
    size = saved[1].stat().st_size
    assert reason(saved[1]) == f"cannot read the saved scene: its arrays take 50 MB, and the file has {size / 1024:.3g} kB"
