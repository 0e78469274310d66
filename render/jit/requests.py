"""Lists of kernels that were needed, as plain data: recorded by one process (MAQUETTE_REQUESTS), compiled by another for its target."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ..simd import target
from .value_types import ValueType, from_plain

_PACKAGE = __name__.partition(".")[0]


class Request(NamedTuple):
    """A kernel by the names of its module and function, and the modules that were loaded when it was needed."""

    module: str
    function: str
    kinds: tuple[ValueType, ...]
    loaded: tuple[str, ...]


def record(function: Callable[..., Any], kinds: tuple[ValueType, ...]) -> None:
    """Add a kernel to this process's list in the folder MAQUETTE_REQUESTS."""
    loaded = sorted(name for name in sys.modules if name.partition(".")[0] == _PACKAGE and name != "__main__")
    line = json.dumps([function.__module__, function.__qualname__, [kind.plain for kind in kinds], loaded])
    folder = Path(target.REQUESTS)
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{os.getpid()}.jsonl").open("a", encoding="utf-8") as file:
        file.write(f"{line}\n")


def recorded(folder: Path) -> Iterator[Request]:
    """The kernels of all lists in a folder, each once; a kernel comes behind those that its process needed earlier."""
    seen = set[str]()
    for path in sorted(folder.glob("*.jsonl")):
        for line in path.read_text(encoding="utf-8").splitlines():
            module, function, kinds, loaded = json.loads(line)
            key = json.dumps([module, function, kinds])
            if key not in seen:
                seen.add(key)
                yield Request(module, function, tuple(map(from_plain, kinds)), tuple(loaded))
