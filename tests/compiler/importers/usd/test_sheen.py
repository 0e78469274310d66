"""Sheen of Conty and Kulla as fuzz."""

import numpy as np
import pytest

from .stages import slot
from .test_closures import joined, surface
from .test_materialx import drawn
from .test_scattering import DIFFUSE, bsdf


def conty_kulla(x, r):
    """The directional albedo by MaterialX's mx_imageworks_sheen_dir_albedo_analytic."""
    top = 13.673 - 68.78018 * x + 799.08825 * r - 905.00061 * x * r + 60.28956 * x * x + 1086.96473 * r * r
    return np.clip(top / (1 + 61.57746 * x + 442.78211 * r + 2597.49308 * x * r + 121.81241 * x * x + 3045.55075 * r * r), 0, 1)


def zeltner(x, y):
    """That of fuzz by mx_zeltner_sheen_dir_albedo."""
    s = y * (0.0206607 + 1.58491 * y) / (0.0379424 + y * (1.32227 + y))
    m = y * (-0.193854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046391 + y)
    o = y * (0.000654023 + (-0.0207818 + 0.119681 * y) * y) / (1.26264 + y * (-1.92021 + y))
    return np.exp(-0.5 * ((x - m) / s) ** 2) / (s * np.sqrt(2 * np.pi)) + o


COSINES = np.linspace(0.02, 1, 99)


def apart(rough, fuzz_rough, weight):
    """The root of the mean square of the difference over the disc of a ball."""
    difference = conty_kulla(COSINES, rough) - weight * zeltner(COSINES, fuzz_rough)
    return np.sqrt(np.average(difference**2, weights=COSINES))


@pytest.mark.parametrize(("rough", "bound"), [(0.05, 0.056), (0.12, 0.043), (0.3, 0.013), (0.45, 0.01), (0.77, 0.008), (1.0, 0.006)])
def test_fuzz_is_as_bright_as_the_sheen(tmp_path, rough, bound):
    scene, messages = drawn(tmp_path, f"float inputs:sheen = 1\nfloat inputs:sheen_roughness = {rough}")
    assert messages == []
    fuzz = slot(scene, "FUZZ_ROUGHNESS")[0], slot(scene, "FUZZ")[0]
    assert apart(rough, *fuzz) < bound < 0.4 * apart(rough, rough, 1.0)


def test_the_roughness_of_gltf_is_squared(tmp_path):
    iridescence = "\nfloat inputs:iridescence = 1"
    inputs = f"color3f inputs:sheen_color = (0.5, 0.5, 0.5)\nfloat inputs:sheen_roughness = 0.5{iridescence}"
    scene, messages = drawn(tmp_path, inputs, "ND_gltf_pbr_surfaceshader")
    assert messages == []
    assert apart(0.25, slot(scene, "FUZZ_ROUGHNESS")[0], 2 * slot(scene, "FUZZ")[0]) < 0.02


@pytest.mark.parametrize(("mode", "is_fuzz"), [("zeltner", True), ("conty_kulla", False)])
def test_a_sheen_of_zeltner_is_fuzz(tmp_path, mode, is_fuzz):
    nodes = DIFFUSE + bsdf("y", "ND_sheen_bsdf", f'float inputs:roughness = 0.3\nstring inputs:mode = "{mode}"')
    scene, messages = surface(tmp_path, nodes + joined("t", "ND_layer_bsdf", top="y", base="b"), "t")
    assert messages == []
    assert (slot(scene, "FUZZ_ROUGHNESS")[0] == pytest.approx(0.3)) == is_fuzz


def test_a_roughness_that_varies_has_a_line(tmp_path):
    ramp = """def Shader "n" { uniform token info:id = "ND_ramplr_float"
        float inputs:valuel = 0.3
        float inputs:valuer = 0.9
        token outputs:out }"""
    inputs = "float inputs:sheen = 1\nfloat inputs:sheen_roughness.connect = </m/n.outputs:out>"
    scene, messages = drawn(tmp_path, inputs, nodes=ramp)
    assert messages == []
    for rough in np.linspace(0.3, 0.9, 5):
        assert apart(rough, 0.5 + 0.37 * rough, slot(scene, "FUZZ")[0]) < 0.05
