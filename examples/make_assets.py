"""Makes the pictures and meshes the examples use, and the USD and OBJ examples themselves: `python examples/make_assets.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from make_smoke import smoke
from numpy.typing import NDArray

HERE = Path(__file__).parent
ASSETS = HERE / "assets"
Array = NDArray[np.float64]


def write_png(path: Path, rgb: Array) -> None:
    """Write (h, w, 3) sRGB values in 0 … 1 as an 8-bit PNG."""
    pixels = np.ascontiguousarray((np.clip(rgb, 0, 1) * 255 + 0.5).astype(np.uint8))
    out = oiio.ImageOutput.create(str(path))
    if out is None:
        raise SystemExit(f"OpenImageIO cannot write {path.name}")
    out.open(str(path), oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "uint8"))
    out.write_image(pixels)
    out.close()


PIPS = {
    1: [(0, 0)],
    2: [(-1, -1), (1, 1)],
    3: [(-1, -1), (0, 0), (1, 1)],
    4: [(-1, -1), (1, -1), (-1, 1), (1, 1)],
    5: [(-1, -1), (1, -1), (0, 0), (-1, 1), (1, 1)],
    6: [(-1, -1), (-1, 0), (-1, 1), (1, -1), (1, 0), (1, 1)],
}


def die_net(cell: int = 192) -> Array:
    """A die's unfolded net, four by three cells: one column of three, one row of four; opposite faces sum to seven."""
    picture = np.full((3 * cell, 4 * cell, 3), 0.22)
    faces = {(1, 0): 2, (1, 1): 3, (1, 2): 5, (1, 3): 4, (0, 1): 1, (2, 1): 6}
    tints = {1: "#f2c14e", 2: "#f78154", 3: "#5fad56", 4: "#4d9078", 5: "#5b8e9e", 6: "#b4436c"}
    y, x = (np.mgrid[0:cell, 0:cell] + 0.5) / cell * 2 - 1
    for (row, column), number in faces.items():
        tint = np.array([int(tints[number][k : k + 2], 16) / 255 for k in (1, 3, 5)])
        face = np.broadcast_to(tint, (cell, cell, 3)).copy()
        face[np.maximum(abs(x), abs(y)) > 0.94] *= 0.72
        for px, py in PIPS[number]:
            face[np.hypot(x - 0.5 * px, y - 0.5 * py) < 0.17] = 0.97
        picture[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell] = face
    return picture


def world_map(height: int = 384) -> Array:
    """An invented planet by latitude and longitude, seamless, with a graticule every 15 degrees."""
    width = 2 * height
    latitude = (0.5 - (np.arange(height) + 0.5) / height)[:, None] * np.pi
    longitude = ((np.arange(width) + 0.5) / width * 2 - 1)[None] * np.pi
    p = np.stack(np.broadcast_arrays(np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)), -1)
    random = np.random.default_rng(7)
    ground = np.zeros((height, width))
    for frequency in (1.5, 3, 6, 12, 24):
        for _ in range(7):
            k = random.normal(size=3) * frequency
            ground += np.cos(p @ k + random.uniform(0, 2 * np.pi)) / frequency
    ground /= ground.std()
    stops = [-2.5, -0.4, 0.05, 0.1, 0.7, 1.6, 2.6]
    colours = np.array([[30, 66, 120], [66, 126, 178], [120, 178, 204], [226, 212, 160], [120, 160, 92], [150, 122, 84], [240, 240, 236]])
    picture = np.stack([np.interp(ground, stops, colours[:, c] / 255) for c in range(3)], -1)
    polar = np.clip((abs(np.sin(latitude)) - 0.93) * 18, 0, 1)[..., None]
    picture = picture * (1 - polar) + 0.95 * polar
    step, line = np.radians(15), 0.9 * np.pi / height
    near = [
        abs((angle + step / 2) % step - step / 2)
        for angle in (np.broadcast_to(latitude, ground.shape), np.broadcast_to(longitude, ground.shape))
    ]
    picture[(near[0] < line) | (near[1] < line)] *= 0.62
    picture[np.broadcast_to(abs(latitude) < 2.2 * line, ground.shape)] = [0.78, 0.16, 0.12]
    return picture


def studs(size: int = 256) -> Array:
    """A normal map of 4 by 4 round studs: red along u, green along v, as (size, size, 3) from 0 to 1."""
    row = (np.arange(size) + 0.5) / size * 4 % 1 - 0.5
    u, v = np.meshgrid(row, -row)
    inside = np.hypot(u, v) < 0.36
    up = np.sqrt(np.maximum(0.36**2 + 0.24**2 - u * u - v * v, 1e-4))
    normal = np.where(inside, np.stack([u, v, up]), np.array([0.0, 0.0, 1.0])[:, None, None])
    return np.moveaxis(normal / np.sqrt((normal**2).sum(axis=0)) * 0.5 + 0.5, 0, -1)


