"""Tests of colour spaces: their matrices against published values and properties, and their names."""

import itertools

import pytest
from maquette.lang import color_spaces as spaces

ALL = {"rec709": spaces.REC709, "rec2020": spaces.REC2020, "p3": spaces.P3, "adobe": spaces.ADOBE, "ap1": spaces.AP1, "ap0": spaces.AP0}


def times(matrix: spaces.Matrix, color: spaces.Row) -> list[float]:
    return [sum(m * c for m, c in zip(row, color, strict=True)) for row in matrix]


def test_published_matrices() -> None:
    """Rec.709 to ACEScg by Bradford, as in the configurations of ACES, and to Rec.2020, as in ITU-R BT.2087."""
    to_acescg = [[0.6130974, 0.3395231, 0.0473795], [0.0701937, 0.9163539, 0.0134524], [0.0206156, 0.1095698, 0.8698146]]
    to_rec2020 = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    for target, expected, digits in ((spaces.AP1, to_acescg, 1e-7), (spaces.REC2020, to_rec2020, 6e-5)):
        for row, known in zip(spaces.matrix(spaces.REC709, target), expected, strict=True):
            assert row == pytest.approx(known, abs=digits)


@pytest.mark.parametrize(("source", "target"), list(itertools.permutations(ALL, 2)))
def test_white_stays_white_and_the_way_back_is_the_inverse(source: str, target: str) -> None:
    there, back = spaces.matrix(ALL[source], ALL[target]), spaces.matrix(ALL[target], ALL[source])
    assert times(there, (1.0, 1.0, 1.0)) == pytest.approx([1.0] * 3, abs=1e-12)
    assert times(back, tuple(times(there, (0.2, 0.7, 0.4)))) == pytest.approx([0.2, 0.7, 0.4], abs=1e-12)  # type: ignore[arg-type]


def test_y_of_primaries() -> None:
    """The middle row of the matrix to XYZ is luminance: that of Rec.709 in ITU-R BT.709."""
    assert spaces.to_xyz(spaces.REC709)[1] == pytest.approx((0.2126, 0.7152, 0.0722), abs=5e-5)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("sRGB", "srgb"), ("srgb_texture", "srgb"), ("sRGB - Texture", "srgb"), ("sRGB Encoded Rec.709 (sRGB)", "srgb"),
        ("linear", "lin_rec709"), ("Linear Rec.709 (sRGB)", "lin_rec709"), ("Utility - Linear - sRGB", "lin_rec709"),
        ("ACEScg", "acescg"), ("ACES - ACEScg", "acescg"), ("lin_ap1", "acescg"), ("ACES2065-1", "aces2065_1"),
        ("Linear Rec.2020", "lin_rec2020"), ("g22_rec709", "g22_rec709"), ("Non-Color", "raw"), ("Utility - Raw", "raw"), ("data", "raw"),
    ],
)  # fmt: skip
def test_names(name: str, expected: str) -> None:
    space = spaces.find(name)
    assert space is not None
    assert space.name == expected


def test_other_names_are_not_known() -> None:
    assert [spaces.find(name) for name in ("", "auto", "Filmic Log", "acesc")] == [None] * 4
    assert all(spaces.find(name) is not None for name in (*spaces.NAMES, *spaces.WORKING))


@pytest.mark.parametrize(
    "odd",
    [
        (0.0,) * 8, (float("nan"),) * 8, (0.3127, 0.329) * 4, (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.0),
        (0.64, 0.33, 0.3, 0.6, 0.47, 0.465, 0.3127, 0.329), (1e30,) * 8, (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.47, 0.465),
    ],
)  # fmt: skip
def test_chromaticities_that_are_of_no_space(odd: spaces.Chromaticities) -> None:
    """Zeros, no numbers, four equal points, a white without Y, primaries on one line, huge ones, and a white on an edge of the triangle."""
    with pytest.raises(ValueError, match="chromaticities are not of a colour space"):
        spaces.matrix(odd, spaces.REC709)


def test_primaries_by_rounded_values() -> None:
    rounded = tuple(float(f"{v:.4g}") for v in spaces.AP1)
    assert spaces.named(rounded) == "acescg"  # type: ignore[arg-type]
    assert spaces.named((0.6, 0.3, 0.3, 0.6, 0.2, 0.1, 0.3127, 0.329)) == ""
