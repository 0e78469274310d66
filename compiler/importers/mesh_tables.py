"""Statements, options and properties of OBJ, MTL, PLY, STL, OFF, 3MF and XYZ, each drawn, without effect or not drawn.

Formats: Wavefront's Object Files 3.0 and MTL Material Format (Ramey, Rose, Tyerman 1995), Turk's PLY (1994).
"""

from __future__ import annotations

from .understood import Table

OBJ = Table(
    "OBJ statements",
    drawn={
        "v vt vn f": "polygons, and spheres without any; `v x y z r g b` has a colour",
        "usemtl mtllib": "a part for each material",
        "s": "smoothing groups",
    },
    no_effect={
        "o g": "names",
        "bevel c_interp d_interp lod": "display attributes",
    },
    not_drawn={
        "shadow_obj trace_obj": "the object itself casts shadows and shows in mirrors",
        "p": "points of a file with faces",
        "l": "lines",
        "vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech": "free-form curves and surfaces",
        "bsp bzp cdc cdp res": "patches of version 2.11",
        "mg": "merging groups of free-form surfaces",
        "call csh": "no other file is read and no command is run",
        "maplib usemap": "maps of version 2",
        "t": "tags of subdivision surfaces",
    },
)

MTL = Table(
    "MTL statements",
    drawn={
        "newmtl Kd Ka Ks Ns Ni d Tr Ke illum": "see compiler/importers/mtl.py for the rules where programs differ",
        "Tf": "the colour of what is seen through; the shadow is grey, as dark as that of its darkest colour, with a note",
        "Pr Pm Pc Pcr Ps": "the PBR extension: roughness, metallic, clear coat, sheen",
        "map_Kd map_Ka map_Ks map_Ke map_Ns map_d map_opacity map_bump map_Bump bump norm map_Kn map_Pr map_Pm map_RMA map_ORM": "pictures",
    },
    no_effect={"sharpness": "of reflection maps", "map_aat": "pictures are always filtered"},
    not_drawn={
        "map_Tr disp decal refl map_refl map_disp": "",
        "map_Ps aniso anisor map_aniso map_anisor map_Pc map_Pcr": "",
        "Km map_Km": "",
    },
)

MTL_OPTIONS = Table(
    "Options of MTL pictures",
    drawn={"-s -o -mm -bm -clamp -imfchan": "scale, offset, range, bump multiplier, clamping, channel"},
    no_effect={"-texres -blendu -blendv": "pictures are always filtered", "-type": "of reflection maps"},
    not_drawn={"-t -boost -cc": ""},
)

PLY = Table(
    "PLY elements and properties",
    drawn={
        "vertex vertex.x vertex.y vertex.z vertex.nx vertex.ny vertex.nz": "without faces as spheres, without normals",
        "vertex.red vertex.green vertex.blue vertex.diffuse_red vertex.diffuse_green vertex.diffuse_blue": "",
        "vertex.s vertex.t vertex.u vertex.v vertex.texture_u vertex.texture_v vertex.texture_s vertex.texture_t": "",
        "face face.vertex_indices face.vertex_index face.texcoord": "",
        "tristrips tristrips.vertex_indices tristrips.vertex_index": "triangle strips",
        "face.red face.green face.blue face.diffuse_red face.diffuse_green face.diffuse_blue": "",
        "comment.TextureFile": "the first picture",
    },
    no_effect={"comment.* obj_info": "text"},
    not_drawn={
        "vertex.alpha face.alpha": "colours are opaque",
        "vertex.quality vertex.confidence face.quality face.flags vertex.flags": "measurements",
        "edge material": "",
        "face.texnumber": "the first picture is drawn",
        "multi_texture_vertex multi_texture_face range_grid camera": "",
    },
)

STL = Table(
    "STL content",
    drawn={"triangles": "equal corners are one vertex", "attribute bytes": "colours as VisCAM, SolidView and Magics write them"},
    no_effect={"header name": "text", "normals": "the winding decides; those that contradict it are reported"},
)

OFF = Table(
    "OFF content",
    drawn={
        "vertices faces": "polygons, and spheres without any",
        "colours normals coordinates": "of COFF, NOFF and STOFF files, and colours of faces",
    },
    not_drawn={"BINARY 4OFF nOFF": "binary files and other dimensions than 3", "colour maps": "a single number as the colour of a face"},
)

THREEMF = Table(
    "3MF content",
    drawn={
        "model.unit object.components item.transform p:path": "units, placed copies, and models of other parts of the archive",
        "basematerials colorgroup": "colours of objects and triangles, with the opacity of base materials",
    },
    no_effect={"metadata": "text", "thumbnail": "a picture of the file", "object.type item.partnumber": "for slicers"},
    not_drawn={
        "texture2dgroup compositematerials multiproperties": "textures and mixtures",
        "*displayproperties": "shine",
        "beamlattice slicestack displacementmesh booleans volumedata implicitfunction": "other geometry",
    },
)

XYZ = Table(
    "XYZ content",
    drawn={"x y z": "points, as spheres of 1/150 of their extent", "r g b": "three columns of numbers from 0 to 255"},
    not_drawn={"nx ny nz": "normals and other columns"},
)

TABLES = (OBJ, MTL, MTL_OPTIONS, PLY, STL, OFF, THREEMF, XYZ)
