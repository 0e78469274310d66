"""Tests of configurations of OpenColorIO: values of views, colour spaces of pictures, and configurations that are refused."""

from pathlib import Path

import numpy as np
import pytest
from maquette.compiler.io import color_config, color_encoding, environment
from maquette.lang import color_spaces

CG = "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5"
OLD = "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1"
LIGHT = np.array([[[0.18, 0.18, 0.18], [1.0, 0.5, 0.25], [4.0, 0.1, 0.05], [0.02, 0.3, 0.9]]])
HEAD = "ocio_profile_version: 2\nsearch_path: luts\n"
BODY = """
roles: {scene_linear: lin, default: lin, aces_interchange: ap0}
displays:
  screen:
    - !<View> {name: plain, colorspace: out}
    - !<View> {name: table, colorspace: graded}
active_displays: []
active_views: []
looks:
  - !<Look> {name: dim, process_space: lin, transform: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}}
colorspaces:
  - !<ColorSpace> {name: lin, isdata: false}
  - !<ColorSpace> {name: ap0, from_scene_reference: !<MatrixTransform> {matrix: [MATRIX]}}
  - !<ColorSpace> {name: out, from_scene_reference: !<ExponentTransform> {value: [2, 2, 2, 1], direction: inverse}}
  - !<ColorSpace> {name: graded, from_scene_reference: !<FileTransform> {src: SOURCE}}
"""
CUBE = "LUT_3D_SIZE 2\n" + "".join(f"{r / 2} {g / 2} {b / 2}\n" for b in (0, 1) for g in (0, 1) for r in (0, 1))


def written(folder: Path, source: str = "half.cube", head: str = HEAD) -> str:
    """A configuration whose reference is linear Rec.709, and a table beside it."""
    rows = [[*row, 0.0] for row in color_spaces.matrix(color_spaces.REC709, color_spaces.AP0)]
    matrix = ", ".join(f"{v:.9g}" for row in [*rows, [0, 0, 0, 1]] for v in row)
    (folder / "luts").mkdir(exist_ok=True)
    (folder / "luts" / "half.cube").write_text(CUBE, encoding="ascii")
    path = folder / "config.ocio"
    path.write_text(head + BODY.replace("MATRIX", matrix).replace("SOURCE", source), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("name", "view", "expected"),
    [
        (CG, "ACES 2.0 - SDR 100 nits (Rec.709)",
         [[0.349188] * 3, [0.724308, 0.57184, 0.460304], [1.0, 0.489175, 0.405534], [0.166374, 0.453939, 0.726249]]),
        (OLD, "ACES 1.0 - SDR Video",
         [[0.355952] * 3, [0.820291, 0.656699, 0.481948], [1.0, 0.541139, 0.290745], [0.0, 0.49626, 0.791464]]),
    ],
)  # fmt: skip
def test_values_of_the_cpu_processor_of_opencolorio(name: str, view: str, expected: list[list[float]]) -> None:
    """`expected` are those of PyOpenColorIO 2.6.0 for a DisplayViewTransform from linear Rec.709, clipped to 0 … 1."""
    shown = color_config.opened(name).show(LIGHT, "sRGB - Display", view, "")
    assert shown[0] == pytest.approx(np.array(expected), abs=3e-6)


def test_a_view_without_tone_mapping_is_the_srgb_curve() -> None:
    shown = color_config.opened(CG).show(LIGHT, "", "Un-tone-mapped", "")
    clipped = np.minimum(LIGHT, 1.0)
    assert shown == pytest.approx(1.055 * clipped ** (1 / 2.4) - 0.055, abs=6e-6)  # OpenColorIO approximates powers


def test_the_views_looks_and_tables_of_a_file(tmp_path: Path) -> None:
    config = color_config.opened(written(tmp_path))
    assert (config.displays, config.views(), config.looks, config.default_view()) == (("screen",), ("plain", "table"), ("dim",), "plain")
    dark = LIGHT / 4.0
    assert config.show(dark, "screen", "plain", "") == pytest.approx(np.sqrt(dark), abs=1e-5)
    assert config.show(dark, "screen", "plain", "dim") == pytest.approx(np.sqrt(dark / 2.0), abs=1e-5)
    assert config.show(dark, "screen", "table", "") == pytest.approx(dark / 2.0, abs=1e-5)
    config.check("screen", "table", "dim")