class Obj:
    """Lines of an OBJ file, with counts for its indices."""

    def __init__(self, first: str) -> None:
        self.lines = [f"# {first}"]
        self.vertices = 0

    def lathe(self, profile: Array, segments: int, material: str | None = None) -> None:
        """A surface of revolution about y: `profile` is (n, 2) of radius and height, from the bottom up."""
        turn = np.arange(segments) * 2 * np.pi / segments
        tangent = np.gradient(profile, axis=0)
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], -1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        if material:
            self.lines.append(f"usemtl {material}")
        base = self.vertices + 1
        for (r, y), (nr, ny) in zip(profile, normal, strict=True):
            for a in turn:
                self.lines.append(f"v {r * np.sin(a):.5g} {y:.5g} {r * np.cos(a):.5g}")
                self.lines.append(f"vn {nr * np.sin(a):.4g} {ny:.4g} {nr * np.cos(a):.4g}")
        self.vertices += len(profile) * segments
        for j in range(len(profile) - 1):
            for i in range(segments):
                k = [base + j * segments + i, base + j * segments + (i + 1) % segments]
                ring = [k[0], k[1], k[1] + segments, k[0] + segments]
                self.lines.append("f " + " ".join(f"{v}//{v}" for v in ring))

    def write(self, path: Path) -> None:
        path.write_text("\n".join(self.lines) + "\n")


def profile_of(points: list[tuple[float, float]], steps: int = 6) -> Array:
    """A Catmull-Rom curve through (radius, height) points."""
    p = np.array([points[0], *points, points[-1]], float)
    t = np.linspace(0, 1, steps, endpoint=False)[:, None]
    pieces = []
    for a, b, c, d in zip(p, p[1:], p[2:], p[3:], strict=False):
        pieces.append(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3))
    return np.concatenate([*pieces, p[-1:]])


def pawn() -> Obj:
    obj = Obj("A pawn, turned on a lathe")
    outline = [
        (0.0, 0),
        (0.34, 0),
        (0.36, 0.06),
        (0.33, 0.12),
        (0.22, 0.18),
        (0.16, 0.3),
        (0.12, 0.5),
        (0.12, 0.6),
        (0.2, 0.64),
        (0.12, 0.69),
    ]
    head = [(0.2 * np.sin(a), 0.83 - 0.2 * np.cos(a)) for a in np.linspace(0.75, np.pi - 1e-3, 7)]
    obj.lathe(np.maximum(profile_of([*outline, *head], 3), [1e-4, 0]), 28)
    return obj


