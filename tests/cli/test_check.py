"""The `check` command on files that have more than is drawn."""

from click.testing import CliRunner
from maquette.cli.main import cli


def test_strict_counts_warnings_as_errors(tmp_path):
    stage = tmp_path / "x.usda"
    stage.write_text('#usda 1.0\ndef Cube "c" {\n}\ndef TetMesh "n" {\n}\n')
    plain = CliRunner().invoke(cli, ["check", str(stage)])
    assert (plain.exit_code, plain.stdout) == (0, f"{stage}: no errors\n")
    assert plain.stderr == f"{stage}</n>: warning: TetMesh is not drawn\n"
    strict = CliRunner().invoke(cli, ["check", str(stage), "--strict"])
    assert (strict.exit_code, strict.stdout) == (1, f"{stage}: 1 error\n")
    assert strict.stderr == f"{stage}</n>: error: TetMesh is not drawn\n"