def test_colour_spaces_of_pictures(tmp_path: Path) -> None:
    config = color_config.opened(written(tmp_path))
    encoding = color_encoding.find("out", integers=True, config=config)
    assert encoding.convert(LIGHT.astype(np.float32)) == pytest.approx(np.abs(LIGHT) ** 2, rel=5e-5)
    assert color_encoding.is_known("graded", config)
    assert not color_encoding.is_known("graded")


def test_names_that_it_does_not_have(tmp_path: Path) -> None:
    config = color_config.opened(written(tmp_path))
    for arguments, message in (
        (("monitor", "plain", ""), "no display is called `monitor`; there are: screen"),
        (("", "plain", "bright"), "no look is called `bright`; there are: dim"),
    ):
        with pytest.raises(color_config.ConfigError) as refused:
            config.check(*arguments)
        assert str(refused.value) == message


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("absent.cube", "failed: The specified file reference 'absent.cube' could not be located"),
        ("../secret.cube", "reads `../secret.cube`, which lies outside of its folder"),
        ("../../secret.cube", "reads `../../secret.cube`, which lies outside of its folder"),
        ("/etc/passwd", "reads `/etc/passwd`, which lies outside of its folder"),
        ('"/etc/passwd"', "reads `/etc/passwd`, which lies outside of its folder"),
        ("link.cube", "reads `link.cube`, which lies outside of its folder"),
        ("$HOME.cube", "a look-up table has a variable in its name: `$HOME.cube`"),
        ('"\\x2fetc/passwd"', "names its look-up tables in a form that is not read"),
        ("*anchor", "names its look-up tables in a form that is not read"),
        ("\n      /etc/passwd", "reads `/etc/passwd`, which lies outside of its folder"),
    ],
)
def test_tables_that_are_missing_or_lie_elsewhere(tmp_path: Path, source: str, message: str) -> None:
    folder = tmp_path / "config"
    folder.mkdir()
    (tmp_path / "secret.cube").write_text(CUBE, encoding="ascii")
    name = written(folder, source)
    (folder / "luts" / "link.cube").symlink_to(tmp_path / "secret.cube")
    with pytest.raises(color_config.ConfigError) as refused:
        color_config.opened(name).check("screen", "table", "")
    assert message in str(refused.value)


@pytest.mark.parametrize("search", ["search_path: /etc\n", "search_path: [luts, ..]\n", "search_path:\n  - luts\n  - ../..\n"])
def test_search_paths_that_lead_elsewhere(tmp_path: Path, search: str) -> None:
    with pytest.raises(color_config.ConfigError, match="which lies outside of its folder"):
        color_config.opened(written(tmp_path, head=f"ocio_profile_version: 2\n{search}"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "there is no such file"), ("", "cannot be read"), ("ocio_profile_version: 2\n - : : [", "illegal map value"),
        ("ocio_profile_version: 99\n", "cannot be read"), ("\xff\x00", "cannot be read"),
    ],
)  # fmt: skip
def test_files_that_are_no_configuration(tmp_path: Path, text: str | None, message: str) -> None:
    path = tmp_path / "config.ocio"
    if text is not None:
        path.write_bytes(text.encode("latin-1"))
    with pytest.raises(color_config.ConfigError) as refused:
        color_config.opened(str(path))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_a_device_and_a_wrong_address(tmp_path: Path) -> None:
    for name in (str(tmp_path), "/dev/zero", "ocio://nothing"):
        with pytest.raises(color_config.ConfigError, match="cannot be read"):
            color_config.opened(name)


def test_the_variable_ocio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OCIO", raising=False)
    assert (environment.color_config(), environment.color_config_folder(None)) == ("ocio://default", None)
    assert color_config.of_pictures() is None
    monkeypatch.setenv("OCIO", written(tmp_path))
    config = color_config.of_pictures()
    assert config is not None
    assert config.displays == ("screen",)
    assert environment.color_config_folder(None) == tmp_path
    assert environment.color_config(CG) == CG
