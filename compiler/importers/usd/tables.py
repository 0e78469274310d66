"""Prim types, applied API schemas, properties and shaders of USD, each drawn, without effect or not drawn.

Schemas: OpenUSD 26.11. `tests/compiler/importers/usd/test_tables.py` compares the tables with usd-core's schema registry.
"""

from __future__ import annotations

from ... import ir
from ..understood import Table

PRIM_TYPES = Table(
    "Prim types",
    drawn={
        "Xform Scope": "transform, visibility and purpose of what is below",
        "Mesh": "polygons; subdivision surfaces are refined by --complexity, else drawn as their cages with smooth normals",
        "TetMesh": "the triangles of its surface",
        "NurbsPatch": "eight by eight faces for each span of knots; without trim curves",
        "BasisCurves NurbsCurves HermiteCurves": (
            "round tubes, or ribbons where they have normals; all bases and wraps; NURBS without knots are clamped"
        ),
        "Points": "spheres; meshes of spheres if they are many or have colours of their own",
        "GeomSubset": "a material for some faces of a mesh",
        "Cube Sphere Cylinder Cylinder_1 Cone Capsule Capsule_1 Plane": (
            "exact shapes; a Capsule_1 of two radii is a mesh; so are a Cube and Plane with primvars that vary"
        ),
        "PointInstancer": "each prototype is one geometry, placed by instances",
        "Camera": "perspective and orthographic",
        "DistantLight SphereLight RectLight DiskLight DomeLight DomeLight_1": "lights of these shapes",
        "CylinderLight": "a prism of twelve sides with its perimeter",
        "Material Shader NodeGraph": "networks of UsdPreviewSurface and MaterialX, also from .mtlx files",
        "SkelRoot Skeleton SkelAnimation BlendShape": "meshes below a SkelRoot, deformed at the time that is drawn",
        "RenderSettings RenderProduct": "the prim of --render-settings, else of the stage's renderSettingsPrimPath",
    },
    no_effect={
        "Backdrop": "layout of a node editor",
        "SpatialAudio": "sound",
        "Physics*": "simulation",
        "RenderVar": "channels of an .exr are asked for by --aov",
        "RenderPass": "one picture is drawn",
        "Field3DAsset OpenVDBAsset": "read by a Volume",
        "LODDistanceHeuristic LODScreenSizeHeuristic": "read by LODRootAPI",
    },
    not_drawn={
        "Volume": "write its grid as an array (docs/media.md says how), and fill a box with medium(density: volume(…))",
        "ParticleField ParticleField3DGaussianSplat": "",
        "PortalLight GeometryLight PluginLight LightFilter PluginLightFilter": "",
        "GenerativeProcedural": "its program is not run",
    },
)

API_SCHEMAS = Table(
    "Applied API schemas",
    drawn={
        "MaterialBindingAPI": "direct, by collection, and by purpose",
        "CollectionAPI": "of material bindings",
        "LightAPI ShadowAPI ShapingAPI": "see the properties",
        "MeshLightAPI": "a mesh that emits light; a stage with mesh lights has one bounce unless `--bounces` says otherwise",
        "SkelBindingAPI": "see SkelRoot",
        "NodeDefAPI": "the identifier of a shader",
        "VisibilityAPI": "visibility by purpose",
        "LODRootAPI LODOverrideAPI": "one level of detail: that of the override, else lod:default:index",
        "GeomModelAPI MotionAPI ColorSpaceAPI": "see the properties",
    },
    no_effect={
        "Physics*": "simulation",
        "Physx*": "simulation (NVIDIA PhysX)",
        "Houdini* Karma*": "Houdini alone",
        "ListAPI LightListAPI": "cached lists of lights; the stage itself is traversed",
        "HydraPrimAPI HydraRenderPassAPI": "hints for Hydra",
        "AssetPreviewsAPI AuthorshipAPI ClaimsAPI": "data about the asset",
        "SemanticsLabelsAPI SemanticsAPI": "labels",
        "NodeGraphNodeAPI SceneGraphPrimAPI AccessibilityAPI": "user interfaces",
        "RiMaterialAPI RiSplineAPI StatementsAPI": "RenderMan alone",
        "ColorSpaceDefinitionAPI": "read by ColorSpaceAPI",
    },
    not_drawn={
        "BackPlateAPI": "",
        "CoordSysAPI": "",
        "HydraGenerativeProceduralAPI": "its program is not run",
        "VolumeLightAPI": "",
        "ParticleField*": "",
    },
)