def knot(along: int = 150, around: int = 12) -> Obj:
    """A trefoil knot's tube, with smooth normals."""
    obj = Obj("A trefoil knot")
    t = np.arange(along) * 2 * np.pi / along
    curve = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], -1)
    tangent = np.roll(curve, -1, 0) - np.roll(curve, 1, 0)
    side = np.cross(tangent, [0, 0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    for c, s, u in zip(curve, side, up, strict=True):
        for a in np.arange(around) * 2 * np.pi / around:
            n = np.cos(a) * s + np.sin(a) * u
            v = c + 0.42 * n
            obj.lines.append(f"v {v[0]:.5g} {v[1]:.5g} {v[2]:.5g}")
            obj.lines.append(f"vn {n[0]:.4g} {n[1]:.4g} {n[2]:.4g}")
    for j in range(along):
        for i in range(around):
            k = [
                j * around + i,
                ((j + 1) % along) * around + i,
                ((j + 1) % along) * around + (i + 1) % around,
                j * around + (i + 1) % around,
            ]
            obj.lines.append("f " + " ".join(f"{v + 1}//{v + 1}" for v in k))
    return obj


def lighthouse() -> tuple[Obj, str]:
    """A lighthouse in bands of material, one lathe each."""
    obj = Obj("A lighthouse")
    obj.lines.append("mtllib lighthouse.mtl")
    heights = np.linspace(0.25, 4.0, 6)
    radius = np.interp(heights, [0.25, 4.0], [0.95, 0.55])
    obj.lathe(np.array([(2.2, -0.5), (1.9, -0.1), (1.5, 0.12), (1.2, 0.25), (0.001, 0.25)]), 40, "rock")
    for k in range(5):
        obj.lathe(np.array([(radius[k], heights[k]), (radius[k + 1], heights[k + 1])]), 48, "red" if k % 2 == 0 else "white")
    obj.lathe(np.array([(0.55, 4.0), (0.85, 4.0), (0.85, 4.1), (0.001, 4.1)]), 48, "iron")
    obj.lathe(np.array([(0.38, 4.1), (0.38, 4.75)]), 24, "lamp")
    obj.lathe(np.array([(0.5, 4.75), (0.52, 4.8), (0.001, 5.3)]), 48, "red")
    obj.lathe(np.array([(0.84, 4.4), (0.86, 4.42), (0.84, 4.44), (0.82, 4.42), (0.84, 4.4)]), 48, "iron")
    for a in np.arange(12) * np.pi / 6:
        post = Obj("")
        post.lathe(np.array([(0.015, 4.1), (0.015, 4.42)]), 6)
        shift = np.array([0.84 * np.sin(a), 0, 0.84 * np.cos(a)])
        for line in post.lines[1:]:
            word = line.split()
            if word[0] == "v":
                line = "v " + " ".join(f"{c:.5g}" for c in np.array(word[1:], float) + shift)
            elif word[0] == "f":
                line = "f " + " ".join(f"{int(w.split('//')[0]) + obj.vertices}//{int(w.split('//')[0]) + obj.vertices}" for w in word[1:])
            obj.lines.append(line)
        obj.vertices += post.vertices
    materials = """# Materials of lighthouse.obj
newmtl red
Kd 0.62 0.07 0.05
Ks 0.2 0.2 0.2
Ns 60
illum 2
newmtl white
Kd 0.82 0.8 0.76
Ks 0.2 0.2 0.2
Ns 60
illum 2
newmtl rock
Kd 0.24 0.23 0.22
illum 1
newmtl iron
Kd 0.05 0.05 0.06
Ks 0.5 0.5 0.5
Ns 120
illum 2
newmtl lamp
Kd 0.1 0.09 0.05
Ke 1.6 1.2 0.5
illum 1
"""
    return obj, materials


STAGE = """#usda 1.0
(
    defaultPrim = "Pavilion"
    metersPerUnit = 1
    upAxis = "Y"
    doc = "A round pavilion: gprims, instances, preview materials, lights and a camera."
)

class "Column"
{{
    def Cylinder "Shaft" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token axis = "Y"
        double radius = 0.2
        double height = 2.4
        double3 xformOp:translate = (0, 1.2, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Pavilion/Looks/Marble>
    }}
    def Cube "Capital" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        double size = 1
        double3 xformOp:translate = (0, 2.47, 0)
        float3 xformOp:scale = (0.56, 0.14, 0.56)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        rel material:binding = </Pavilion/Looks/Marble>
    }}
}}

def Xform "Pavilion"
{{
    def Scope "Looks"
    {{{looks}
    }}

    def Xform "Columns"
    {{{columns}
    }}

    def Cylinder "Step" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token axis = "Y"
        double radius = 3.1
        double height = 0.22
        double3 xformOp:translate = (0, 0.11, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Pavilion/Looks/Marble>
    }}
    def Cylinder "Floor" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token axis = "Y"
        double radius = 2.8
        double height = 0.22
        double3 xformOp:translate = (0, 0.33, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Pavilion/Looks/Marble>
    }}
    def Cylinder "Ring" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token axis = "Y"
        double radius = 2.75
        double height = 0.3
        double3 xformOp:translate = (0, 3.14, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Pavilion/Looks/Marble>
    }}
    def Cone "Roof" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token axis = "Y"
        double radius = 3.05
        double height = 1.5
        double3 xformOp:translate = (0, 4.04, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Pavilion/Looks/Copper>
    }}
    def Sphere "Finial" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        double radius = 0.2
        double3 xformOp:translate = (0, 4.9, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Pavilion/Looks/Gold>
    }}
    def Sphere "Orb" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        double radius = 0.7
        double3 xformOp:translate = (0, 1.14, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Pavilion/Looks/Gold>
    }}
    def Mesh "Lawn" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-30, 0, 30), (30, 0, 30), (30, 0, -30), (-30, 0, -30)]
        uniform token subdivisionScheme = "none"
        rel material:binding = </Pavilion/Looks/Grass>
    }}

    def DistantLight "Sun"
    {{
        float inputs:angle = 2
        color3f inputs:color = (1, 0.9, 0.75)
        float inputs:intensity = 2600
        float3 xformOp:rotateXYZ = (-38, 42, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    }}
    def DomeLight "Sky"
    {{
        color3f inputs:color = (0.55, 0.7, 1)
        float inputs:intensity = 0.75
    }}
    def Camera "main_cam"
    {{
        float focalLength = 35
        float horizontalAperture = 36
        float verticalAperture = 24
        float2 clippingRange = (0.1, 1000)
        double3 xformOp:translate = (5.2, 2.9, 10.4)
        float3 xformOp:rotateXYZ = (-3.5, 26.5, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }}
}}
"""


def pavilion() -> str:
    """A USD stage in Y-up metres: a round pavilion of instanced columns, preview materials, a dome, a sun and a camera."""

    def material(name: str, *inputs: str) -> str:
        lines = "\n                ".join(inputs)
        return f"""
        def Material "{name}"
        {{
            token outputs:surface.connect = </Pavilion/Looks/{name}/Surface.outputs:surface>
            def Shader "Surface"
            {{
                uniform token info:id = "UsdPreviewSurface"
                {lines}
                token outputs:surface
            }}
        }}"""

    looks = "".join(
        (
            material("Marble", "color3f inputs:diffuseColor = (0.78, 0.73, 0.65)", "float inputs:roughness = 0.45"),
            material("Copper", "color3f inputs:diffuseColor = (0.16, 0.42, 0.36)", "float inputs:roughness = 0.5"),
            material(
                "Gold", "color3f inputs:diffuseColor = (0.9, 0.62, 0.2)", "float inputs:metallic = 1", "float inputs:roughness = 0.3"
            ),
            material("Grass", "color3f inputs:diffuseColor = (0.2, 0.3, 0.1)", "float inputs:roughness = 1"),
        )
    )
    columns = "\n".join(
        f"""
        def Xform "Column{k}" (
            instanceable = true
            references = </Column>
        )
        {{
            double3 xformOp:translate = ({2.4 * np.cos(a):.5f}, 0.45, {2.4 * np.sin(a):.5f})
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }}"""
        for k, a in enumerate((np.arange(8) + 0.5) * np.pi / 4)
    )
    return STAGE.format(looks=looks, columns=columns)


VASE = """#usda 1.0
( defaultPrim = "Vase"; metersPerUnit = 1; upAxis = "Y" )
def Xform "Vase" {{
    def Mesh "Body" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
        uniform token subdivisionScheme = "none"
        point3f[] points = [{points}]
        normal3f[] normals = [{normals}] ( interpolation = "vertex" )
        int[] faceVertexCounts = [{counts}]
        int[] faceVertexIndices = [{indices}]
        rel material:binding = </Vase/Looks/Materials/Patina>
    }}
    def Scope "Looks" ( references = @patina.mtlx@</MaterialX> ) {{}}
}}
"""


def vase() -> str:
    """A vase, turned on a lathe, with a material of patina.mtlx."""
    outline = [(0.41, 0), (0.43, 0.03), (0.24, 0.16), (0.2, 0.26), (0.5, 0.6), (0.63, 0.95), (0.5, 1.27), (0.27, 1.42), (0.26, 1.52),
               (0.36, 1.62), (0.34, 1.635), (0.22, 1.52), (0.24, 1.4), (0.4, 1.25)]  # fmt: skip
    obj = Obj("")
    obj.lathe(profile_of(outline, 3), 36)
    rows: dict[str, list[str]] = {"v": [], "vn": [], "f": []}
    for kind, *parts in (line.split() for line in obj.lines if line[:1] in "vf"):
        rows[kind].append(", ".join(str(int(p.split("/")[0]) - 1) if kind == "f" else f"{float(p):.3g}" for p in parts))
    places, normals = (", ".join(f"({row})" for row in rows[kind]) for kind in ("v", "vn"))
    counts = ", ".join(["4"] * len(rows["f"]))
    return VASE.format(points=places, normals=normals, counts=counts, indices=", ".join(rows["f"]))


def main() -> None:
    ASSETS.mkdir(exist_ok=True)
    np.save(ASSETS / "smoke.npy", smoke())
    write_png(ASSETS / "net.png", die_net())
    write_png(ASSETS / "map.png", world_map())
    write_png(ASSETS / "studs.png", studs())
    pawn().write(ASSETS / "pawn.obj")
    knot().write(ASSETS / "knot.obj")
    (ASSETS / "vase.usda").write_text(vase())
    obj, materials = lighthouse()
    obj.write(HERE / "lighthouse.obj")
    (HERE / "lighthouse.mtl").write_text(materials)
    (HERE / "pavilion.usda").write_text(pavilion())


if __name__ == "__main__":
    main()
