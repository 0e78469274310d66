"""The `thumbnail` command: a picture of each asset of a folder, framed and lit, and an HTML index of them."""

from __future__ import annotations

import atexit
import html
import json
import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import click

from ... import __version__
from ...compiler.io import child_process, import_path
from ...compiler.io.regular_files import MAX_DATA, read_text
from ...compiler.io.replace_file import make_folder, replace_file
from ...lang import file_types
from .. import common_options as shared
from .. import option_types as values
from ..process import supervisor

KINDS = (*file_types.USD, *file_types.MESH)
RECORDS = "thumbnails.json"  # what each picture was made from; pictures that are up to date are skipped
SAMPLES = 8
CRASHED = "the process that drew it crashed, which is a bug in maquette: `maquette render {}` tells what to send"
CRASHES = (BrokenProcessPool, BrokenPipeError)  # the second where a process ends before it has read what it does
SAVED_EVERY = 5.0  # seconds between writes of the records and the index


@dataclass(frozen=True, slots=True)
class Asset:
    """A file to draw. `name` is shown and, with .png, names its picture."""

    path: Path
    name: str


@dataclass(frozen=True, slots=True)
class Looks:
    """What all pictures have in common. `options` is its text in records; `allow` are folders that assets may read beside their own."""

    size: tuple[int, int]
    complexity: int
    options: str
    allow: tuple[Path, ...]


@dataclass(slots=True)
class Thumbnail:
    """The record of an asset in thumbnails.json. `made_from` are the files that it used with their times of change."""

    name: str
    path: str
    picture: str
    size: tuple[int, int]
    triangles: int = 0
    instances: int = 0
    seconds: float = 0.0
    version: str = __version__
    options: str = ""
    made_from: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    error: str = ""
    skipped: bool = False


@click.command("thumbnail")
@click.argument("assets", type=click.Path(exists=True, path_type=Path), nargs=-1, required=True)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder of the pictures and of index.html."
)
@click.option("--size", type=values.SIZE, default="512", show_default=True, help="Size in pixels: 512 for a square, or 800x600.")
@click.option("--complexity", type=values.COMPLEXITY, help="Refinement of USD subdivision surfaces: low, medium, high or veryhigh.")
@shared.allow
@click.option("--jobs", type=click.IntRange(1, 1024), help="Assets drawn at a time. Default: one a core.")
@click.option("--force", is_flag=True, help="Draw also pictures that are up to date.")
@click.option("--json", "as_json", is_flag=True, help="Print a record of each asset as JSON.")
@shared.examples("maquette thumbnail assets -o thumbs", "maquette thumbnail robot.usdz spot.obj -o thumbs --size 256 --json")
@click.pass_context
def command(
    ctx: click.Context, assets: tuple[Path, ...], output: Path, size: tuple[int, int], complexity: int | None, allow: tuple[Path, ...],
    jobs: int | None, force: bool, as_json: bool,
) -> None:  # fmt: skip
    """Draw a picture of each of ASSETS, which are files or folders of them.

    USD, glTF, OBJ, PLY, STL and OFF files are framed from three quarters, or through the camera main_cam of a stage. A file without
    lights gets a sun and a sky; with lights of its own the exposure is metered. Pictures whose files have not changed are kept.
    An asset may read files of its own folder, of the folders among ASSETS and of each --allow.
    index.html shows all pictures with names, sizes and warnings. The exit code is 1 if some asset cannot be drawn.
    """
    wanted = list(_assets(assets))
    output.mkdir(parents=True, exist_ok=True)
    options = json.dumps({"size": size, "complexity": complexity or 0, "samples": SAMPLES, "allow": [str(path) for path in allow]})
    before = {} if force else _records(output / RECORDS)
    done = {asset.name: earlier for asset in wanted if (earlier := _up_to_date(before.get(asset.name), asset, output, options))}
    waiting = [asset for asset in wanted if asset.name not in done]
    saved = time.perf_counter()
    looks = Looks(size, complexity or 0, options, (*(path for path in assets if path.is_dir()), *allow))
    for thumbnail in _draw_all(waiting, output, looks, jobs or os.cpu_count() or 1):
        done[thumbnail.name] = thumbnail
        if time.perf_counter() - saved > SAVED_EVERY:  # a run that is stopped goes on from there
            _save(output, list(done.values()))
            saved = time.perf_counter()
        if not as_json:
            _print(thumbnail)
    ordered = [done[asset.name] for asset in wanted]
    _save(output, ordered)
    failed = sum(bool(thumbnail.error) for thumbnail in ordered)
    if as_json:
        click.echo(json.dumps([asdict(thumbnail) for thumbnail in ordered], indent=2))
    else:
        earlier = sum(thumbnail.skipped for thumbnail in ordered)
        drawn = len(ordered) - earlier - failed
        click.echo(f"{output / 'index.html'}: {len(ordered)} assets, {drawn} drawn, {earlier} up to date, {failed} failed")
    ctx.exit(1 if failed else 0)