PROPERTIES = Table(
    "Properties",
    drawn={
        "xformOp:* xformOpOrder visibility purpose renderVisibility proxyVisibility guideVisibility": "every prim",
        "points faceVertexCounts faceVertexIndices holeIndices subdivisionScheme normals orientation": "Mesh",
        "doubleSided": "by --cull-backfaces, of meshes; else both sides are drawn, as by usdrecord",
        "creaseIndices creaseLengths creaseSharpnesses cornerIndices cornerSharpnesses": "Mesh, refined by --complexity",
        "interpolateBoundary faceVaryingLinearInterpolation triangleSubdivisionRule": "Mesh, refined by --complexity",
        "type basis wrap curveVertexCounts widths order knots ranges pointWeights": "BasisCurves, NurbsCurves and Points",
        "tangents": "HermiteCurves",
        "tetVertexIndices surfaceFaceVertexIndices": "TetMesh",
        "uVertexCount uOrder uKnots uRange vVertexCount vOrder vKnots vRange uForm vForm": "NurbsPatch",
        "skel:*": "animation source, joints, weights, blend shapes, skinning method",
        "joints bindTransforms restTransforms translations rotations blendShapes blendShapeWeights": "skeletons",
        "offsets normalOffsets pointIndices": "BlendShape",
        "elementType familyName indices": "GeomSubset",
        "axis size radius height width length radiusBottom radiusTop": "shapes",
        "protoIndices prototypes positions orientations orientationsf scales ids invisibleIds": "PointInstancer",
        "primvars:*": "displayColor, displayOpacity, normals; of a material all texture coordinates, its colour, one varying number",
        "velocities accelerations angularVelocities": (
            "points and instances move from the sample before the time, between two samples and less than a time code after the last"
        ),
        "projection horizontalAperture verticalAperture horizontalApertureOffset verticalApertureOffset focalLength": "Camera",
        "clippingPlanes": f"Camera; at most {ir.CLIP_PLANES}; they bound what the camera sees, not light and shadows",
        "clippingRange fStop focusDistance shutter:open shutter:close exposure": "Camera",
        "exposure:iso exposure:time exposure:fStop exposure:responsivity": "Camera",
        "resolution camera products dataWindowNDC": "render settings; options of the command line precede them",
        "aspectRatioConformPolicy pixelAspectRatio": "render settings",
        "disableDepthOfField disableMotionBlur instantaneousShutter includedPurposes": "render settings",
        "inputs:color inputs:intensity inputs:exposure inputs:diffuse inputs:normalize": "lights",
        "inputs:enableColorTemperature inputs:colorTemperature": "lights",
        "inputs:angle inputs:radius inputs:length inputs:width inputs:height treatAsPoint": "lights",
        "inputs:texture:format": "angular, mirroredBall and cubeMapVerticalCross; automatic is latlong",
        "treatAsLine": "a thin CylinderLight of the same power",
        "colorSpace:name": "colours of lights, primvars and materials, as the colorSpace of an attribute; pictures have their own",
        "inputs:texture:file": "DomeLight; RectLight as the means of 8 by 8 cells",
        "DomeLight_1.poleAxis": "",
        "inputs:shadow:enable": "ShadowAPI",
        "collection:lightLink:* collection:shadowLink:* collection:lightLink collection:shadowLink": (
            "the prims that a light lights, and those that cast its shadows; an instancer counts as one prim"
        ),
        "inputs:shaping:cone:angle inputs:shaping:cone:softness inputs:shaping:focus inputs:shaping:focusTint": "every shape",
        "inputs:shaping:ies:file inputs:shaping:ies:angleScale inputs:shaping:ies:normalize": "every shape",
        "model:drawMode model:applyDrawMode model:drawModeColor": "bounds, origin and cards in place of a model",
        "model:cardGeometry model:cardTexture* model:cardVisibility": "with model:drawMode cards",
        "extent extentsHint": "the bounds and cards of model:drawMode; a camera that frames everything frames what is drawn",
        "lod:default:index lod:override:mode lod:override:index": "LODRootAPI and LODOverrideAPI",
        "info:id info:implementationSource outputs:*": "shaders and materials",
        "material:binding*": "every prim",
    },
    no_effect={
        "productName productType orderedVars": "-o names the file, --aov its channels",
        "proxyPrim": "purposes decide what is drawn",
        "collection:* colorSpaceDefinition:*": "read where they are named",
        "stereoRole": "one camera draws a picture",
        "guideRadius": "the size of a symbol",
        "light:shaderId": "the lights of the schema are drawn",
        "lightList lightList:cacheBehavior": "",
        "ui:* physics:* authorship:* semantics:* accessibility:* hydra:*": "",
        "coordSys:* inputs:ri:*": "RenderMan alone",
        "primvars:ri:* primvars:arnold:*": "other renderers",
        "GenerativeProcedural.proceduralSystem": "reported by the type",
        "jointNames": "names for a user interface",
        "userProperties:*": "data of the user",
    },
    not_drawn={
        "light:materialSyncMode": "the material of a mesh light takes no part in its light",
        "materialBindingPurposes": "full precedes preview, which precedes all-purpose",
        "lod:heuristics": "a level of detail is drawn at every distance",
        "motion:*": "velocities count as they are, between all samples",
        "trimCurve:*": "the whole patch is drawn",
        "renderingColorSpace": "colours are linear with the primaries of sRGB",
        "inputs:specular light:filters portals": "",
        "inputs:shadow:color inputs:shadow:distance inputs:shadow:falloff inputs:shadow:falloffGamma": "",
    },
)

