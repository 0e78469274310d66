"""The shared sample stages: what each holds, as its manifest says, and the cameras its reference was made with."""

import csv

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.importers.stage_options import StageOptions
from maquette.lang.diagnostics import Diagnostics, SceneError

from .stages import load as read

pytestmark = pytest.mark.assets

# instances, triangles drawn, first camera, lights
SAMPLES = {
    "pub_all_primitives": (5, 0, "frame", ["POINT"]),
    "pub_subdiv_catmullclark": (1, 12, "frame", ["POINT"]),
    "pub_xforms_nested": (5, 0, "frame", ["POINT"]),
    "pub_class_inherit": (2, 0, "frame", ["POINT"]),
    "pub_animcube": (1, 12, "/Cameras/main_cam", ["POINT"]),
    "pub_preview_texture": (1, 2, "frame", ["POINT"]),
    "pub_preview_grid": (100, 0, "frame", ["POINT"]),
    "pub_pointinstancer": (6, 48, "frame", ["POINT"]),
    "pub_native_instances": (7, 0, "frame", ["POINT"]),
    "pub_dome_yup": (1, 0, "frame", ["DOME"]),
    "pub_camera_animated": (2, 24, "/World/main_cam", ["POINT"]),
    "pub_light_sphere_cone": (2, 324, "frame", ["SPHERE"]),
    "pub_holes": (1, 6, "frame", ["SPHERE"]),
    "pub_teapot_maxusd": (1, 4032, "frame", ["POINT", "SKY"]),
    "pub_usdz_mesh": (1, 12, "frame", ["SUN"]),
    "pub_texcoord": (5, 10, "frame", ["POINT"]),
    "pub_roughness_usdz": (6, 504, "frame", ["POINT"]),
    "pub_vehicles": (15, 1973, "frame", ["POINT"]),
}


def manifest(assets):
    with open(assets / "MANIFEST.tsv", encoding="utf-8") as file:
        return {row["case"]: row for row in csv.DictReader(file, delimiter="\t")}


@pytest.mark.parametrize("case", SAMPLES)
def test_sample(assets, case):
    scene, messages = read(assets / manifest(assets)[case]["path"], [assets])
    t = scene.tables
    count, triangles, camera, lights = SAMPLES[case]
    assert len(t.instances.geometry) == count
    assert int(t.geometries.triangle_count[t.instances.geometry].sum()) == triangles
    assert scene.names.cameras[0] == camera
    assert [ir.LightKind(k).name for k in t.lights.kind] == lights
    assert not [m for m in messages if ": error: " in m]


def test_the_manifest_is_covered(assets):
    assert {case for case, row in manifest(assets).items() if row["path"].startswith("usd/") and row["tier"] == "public"} == set(SAMPLES)


@pytest.mark.parametrize("case", SAMPLES)
def test_the_whole_way_to_a_validated_scene(assets, case):
    row = manifest(assets)[case]
    reference = row["ref_camera"]
    path = reference.partition(":/")[0] if ":/" in reference else row["path"]
    scene = load.load(assets / path, allow=[assets])
    if ":/" in reference:
        assert scene.names.cameras == ("frame", "/RefCamera")
    elif reference != "-":
        assert reference.split()[0] in scene.names.cameras


@pytest.mark.parametrize("case", ["pub_all_primitives", "pub_subdiv_catmullclark", "pub_xforms_nested", "pub_class_inherit"])
def test_the_framing_camera_is_usdrecord_s(assets, case):
    """Those reference cameras are the ones that usdrecord framed the stage with."""
    scene, _ = read(assets / manifest(assets)[case]["ref_camera"].partition(":/")[0], [assets])
    cameras = scene.tables.cameras
    ours, theirs = (scene.tables.transforms.matrix[cameras.transform[k]] for k in (0, 1))
    assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-6)
    assert cameras.extent[0] == pytest.approx(cameras.extent[1])
    assert cameras.aspect[0] == pytest.approx(cameras.aspect[1])


def test_time_codes_move_the_camera(assets):
    path = assets / manifest(assets)["pub_camera_animated"]["path"]
    eyes = [read(path, code=code)[0].tables.transforms.matrix[-1][:, 3] for code in (1, 2, 3)]
    assert not np.allclose(eyes[0], eyes[1])
    assert not np.allclose(eyes[1], eyes[2])


@pytest.mark.long
def test_variants_change_what_is_drawn(assets):
    path = assets / manifest(assets)["pub_vehicles"]["path"]
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))  # pyright: ignore[reportAttributeAccessIssue] - usd-core makes its names at run time
    prim = next(p for p in stage.TraverseAll() if p.HasVariantSets())
    name = prim.GetVariantSets().GetNames()[0]
    choices = prim.GetVariantSet(name).GetVariantNames()
    chosen = [StageOptions(variants={f"{prim.GetPath()}:{name}": c}) for c in choices]
    counts = {len(load.load(path, allow=[assets], stage=stage).tables.pools.triangles) for stage in chosen}
    assert len(counts) > 1


def test_a_wrong_variant_of_a_real_stage_is_one_error(assets):
    found = Diagnostics()
    asked = StageOptions(variants={"/nowhere:x": "y"})
    with pytest.raises(SceneError):
        load.load(assets / manifest(assets)["pub_vehicles"]["path"], allow=[assets], stage=asked, diagnostics=found)
    assert [d.message for d in found.items] == ["the stage has no prim `/nowhere`"]
