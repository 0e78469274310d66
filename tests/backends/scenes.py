"""Small scenes that together use all features shared by the backends, for comparisons of pictures."""

from __future__ import annotations

FLOOR = "plane(y: -0.01, material: lambert(checker(#dddddd, #777777, size: 50cm)))\n"
CAMERA = "camera(position: [1.2, 2.6, 5], look_at: [0, 0.6, 0], fov: 36deg)\n"
LAMP = "point([3, 5, 4], intensity: 60)\n"

OBJ = """
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v 0 1.5 0
vt 0 0
vt 1 0
vt 0.5 1
f 4/1 3/2 5/3
f 3/1 2/2 5/3
f 2/1 1/2 5/3
f 1/1 4/2 5/3
f 1 2 3 4
"""

USD = """#usda 1.0
(
  upAxis = "Z"
  metersPerUnit = 0.01
)
def Xform "World" {
  def Sphere "Ball" {
    double radius = 60
    color3f[] primvars:displayColor = [(0.8, 0.3, 0.2)]
    double3 xformOp:translate = (-70, 0, 60)
    uniform token[] xformOpOrder = ["xformOp:translate"]
  }
  def Cube "Box" {
    double size = 90
    color3f[] primvars:displayColor = [(0.2, 0.5, 0.8)]
    double3 xformOp:translate = (80, 20, 45)
    float xformOp:rotateZ = 30
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]
  }
}
"""

SHAPES = """
sphere(0.45, center: [-1.6, 0.45, 0], material: lambert(#d0402a))
box([0.6, 0.9, 0.5], center: [-0.6, 0.45, 0.3], rotate: [0, 20deg, 0], material: lambert(#40a060))
cylinder(0.3, 0.9, center: [0.3, 0.45, 0.2], material: lambert(#4060c0))
cone(0.4, 1, center: [1.1, 0.5, 0.3], material: lambert(#c0a030))
torus(0.35, 0.12, center: [1.7, 0.4, -0.4], rotate: [70deg, 0, 0], material: lambert(#a040a0))
capsule(0.2, 0.5, center: [-1.1, 0.5, -0.9], material: lambert(#30a0a0))
ellipsoid([0.5, 0.3, 0.3], center: [-0.1, 0.4, -0.9], material: lambert(#909090))
quadric([1, -0.6, 1, 0, 0, 0, 0, 0, 0, -0.05], within: 0.9, translate: [0.9, 0.5, -0.9], material: lambert(#c06030))
disk(0.5, center: [-1.3, 0.02, 1.2], material: lambert(#ffffff))
triangle([[0.6, 0.02, 1.5], [1.5, 0.02, 1.5], [1, 0.8, 1.2]], material: lambert(#60c060))
polygon([[-0.5, 0.02, 1], [0.4, 0.02, 1], [0.4, 0.02, 1.6], [0, 0.02, 1.3], [-0.5, 0.02, 1.6]], material: lambert(#c0c060))
"""

TETRAHEDRON = "mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1.2, 0], [0, 0, 0.8]], faces: [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]"
WAVE = (
    "let n = 6\nlet grid = fold(|list, j| concat(list, [[0.4 * i - 1.2, 0.4 + 0.15 * sin(2rad * i) * cos(1.7rad * j), 0.4 * j - 1.2] "
    "for i in 0..n]), [], 0..n)\n"
    "let quads = fold(|list, j| concat(list, [[(n + 1) * j + i, (n + 1) * (j + 1) + i, (n + 1) * (j + 1) + i + 1, (n + 1) * j + i + 1] "
    "for i in 0..n - 1]), [], 0..n - 1)\n"
)

