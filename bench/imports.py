"""Import of stages and meshes: usd-core's own opening and reading, memory of a million instances, a large OBJ file, thumbnails."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..compiler import ir, load
from ..lang.diagnostics import Diagnostics
from . import meshes, report
from .harness import OURS, Case, Contender, Disagreement, Effort, measure

TEXT = """
From files to a validated scene, on one thread, with the files in the system's memory. *Stage*: meshes with normals and texture
coordinates under transforms, each with a material of one of some pictures (PNG). usd-core opens the stage, traverses it, and reads all
transforms, points, counts, indices, normals and coordinates as arrays; OpenImageIO decodes the pictures. *OBJ*: a knot of a million
triangles with normals, as text. *Whole processes*: the seconds and the peak of the memory of a picture of a stage of a million instances,
and of thumbnails of small meshes, the second time.
"""


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure a stage, an OBJ file, and two whole processes."""
    result = report.Section("imports", "Importing files", TEXT)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        count, pictures, size = (3, 2, (20, 10)) if quick else (400, 24, (100, 50))
        path = stage(folder, count, pictures, meshes.knot(*size))
        sides = [Contender(OURS, lambda: _ours(path), _of_scene), Contender("usd-core", lambda: _usd_core(path))]
        result.add("Stage", [measure(Case(f"{count} meshes, {pictures} pictures", sides, agree), effort)], "", by="cpu")
        knot = meshes.knot(*meshes.sizes(quick)["2k" if quick else "1M"])
        text = obj(folder, knot)
        alone = [Contender(OURS, lambda: _ours(text), _of_scene)]
        result.add("OBJ", [measure(Case(f"{len(knot.triangles):,} triangles", alone, lambda _: "no peer"), effort)], "")
        result.blocks += ["**Whole processes**", report.grid(("", "CPU, s", "wall, s", "peak, MB"), processes(folder, quick))]
    result.versions = report.version_of("usd-core")
    return result


def stage(folder: Path, count: int, pictures: int, mesh: meshes.Mesh) -> Path:
    """A stage of copies of a mesh, no two alike, with pictures of noise."""
    from PIL import Image
    from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

    rng = np.random.default_rng(1)
    for k in range(pictures):
        Image.fromarray(rng.integers(0, 255, (512, 512, 3), np.uint8)).save(folder / f"p{k}.png")
    usd_stage = Usd.Stage.CreateNew(str(folder / "stage.usdc"))
    for k in range(pictures):
        material = UsdShade.Material.Define(usd_stage, f"/m{k}")
        surface, picture = (UsdShade.Shader.Define(usd_stage, f"/m{k}/{name}") for name in ("s", "t"))
        surface.CreateIdAttr("UsdPreviewSurface")
        picture.CreateIdAttr("UsdUVTexture")
        picture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./p{k}.png")
        color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
        color.ConnectToSource(picture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
        material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    uvs = Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.positions[:, :2]))
    for k in range(count):
        prim = UsdGeom.Mesh.Define(usd_stage, f"/g{k // 20}/x{k}")
        prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(mesh.positions * np.float32(1.0 + k / 1024)))
        prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.triangles), 3, np.int32)))
        prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.triangles.reshape(-1)))
        prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(mesh.normals))
        prim.SetNormalsInterpolation("vertex")
        prim.CreateSubdivisionSchemeAttr("none")
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set(uvs)
        UsdGeom.XformCommonAPI(prim).SetTranslate((k % 20, k // 20, 0))
        UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(usd_stage, f"/m{k % pictures}"))
    usd_stage.Save()
    return folder / "stage.usdc"


def obj(folder: Path, mesh: meshes.Mesh) -> Path:
    """A mesh as an OBJ file with normals."""
    path = folder / "knot.obj"
    with path.open("w", encoding="ascii") as file:
        np.savetxt(file, mesh.positions, "v %.6f %.6f %.6f")
        np.savetxt(file, mesh.normals, "vn %.4f %.4f %.4f")
        np.savetxt(file, np.repeat(mesh.triangles + 1, 2, axis=1), "f %d//%d %d//%d %d//%d")
    return path


def _ours(path: Path) -> ir.Scene:
    return load.load(path, diagnostics=Diagnostics())


def _of_scene(scene: ir.Scene) -> dict[str, float]:
    t = scene.tables
    points = float(((t.pools.positions + np.repeat(t.geometries.origin, t.geometries.vertex_count, axis=0)) ** 2).sum())
    places = float(t.transforms.matrix[t.instances.transform, :, 3].sum())
    return {"triangles": len(t.pools.triangles), "points": points, "places": places, "texels": len(t.images.texels)}


def _usd_core(path: Path) -> dict[str, float]:
    """Open and read a stage by usd-core, and its pictures by OpenImageIO."""
    import OpenImageIO as oiio
    from pxr import Usd, UsdGeom, UsdShade

    opened = Usd.Stage.Open(str(path))
    cache = UsdGeom.XformCache()
    sums: dict[str, float] = {"triangles": 0.0, "points": 0.0, "places": 0.0, "texels": 0.0}
    for prim in opened.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            arrays = [np.array(a.Get()) for a in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr(),
                                                  mesh.GetNormalsAttr(), prim.GetAttribute("primvars:st"))]  # fmt: skip
            sums["triangles"] += len(arrays[1])
            sums["points"] += float((arrays[0].astype(np.float64) ** 2).sum())
            sums["places"] += sum(cache.GetLocalToWorldTransform(prim).ExtractTranslation())
        elif prim.IsA(UsdShade.Shader) and (file := UsdShade.Shader(prim).GetInput("file")):
            picture = oiio.ImageInput.open(file.Get().resolvedPath)
            assert picture is not None
            sums["texels"] += np.asarray(picture.read_image("uint8")).shape[0] * picture.spec().width
            picture.close()
    return sums


