"""The `lsp` command: the language server of editors."""

from __future__ import annotations

from pathlib import Path

import click

from .. import common_options as shared


@click.command("lsp")
@click.option("--stdio", is_flag=True, expose_value=False, help="Speak over stdin and stdout: the default. Some editors pass it.")
@shared.allow
@shared.examples("maquette lsp --stdio", "maquette lsp --allow ~/textures")
def command(allow: tuple[Path, ...]) -> None:
    """Serve an editor: errors while typing, completion, docs, renames.

    Speaks the Language Server Protocol over stdin and stdout. Editors start it: docs/editors.md has the settings of VS Code, Neovim,
    Emacs and Helix.
    """
    from ...live.lsp import server

    server.serve(allow)