DIRECT = {  # what every backend draws whole
    "every shape": CAMERA + FLOOR + LAMP + SHAPES,
    "orthographic": "camera(position: [1.2, 2.6, 5], look_at: [0, 0.6, 0], width: 4.4)\n" + FLOOR + LAMP + SHAPES,
    "near and far": "camera(position: [1.2, 2.6, 5], look_at: [0, 0.6, 0], fov: 36deg, near: 4.9, far: 6.6)\n" + FLOOR + LAMP + SHAPES,
    "textures": CAMERA + FLOOR + LAMP + (
        'sphere(0.6, center: [-1, 0.6, 0], material: lambert(image("a.exr")))\n'
        'box(0.9, center: [0.4, 0.45, 0.4], rotate: [0, 30deg, 0], material: blinn_phong(image("a.exr", mapping: "net"), specular: 0.3))\n'
        "torus(0.5, 0.2, center: [1.4, 0.5, -0.5], rotate: [60deg, 0, 0], "
        'material: lambert(image("a.exr", mapping: "latlong", scale: 2)))\n'
        'cylinder(0.3, 0.8, center: [0, 0.4, -1], material: lambert(stripes(#ff0000, #0000ff, size: 10cm, angle: 30deg)))\n'
    ),
    "instances": CAMERA + FLOOR + LAMP + (
        f"{TETRAHEDRON}, material: lambert(#d08040))\n"
        f"{TETRAHEDRON}, scale: [-1, 1, 1], translate: [-0.4, 0, 0], material: lambert(#d08040))\n"
        f"{TETRAHEDRON}, scale: [1, 0.5, -1.5], translate: [0.2, 0.6, -1], rotate: [0, 50deg, 10deg], material: lambert(#4080d0))\n"
        "sphere(0.4, scale: [-1, 1.5, 0.7], translate: [-1.2, 0.6, 1], material: blinn_phong(#80d040, specular: 0.4))\n"
    ),
    "hard lights": CAMERA + FLOOR + SHAPES + (
        "point([3, 5, 4], intensity: 20, color: #ffd0a0)\nspot([-2, 4, 3], look_at: [0, 0.4, 0], cone: 20deg, soft: 6deg, intensity: 60)\n"
        "directional(from: [1, 2, -1], illuminance: 0.8, color: #a0c0ff)\n"
        "point([0, 3, 0], intensity: 6, falloff: [0.5, 0.3, 0.2], shadows: false)\n"
        "point([-3, 2, 1], intensity: 2, falloff: ramp(1m, 6m))\nambient(#ffffff, luminance: 0.1)\n"
    ),
    "gouraud": CAMERA + FLOOR + LAMP + WAVE + (
        "mesh(points: grid, faces: quads, normals: grid, "
        'material: blinn_phong(#d08040, specular: 0.6, shininess: 12, shading: "gouraud"))\n'
        'sphere(0.5, center: [1.2, 1, -0.6], material: phong(#40a0d0, specular: 0.5, shading: "gouraud"))\n'
    ),
    "flat": CAMERA + FLOOR + LAMP + WAVE + (
        'mesh(points: grid, faces: quads, normals: grid, material: blinn_phong(#d08040, specular: 0.6, shininess: 12, shading: "flat"))\n'
    ),
    "formulas": CAMERA + FLOOR + LAMP + (
        "implicit(|x, y, z| (hypot(x, z) - 0.5)^2 + y^2 <= 0.04, translate: [-1.1, 0.3, 0.4], material: lambert(#d04030))\n"
        "implicit(|x, y, z| sin(7*x)*cos(7*y) + sin(7*y)*cos(7*z) + sin(7*z)*cos(7*x) == 0.3, within: sphere(0.7), "
        "translate: [0.7, 0.8, -0.4], scale: [1, 1.2, 0.8], rotate: [0, 20deg, 10deg], material: phong(#3070c0, specular: 0.3))\n"
        "implicit(|x, y, z| y <= 0.3 * noise(3 * x, 3 * z) + 0.4 and abs(x) <= 0.5 and abs(z) <= 0.5, within: box([1.2, 2, 1.2]), "
        "translate: [1.3, 0, 1], material: lambert(#60a040))\n"
    ),
    "patterns": CAMERA + FLOOR + LAMP + (
        "let grain = pattern(|x, y, z| if sin(30 * hypot(x, z) + 5 * noise(3 * x, 2 * y, 3 * z)) > 0 then rgb(0.5, 0.3, 0.1) "
        "else rgb(0.7, 0.5, 0.2))\n"
        "let dots = pattern(|x, y, z| mod(floor(6 * x) + floor(6 * y) + floor(6 * z), 2) == 0)\n"
        "box(0.9, center: [-0.9, 0.45, 0.2], rotate: [0, 25deg, 0], material: lambert(grain))\n"
        "sphere(0.5, center: [0.4, 0.5, 0.3], material: phong(pattern(|x, y, z| 0.5 + 0.4 * noise(4 * x, 4 * y, 4 * z)), specular: dots))\n"
        "union(translate: [1.3, 0.5, -0.4], material: lambert(dots)) { sphere(0.4); box([0.3, 0.9, 0.9]) }\n"
    ),
    "OBJ": CAMERA + FLOOR + LAMP + 'mesh("a.obj", height: 1.4, rotate: [0, 25deg, 0], material: lambert(image("a.exr")))\n',
    "USD": CAMERA + FLOOR + LAMP + 'usd("a.usda", material: lambert(#909090))\n',
    "far from the origin": "group(translate: [100000, 0, -250000]) {\n" + FLOOR + LAMP + SHAPES + "}\n"
    "camera(position: [100001.2, 2.6, -249995], look_at: [100000, 0.6, -250000], fov: 36deg)\n",
}  # fmt: skip