def _assets(paths: Sequence[Path]) -> Iterator[Asset]:
    """The files of known kinds, folders searched; each name once."""
    names: set[str] = set()
    for path in paths:
        files = sorted(p for p in path.rglob("*") if p.suffix.lower() in KINDS and p.is_file()) if path.is_dir() else [path]
        for file in files:
            name = file.relative_to(path).as_posix() if path.is_dir() else file.name
            unique = name if name not in names else file.resolve().as_posix().lstrip("/")
            if unique not in names:
                names.add(unique)
                yield Asset(file, unique)


def _save(output: Path, thumbnails: Sequence[Thumbnail]) -> None:
    """Writes the records and the index."""
    replace_file(output / RECORDS, (json.dumps([asdict(thumbnail) for thumbnail in thumbnails], indent=1) + "\n").encode())
    replace_file(output / "index.html", index_page(thumbnails).encode())


def _records(path: Path) -> dict[str, dict[str, Any]]:
    try:
        return {row["name"]: row for row in json.loads(read_text(path, MAX_DATA))}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _up_to_date(record: dict[str, Any] | None, asset: Asset, output: Path, options: str) -> Thumbnail | None:
    """The record of a picture that would come out the same; None without one."""
    if record is None or record.get("error") or record.get("version") != __version__ or record.get("options") != options:
        return None
    sources = record.get("made_from") or {}
    if record.get("path") != str(asset.path) or not sources or not (output / str(record.get("picture"))).is_file():
        return None
    if any(_changed(Path(file)) != time_ for file, time_ in sources.items()):
        return None
    return Thumbnail(**{**record, "size": tuple(record["size"]), "skipped": True})


def _changed(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return -1.0


def _draw_all(assets: Sequence[Asset], output: Path, looks: Looks, jobs: int) -> Iterator[Thumbnail]:
    """The thumbnails of assets in the order in which they are done: in one process, or in `jobs` of them."""
    count = min(jobs, len(assets))
    if count < 2:
        yield from (draw(asset, output, looks) for asset in assets)
        return
    alone: list[Asset] = []  # a process that crashes ends the pool, whoever had drawn in it
    with _pool(count) as pool:
        waiting: dict[Future[Thumbnail], Asset] = {}
        for asset in assets:
            try:
                waiting[pool.submit(draw, asset, output, looks)] = asset
            except CRASHES:
                alone.append(asset)
        for future in as_completed(waiting):
            try:
                yield future.result()
            except BrokenProcessPool:
                alone.append(waiting[future])
    for asset in alone:
        with _pool(1) as pool:
            try:
                yield pool.submit(draw, asset, output, looks).result()
            except CRASHES:
                yield Thumbnail(asset.name, str(asset.path), "", looks.size, error=CRASHED.format(asset.path), options=looks.options)


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    with child_process.isolated(), ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _begin_worker) as pool:
        yield pool


def _begin_worker() -> None:
    supervisor.end_with_parent(os.getppid())
    import_path.isolate()
    shared.raise_gc_threshold()
    atexit.register(os._exit, 0)  # as in main: without the end of OpenImageIO's module, which prints what it leaks


