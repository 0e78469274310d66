"""Light on flat triangles, shaded by spans, against the lighting equations in float64, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData, LightData, MeshAttribute

from .. import pictures
from ..tables import matrix, mesh, phong, scene

SIZE = (70, 45)  # no multiple of blocks
Triple = tuple[float, float, float]
LAMPS: list[tuple[Triple, Triple]] = [  # towards them, and their colour
    ((0.48, 0.64, 0.6), (2.0, 1.0, 0.5)), ((-0.96, 0.0, 0.28), (0.3, 0.6, 0.9)), ((0.0, -0.6, -0.8), (1.0, 1.0, 1.0)),
]  # fmt: skip
DIFFUSE, SPECULAR, SHININESS, AMBIENT = 0.6, 0.3, 24.0, 0.2
MODELS = {"phong": ir.MaterialModel.PHONG, "blinn_phong": ir.MaterialModel.BLINN_PHONG}


def corners_of(reach: float) -> np.ndarray:
    """(12, 3, 3) equilateral triangles of this radius before the eye, some behind others."""
    random = np.random.default_rng(5)
    along = unit(random.normal(size=(12, 3)))
    across = unit(np.cross(along, random.normal(size=(12, 3))))
    turns = 2.0 * np.pi / 3.0 * np.arange(3)[:, None]
    middle = random.uniform(-0.5, 0.5, (12, 1, 3)) + [0.0, 0.0, -3.0]
    return middle + reach * (np.cos(turns) * along[:, None] + np.sin(turns) * across[:, None])


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def expected(camera: CameraData, normals: np.ndarray, ids: np.ndarray, model: ir.MaterialModel, normalized: bool) -> np.ndarray:
    """(h, w, 3) the light of triangles `ids`, whose normals (n, 3) point to either side."""
    w, h = SIZE
    y, x = np.mgrid[0:h, 0:w] + 0.5
    step = 2.0 * camera.extent / h
    ray = np.stack([(x - w / 2) * step, (h / 2 - y) * step, -np.ones((h, w))], axis=-1)
    viewer = unit(-ray) if camera.projection == ir.Projection.PERSPECTIVE else np.broadcast_to([0.0, 0.0, 1.0], ray.shape)
    normal = normals[ids]
    light = np.full((h, w, 3), AMBIENT * DIFFUSE)
    for direction, color in LAMPS:
        to = np.array(direction)
        cosine = normal @ to
        if model == ir.MaterialModel.PHONG:
            base, scale = np.sum((2.0 * cosine[..., None] * normal - to) * viewer, axis=-1), 0.5 * (SHININESS + 2.0)
        else:
            base, n = np.sum(normal * unit(to + viewer), axis=-1), SHININESS
            scale = (n + 2.0) * (n + 4.0) / (8.0 * (2.0 ** (-0.5 * n) + n))
        lobe = np.clip(base, 0.0, 1.0) ** SHININESS * (scale * cosine if normalized else 1.0)
        light += np.where(cosine > 0.0, DIFFUSE * cosine + SPECULAR * lobe, 0.0)[..., None] * np.array(color) / np.pi
    return light


@pytest.mark.parametrize("samples", [1, 4])
@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("reach", [0.4, 3.0, 40.0])
@pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
def test_flat_faces_are_lit_by_the_equations(model, reach, perspective, samples):
    corners, normalized = corners_of(reach), reach == 3.0
    outward = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    tilted = unit(outward + 0.3 * unit(np.random.default_rng(8).normal(size=outward.shape)))
    tilted[4:8] *= -1.0  # to the other side of their faces
    corner_normals = [None if k < 4 else MeshAttribute(np.repeat(tilted[k : k + 1], 3, axis=0)) for k in range(12)]
    meshes = [(mesh(t, [[0, 1, 2]], normals=n), matrix(), 0) for t, n in zip(corners, corner_normals, strict=True)]
    lamps = [LightData(ir.LightKind.DIRECTIONAL, color, direction=direction, shadows=False) for direction, color in LAMPS]
    lamps.append(LightData(ir.LightKind.AMBIENT, (AMBIENT, AMBIENT, AMBIENT)))
    camera = CameraData(0, 0.3 if perspective else 0.9, ir.Projection.PERSPECTIVE if perspective else ir.Projection.ORTHOGRAPHIC)
    tables = scene(
        meshes=meshes, materials=[phong(DIFFUSE, SPECULAR, SHININESS, model, normalized=normalized)], lights=lamps, camera=camera
    )
    ids = pictures.aov(tables, "id", size=SIZE)[..., 0].astype(int)
    colors = pictures.picture(tables, size=SIZE, samples=samples, filter="box").channels["rgba"][..., :3]

    normals = np.where((np.arange(12) < 4)[:, None], outward, tilted)
    middle = np.mean(corners, axis=1)
    away = np.sum(outward * (-middle if perspective else [0.0, 0.0, 1.0]), axis=1) < 0.0
    side = np.sign(np.sum(normals * outward, axis=1)) * np.where(away, -1.0, 1.0)
    right = expected(camera, normals * side[:, None], np.maximum(ids, 0), model, normalized)
    inner = ids >= 0
    for dy, dx in np.ndindex(3, 3):
        inner &= np.roll(ids, (dy - 1, dx - 1), (0, 1)) == ids
    inner[[0, -1]] = inner[:, [0, -1]] = False
    assert inner.sum() > 100
    good = np.isclose(colors, right, rtol=2e-4, atol=1e-6).all(axis=-1)
    assert np.mean(np.asarray(good)[inner]) > (0.9999 if samples == 1 else 0.97)  # between pixels' centres something else may be seen
