"""Packages that cannot be read: each error has its reason."""

import io
import zipfile

import pytest
from maquette.compiler.importers.usd.layers import packages

from .. import stages

SPHERE = '#usda 1.0\ndef Sphere "s" {}\n'
AGAIN = "\n  copy or export it again"
CUT_OFF = "it is cut off: the list of files at the end of the zip archive is missing"
NO_LAYER = "it holds no layer: no .usda, .usdc or .usd file"


def package(files):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return made.getvalue()


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "it is empty"),
        (b"rubbish", f"it is not a zip archive{AGAIN}"),
        (b"PK\3\4rubbish", f"{CUT_OFF}{AGAIN}"),
        (package({}), f"{NO_LAYER}{AGAIN}"),
        (package({"a.txt": "text"}), f"{NO_LAYER}{AGAIN}"),
    ],
    ids=["empty", "rubbish", "cut off", "no file", "no layer"],  # archives hold the time
)
def test_a_package_that_cannot_be_read_has_a_reason(tmp_path, data, reason):
    path = tmp_path / "x.usdz"
    path.write_bytes(data)
    assert stages.load(path)[1] == [f"x.usdz: error: cannot read the stage `x.usdz`: {reason}"]


def test_a_package_without_its_list_of_files_is_drawn_with_a_warning(tmp_path):
    path = tmp_path / "x.usdz"
    data = package({"a.usda": SPHERE})
    path.write_bytes(data[: data.index(b"PK\1\2")])
    assert stages.load(path)[1] == [f"x.usdz: warning: the package may lack files: {CUT_OFF}{AGAIN}"]


def test_the_reason_of_the_system(tmp_path, monkeypatch):
    path = tmp_path / "x.usdz"
    path.write_bytes(package({"a.usda": SPHERE}))
    assert packages.fault_of(path) == ""

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    assert packages.fault_of(path) == "Permission denied"
