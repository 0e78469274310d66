"""Extensions and properties of glTF, each drawn, without effect or not drawn. Reports the unknown names of a document.

Format: glTF 2.0 (Khronos, ISO/IEC 12113:2022) and the extensions of github.com/KhronosGroup/glTF/tree/main/extensions/2.0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .understood import State, Table

EXTENSIONS = Table(
    "Extensions",
    drawn={
        "KHR_lights_punctual": "point, spot and directional lights",
        "KHR_materials_clearcoat": "weight, roughness and a normal of its own",
        "KHR_materials_sheen": "over the highlight and the base, under a coat",
        "KHR_materials_emissive_strength KHR_materials_ior": "",
        "KHR_materials_transmission": (
            "a thin surface, which may be rough; solid glass with a volume, or with a tint from one half on without a picture"
        ),
        "ADOBE_materials_thin_transparency": "as KHR_materials_transmission, which precedes it",
        "KHR_materials_anisotropy": "as OpenPBR, whose roughness and anisotropy have the same widths",
        "KHR_materials_iridescence": "as OpenPBR: on surfaces, thin walls and solid glass; a sheen is its fuzz, no occlusion",
        "KHR_materials_dispersion": "of solid glass, by wavelength, at most 4",
        "KHR_materials_unlit": "the colour as emission",
        "KHR_materials_diffuse_transmission": "beside a highlight, which is weaker by the share that passes",
        "KHR_materials_specular": "factors and pictures of surfaces that are not metals; of others the mean of the factors",
        "KHR_materials_volume": "absorption of glass, as a solid",
        "KHR_materials_volume_scatter": "the medium inside of glass, or of what light enters by KHR_materials_diffuse_transmission",
        "KHR_materials_pbrSpecularGlossiness": "",
        "KHR_draco_mesh_compression": "with the package DracoPy (extra draco)",
        "EXT_meshopt_compression KHR_meshopt_compression": "as gltfpack writes it: version 0 of the attribute codec",
        "KHR_mesh_quantization": "",
        "KHR_node_visibility": "",
        "KHR_texture_transform": "",
        "EXT_mesh_gpu_instancing": "TRANSLATION, ROTATION and SCALE",
        "EXT_texture_webp": "",
        "KHR_texture_basisu": "pictures in KTX 2, ETC1S and UASTC, with the package opengl_basisu (extra basisu); else those beside them",
    },
    no_effect={
        "KHR_xmp KHR_xmp_json_ld KHR_node_hoverability KHR_node_selectability": "data about the asset",
        "KHR_physics_rigid_bodies KHR_implicit_shapes KHR_collision_shapes OMI_*": "simulation",
        "KHR_audio_emitter MSFT_audio_emitter KHR_audio_graph": "sound",
        "EXT_structural_metadata EXT_mesh_features EXT_instance_features EXT_feature_metadata": "data about features",
        "FB_geometry_metadata AGI_stk_metadata GRIFFEL_bim_data": "data",
        "MSFT_packing_occlusionRoughnessMetallic MSFT_packing_normalRoughnessMetallic": "copies of pictures",
    },
    not_drawn={
        "KHR_animation_pointer": "",
        "KHR_interactivity": "its graph is not run",
        "AGI_articulations": "the initial values of articulations move no node",
        "KHR_materials_subsurface KHR_materials_scatter": "",
        "KHR_materials_variants": "the default materials are drawn",
        "ADOBE_materials_clearcoat_specular ADOBE_materials_clearcoat_tint": "",
        "EXT_texture_astc MSFT_texture_dds KHR_texture_procedurals EXT_texture_procedurals_mx_1_39": "",
        "KHR_techniques_webgl KHR_gaussian_splatting KHR_gaussian_splatting_compression_spz KHR_gaussian_splatting_compression_spz_2": "",
        "EXT_lights_image_based EXT_lights_ies EXT_texture_video NV_materials_mdl KHR_xmp_material": "",
        "MSFT_lod": "the most detailed level is drawn",
        "CESIUM_primitive_outline CESIUM_primitive_restart EXT_mesh_manifold EXT_mesh_primitive_restart KHR_mesh_primitive_restart": "",
        "EXT_primitive_voxels MPEG_*": "",
    },
)

PROPERTIES = Table(
    "Properties",
    drawn={
        "asset.version scene scenes.nodes": "the default scene, else the first",
        "nodes.children nodes.matrix nodes.translation nodes.rotation nodes.scale nodes.mesh nodes.camera": "",
        "meshes.primitives meshes.primitives.mode meshes.primitives.indices meshes.primitives.material": (
            "triangles, strips and fans; points as spheres and lines as tubes, with 1/150 of their extent as their width"
        ),
        "meshes.primitives.attributes.POSITION meshes.primitives.attributes.NORMAL meshes.primitives.attributes.COLOR_0": "",
        "meshes.primitives.attributes.TANGENT": "as those of the texture coordinates; others are reported where a normal map uses them",
        "meshes.primitives.attributes.TEXCOORD_*": "a part for each map between the sets of a material's pictures, at most 64",
        "nodes.skin skins.joints skins.inverseBindMatrices": "",
        "meshes.primitives.attributes.JOINTS_* meshes.primitives.attributes.WEIGHTS_*": "skins",
        "nodes.weights meshes.weights meshes.primitives.targets.POSITION meshes.primitives.targets.NORMAL": "morph targets",
        "animations.channels animations.channels.* animations.samplers animations.samplers.*": "the first, or --animation, at --time",
        "materials.pbrMetallicRoughness.*": "base colour, metallic and roughness with their pictures",
        "materials.normalTexture textureInfo.scale materials.occlusionTexture": "",
        "materials.emissiveFactor materials.emissiveTexture materials.alphaMode materials.alphaCutoff": "",
        "materials.doubleSided": (
            "single-sided surfaces are not seen from behind; their backs shine, cast shadows and show in mirrors, "
            "but for shells seen from outside; glass has both sides"
        ),
        "textureInfo.index textureInfo.texCoord textureInfo.strength": "",
        "textures.source textures.sampler samplers.wrapS samplers.wrapT samplers.magFilter": "",
        "images.uri images.bufferView": "files beside the document, data URIs and the binary chunk",
        "cameras.type cameras.perspective.* cameras.orthographic.*": "of a file that is drawn by itself",
        "accessors.bufferView accessors.byteOffset accessors.componentType accessors.normalized accessors.count accessors.type": "",
        "accessors.sparse accessors.sparse.* bufferViews.buffer bufferViews.byteOffset bufferViews.byteLength bufferViews.byteStride": "",
        "buffers.uri buffers.byteLength": "",
        "KHR_lights_punctual.lights KHR_lights_punctual.light KHR_lights_punctual.lights.color KHR_lights_punctual.lights.intensity": "",
        "KHR_lights_punctual.lights.type KHR_lights_punctual.lights.spot KHR_lights_punctual.lights.spot.*": "",
        "KHR_materials_clearcoat.clearcoatFactor KHR_materials_clearcoat.clearcoatRoughnessFactor": "",
        "KHR_materials_sheen.sheenColorFactor KHR_materials_sheen.sheenRoughnessFactor": "",
        "KHR_materials_sheen.sheenColorTexture KHR_materials_sheen.sheenRoughnessTexture": "",
        "KHR_materials_clearcoat.clearcoatTexture KHR_materials_clearcoat.clearcoatRoughnessTexture": "",
        "KHR_materials_clearcoat.clearcoatNormalTexture": "without it a coat is smooth over a base with a normal map",
        "KHR_materials_emissive_strength.emissiveStrength KHR_materials_ior.ior KHR_materials_transmission.*": "",
        "ADOBE_materials_thin_transparency.transmissionFactor ADOBE_materials_thin_transparency.transmissionTexture": "",
        "KHR_materials_specular.specularFactor KHR_materials_specular.specularColorFactor": "",
        "KHR_materials_specular.specularTexture KHR_materials_specular.specularColorTexture": "",
        "KHR_materials_volume.thicknessFactor KHR_materials_volume.attenuationDistance KHR_materials_volume.attenuationColor": "",
        "KHR_materials_diffuse_transmission.diffuseTransmissionFactor KHR_materials_diffuse_transmission.diffuseTransmissionTexture": "",
        "KHR_materials_diffuse_transmission.diffuseTransmissionColorFactor": "",
        "KHR_materials_diffuse_transmission.diffuseTransmissionColorTexture": "",
        "KHR_materials_volume_scatter.multiscatterColor KHR_materials_volume_scatter.scatterAnisotropy": "",
        "KHR_materials_anisotropy.* KHR_materials_iridescence.* KHR_materials_dispersion.dispersion": "",
        "KHR_materials_pbrSpecularGlossiness.*": "",
        "KHR_draco_mesh_compression.bufferView KHR_draco_mesh_compression.attributes KHR_draco_mesh_compression.attributes.*": "",
        "EXT_meshopt_compression.* KHR_meshopt_compression.*": "",
        "KHR_node_visibility.visible KHR_texture_transform.* EXT_texture_webp.source KHR_texture_basisu.source": "",
        "EXT_mesh_gpu_instancing.attributes.TRANSLATION EXT_mesh_gpu_instancing.attributes.ROTATION": "",
        "EXT_mesh_gpu_instancing.attributes.SCALE": "",
    },
    no_effect={
        "name *.name extras *.extras asset.* extensionsUsed extensionsRequired": "data about the asset",
        "accessors.min accessors.max": "bounds are computed",
        "bufferViews.target images.mimeType samplers.minFilter": "hints; pictures are filtered over the pixel",
        "meshes.primitives.attributes._* EXT_mesh_gpu_instancing.attributes._*": "data of the user",
        "skins.skeleton": "a hint",
        "KHR_materials_volume.thicknessTexture": "a hint for renderers without rays: a shape has its own thickness",
    },
    not_drawn={
        "meshes.primitives.attributes.COLOR_*": "",
        "meshes.primitives.targets.*": "positions and normals are morphed",
        "KHR_lights_punctual.lights.range": "the light reaches any distance",
        "KHR_materials_clearcoat.* KHR_materials_volume.* KHR_materials_volume_scatter.*": "",
        "ADOBE_materials_thin_transparency.ior": "",
        "EXT_mesh_gpu_instancing.attributes.*": "",
    },
)

TABLES = (EXTENSIONS, PROPERTIES)
_ROWS = [name for _, names, _ in PROPERTIES for name in names.split()]
_OBJECTS = frozenset(name.rsplit(".", k)[0] for name in _ROWS for k in range(1, name.count(".") + 1))  # of further properties
_DATA = frozenset({"extras", "asset"})


def report(document: dict[str, Any], warn: Callable[[str], None]) -> None:
    """Warn of every extension and property of a document that is not drawn, once each, with the place of the first property."""
    reported: set[str] = set()

    def extension(name: str) -> None:
        if name not in reported and (message := EXTENSIONS.report(f"the extension `{name[:80]}`", name)):
            warn(message)
        reported.add(name)

    for name in sorted({str(e) for key in ("extensionsUsed", "extensionsRequired") for e in document.get(key, ())}):
        extension(name)
    waiting: list[tuple[Any, str, str]] = [(document, "", "")]  # value, name of its object in the table, place in the document
    while waiting:
        value, path, place = waiting.pop()
        if isinstance(value, list):
            waiting += [(item, path, f"{place}[{k}]") for k, item in reversed(list(enumerate(value))) if isinstance(item, dict | list)]
            continue
        for key, item in value.items():
            inside = f"{path}.{key}" if path else str(key)
            if key == "extensions" and isinstance(item, dict):
                for name in item:
                    extension(name)
                drawn = [name for name in item if (EXTENSIONS.find(name) or ("",))[0] == State.DRAWN]
                waiting += [(item[name], name, f"{place}.{name}") for name in drawn if isinstance(item[name], dict)]
                continue
            shown = f"{place}.{key}" if place else str(key)
            if inside not in reported and inside not in _OBJECTS:
                reported.add(inside)
                if message := PROPERTIES.report(f"`{shown[:120]}`", inside):
                    warn(message)
            if key not in _DATA and isinstance(item, dict | list):
                waiting.append((item, "textureInfo" if str(key).endswith("Texture") else inside, shown))
