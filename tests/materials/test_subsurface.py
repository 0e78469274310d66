"""Bodies with a medium inside: the inversion of their colour, their rows and substitutes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.materials import subsurface, traits

REST = "\ncamera([0, 1, 5])\nsun()\n"
FREE_PATH = {0.0: 4.14, 0.2: 2.96, 0.5: 1.715, 0.8: 1.1, 1.0: 1.04}  # over the radius: equation 8 of Chiang and others 2016


def grey(value: float) -> tuple[float, float, float]:
    return (value, value, value)


@pytest.mark.parametrize("color", FREE_PATH)
@pytest.mark.parametrize("radius", [0.001, 0.02, 3.0])
def test_the_mean_free_path_of_a_colour(color: float, radius: float) -> None:
    scattering, absorption = subsurface.coefficients(grey(color), grey(radius))
    assert np.allclose(np.add(scattering, absorption), 1 / (FREE_PATH[color] * radius))
    assert min(absorption) >= 0.0


def albedo_of_half_space(single: float) -> float:
    """The share of diffuse light that a half space of even scattering sends back: 1 − 2 √(1 − ϖ) ∫ μ H(μ) dμ (Chandrasekhar 1950)."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu, weights, h = 0.5 * (nodes + 1), 0.5 * weights, np.ones(64)
    for _ in range(500):
        h = 1 / (np.sqrt(1 - single) + 0.5 * single * ((mu * h * weights) / (mu[:, None] + mu)).sum(axis=1))
    return float(1 - 2 * np.sqrt(1 - single) * (h * mu * weights).sum())


@pytest.mark.parametrize("color", [0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95])
def test_a_half_space_has_its_colour(color: float) -> None:
    scattering, absorption = subsurface.coefficients(grey(color), grey(0.01))
    assert albedo_of_half_space(scattering[0] / (scattering[0] + absorption[0])) == pytest.approx(color, rel=5e-3)


def test_brighter_bodies_scatter_more() -> None:
    colors = np.linspace(0, 1, 50)
    albedos = [scattering[0] / (scattering[0] + absorption[0]) for scattering, absorption in (
        subsurface.coefficients(grey(c), grey(1.0)) for c in colors.tolist()
    )]  # fmt: skip
    assert (np.diff(albedos) > 0).all()
    assert albedos[-1] < 1


def test_a_body_has_a_medium_by_channel(compiled) -> None:
    tables = compiled("sphere(1, material: subsurface(rgb(0.8, 0.5, 0.2), radius: [10mm, 5mm, 2mm]))" + REST).tables
    row = int(tables.instances.material[0])
    assert tables.materials.model[row] == ir.MaterialModel.SUBSURFACE
    assert tables.materials.values[row, ir.Slot.AMBIENT].tolist() == [0.8, 0.5, 0.2]
    assert tables.materials.values[row, ir.Slot.DIFFUSE_TRANSMISSION].tolist() == [1, 1, 1]
    extinction = (tables.media.scattering + tables.media.absorption)[tables.materials.medium[row]]
    assert np.allclose(extinction, [1 / (1.1 * 0.01), 1 / (1.715 * 0.005), 1 / (2.96 * 0.002)])
    assert traits.translucent(tables)[row]
    assert tables.instances.visible[0] == 7


def test_without_media_a_body_is_a_diffuse_surface(compiled) -> None:
    tables = compiled("sphere(1, material: subsurface(#ff8000))\nbox(1, material: glass(), medium: medium())" + REST).tables
    drawn = subsurface.diffuse_substitute(tables)
    row, other = tables.instances.material.tolist()
    assert drawn.materials.model[row] == ir.MaterialModel.LAMBERT
    assert drawn.materials.values[row, ir.Slot.DIFFUSE].tolist() == tables.materials.values[row, ir.Slot.AMBIENT].tolist()
    assert not drawn.materials.values[row, ir.Slot.DIFFUSE_TRANSMISSION].any()
    assert (drawn.materials.medium[row], drawn.materials.medium[other]) == (-1, tables.materials.medium[other])
    assert subsurface.diffuse_substitute(drawn) is drawn


def test_a_blend_with_a_body_has_its_medium(compiled) -> None:
    tables = compiled("sphere(1, material: blend(lambert(), subsurface(), 0.7))" + REST).tables
    row = int(tables.instances.material[0])
    assert tables.materials.medium[row] == tables.materials.medium[tables.materials.second[row]] >= 0


TOLD = {
    "disk(1, material: subsurface())": (
        "warning: this disk has no thickness: light that enters its material does not find the other side"
    ),
    "sphere(1, material: subsurface(), medium: medium())": (
        "error: the material of this sphere has a medium inside of it, and its `medium` is another one"
    ),
    "sphere(1, material: blend(subsurface(), subsurface(#ff0000)))": (
        "error: both parts of this material have a medium inside of them, and a shape is filled by one"
    ),
    "sphere(1, material: subsurface(rgb(1, 1.2, 1)))": (
        "warning: this subsurface reflects more light than it gets: a channel of its colour is 1.2"
    ),
    'sphere(1, material: subsurface(image("a.png")))': "error: there is no picture `a.png`",
    "sphere(1, material: subsurface(scale: 0))": "error: `scale` must be more than 0, got 0",
    "sphere(1, material: subsurface(radius: 0))": "error: `radius` must be more than 0, got 0",
}


@pytest.mark.parametrize("text", TOLD)
def test_what_is_refused(said, text: str) -> None:
    messages = [line.partition(": ")[2] for line in said(text + REST).splitlines() if line.startswith("a.scene:")]
    assert messages[0] == TOLD[text]