def agree(answers: Mapping[str, Any]) -> str:
    """Compare counts, the sum of the points' squared coordinates, and the sum of the places."""
    mine, theirs = answers[OURS], answers["usd-core"]
    for name, value in mine.items():
        if abs(value - theirs[name]) > 1e-4 * max(abs(value), 1.0):
            raise Disagreement(f"{name}: {value:g} and {theirs[name]:g}")
    return ", ".join(f"{value:,.6g} {name}" for name, value in mine.items())


def processes(folder: Path, quick: bool) -> list[tuple[str, ...]]:
    """Rows (what, CPU, wall, peak) of the second of two equal runs of whole processes."""
    count, assets = (1000, 2) if quick else (1_000_000, 24)
    many, small = instances(folder, count), folder / "assets"
    small.mkdir()
    for k in range(assets):
        obj(folder, meshes.knot(100 + k, 20)).rename(small / f"a{k}.obj")
    picture = ["render", str(many), "-o", str(folder / "many.png"), "--size", "512x512", "--samples", "1"]
    commands = {f"picture of {count:,} instances": [picture] * 2}
    commands[f"{assets} thumbnails of 512²"] = [["thumbnail", str(small), "-o", str(folder / f"out{k}")] for k in range(2)]
    return [(name, *[_process(command) for command in runs][-1]) for name, runs in commands.items()]


def instances(folder: Path, count: int) -> Path:
    """A stage of turned and scaled tetrahedra of a point instancer."""
    from pxr import Usd, UsdGeom, Vt

    rng = np.random.default_rng(2)
    usd_stage = Usd.Stage.CreateNew(str(folder / "many.usdc"))
    instancer, mesh = UsdGeom.PointInstancer.Define(usd_stage, "/i"), UsdGeom.Mesh.Define(usd_stage, "/i/t")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    mesh.CreateFaceVertexCountsAttr([3] * 4)
    mesh.CreateFaceVertexIndicesAttr([0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2])
    mesh.CreateSubdivisionSchemeAttr("none")
    instancer.CreatePrototypesRel().SetTargets([mesh.GetPath()])
    instancer.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(np.zeros(count, np.int32)))
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy((rng.random((count, 3)) * 200).astype(np.float32)))
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy((rng.random((count, 3)) + 0.5).astype(np.float32)))
    turns = rng.normal(size=(count, 4))
    turns = (turns / np.linalg.norm(turns, axis=1, keepdims=True)).astype(np.float32)
    instancer.GetPrim().GetAttribute("orientationsf").Set(Vt.QuatfArray.FromNumpy(turns))
    usd_stage.Save()
    return folder / "many.usdc"


def _process(arguments: list[str]) -> tuple[str, str, str]:
    """CPU seconds, wall seconds and peak memory in MB (10⁶ bytes) of a command and its children."""
    started = time.perf_counter()
    child = subprocess.Popen([sys.executable, "-P", "-m", "maquette", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise RuntimeError(f"{' '.join(arguments)} failed")
    wall = time.perf_counter() - started
    return f"{used.ru_utime + used.ru_stime:.2f}", f"{wall:.2f}", f"{used.ru_maxrss * 1024 / 1e6:.0f}"
