"""Scenes of one feature each: every member of the enumerations of the IR alone, so that the tables of all others are empty."""

from __future__ import annotations

from enum import IntEnum

from maquette.compiler import ir

CAMERA = "camera(position: [2, 2.4, 3.4], look_at: [0, 0.2, 0], fov: 40deg)\n"
BLACK = "render(background: #000000)\n"
FLOOR = "plane(y: -0.6, material: lambert(0.7))\n"
BALL = "sphere(0.6, material: lambert(0.7))\n"
SUN = "directional(from: [1, 2, 3])\n"
MESH = "mesh(points: [[-1, 0, 0.4], [1, 0, 0.4], [0, 1, 0], [0, 0.2, -1]], faces: [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]{})\n"

SHAPES: dict[IntEnum, str] = {  # `{}` is the place of more arguments
    ir.GeometryKind.MESH: MESH,
    ir.GeometryKind.SPHERE: "sphere(0.6{})\n",
    ir.GeometryKind.BOX: "box(0.8{})\n",
    ir.GeometryKind.PLANE: "plane(y: 0.1{})\n",
    ir.GeometryKind.RECTANGLE: "area([0, 0.1, 0], look_at: [1, 2, 2], size: [1, 0.8], luminance: 0)\n",  # the shape of area lights
    ir.GeometryKind.DISK: "disk(0.7{})\n",
    ir.GeometryKind.CYLINDER: "cylinder(0.4, 0.9{})\n",
    ir.GeometryKind.CONE: "cone(0.5, 1{})\n",
    ir.GeometryKind.TORUS: "torus(0.6, 0.2{})\n",
    ir.GeometryKind.CAPSULE: "capsule(0.3, 0.6{})\n",
    ir.GeometryKind.QUADRIC: "quadric([1, -0.6, 1, 0, 0, 0, 0, 0, 0, -0.05], within: 0.9{})\n",
    ir.GeometryKind.FORMULA: "implicit(|x, y, z| x * x + y * y + z * z + 0.05 * sin(9 * x) <= 0.4{})\n",
}
LIGHTS: dict[IntEnum, str] = {
    ir.LightKind.POINT: "point([1, 3, 2])\n",
    ir.LightKind.SPOT: "spot([1, 3, 2])\n",
    ir.LightKind.DIRECTIONAL: SUN,
    ir.LightKind.SUN: "sun(from: [1, 2, 3], angle: 5deg)\n",
    ir.LightKind.SKY: "sky(luminance: 0.5)\n",
    ir.LightKind.DOME: 'dome("sky.exr")\n',
    ir.LightKind.AMBIENT: "ambient(luminance: 0.5)\n",
    ir.LightKind.RECTANGLE: "area([1, 3, 2], look_at: [0, 0, 0], luminance: 9)\n",
    ir.LightKind.DISK: 'area([1, 3, 2], look_at: [0, 0, 0], shape: "disk", luminance: 9)\n',
    ir.LightKind.SPHERE: 'usd("light.usda")\n',
}
MODELS: dict[IntEnum, str] = {
    ir.MaterialModel.LAMBERT: "lambert(0.7)",
    ir.MaterialModel.PHONG: "phong(#d0402a, specular: 0.4, shininess: 20, reflection: 0.2)",
    ir.MaterialModel.BLINN_PHONG: "blinn_phong(#d0402a, specular: 0.4, shininess: 20, transmission: 0.3)",
    ir.MaterialModel.MIRROR: "mirror(0.9)",
    ir.MaterialModel.GLASS: "glass(inside: #80c0ff)",
    ir.MaterialModel.EMISSIVE: "emissive(luminance: 3)",
    ir.MaterialModel.PRINCIPLED: "principled(#d0402a, roughness: 0.4)",
    ir.MaterialModel.PRINCIPLED_SPECULAR: "principled(#d0402a, specular: #806040, roughness: 0.4)",
    ir.MaterialModel.METAL: 'metal("gold", roughness: 0.3)',
    ir.MaterialModel.TRANSLUCENT: "translucent(0.3, transmission: 0.6)",
    ir.MaterialModel.SUBSURFACE: "subsurface(#d0a080, radius: 0.1)",
    ir.MaterialModel.OPENPBR: "openpbr(#d0a080, specular_roughness: 0.4, coat_weight: 0.5)",
    ir.MaterialModel.BLEND: 'blend(metal("copper"), lambert(#5a9a80), 0.4)',
}
SHADINGS: dict[IntEnum, str] = {
    ir.Shading.SMOOTH: 'phong(0.7, shading: "phong")',
    ir.Shading.GOURAUD: 'phong(0.7, shading: "gouraud")',
    ir.Shading.FLAT: 'phong(0.7, shading: "flat")',
}
_IMAGE = 'image("a.exr")'
SLOTS: dict[IntEnum, str] = {  # each with an image where it takes one
    ir.Slot.AMBIENT: f"principled(0.5, occlusion: {_IMAGE})",
    ir.Slot.DIFFUSE: f"lambert({_IMAGE})",
    ir.Slot.SPECULAR: f"phong(0.5, specular: {_IMAGE})",
    ir.Slot.SHININESS: f"phong(0.5, shininess: {_IMAGE})",
    ir.Slot.REFLECTION: f"mirror({_IMAGE})",
    ir.Slot.TRANSMISSION: f"glass({_IMAGE})",
    ir.Slot.IOR: f"principled(0.5, ior: {_IMAGE})",
    ir.Slot.EMISSION: f"emissive({_IMAGE})",
    ir.Slot.OPACITY: f"lambert(0.5, opacity: {_IMAGE})",
    ir.Slot.ROUGHNESS: f'metal("gold", roughness: {_IMAGE})',
    ir.Slot.METALLIC: f"principled(0.5, metallic: {_IMAGE})",
    ir.Slot.EDGE: 'metal("copper")',
    ir.Slot.COAT: f"principled(0.5, clearcoat: {_IMAGE})",
    ir.Slot.COAT_ROUGHNESS: f"principled(0.5, clearcoat: 1, clearcoat_roughness: {_IMAGE})",
    ir.Slot.NORMAL: f"lambert(0.7, normal_map: {_IMAGE})",
    ir.Slot.BUMP: f"lambert(0.7, bump_map: {_IMAGE})",
    ir.Slot.ABSORPTION: "glass(inside: #80c0ff, depth: 0.5)",
    ir.Slot.PRIORITY: "glass(priority: 2)",
    ir.Slot.WEIGHT: f"blend(lambert(0.2), lambert(0.8), {_IMAGE})",
    ir.Slot.SHEEN: f"principled(0.5, sheen: {_IMAGE})",
    ir.Slot.SHEEN_ROUGHNESS: f"principled(0.5, sheen: 0.5, sheen_roughness: {_IMAGE})",
    ir.Slot.DIFFUSE_TRANSMISSION: f"translucent(0.2, transmission: {_IMAGE})",
    ir.Slot.RADIUS: f"subsurface(0.5, radius: 0.1, scale: {_IMAGE})",
    ir.Slot.FLAKE_SIZE: "openpbr(0.5, base_metalness: 1, normal_map: flakes(5cm))",
    ir.Slot.FLAKE_TILT: f"openpbr(0.5, base_metalness: 1, normal_map: flakes(5cm, tilt: {_IMAGE}))",
    ir.Slot.FLAKE_COVERAGE: f"openpbr(0.5, base_metalness: 1, normal_map: flakes(5cm, coverage: {_IMAGE}))",
    ir.Slot.FLAKE_SEED: "openpbr(0.5, base_metalness: 1, normal_map: flakes(5cm, seed: 3))",
    ir.Slot.DISPERSION: "glass(dispersion: 0.5)",
    ir.Slot.BASE_WEIGHT: f"openpbr(0.5, base_weight: {_IMAGE})",
    ir.Slot.DIFFUSE_ROUGHNESS: f"openpbr(0.5, base_diffuse_roughness: {_IMAGE})",
    ir.Slot.SPECULAR_WEIGHT: f"openpbr(0.5, specular_weight: {_IMAGE})",
    ir.Slot.ANISOTROPY: f'metal("gold", roughness: 0.4, anisotropy: {_IMAGE})',
    ir.Slot.ROTATION: f'metal("gold", roughness: 0.4, anisotropy: 0.8, rotation: {_IMAGE})',
    ir.Slot.COAT_COLOR: f"openpbr(0.5, coat_weight: 1, coat_roughness: 0.4, coat_color: {_IMAGE})",
    ir.Slot.COAT_IOR: f"openpbr(0.5, coat_weight: 1, coat_roughness: 0.4, coat_ior: {_IMAGE})",
    ir.Slot.COAT_ANISOTROPY: f"openpbr(0.5, coat_weight: 1, coat_roughness: 0.4, coat_roughness_anisotropy: {_IMAGE})",
    ir.Slot.COAT_ROTATION: f"openpbr(0.5, coat_weight: 1, coat_roughness: 0.4, coat_roughness_anisotropy: 0.8, coat_rotation: {_IMAGE})",
    ir.Slot.COAT_NORMAL: f"openpbr(0.5, coat_weight: 1, coat_roughness: 0.4, geometry_coat_normal: {_IMAGE})",
    ir.Slot.COAT_DARKENING: f"openpbr(0.5, coat_weight: 1, coat_roughness: 0.4, coat_darkening: {_IMAGE})",
    ir.Slot.FUZZ: f"openpbr(0.5, fuzz_weight: {_IMAGE})",
    ir.Slot.FUZZ_COLOR: f"openpbr(0.5, fuzz_weight: 1, fuzz_color: {_IMAGE})",
    ir.Slot.FUZZ_ROUGHNESS: f"openpbr(0.5, fuzz_weight: 1, fuzz_roughness: {_IMAGE})",
    ir.Slot.FILM: f"openpbr(0.5, thin_film_weight: {_IMAGE})",
    ir.Slot.FILM_THICKNESS: f"openpbr(0.5, thin_film_weight: 1, thin_film_thickness: {_IMAGE})",
    ir.Slot.FILM_IOR: f"openpbr(0.5, thin_film_weight: 1, thin_film_ior: {_IMAGE})",
    ir.Slot.TRANSMISSION_WEIGHT: f"openpbr(0.5, specular_roughness: 0.4, transmission_weight: {_IMAGE})",
    ir.Slot.TRANSMISSION_COLOR: f"openpbr(specular_roughness: 0.4, transmission_weight: 1, coat_weight: 1, transmission_color: {_IMAGE})",
    ir.Slot.SUBSURFACE_WEIGHT: f"openpbr(0.5, geometry_thin_walled: true, subsurface_weight: {_IMAGE})",
    ir.Slot.SUBSURFACE_COLOR: f"openpbr(0.5, geometry_thin_walled: true, subsurface_weight: 1, subsurface_color: {_IMAGE})",
    ir.Slot.THIN_WALLED: "openpbr(0.5, specular_roughness: 0.4, transmission_weight: 1, geometry_thin_walled: true)",
    ir.Slot.SUBSURFACE_ANISOTROPY:
        "openpbr(0.5, geometry_thin_walled: true, subsurface_weight: 1, subsurface_scatter_anisotropy: 0.5)",
}
TEXTURES: dict[IntEnum, str] = {
    ir.TextureKind.IMAGE: _IMAGE,
    ir.TextureKind.CHECKER: "checker(#dddddd, #777777)",
    ir.TextureKind.STRIPES: "stripes(#dddddd, #777777)",
    ir.TextureKind.FORMULA: "pattern(|x, y, z| 0.5 + 0.4 * sin(9 * x) * sin(7 * y))",
}
MAPPINGS: dict[IntEnum, str] = {
    ir.TextureMapping.UV: 'image("a.exr", mapping: "uv")',
    ir.TextureMapping.LATLONG: 'image("a.exr", mapping: "latlong")',
    ir.TextureMapping.PROJECTED: 'image("a.exr", mapping: "projected")',
    ir.TextureMapping.BOX: 'image("a.exr", mapping: "box")',
    ir.TextureMapping.NET: 'image("a.exr", mapping: "net")',
}
WRAPS: dict[IntEnum, str] = {
    ir.Wrap.REPEAT: 'image("a.exr", wrap: "repeat", scale: 3)',
    ir.Wrap.CLAMP: 'image("a.exr", wrap: "clamp", scale: 3)',
    ir.Wrap.MIRROR: 'image("a.exr", wrap: "mirror", scale: 3)',
    ir.Wrap.BLACK: 'image("a.exr", wrap: "black", scale: 3)',
}
FALLOFFS: dict[IntEnum, str] = {
    ir.FalloffKind.INVERSE_SQUARE: "point([1, 3, 2])\n",
    ir.FalloffKind.POLYNOMIAL: "point([1, 3, 2], falloff: [1, 0.5, 0.1])\n",
    ir.FalloffKind.RAMP: "point([1, 3, 2], falloff: ramp(2, 9))\n",
}
PROJECTIONS: dict[IntEnum, str] = {
    ir.Projection.PERSPECTIVE: CAMERA,
    ir.Projection.ORTHOGRAPHIC: "camera(position: [2, 2.4, 3.4], look_at: [0, 0.2, 0], width: 3)\n",
    ir.Projection.PANORAMIC: 'camera(position: [0.4, 1.4, 0.9], look_at: [0, 0.2, 0], projection: "panoramic")\n',
}
INTERPOLATIONS: dict[IntEnum, str] = {
    ir.Interpolation.CONSTANT: 'usd("constant.usda")\n',
    ir.Interpolation.FACE: 'usd("uniform.usda")\n',
    ir.Interpolation.VERTEX: 'usd("vertex.usda")\n',
    ir.Interpolation.CORNER: 'usd("faceVarying.usda")\n',
}
EMPTY = {
    "nothing": "",
    "a camera": CAMERA,
    "a floor in the dark": FLOOR,
    "a mesh without faces": "mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [])\n" + SUN,
    "text without letters": 'text(" ", size: 1)\n' + SUN,
    "a solid that is empty": "difference { sphere(0.5); box(3) }\n" + SUN,
    "a formula without a root": "implicit(|x, y, z| x * x + y * y + z * z + 1 <= 0, within: 1)\n" + SUN,
    "a black emitter": "box(1, material: emissive(luminance: 0))\n" + FLOOR,
    "a black light": "point([1, 3, 2], intensity: 0)\n" + FLOOR,
    "lights that light nothing": 'point([1, 3, 2], receivers: ["!*"])\n' + FLOOR,
    "an emitter behind a link": 'directional(from: [1, 2, 3], receivers: ["a"], blockers: ["!a"])\nbox(0.6, name: "a", '
    "material: emissive(luminance: 3))\n" + FLOOR,
}

