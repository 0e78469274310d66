"""Faces at discontinuities of formulas, or where they become undefined, have the right normal, also at grazing angles.

In every backend.
"""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest

H = 0.5**0.5
FACES = {  # what is solid, how far places are from its faces, their normal
    "mod": ("mod(x, 0.5) - 0.25 + y * y + z * z <= 0", lambda x, y, z: 2 * x - np.rint(2 * x), (-1, 0, 0)),
    "floor": ("y <= 0.2 * floor(4 * x)", lambda x, y, z: 4 * x - np.rint(4 * x), (-1, 0, 0)),
    "ceil": ("y <= 0.2 * ceil(3 * x)", lambda x, y, z: 3 * x - np.rint(3 * x), (-1, 0, 0)),
    "sign": ("y <= 0.3 * sign(x - z)", lambda x, y, z: x - z, (-H, 0, H)),
    "root": ("sqrt(x) + y * y + z * z <= 0.5", lambda x, y, z: x, (-1, 0, 0)),
    "root of a slope": ("sqrt(x - z) + y * y + x * x <= 0.5", lambda x, y, z: x - z, (-H, 0, H)),
    "logarithm": ("log(x) + 4 * y * y + 4 * z * z <= 0", lambda x, y, z: x, (-1, 0, 0)),
    "arc cosine": ("y <= 0.2 * acos(2 * x - 1) - 0.3", lambda x, y, z: x, (-1, 0, 0)),
    "power": ("x ^ 1.5 + y * y + z * z <= 0.5", lambda x, y, z: x, (-1, 0, 0)),
    "angle": ("z <= 0.15 * atan2(y, x)", lambda x, y, z: np.where(x < 0, y, 1), (0, -1, 0)),
}
EYES = {"in front": "[-2.6, 1.4, 3.1]", "edge-on": "[-0.35, 0.5, 4.4]"}
BELOW = {"in front": "[-2.6, -1.4, 3.1]", "edge-on": "[-3.2, -0.2, 2.8]"}
SUN = "directional([1, 2.165, 1])\n"


@pytest.mark.long
@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("name", FACES)
def test_faces_have_normals_of_their_own(tmp_path: Path, backend: str, name: str, eye: str) -> None:
    text, away, normal = FACES[name]
    at = (BELOW if name == "angle" else EYES)[eye]
    scene = f"implicit(|x, y, z| {text}, within: 1)\n{SUN}camera({at}, look_at: [0, 0, 0], fov: 36deg)\n"
    (tmp_path / "a.scene").write_text(scene, encoding="utf-8")
    drawn = maquette.render(tmp_path / "a.scene", size=(96, 72), samples=1, backend=backend, aov=("normal", "position")).channels
    x, y, z = drawn["position"].astype(float).transpose(2, 0, 1)
    seen = drawn["rgba"][..., 3] > 0.5
    face = seen & (np.abs(away(x, y, z)) < 1e-5) & (np.maximum(np.maximum(abs(x), abs(y)), abs(z)) < 0.99)
    right = np.abs(drawn["normal"] - np.array(normal)).max(axis=-1) < 2e-3
    assert face.sum() >= (100 if eye == "in front" else 5)
    assert (face & ~right).sum() <= max(0.03 * face.sum(), 1)  # at edges


@pytest.mark.long
def test_what_leaves_a_face_leaves_it_whichever_side_rounding_put_it_on(tmp_path: Path, backend: str) -> None:
    """Cubes in a checkerboard, visible faces lit up to the box's edge: no pixel is in its own shadow."""
    text = "mod(floor(5 * x) + floor(5 * y) + floor(5 * z), 2) < 1"
    scene = f"implicit(|x, y, z| {text}, within: 1)\ndirectional([1, 2, 1.5])\ncamera([1.9, 1.6, 2.6], look_at: [0, 0, 0], fov: 50deg)\n"
    (tmp_path / "a.scene").write_text(scene, encoding="utf-8")
    drawn = maquette.render(tmp_path / "a.scene", size=(48, 36), samples=1, backend=backend, aov=("normal", "position")).channels
    position, normal = drawn["position"].astype(float), drawn["normal"].astype(float)
    seen = (drawn["rgba"][..., 3] > 0.5) & (np.abs(normal).max(axis=-1) > 0.999)
    to_sun = np.array([1.0, 2.0, 1.5]) / np.linalg.norm([1.0, 2.0, 1.5])
    o = position[seen] + 1e-6 * normal[seen]
    leaves = ((np.sign(to_sun) - o) / to_sun).min(axis=1)
    t = leaves[:, None] * (np.arange(400) + 0.5) / 400
    points = o[:, None] + t[..., None] * to_sun
    clear = ~(np.floor(5 * points).sum(axis=-1) % 2 < 1).any(axis=1)
    light = drawn["rgba"][seen][:, 0]
    lit = (normal[seen] @ to_sun > 1e-3) & clear
    assert lit.sum() > 100
    assert (light[lit] > 0.01).all()
