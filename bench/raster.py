"""Frames of triangles: the raster backend against OpenGL on Mesa's llvmpipe, with coverage and colours compared pixel by pixel."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir, plan
from ..compiler.rows import Input, LightData, MaterialData
from ..render import film, prepare, raster
from ..render.records import View
from . import gl, meshes, report
from .harness import OURS, Case, Contender, Disagreement, Effort, Peers, measure, timed
from .meshes import Mesh

TEXT = """
One frame of 1024², from a mesh that is ready to an array of pixels that Python can read: vertices transformed, triangles filled (those
that face away too), Blinn–Phong with one distant light and no shadows computed at each pixel, read back. Meshes: the knot of the rays in
three sizes, and 200 large triangles at random that cross each other. llvmpipe draws in the calling thread (`LP_NUM_THREADS=0`) into 8-bit
colours and a 24-bit depth; maquette into float32. *1 sample* is the pixel's centre for both; *4 samples* are multisampling with one
shading a pixel and triangle for llvmpipe, and four shaded samples at places of its own for maquette: there, covered areas are compared.
"""
DIFFUSE, SPECULAR, SHININESS = (0.6, 0.5, 0.4), (0.3, 0.3, 0.3), 32.0
TOWARDS_LIGHT = (0.48, 0.64, 0.6)
MOST_APART = 2e-4  # share of pixels whose coverage may differ: vertices come from float64 here and float32 there
COLOR = 1.5 / 255.0  # by which colours may differ where both cover: 8 bits, and normals in half the precision
MOST_CROSSING = 0.02  # share of covered pixels where they may differ more: where surfaces meet, another one may be in front


def big_triangles(count: int, seed: int = 3) -> Mesh:
    """Triangles about as large as the picture, flat and crossing."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 3, 3)) * 0.5
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3).astype(np.float32), np.repeat(normals, 3, axis=0).astype(np.float32), triangles)


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure every mesh at 1 and at 4 samples."""
    peers = Peers()
    found = report.Section("raster", "Triangles on a grid of pixels", TEXT, versions=report.version_of("moderngl"))
    size = 64 if quick else 1024
    sizes = meshes.TINY if quick else meshes.SIZES
    everything = {f"{name} triangles": functools.partial(meshes.knot, *rings) for name, rings in sizes.items()}
    everything["200 large triangles"] = functools.partial(big_triangles, 200)
    for samples in (1, 4):
        results = []
        for name, make in everything.items():
            mesh = make()
            contenders = peers.gather(functools.partial(ours, mesh, size, samples), functools.partial(theirs, mesh, size, samples, found))
            results.append(measure(Case(name, contenders, agree_areas if samples > 1 else agree, size * size), effort))
        found.add("1 sample" if samples == 1 else f"{samples} samples", results, "Mpixels/s")
    found.missing = peers.missing
    return found


def ours(mesh: Mesh, size: int, samples: int) -> Contender:
    """The raster backend from a prepared scene on: its view-dependent setup and its film."""
    slots = {ir.Slot.DIFFUSE: Input(DIFFUSE), ir.Slot.SPECULAR: Input(SPECULAR), ir.Slot.SHININESS: Input.number(SHININESS)}
    material = MaterialData(ir.MaterialModel.BLINN_PHONG, slots)
    sun = LightData(ir.LightKind.DIRECTIONAL, (np.pi, np.pi, np.pi), direction=TOWARDS_LIGHT, shadows=False)
    scene = meshes.scene(mesh, None, material, (sun,))
    settings = ir.Settings(size=(size, size), backend="raster", samples=samples, filter="box", threads=1, background="transparent")
    decided = plan.make(scene, settings)
    view = View(decided["camera"], size, size)
    prepared, build = timed(lambda: prepare.prepare(scene, decided, view))

    def frame() -> NDArray[np.float32]:
        return film.run(raster.Renderer(prepared, decided, view), decided, view).channels["rgba"]

    return Contender(OURS, frame, build=build)


def theirs(mesh: Mesh, size: int, samples: int, found: report.Section) -> Contender:
    """llvmpipe, by OpenGL."""
    uniforms = {"light": TOWARDS_LIGHT, "diffuse": DIFFUSE, "specular": SPECULAR, "shininess": SHININESS}
    window, build = timed(lambda: gl.Window(mesh, size, samples, uniforms))
    found.versions["GL"] = window.version()
    return Contender("llvmpipe", window.draw, lambda pixels: pixels.astype(np.float32) / 255.0, build)


def agree(answers: Mapping[str, Any]) -> str:
    """Coverage pixel by pixel, and colours where both cover."""
    mine = answers[OURS]
    covered = mine[..., 3] > 0.0
    said = [f"{covered.mean():.0%} of {covered.size:,} pixels are covered"]
    for name, theirs in ((k, v) for k, v in answers.items() if k != OURS):
        apart = int(np.count_nonzero(covered != (theirs[..., 3] > 0.0)))
        both = covered & (theirs[..., 3] > 0.0)
        off = np.abs(np.clip(mine[both], 0.0, 1.0) - theirs[both]).max(axis=1, initial=0.0) > COLOR
        text = f"{name}: coverage of {apart} pixels differs, colour of {np.count_nonzero(off)}"
        if apart > max(2.0, MOST_APART * covered.size) or np.count_nonzero(off) > max(4.0, MOST_CROSSING * both.sum()):
            raise Disagreement(text)
        said.append(text)
    return "; ".join(said)


def agree_areas(answers: Mapping[str, Any]) -> str:
    """How much of the picture is covered in all: samples lie elsewhere."""
    area = {name: float(np.mean(answer[..., 3])) for name, answer in answers.items()}
    apart = max(abs(a - area[OURS]) for a in area.values())
    text = ", ".join(f"{name} covers {a:.4%}" for name, a in area.items())
    if apart > 0.002 * max(area[OURS], 1e-6) + 1.0 / answers[OURS][..., 3].size:
        raise Disagreement(text)
    return text
