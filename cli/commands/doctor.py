"""The command `doctor`: checks the installation, and prints versions, caches and missing packages."""

from __future__ import annotations

import json

import click

from .. import common_options as shared


@click.command("doctor")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@shared.examples("maquette doctor --json")
@click.pass_context
def command(ctx: click.Context, as_json: bool) -> None:
    """Show what this installation renders with.

    Prints versions, the instruction set, the cache of kernels, prebuilt kernels and missing packages. The exit code is 1 if something
    prevents rendering.
    """
    from .. import installation

    findings = installation.findings()
    ready = all(finding.state != "error" for finding in findings)
    if as_json:
        rows = [{"name": f.name, "state": f.state, "text": f.text, **f.data} for f in findings]
        click.echo(json.dumps({"ready": ready, "findings": rows}, indent=2))
    else:
        width = max(len(finding.name) for finding in findings)
        for finding in findings:
            mark = "" if finding.state == "ok" else f"{finding.state}: "
            click.echo(f"{finding.name:<{width}}  {mark}{finding.text}")
    ctx.exit(0 if ready else 1)
