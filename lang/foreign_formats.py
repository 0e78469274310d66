"""Formats that are not read, with the program that writes one that is."""

from __future__ import annotations

import re

from . import file_types

_BLENDER = "Blender imports it, and exports .glb or .usdc"
_ASSIMP = "assimp converts it: assimp export {name} {stem}.glb -fglb2"
_MESHLAB = "MeshLab opens it, and exports .ply or .obj"
_PARAVIEW = "ParaView opens it, and exports .ply"
_CAD = "FreeCAD opens it, and exports .3mf or .stl"
_OWN = "the program that made it exports {}"
_ADVICE = {
    ".step .stp .stpz .p21 .iges .igs .brep .brp .fcstd .ifc": _CAD,
    ".sldprt .sldasm .ipt .iam .catpart .catproduct .prt .asm .x_t .x_b .sat .f3d .f3z .jt .3dxml": _OWN.format(".3mf, .stl or .step"),
    ".scad": "OpenSCAD writes it: openscad -o {stem}.3mf {name}",
    ".blend": "Blender writes it: blender {name} -b --python-expr \"import bpy; bpy.ops.wm.usd_export(filepath='{stem}.usdc')\"",
    ".fbx .abc": _BLENDER,
    ".dae .3ds .lwo .x .ac .b3d .ms3d .md2 .md3 .md5mesh .smd .amf": _ASSIMP,
    ".x3d .x3dv .wrl .vrml .ctm": _MESHLAB,
    ".vtk .vtp .vtu": _PARAVIEW,
    ".vox": _OWN.format(".obj or .ply"),
    ".bvh": "it is the motion of a skeleton and has no surface: Blender exports a character that moves by it as .glb or .usdc",
    ".max .ma .mb .c4d .hip .hipnc .skp .3dm .zpr .ztl .lxo .dwg": _OWN.format(".glb, .usdc or .obj"),
    ".dxf .svg": "it is a drawing: FreeCAD extrudes it, and exports .3mf or .stl",
    ".gcode .bgcode .sl1 .ctb": "it is for a printer: take the .3mf or .stl that it was made from",
    ".las .laz .e57 .pcd": "CloudCompare opens it, and exports .ply",
    ".pbrt .rib .vdb": "it is not a mesh: convert its scene to .usdc or .glb",
    ".zip .7z .rar .gz .tar": "unpack it, and name a file in it",
    ".png .jpg .jpeg .tif .tiff .exr .hdr .webp .gif": 'it is a picture: a scene shows it by image("{name}")',
}
_BY_SUFFIX = {suffix: advice for suffixes, advice in _ADVICE.items() for suffix in suffixes.split()}


def advice(name: str) -> str:
    """What to do with a file of a format that is not read, by the ending of its name; empty for unknown ones."""
    name = name.replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, ending = name.rpartition(".")
    if not dot:
        return ""
    if not re.fullmatch(r"[\w.-]+", name) or name.startswith("-"):  # commands are copied to a shell
        name, stem = f"FILE.{ending}", "FILE"
    return _BY_SUFFIX.get(f".{ending.lower()}", "").replace("{name}", name).replace("{stem}", stem)


def placed_by(path: str) -> str:
    """What to write for a file that another element reads, or what to do with one that none reads; empty for unknown ones."""
    _, dot, ending = path.rpartition(".")
    suffix = dot + ending.lower()
    for suffixes, element in ((file_types.MESH, "mesh"), (file_types.USD, "usd")):
        if suffix in suffixes:
            return f'write {element}("{path}")'
    return f'write use "{path}"' if suffix in file_types.SCENE else advice(path)
