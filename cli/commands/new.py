"""The `new` command: writes a starter scene from a template, or one that shows a mesh or USD file."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from ...compiler.io.replace_file import replace_file
from ...lang import file_types
from .. import common_options as shared
from .. import render_job as jobs

_TEMPLATES = Path(__file__).parents[2] / "stdlib" / "new"
KINDS = {"still": "a still life in the sun", "room": "a lit room", "part": "a 3D-printable part", "formula": "an implicit surface"}
_MESH = 'mesh("FILE", height: 1m, material: lambert(#c8c2b8))'  # in thing.scene


@click.command("new")
@click.argument("name", type=click.Path(path_type=Path))
@click.option(
    "--from", "source", default="still", metavar="KIND|FILE",
    help="; ".join(f"{kind}: {what}" for kind, what in KINDS.items()) + "; or a mesh or USD file to show. Default: still.",
)
@shared.examples("maquette new vase", "maquette new lamp --from room", "maquette new chair --from models/chair.obj")
def command(name: Path, source: str) -> None:
    """Write the starter scene NAME.scene. An existing file is not changed."""
    path = name if name.suffix == ".scene" else name.with_name(f"{name.name}.scene")
    text = _text(path, source)
    jobs.check_folder(path)
    if os.path.lexists(path):
        raise FileExistsError(f"{path} exists already: choose another name")
    replace_file(path, text.encode())
    click.echo(f"{path}: see it with  maquette watch {path} -o {path.with_suffix('.png')}")


def _text(path: Path, source: str) -> str:
    if source in KINDS:
        text = (_TEMPLATES / f"{source}.scene").read_text(encoding="utf-8")
    else:
        file = Path(source)
        ending = file.suffix.lower()
        if ending not in file_types.MESH + file_types.USD:
            endings = " ".join(file_types.MESH + file_types.USD)
            raise click.UsageError(f"--from is one of {', '.join(KINDS)}, or a file that ends in {endings}")
        if not file.is_file():
            raise FileNotFoundError(f"there is no file {file}")
        shown = os.path.relpath(file.resolve(), path.resolve().parent)
        if shown.startswith(os.pardir):
            raise PermissionError(f"a scene reads files below its own folder: put {path.name} in the folder of {file.name} or above")
        written = json.dumps(Path(shown).as_posix(), ensure_ascii=False)
        thing = _MESH.replace('"FILE"', written) if ending in file_types.MESH else f"usd({written})"
        text = (_TEMPLATES / "thing.scene").read_text(encoding="utf-8").replace(_MESH, thing)
    return text.replace("NAME", path.stem)
