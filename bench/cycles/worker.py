"""Renders a USD stage by Cycles on one thread, in a Python with bpy: a request a line in, an answer a line out, both JSON.

Arguments: the stage, and the media of its objects as JSON, {object: {scattering: [3], absorption: [3], phase: g}}, per metre.

A request has the width and height `size`, `samples`, `seed`, `bounces`, `guiding` and the EXR file `out`. An answer has the CPU seconds
of the process so far. Answers begin with ANSWER, as Blender writes lines of its own.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

ANSWER = "@answer "
SUN = 4.0  # factor by which Blender's reader multiplies the irradiance of distant lights


def open_stage(path: str) -> Any:
    """Blender's scene of a stage, for pictures by Cycles."""
    import bpy  # pyright: ignore[reportMissingImports]

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.world = bpy.data.worlds.new("world")
    bpy.ops.wm.usd_import(filepath=path)
    scene = bpy.context.scene
    for light in (item.data for item in scene.objects if item.type == "LIGHT" and item.data.type == "SUN"):
        light.energy /= SUN
    scene.camera = next(item for item in scene.objects if item.type == "CAMERA")
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.use_persistent_data = True
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    settings = scene.cycles
    settings.device, settings.use_adaptive_sampling, settings.use_denoising = "CPU", False, False
    settings.sample_clamp_indirect, settings.blur_glossy = 0.0, 0.0
    settings.pixel_filter_type = "BOX"
    return scene


def fill(scene: Any, media: dict[str, dict[str, Any]]) -> None:
    """Replace the materials of objects by media without a surface. Lights of such scenes are seen."""
    import bpy  # pyright: ignore[reportMissingImports]

    for light in (item for item in scene.objects if media and item.type == "LIGHT"):
        light.visible_camera = True
    for name, medium in media.items():
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        volume = tree.nodes.new("ShaderNodeVolumeCoefficients")
        volume.inputs["Absorption Coefficients"].default_value = medium["absorption"]
        volume.inputs["Scatter Coefficients"].default_value = medium["scattering"]
        volume.inputs["Anisotropy"].default_value = medium["phase"]
        tree.links.new(volume.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"])
        mesh = scene.objects[name].data
        mesh.materials.clear()
        mesh.materials.append(material)


def draw(scene: Any, request: dict[str, Any]) -> None:
    """Write one picture."""
    import bpy  # pyright: ignore[reportMissingImports]

    settings = scene.cycles
    scene.render.resolution_x = scene.render.resolution_y = request["size"]
    scene.render.filepath = request["out"]
    settings.samples, settings.seed, settings.use_guiding = request["samples"], request["seed"], request["guiding"]
    for name in ("max", "diffuse", "glossy", "transmission", "volume", "transparent_max"):
        setattr(settings, f"{name}_bounces", request["bounces"])
    bpy.ops.render.render(write_still=True)


def main() -> None:
    """Answer requests until the end of the input."""
    scene = open_stage(sys.argv[1])
    fill(scene, json.loads(sys.argv[2]))
    print(ANSWER + json.dumps({"cpu": time.process_time()}), flush=True)
    for line in sys.stdin:
        draw(scene, json.loads(line))
        print(ANSWER + json.dumps({"cpu": time.process_time()}), flush=True)


if __name__ == "__main__":
    main()