SHADERS = Table(
    "Shaders",
    drawn={
        "UsdPreviewSurface": "see the inputs",
        "UsdUVTexture": "with wrap modes, scale, bias, fallback and colour space; UDIM tiles, each a picture of its own",
        "UsdTransform2d": "",
        "UsdPrimvarReader_float UsdPrimvarReader_float2 UsdPrimvarReader_float3 UsdPrimvarReader_float4": "",
        "ND_standard_surface_surfaceshader ND_open_pbr_surface_surfaceshader arnold:standard_surface ND_disney_principled": (
            "as `openpbr`, under outputs:mtlx:surface too, which precedes outputs:surface: see [materialx.md](materialx.md)"
        ),
        "ND_gltf_pbr_surfaceshader": "as `principled`; as `openpbr` where light passes, or with iridescence, anisotropy or specular inputs",
        "ND_surface ND_surface_unlit ND_layer_bsdf ND_mix_bsdf ND_add_bsdf ND_multiply_bsdfF ND_multiply_bsdfC ND_layer_vdf": (
            "graphs of the BSDFs below; mixtures by a texture are blends"
        ),
        "ND_mix_surfaceshader ND_convert_*_surfaceshader ND_dot_surfaceshader": "blends of surfaces, each with its normal map",
        "ND_add_edf ND_mix_edf ND_multiply_edfF ND_multiply_edfC": "emission",
        "ND_oren_nayar_diffuse_bsdf ND_burley_diffuse_bsdf ND_translucent_bsdf ND_subsurface_bsdf": "diffuse bases, sheets and bodies",
        "ND_dielectric_bsdf ND_conductor_bsdf ND_generalized_schlick_bsdf ND_sheen_bsdf ND_uniform_edf": (
            "highlights, coats, metals, fuzz and emission, with thin films"
        ),
        "ND_UsdPreviewSurface_surfaceshader ND_UsdUVTexture ND_UsdTransform2d ND_UsdPrimvarReader_*": "as those of USD",
        "ND_flake3d ND_flake2d": "as the normal of a surface",
        "ND_image_* ND_tiledimage_*": "pictures with address modes and the colour space of the file's metadata",
        "ND_texcoord_* ND_geompropvalue_* ND_place2d_vector2": "",
        "ND_*": "the other nodes of textures, as tapes: see [materialx.md](materialx.md)",
        "UsdPrimvarReader_int UsdPrimvarReader_string UsdPrimvarReader_normal UsdPrimvarReader_point UsdPrimvarReader_vector": "",
    },
    not_drawn={
        "UsdPrimvarReader_matrix": "",
        "HwPrimvar_1 HwUvTexture_1 HwPtexTexture_1 HwFieldReader_*": "",
        "ND_tangent_vector3 ND_bitangent_vector3": "in textures",
        "ND_hextilednormalmap_vector3 ND_blur_* ND_chiang_hair_bsdf": "",
    },
)

INPUTS = Table(
    "Inputs of shaders",
    drawn={
        "diffuseColor emissiveColor useSpecularWorkflow specularColor metallic roughness clearcoat clearcoatRoughness": "UsdPreviewSurface",
        "opacity opacityThreshold ior normal occlusion": "UsdPreviewSurface",
        "opacityMode": "an opacity that varies, or of a metal, fades highlights in both modes",
        "file st wrapS wrapT fallback scale bias sourceColorSpace": "UsdUVTexture",
        "in rotation translation": "UsdTransform2d",
        "varname": "UsdPrimvarReader",
        "uaddressmode vaddressmode default texcoord uvtiling uvoffset filtertype": "ND_image, ND_tiledimage; closest, else over the pixel",
        "geomprop index value pivot rotate offset": "ND_geompropvalue, ND_extract, ND_constant, ND_place2d",
        "displacement": (
            "moves the points of meshes, refined by --complexity, along their normals, in units of the stage; in prototypes in theirs"
        ),
    },
    not_drawn={
        "tangent bitangent space": "ND_normalmap: normal maps are those of tangent space, whose tangents come from texture coordinates",
        "layer framerange frameoffset frameendaction operationorder realworldimagesize realworldtilesize": "",
    },
)

TABLES = (PRIM_TYPES, API_SCHEMAS, PROPERTIES, SHADERS, INPUTS)