SOFT = {  # sampled with random numbers
    "area lights": CAMERA + FLOOR + SHAPES + (
        "area([-1, 3, 2], look_at: [0, 0, 0], size: [1, 0.5], luminance: 8)\n"
        'area([2, 2.5, 1], look_at: [0, 0.5, 0], size: 0.6, shape: "disk", luminance: 8, color: #ffc080)\n'
        "sphere(0.2, center: [0.5, 1.8, 0.5], material: emissive(#80c0ff, luminance: 6))\n"
    ),
    "sun and sky": CAMERA + FLOOR + SHAPES + "sun(from: [2, 3, 1], illuminance: 2, angle: 4deg)\nsky(color: #a0c0ff, luminance: 0.5)\n",
    "dome": CAMERA + FLOOR + SHAPES + 'dome("a.exr", luminance: 0.8, rotate: [0, 40deg, 0])\n',
}  # fmt: skip

RAYS = {  # reflected and refracted rays
    "glass": CAMERA + FLOOR + LAMP + (
        "sphere(0.6, center: [-0.7, 0.6, 0], material: glass(ior: 1.5))\nbox(0.8, center: [0.6, 0.4, 0.4], rotate: [0, 30deg, 0], "
        "material: glass(#d0ffe0, ior: 1.4))\nsphere(0.3, center: [0, 0.3, -1], material: lambert(#d04040))\n"
        "sky(color: #a0c0ff, luminance: 0.5)\n"
    ),
    "formula of glass": CAMERA + FLOOR + LAMP + (
        "implicit(|x, y, z| x^4 + y^4 + z^4 <= 0.4, translate: [-0.6, 0.8, 0], material: glass(ior: 1.4))\n"
        "implicit(|x, y, z| max(hypot(x, y, z) - 0.6, 0.5 - hypot(x, y, z)) <= 0, translate: [0.9, 0.7, 0], material: glass())\n"
        "sphere(0.3, center: [0, 0.3, -1], material: lambert(#d04040))\nsky(color: #a0c0ff, luminance: 0.5)\n"
    ),
    "mirrors": CAMERA + FLOOR + LAMP + (
        "sphere(0.6, center: [-0.7, 0.6, 0], material: mirror(#ffe0c0))\nbox(0.8, center: [0.6, 0.4, 0.2], rotate: [0, 30deg, 0], "
        "material: phong(#303030, specular: 0.5, k_r: 0.6))\nsphere(0.3, center: [0, 0.3, 1], material: lambert(#40d040))\n"
    ),
    "interreflection": CAMERA + FLOOR + LAMP + SHAPES + "render(bounces: 2)\n",
    "panorama": 'camera(position: [0.2, 0.7, 0.9], look_at: [0, 0.4, 0], projection: "panoramic")\n' + FLOOR + LAMP + SHAPES,
    "depth of field": (
        "camera(position: [1.2, 2.6, 5], look_at: [0, 0.6, 0], fov: 36deg, aperture: 0.2)\n" + FLOOR + LAMP + SHAPES
    ),
    "depth of field, interreflection": (
        "camera(position: [1.2, 2.6, 5], look_at: [0, 0.6, 0], fov: 36deg, aperture: 0.2)\n" + FLOOR + LAMP + SHAPES
        + "render(bounces: 1)\n"
    ),
}  # fmt: skip
