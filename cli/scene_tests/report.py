"""The HTML report of `maquette test`: each scene with its result, the kept picture, the new one and their difference."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class Result(NamedTuple):
    """The result of one scene."""

    name: str
    status: str  # "passed", "failed", "new", "updated" or "error"
    text: str = ""  # figures or messages
    picture: str = ""  # file in the report: new picture, kept picture and difference side by side
    seconds: float = 0.0


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Scene tests</title><style>
body {{ font: 14px sans-serif; margin: 1em; background: #f4f4f4; color: #222 }}
section {{ background: #fff; border: 1px solid #ddd; border-left: 4px solid #2a7d3f; margin: 0 0 0.7em; padding: 0.5em 1em }}
.failed, .error, .new {{ border-left-color: #b00020 }}
img {{ max-width: 100% }}
pre {{ white-space: pre-wrap }}
@media (prefers-color-scheme: dark) {{ body {{ background: #1c1c1c; color: #ddd }} section {{ background: #262626; border-color: #444 }} }}
</style></head><body><h1>{title}</h1>
{sections}
</body></html>
"""
_ORDER = ("error", "failed", "new", "updated", "passed")


def page(results: Sequence[Result], title: str) -> str:
    """The page; failures first."""
    ordered = sorted(results, key=lambda result: (_ORDER.index(result.status), result.name))
    return _PAGE.format(title=html.escape(title), sections="\n".join(map(_section, ordered)))


def _section(result: Result) -> str:
    text = f"<pre>{html.escape(result.text)}</pre>" if result.text else ""
    name = html.escape(result.name)
    shown = f'<img src="{html.escape(result.picture, quote=True)}" alt="new, kept and difference of {name}">' if result.picture else ""
    return f'<section class="{result.status}"><b>{name}</b>: {result.status}, {result.seconds:.2f} s{text}{shown}</section>'


def picture_name(name: str) -> str:
    """The file of a scene's pictures in the report."""
    return f"{Path(name).as_posix().replace('/', '_')}.png"
