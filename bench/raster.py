"""Frames of the raster backend against OpenGL on Mesa's llvmpipe, with coverage and colours compared pixel by pixel."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.plan import plan
from ..compiler.scene.builder import SceneBuilder
from ..compiler.scene.row_records import CameraData, Input, InstanceData, LightData, MaterialData, MeshAttribute, MeshData, TextureData
from ..render.backends import prepare, raster
from ..render.film import film
from ..render.types import View
from . import gl, meshes, report
from .harness import OURS, Case, Contender, Disagreement, Effort, Peers, measure, timed
from .meshes import Mesh

TEXT = """
One frame of 1024², from a mesh that is ready to an array of pixels that Python can read: vertices transformed, triangles filled (those
that face away too), Blinn–Phong with one distant light and no shadows, read back. Meshes: the knot of the rays in three sizes, plain and
with a picture on it (bilinear, without mip levels); 200 large triangles at random that cross each other; and a room round the eye, whose
walls are cut at its plane. llvmpipe draws in the calling thread (`LP_NUM_THREADS=0`) into 8-bit colours and a 24-bit depth; maquette into
float32, by the pipeline that `maquette render --backend raster` takes for such scenes. *1 sample* is the pixel's centre; *4 samples* are
multisampling at the same places, with one shading a pixel and triangle and a box for a filter. Coverage is compared pixel by pixel,
and colours, which GL extrapolates outside of triangles, in the mean.
"""
DIFFUSE, SPECULAR, SHININESS = (0.6, 0.5, 0.4), (0.3, 0.3, 0.3), 32.0
TOWARDS_LIGHT = (0.48, 0.64, 0.6)
MAX_DIFFERING = 2e-4  # allowed share of pixels with different coverage: our vertices are float64, llvmpipe's float32
COLOR = 1.5 / 255.0  # allowed difference of colours: 8 bits, and normals of half precision
MAX_CROSSING = 0.02  # allowed share of covered pixels with larger differences, as where surfaces intersect


def big_triangles(count: int, seed: int = 3) -> Mesh:
    """Triangles about as large as the picture, flat and crossing."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 3, 3)) * 0.5
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3).astype(np.float32), np.repeat(normals, 3, axis=0).astype(np.float32), triangles)


def room() -> Mesh:
    """The inside of a cube around the camera with two blocks in it."""
    corners, normals = [], []
    for (low, high), inward in (((-3.0, 3.0), -1.0), ((-0.9, -0.2), 1.0), ((0.1, 0.6), 1.0)):
        for axis in range(3):
            for side in (0, 1):
                u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
                middle = 0.5 * (low + high) * np.ones(3) + (0.5 if side else -0.5) * (high - low) * np.eye(3)[axis]
                half = 0.5 * (high - low)
                corners.append([middle - half * (u + v), middle + half * (u - v), middle + half * (u + v), middle + half * (v - u)])
                normals.append([inward * (1.0 if side else -1.0) * np.eye(3)[axis]] * 4)
    first = 4 * np.arange(len(corners))[:, None]
    triangles = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]]).astype(np.int32)
    return Mesh(np.reshape(corners, (-1, 3)).astype(np.float32), np.reshape(normals, (-1, 3)).astype(np.float32), triangles)


def picture(size: int = 256) -> NDArray[np.uint8]:
    """(size, size, 4) a smooth periodic image, row 0 at the top."""
    y, x = np.mgrid[0:size, 0:size] * (2.0 * np.pi / size)
    waves = np.stack([np.sin(x) * np.cos(y), np.cos(2 * x + y), np.sin(x - 2 * y)], axis=-1)
    return np.concatenate([np.round(160 + 80 * waves), np.full((size, size, 1), 255.0)], axis=-1).astype(np.uint8)


