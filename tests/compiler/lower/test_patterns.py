"""Patterns with coordinates, normals, pictures, MaterialX's noise and other patterns: their values, and messages about wrong ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.formula.tape import load_tape
from maquette.compiler.load import load
from maquette.compiler.texture_graph import evaluate
from maquette.compiler.texture_graph.opcodes import is_graph
from maquette.lang.diagnostics import SceneError

from ...files import write_image

VIEW = "camera([0, 1, 5])\nsun()\n"
TEXELS = np.array([[[0.75, 0.375, 0.1875, 0.75]]], np.float32)  # 1, 0.5, 0.25 times alpha, as OpenEXR has them
OTHER = np.array([[[0.5, 0.25, 0.125]]], np.float32)
POINTS = np.array([[0.31, -0.52, 1.7, 0.25, 0.6, 0.6, 0.64, 0.48], [-0.4, 0.2, 0.1, 0.8, 0.1, 0.0, 1.0, 0.0]])
Compile = Callable[..., ir.Scene]


@pytest.fixture
def values(compiled: Compile, tmp_path: Path) -> Callable[..., Any]:
    """The values (points, results) of a pattern at POINTS. Its pictures `p` and `q` are 1 × 1 texels of floats."""
    write_image(tmp_path / "p.exr", TEXELS)
    write_image(tmp_path / "q.exr", OTHER)

    def run(pattern: str, before: str = "") -> Any:
        lets = (
            '\nlet p = image("p.exr")\nlet q = image("q.exr", gain: rgb(1, 2, 4), bias: 0.25)\nlet alpha = image("p.exr", channel: "a")\n'
        )
        scene = compiled(f"{before}{lets}assert(len([p, q, alpha]) == 3)\nsphere(1, material: lambert({pattern}))\n{VIEW}")
        tables = scene.tables
        tape = load_tape(tables, int(tables.textures.tape[tables.materials.textures[0, ir.Slot.DIFFUSE]]))

        def look(texture: int, s: Any, t: Any) -> Any:
            image = int(tables.textures.image[texture])
            return tables.images.texels[int(tables.images.first[image])].astype(float)

        return np.array(evaluate.results(tape, list(POINTS.T), look)).T

    return run


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("pattern(|u, v| rgb(u, v, 0.5))", lambda x, y, z, u, v, nx, ny, nz: (u, v, 0.5)),
        ("pattern(|x, y, z, u, v| x + 2 * v)", lambda x, y, z, u, v, nx, ny, nz: (x + 2 * v,)),
        ("pattern(|x, y, z, u, v, a, b, c| rgb(abs(a), b, c))", lambda x, y, z, u, v, nx, ny, nz: (abs(nx), ny, nz)),
        ("pattern(|u, v| u > v)", lambda x, y, z, u, v, nx, ny, nz: (float(u > v),)),
        ("pattern(|u, v| u <= v and not (u == v) or u > 0.7)", lambda x, y, z, u, v, nx, ny, nz: (float(u < v or u > 0.7),)),
        ("pattern(|u, v| if u != v then (u - 1) ^ 2 else 0)", lambda x, y, z, u, v, nx, ny, nz: ((u - 1) ** 2,)),
        (
            "pattern(|u, v| mod(7 * u, 1) + round(v) / (1 + u))",
            lambda x, y, z, u, v, nx, ny, nz: (7 * u % 1 + np.floor(v + 0.5) / (1 + u),),
        ),
        ("pattern(|u, v| p(u, v))", lambda *_: (1.0, 0.5, 0.25)),
        ("pattern(|x, y, z| p(x, y).g * alpha(x, z))", lambda *_: (0.5 * 0.75,)),
        ("pattern(|x, y, z| p(0.5, 0.5) + 0 * cellnoise_color(1, 2, 3))", lambda *_: (1.0, 0.5, 0.25)),
        ("pattern(|u, v| q(u, v))", lambda *_: (0.75, 0.75, 0.75)),
        ("pattern(|u, v| lerp(p(u, v), #000000, 0.5 + 0 * u))", lambda *_: (0.5, 0.25, 0.125)),
        ("pattern(|u, v| if u > 0.5 then p(u, v) else q(v, u))", lambda x, y, z, u, *_: (1.0, 0.5, 0.25) if u > 0.5 else (0.75,) * 3),
    ],
)
def test_values(values: Callable[..., Any], pattern: str, expected: Callable[..., tuple[float, ...]]) -> None:
    np.testing.assert_allclose(values(pattern), [expected(*point) for point in POINTS], rtol=1e-6)


def test_noise_is_that_of_materialx(values: Callable[..., Any]) -> None:
    spread = np.concatenate([
        values("pattern(|x, y, z| perlin(9 * x, 9 * y, 9 * z))"), values("pattern(|x, y, z| perlin(9 * x, 9 * y))"),
        values("pattern(|x, y, z| perlin_color(9 * x, 9 * y, 9 * z))"), values("pattern(|u, v| perlin_color(9 * u, 9 * v))"),
    ], axis=1)  # fmt: skip
    assert (np.abs(spread) < 1.01).all()
    assert spread.std() > 0.1
    cells = values("pattern(|x, y, z| rgb(cellnoise(9 * x), cellnoise(9 * x, 9 * y), cellnoise(9 * x, 9 * y, 9 * z)))")
    random = values("pattern(|x, y, z| cellnoise_color(9 * x, 9 * y, 9 * z))")
    assert ((cells >= 0.0) & (cells <= 1.0)).all()
    assert ((random >= 0.0) & (random <= 1.0)).all()
    assert len({*cells.ravel().tolist(), *random.ravel().tolist()}) == 12


def test_a_pattern_is_called_in_another(values: Callable[..., Any]) -> None:
    inner = "let inner = pattern(|x, y, z, u, v| rgb(x, y, z) * u + p(u, v) * v)\n"
    outer = values("pattern(|x, y, z, u, v| 0.5 * inner(2 * y, x, z, v, u))", inner)
    expected = [0.5 * (np.array([2 * y, x, z]) * v + np.array([1.0, 0.5, 0.25]) * u) for x, y, z, u, v, *_ in POINTS]
    np.testing.assert_allclose(outer, expected, rtol=1e-6)
    truth = values("pattern(|x, y, z| 3 * pattern(|x, y, z| x > 0)(x, y, z))")
    np.testing.assert_array_equal(truth, [[3.0], [0.0]])


def test_units_of_both_files_count(compiled: Compile, tmp_path: Path) -> None:
    (tmp_path / "lib.scene").write_text("unit mm\nlet stripes = pattern(|x, y, z, u, v| mod(x, 10) + 100 * u)\n", encoding="utf-8")
    scene = compiled(
        'unit cm\nuse "lib.scene"\nsphere(1, material: lambert(pattern(|x, y, z, u, v| lib.stripes(x, y, z, u, v) + 1000 * x)))\n' + VIEW
    )
    tape = load_tape(scene.tables, 0)
    (result,) = evaluate.results(tape, list(POINTS.T), lambda *_: ())
    x, u = POINTS.T[0], POINTS.T[3]  # in metres
    np.testing.assert_allclose(result, np.mod(1000.0 * x, 10.0) + 100.0 * u + 1e5 * x, rtol=1e-9)


def test_patterns_of_the_point_alone_stay_formulas(compiled: Compile) -> None:
    scene = compiled("sphere(1, material: lambert(pattern(|x, y, z| abs(noise(x, y, z)))))\n" + VIEW)
    tape = load_tape(scene.tables, 0)
    assert not is_graph(tape.code, tape.results)


@pytest.fixture
def errors(tmp_path: Path) -> Callable[[str], list[str]]:
    """The errors of a scene, each with its fix in parentheses."""
    write_image(tmp_path / "p.exr", TEXELS)

    def run(text: str) -> list[str]:
        path = tmp_path / "a.scene"
        path.write_text(f"{text}\n{VIEW}", encoding="utf-8")
        with pytest.raises(SceneError) as raised:
            load(path)
        return [d.message + (f" ({d.hint})" if d.hint else "") for d in raised.value.diagnostics if d.severity == "error"]

    return run


def test_values_outside_of_formulas_are_refused_before_and_after(errors: Callable[[str], list[str]]) -> None:
    text = 'let p = image("p.exr")\nlet c = p(0.5, 0.5)\nlet a = lambert(pattern(|u, v| c * u))\nlet b = lambert(pattern(|u, v| c * v))'
    hint = "the texture `image` has values inside of a pattern alone (write pattern(|x, y, z, u, v| …) around it)"
    assert errors(f"{text}\nsphere(1, material: a)\nsphere(1, material: b)") == [hint]


@pytest.mark.parametrize(
    ("material", "message"),
    [
        (
            "lambert(pattern(|x, z| x))",
            "the parameters of this pattern are u, v: `x` stands at the place of u "
            "(write |x, y, z|, |u, v|, |x, y, z, u, v| or |x, y, z, u, v, nx, ny, nz|)",
        ),
        (
            "lambert(pattern(|a| a))",
            "a pattern's formula has two, three, five or eight parameters, not 1 "
            "(write |x, y, z|, |u, v|, |x, y, z, u, v| or |x, y, z, u, v, nx, ny, nz|)",
        ),
        ("lambert(pattern(|u, v| [u, v, 0]))", "a pattern here gives a number or a colour, not a list (write rgb(r, g, b))"),
        ('metal("gold", roughness: pattern(|u, v| rgb(u, v, 0)))', "a pattern here gives a number, not a color"),
        (
            "lambert(pattern(|u, v| checker()(u, v)))",
            "a formula has no values of the texture `checker` (image(…)(u, v) and pattern(…)(x, y, z) have values there)",
        ),
        ('lambert(pattern(|u, v| image("p.exr")(u)))', "this image takes 2 coordinates, got 1 (write image(…)(u, v))"),
        ('lambert(pattern(|u, v| image("p.exr")(u, v: v)))', "coordinates of a texture have no names (write image(…)(u, v))"),
        ('lambert(pattern(|u, v| image("p.exr")(u, "v")))', 'expected number, got the string "v"'),
        (
            'lambert(pattern(|u, v| image("p.exr", mapping: "latlong")(u, v)))',
            "a picture in a formula is placed by its coordinates (leave out `mapping`)",
        ),
        (
            'lambert(image("p.exr")(0.5, 0.5))',
            "the texture `image` has values inside of a pattern alone (write pattern(|x, y, z, u, v| …) around it)",
        ),
        (
            "lambert(pattern(|x, y, z| x)(1, 2, 3))",
            "the texture `pattern` has values inside of a pattern alone (write pattern(|x, y, z, u, v| …) around it)",
        ),
        ("lambert(perlin(0.5, 0.5))", "perlin has values inside of a pattern alone (noise(x, y, z, seed) has them everywhere)"),
        ("lambert(pattern(|u, v| cellnoise(u, z: v)))", "cellnoise has no y here (write cellnoise(x, y, z))"),
        ('lambert(pattern(|u, v| image("none.png")(u, v)))', "there is no picture `none.png` (looked in {folder})"),
    ],
)
def test_what_is_said(errors: Callable[[str], list[str]], tmp_path: Path, material: str, message: str) -> None:
    assert errors(f"sphere(1, material: {material})") == [message.format(folder=tmp_path)]


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (
            "implicit(|x, y, z| perlin(x, y, z) <= 0, within: 2)",
            "perlin has values in patterns of materials alone (write noise(x, y, z) here)",
        ),
        ('implicit(|x, y, z| image("p.exr")(x, y).r <= 0, within: 2)', "a picture is looked up in patterns of materials alone"),
        (
            "heightfield(|x, z| cellnoise(x, z), size: 1)",
            "cellnoise has values in patterns of materials alone (write noise(x, y, z) here)",
        ),
        (
            "sphere(1, medium: medium(depth: 1, density: |x, y, z| 1 + perlin(x, y, z)))",
            "perlin has values in patterns of materials alone (write noise(x, y, z) here)",
        ),
        ("dome(pattern: |x, y, z| perlin(x, y, z))", "perlin has values in patterns of materials alone (write noise(x, y, z) here)"),
    ],
)
def test_other_formulas_refuse_what_patterns_alone_have(errors: Callable[[str], list[str]], item: str, message: str) -> None:
    assert errors(item) == [message]


def test_the_fix_has_the_name_of_the_picture(errors: Callable[[str], list[str]]) -> None:
    text = 'let wood = image("p.exr")\nsphere(1, material: lambert(pattern(|u, v| wood(u))))'
    assert errors(text) == ["this image takes 2 coordinates, got 1 (write wood(u, v))"]


def test_a_graph_of_too_many_operations_is_refused(errors: Callable[[str], list[str]]) -> None:
    text = "sphere(1, material: lambert(pattern(|u, v| fold(|sum, k| sum + perlin(k * u, v), 0, 1..2000))))"
    assert errors(text) == ["the graph has more than 2040 operations"]