def draw(asset: Asset, output: Path, looks: Looks) -> Thumbnail:
    """Draws one asset on one thread. Errors of the file are in the record; nothing is raised."""
    from ...lang.diagnostics import SceneError

    began = time.perf_counter()
    record = Thumbnail(asset.name, str(asset.path), f"{asset.name}.png", looks.size, options=looks.options)
    try:
        _draw(asset, output, looks, record)
    except SceneError as error:
        record.error = "; ".join(d.message for d in error.diagnostics if d.severity == "error")
    except Exception as fault:  # one asset never ends the run
        record.error = f"{type(fault).__name__}: {fault}"
    record.seconds = round(time.perf_counter() - began, 3)
    return record


def _draw(asset: Asset, output: Path, looks: Looks, record: Thumbnail) -> None:
    from ...compiler import ir, load
    from ...compiler.importers.stage_options import StageOptions
    from ...compiler.plan import plan as planner
    from ...lang.diagnostics import Diagnostics
    from ...render import render_scene
    from ...render.image import image_files

    diagnostics, picture = Diagnostics(), output / record.picture
    stage = StageOptions(complexity=looks.complexity, conform="expand", size=record.size, as_asset=True)
    usd = asset.path.suffix.lower() in file_types.USD
    scene = load.load(asset.path, allow=looks.allow, diagnostics=diagnostics, stage=stage if usd else None)
    own_light = not any(text.startswith("sun") for text in scene.defaults)
    background = None if asset.path.suffix.lower() in file_types.SCENE else "transparent"
    settings = ir.Settings(size=record.size, samples=SAMPLES, threads=1, background=background)
    plan = planner.make_plan(replace(scene, photometric=own_light), settings)
    image = render_scene.draw(scene, plan)
    exposure = plan["exposure"]
    if exposure == "metered":
        exposure = image_files.auto_exposure(image.channels["rgba"], int(image.metadata.get("threads", 0)))
    make_folder(picture.parent, output)
    image_files.write(image, picture, image_files.Look.of(plan, exposure, alpha=True), {"version": __version__})
    record.triangles, record.instances = len(scene.tables.pools.triangles), len(scene.tables.instances.geometry)
    record.made_from = {file: _changed(Path(file)) for file in dict.fromkeys((str(asset.path), *scene.files))}
    record.warnings = [f"{d.span}: {d.message}" if d.span else d.message for d in diagnostics.items if d.severity == "warning"]


def _print(thumbnail: Thumbnail) -> None:
    if thumbnail.error:
        click.echo(f"{thumbnail.path}: error: {thumbnail.error}", err=True)
        return
    for warning in thumbnail.warnings:
        click.echo(f"warning: {warning}", err=True)
    click.echo(f"{thumbnail.picture}: {thumbnail.triangles:,} triangles, {thumbnail.instances:,} instances, {thumbnail.seconds:.2f} s")


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Assets</title><style>
body {{ font: 14px sans-serif; margin: 1em; background: #f4f4f4; color: #222 }}
main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(15em, 1fr)); gap: 1em }}
figure {{ margin: 0; padding: 0.5em; background: #fff; border: 1px solid #ddd }}
img {{ width: 100%; background: #e8e8e8 }}
figcaption {{ overflow-wrap: anywhere }}
small {{ color: #666 }}
li {{ color: #946200 }}
.error {{ color: #b00020 }}
</style></head><body><h1>{count} assets</h1><main>
{figures}
</main></body></html>
"""


def index_page(thumbnails: Sequence[Thumbnail]) -> str:
    """The HTML page of thumbnails."""
    return _PAGE.format(count=len(thumbnails), figures="\n".join(map(_figure, thumbnails)))


def _figure(thumbnail: Thumbnail) -> str:
    name = html.escape(thumbnail.name)
    if thumbnail.error:
        return f'<figure><figcaption><b>{name}</b><p class="error">{html.escape(thumbnail.error)}</p></figcaption></figure>'
    notes = "".join(f"<li>{html.escape(text)}</li>" for text in thumbnail.warnings)
    facts = f"{thumbnail.triangles:,} triangles, {thumbnail.instances:,} instances, {thumbnail.seconds:.2f} s"
    link = html.escape(thumbnail.picture, quote=True)
    image = f'<a href="{link}"><img src="{link}" alt="{name}" width="{thumbnail.size[0]}" height="{thumbnail.size[1]}" loading="lazy"></a>'
    return f"<figure>{image}<figcaption><b>{name}</b><br><small>{facts}</small><ul>{notes}</ul></figcaption></figure>"