LIGHT_USD = """#usda 1.0
(
  upAxis = "Y"
  metersPerUnit = 1
)
def SphereLight "Lamp" {
  float inputs:radius = 0.4
  float inputs:intensity = 9
  double3 xformOp:translate = (1, 3, 2)
  uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def colored_mesh(interpolation: str) -> str:
    """A stage with a tetrahedron whose colours and normals are interpolated this way."""
    count = {"constant": 1, "uniform": 4, "vertex": 4, "faceVarying": 12}[interpolation]
    colors = ", ".join(f"({0.9 - 0.05 * k}, {0.3 + 0.05 * k}, 0.5)" for k in range(count))
    normals = ", ".join(f"({0.1 * k}, 1, 0.3)" for k in range(count))
    return f"""#usda 1.0
(
  upAxis = "Y"
  metersPerUnit = 1
)
def Mesh "Tetrahedron" {{
  point3f[] points = [(-1, 0, 0.4), (1, 0, 0.4), (0, 1, 0), (0, 0.2, -1)]
  int[] faceVertexCounts = [3, 3, 3, 3]
  int[] faceVertexIndices = [0, 1, 2, 0, 3, 1, 1, 3, 2, 2, 3, 0]
  uniform token subdivisionScheme = "none"
  normal3f[] normals = [{normals}] (interpolation = "{interpolation}")
  color3f[] primvars:displayColor = [{colors}] (interpolation = "{interpolation}")
}}
"""


def emitter(kind: IntEnum) -> str:
    """A shape that shines."""
    return SHAPES[kind].format(", material: emissive(luminance: 3)").replace("luminance: 0)", "luminance: 3)")


def every_scene() -> dict[str, str]:
    """The scenes by a name each, such as "emitter TORUS"."""
    of_kind = {
        **{f"shape {kind.name}": text.format(", material: lambert(0.7)") + SUN for kind, text in SHAPES.items()},
        **{f"shape {kind.name} in a sky": text.format(", material: lambert(0.7)") + "sky()\n" for kind, text in SHAPES.items()},
        **{f"emitter {kind.name}": emitter(kind) + FLOOR for kind in SHAPES},
        **{f"light {kind.name}": FLOOR + text for kind, text in LIGHTS.items()},
        **{f"light {kind.name} on nothing": text for kind, text in LIGHTS.items()},
        **{f"material {kind.name}": f"sphere(0.6, material: {text})\n" + SUN for kind, text in MODELS.items()},
        **{f"material {kind.name} in the dark": f"box(0.6, material: {text})\n" + FLOOR for kind, text in MODELS.items()},
        **{f"shading {kind.name}": MESH.format(f", material: {text}") + SUN for kind, text in SHADINGS.items()},
        **{f"slot {kind.name}": f"sphere(0.6, material: {text})\n" + SUN for kind, text in SLOTS.items()},
        **{f"texture {kind.name}": f"sphere(0.6, material: lambert({text}))\n" + SUN for kind, text in TEXTURES.items()},
        **{f"glowing {kind.name}": f"box(0.8, material: emissive({text}, luminance: 3))\n" + FLOOR for kind, text in TEXTURES.items()},
        **{f"mapping {kind.name}": f"box(0.8, material: lambert({text}))\n" + SUN for kind, text in MAPPINGS.items()},
        **{f"wrap {kind.name}": f"box([1.4, 0.1, 1.4], material: lambert({text}))\n" + SUN for kind, text in WRAPS.items()},
        **{f"falloff {kind.name}": FLOOR + text for kind, text in FALLOFFS.items()},
        **{f"colors {kind.name}": text + SUN for kind, text in INTERPOLATIONS.items()},
    }
    others = {f"projection {kind.name}": text + BALL + SUN for kind, text in PROJECTIONS.items()}
    return {**{name: CAMERA + BLACK + text for name, text in of_kind.items()}, **others, **EMPTY}