def coordinates(mesh: Mesh) -> NDArray[np.float32]:
    """(v, 2) texture coordinates: planar projection from the front."""
    return (mesh.positions[:, :2] * np.float32(0.8)).astype(np.float32)


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure every mesh with 1 and 4 samples."""
    peers = Peers()
    result = report.Section("raster", "Triangles on a grid of pixels", TEXT, versions=report.version_of("moderngl"))
    size = side(quick)
    for samples in (1, 4):
        results = []
        for name, (mesh, textured) in cases(quick).items():
            contenders = peers.gather(
                functools.partial(our_frame, mesh, size, samples, textured),
                functools.partial(llvmpipe_frame, mesh, size, samples, textured, result),
            )
            results.append(measure(Case(name, contenders, agree if samples == 1 else agree_in_mean, size * size), effort))
        result.add("1 sample" if samples == 1 else f"{samples} samples", results, "Mpixels/s")
    result.missing = peers.missing
    return result


def side(quick: bool) -> int:
    """The side of a picture in pixels."""
    return 64 if quick else 1024


def cases(quick: bool) -> dict[str, tuple[Mesh, bool]]:
    """The meshes, and whether they are textured."""
    everything: dict[str, tuple[Mesh, bool]] = {}
    for name, rings in meshes.sizes(quick).items():
        everything[f"{name} triangles"] = meshes.knot(*rings), False
        everything[f"{name} triangles, textured"] = meshes.knot(*rings), True
    everything["200 large triangles"] = big_triangles(200), False
    everything["a room round the eye"] = room(), False
    return everything


def our_frame(mesh: Mesh, size: int, samples: int, textured: bool = False, threads: int = 1, name: str = OURS) -> Contender:
    """The raster backend on a prepared scene: view-dependent setup and film."""
    scene = scene_of(mesh, textured)
    settings = ir.Settings(size=(size, size), backend="raster", samples=samples, filter="box", threads=threads, background="transparent")
    decided = plan.make_plan(scene, settings, {"raster.shading": "pixel", **({"texture_filter": "point"} if textured else {})})
    view = View(decided["camera"], size, size)
    prepared, build = timed(lambda: prepare.prepare(scene, decided, view))

    def frame() -> NDArray[np.float32]:
        return film.run(raster.Renderer(prepared, decided, view), decided, view).channels["rgba"]

    return Contender(name, frame, build=build)


def scene_of(mesh: Mesh, textured: bool) -> ir.Scene:
    """The mesh under one distant light, seen from meshes.EYE."""
    builder = SceneBuilder()
    diffuse = Input(DIFFUSE)
    if textured:
        image = builder.image(picture().astype(np.float32) / 255.0)
        diffuse = Input(DIFFUSE, builder.texture(TextureData(ir.TextureKind.IMAGE, image)))
    slots = {ir.Slot.DIFFUSE: diffuse, ir.Slot.SPECULAR: Input(SPECULAR), ir.Slot.SHININESS: Input.number(SHININESS)}
    material = builder.material(MaterialData(ir.MaterialModel.BLINN_PHONG, slots))
    uvs = MeshAttribute(coordinates(mesh)) if textured else None
    geometry = builder.mesh(MeshData(mesh.positions, mesh.triangles, normals=MeshAttribute(mesh.normals), uvs=uvs))
    builder.instance(InstanceData(geometry, 0, material))
    builder.light(LightData(ir.LightKind.DIRECTIONAL, (np.pi, np.pi, np.pi), direction=TOWARDS_LIGHT, shadows=False))
    builder.camera(CameraData(builder.transform(meshes.look_at(meshes.EYE)), meshes.EXTENT))
    return builder.finish("bench")


def llvmpipe_frame(mesh: Mesh, size: int, samples: int, textured: bool, result: report.Section) -> Contender:
    """llvmpipe through OpenGL."""
    uniforms = {"light": TOWARDS_LIGHT, "diffuse": DIFFUSE, "specular": SPECULAR, "shininess": SHININESS}
    image = (coordinates(mesh), picture()) if textured else None
    window, build = timed(lambda: gl.Window(mesh, size, samples, uniforms, image))
    result.versions["GL"] = window.version()
    return Contender("llvmpipe", window.draw, lambda pixels: pixels.astype(np.float32) / 255.0, build)


def agree_in_mean(answers: Mapping[str, Any]) -> str:
    """Compare coverage pixel by pixel and mean colours."""
    return agree(answers, in_mean=True)


def agree(answers: Mapping[str, Any], in_mean: bool = False) -> str:
    """Compare coverage pixel by pixel, and colours of pixels that both cover fully."""
    mine = answers[OURS]
    said = [f"{np.mean(mine[..., 3] > 0.0):.0%} of {mine[..., 3].size:,} pixels are covered"]
    for name, theirs in ((k, v) for k, v in answers.items() if k != OURS):
        apart = int(np.count_nonzero(np.abs(mine[..., 3] - theirs[..., 3]) > 0.1))
        both = (mine[..., 3] > 0.99) & (theirs[..., 3] > 0.99)
        off = np.abs(np.clip(mine[both], 0.0, 1.0) - theirs[both]).max(axis=1, initial=0.0) > COLOR
        mean = float(np.abs(np.mean(np.clip(mine[both], 0.0, 1.0) - theirs[both], axis=0)).max(initial=0.0))
        text = f"{name}: coverage of {apart} pixels differs, colour of {np.count_nonzero(off)}, in the mean by {mean:.1e}"
        wrong = mean > COLOR if in_mean else np.count_nonzero(off) > max(4.0, MAX_CROSSING * both.sum())
        if apart > max(2.0, MAX_DIFFERING * mine[..., 3].size) or wrong:
            raise Disagreement(text)
        said.append(text)
    return "; ".join(said)
