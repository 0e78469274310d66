"""Tests of thin films against Airy's formula, integrated over the spectrum."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render.material import thin_film

TO_RGB = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.969266, 1.8760108, 0.041556], [0.0556434, -0.2040259, 1.0572252]])


def matching(wavelength):
    """The colour matching functions at wavelengths in nm (Wyman, Sloan, Shirley 2013), (3, n)."""

    def lobe(height, centre, below, above):
        off = (wavelength - centre) * np.where(wavelength < centre, below, above)
        return height * np.exp(-0.5 * off * off)

    x = lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.0490, 0.0382)
    y = lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322)
    z = lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725)
    return np.stack([x, y, z])


def airy(cosine, film, thickness, base):
    """Reflectance in red, green and blue: Airy's formula of both polarizations at each wavelength."""
    wavelength = np.linspace(360.0, 830.0, 2000)
    sine = 1.0 - cosine**2
    inside, bent = np.sqrt(1.0 - sine / film**2), np.sqrt(1.0 - sine / base**2)
    delta = 4.0 * np.pi * film * thickness * 1e3 * inside / wavelength
    total = np.zeros_like(wavelength)
    for a, b in (
        ((film * cosine - inside) / (film * cosine + inside), (base * inside - film * bent) / (base * inside + film * bent)),
        ((cosine - film * inside) / (cosine + film * inside), (film * inside - base * bent) / (film * inside + base * bent)),
    ):
        amplitude = (a + b * np.exp(1j * delta)) / (1.0 + a * b * np.exp(1j * delta))
        total += 0.5 * np.abs(amplitude) ** 2
    weights = matching(wavelength)
    xyz = (weights * total).sum(axis=1) / weights.sum(axis=1)
    return TO_RGB @ xyz / TO_RGB.sum(axis=1)


@pytest.mark.parametrize("base", [1.0, 1.5, 2.4])
@pytest.mark.parametrize("film", [1.33, 1.8])
def test_colors_are_those_of_airys_formula(film, base):
    """Within 0.03 up to 1.2 µm, at grazing angles 0.06: the series has three terms, and the matching functions are fits."""
    for thickness in (0.02, 0.1, 0.25, 0.4, 0.6, 0.9, 1.2):
        for cosine in (1.0, 0.8, 0.5, 0.2):
            found = thin_film.reflectance(np.float64(cosine), film, thickness, (base, base, base))
            expected, off = np.clip(airy(cosine, film, thickness, base), 0.0, 1.0), 0.03 if cosine >= 0.5 else 0.06
            assert np.allclose(found, expected, atol=off), (thickness, cosine)


@pytest.mark.parametrize(("film", "base", "off", "grazing"), [
    (1.33, 5.0, 0.02, 0.03), (1.33, 39.0, 0.01, 0.04), (1.8, 10.0, 0.035, 0.08), (1.8, 39.0, 0.02, 0.11), (2.4, 10.0, 0.05, 0.04),
    (2.4, 1.5, 0.03, 0.01),
])  # fmt: skip
def test_films_on_metals_at_sixty_thicknesses(film, base, off, grazing):
    """An index of 39 reflects 0.9 at normal incidence, 10 0.67, 5 0.44. The brighter both boundaries, the more the fourth term matters."""
    for thickness in np.linspace(0.02, 1.2, 60):
        for cosine, tolerance in ((1.0, off), (0.8, off), (0.5, 0.045), (0.2, grazing)):
            color = thin_film.reflectance(np.float64(cosine), film, thickness, (base, base, base))
            assert np.allclose(color, np.clip(airy(cosine, film, thickness, base), 0.0, 1.0), atol=tolerance), (thickness, cosine)


def test_a_film_without_thickness_is_none():
    """Both boundaries become that of the base, within the terms that are left out."""
    for cosine in (1.0, 0.6, 0.3):
        plain = thin_film.reflectance(np.float64(cosine), 1.0, 0.3, (1.5, 1.5, 1.5))
        thin = thin_film.reflectance(np.float64(cosine), 1.4, 0.0, (1.5, 1.5, 1.5))
        assert np.allclose(plain, thin, atol=0.01)


def test_a_thick_film_is_grey():
    red, green, blue = thin_film.reflectance(np.float64(0.9), 1.4, 30.0, (1.5, 1.5, 1.5))
    assert red == pytest.approx(green, abs=1e-6) == pytest.approx(blue, abs=1e-6)
