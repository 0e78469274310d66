"""Scenes of the paths benchmark: ours as text, the peer's from our exporter with replacements for unsupported features."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import load
from ..compiler import ir
from ..compiler.exporters.mitsuba import scene as mitsuba_scene
from ..compiler.exporters.usd import scene as usd_scene
from ..compiler.plan import plan
from ..render.tessellation import scene_meshes
from . import meshes


@dataclass(frozen=True)
class Setting:
    """A scene. `swaps` are patterns of the exported XML and their replacements, each for the first match.

    `stage` is a USD file of the scene. Rooms are read from it (`staged`): peers shade its materials and lights in their own ways, so that
    answers differ. `media` has the media of the stage's objects by name, which the stage does not have.
    """

    title: str
    scene: ir.Scene
    depth: int
    swaps: tuple[tuple[str, str], ...] = ()
    stage: Path | None = None
    staged: bool = False
    media: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def decide(self, size: int, samples: int | None, seed: int, error: float | None = None) -> tuple[ir.Scene, plan.Plan]:
        """The scene, and the plan of a square picture on one thread."""
        settings = ir.Settings(
            size=(size, size), samples=samples, error=error, seed=seed, backend="ray", bounces=self.depth - 2, filter="box", threads=1
        )
        return self.scene, plan.make_plan(self.scene, settings)

    def exported(self, size: int, folder: Path) -> Path:
        """The XML file for Mitsuba, with its Russian roulette from the fifth surface on."""
        _, decided = self.decide(size, 16, 0)
        export = mitsuba_scene.write(self.scene, decided, "part", scene_meshes.make_tessellator(self.scene, decided))
        for name, data in export.files.items():
            (folder / name).write_bytes(data)
        text = export.text.replace(f'value="{mitsuba_scene.NO_ROULETTE}"', 'value="5"').replace('"multijitter"', '"independent"')
        for old, new in self.swaps:
            text, count = re.subn(old, new, text, count=1, flags=re.DOTALL)
            if not count:
                raise ValueError(f"the exported scene has no {old}")
        path = folder / "scene.xml"
        path.write_text(text, encoding="utf-8")
        return path


def _setting(folder: Path, name: str, title: str, text: str, depth: int, swaps: tuple[tuple[str, str], ...] = ()) -> Setting:
    path = folder / f"{name}.scene"
    path.write_text(text, encoding="utf-8")
    return Setting(title, load(path), depth, swaps)


def _with_media(setting: Setting, folder: Path, media: Mapping[str, Mapping[str, Any]]) -> Setting:
    """The setting with a stage for Cycles, and the media of its objects."""
    return replace(setting, stage=_stage(setting.scene, folder, setting.title.split()[0].lower()), media=media)


def _stage(scene: ir.Scene, folder: Path, name: str) -> Path:
    decided = plan.make_plan(scene, ir.Settings(size=(128, 128)))
    stage = folder / f"{name}.usdc"
    usd_scene.write(scene, decided, name, stage.suffix, scene_meshes.make_converters(scene, None)).save(stage)
    return stage


EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
_PRINCIPLED = r' *<bsdf type="principled">.*?</bsdf>\n'  # Mitsuba's own is slower than its rough conductor
_ROUGH = """        <bsdf type="roughconductor">
            <string name="material" value="none"/>
            <string name="distribution" value="ggx"/>
            <float name="alpha" value="{}"/>
        </bsdf>
"""
ROOM = """
polygon([[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]], material: lambert(0.5))
polygon([[-3, 3, -3], [3, 3, -3], [3, 3, 3], [-3, 3, 3]], material: lambert(0.7))
polygon([[-3, 0, -3], [3, 0, -3], [3, 3, -3], [-3, 3, -3]], material: lambert(0.7))
polygon([[3, 0, 3], [-3, 0, 3], [-3, 3, 3], [3, 3, 3]], material: lambert(0.7))
polygon([[-3, 0, 3], [-3, 0, -3], [-3, 3, -3], [-3, 3, 3]], material: lambert(rgb(0.6, 0.3, 0.25)))
polygon([[3, 0, -3], [3, 0, 3], [3, 3, 3], [3, 3, -3]], material: lambert(rgb(0.25, 0.4, 0.6)))
camera(position: [0, 1.5, 2.9], look_at: [0, 1.2, 0], fov: 70deg)
"""


def lamps(folder: Path, _quick: bool = False) -> Setting:
    """A room with 200 small lights of different power on walls and ceiling, and a few objects."""
    rng = np.random.default_rng(7)
    lines = [
        ROOM, "box([1.4, 0.7, 0.8], center: [0.2, 0.35, -0.6], material: lambert(0.6))",
        "sphere(0.35, center: [0.3, 1.05, -0.6], material: lambert(0.75))",
        "box([0.6, 1.8, 0.6], center: [-1.8, 0.9, -1.4], material: lambert(0.4))",
    ]  # fmt: skip
    edge = 2.999  # lights lie on the walls
    for k in range(200):
        column, line = (k // 4) % 10, k // 40  # in cells, so that no two overlap
        across, up = np.array([column, line]) + rng.uniform(0.2, 0.8, 2)
        x = z = round(-2.8 + 0.56 * float(across), 4)
        y = round(0.3 + 0.5 * float(up), 4)
        if k % 4 == 0:
            z = round(-2.8 + 1.12 * float(up), 4)
        wall = (((x, edge, z), (0, -1, 0)), ((-edge, y, z), (1, 0, 0)), ((edge, y, z), (-1, 0, 0)), ((x, y, -edge), (0, 0, 1)))
        place, towards = wall[k % 4]
        to = [round(p + d, 4) for p, d in zip(place, towards, strict=True)]
        color = "rgb({:.3f}, {:.3f}, {:.3f})".format(*rng.uniform(0.2, 1.0, 3))
        lines.append(f"area({list(place)}, look_at: {to}, size: 0.08, luminance: {rng.lognormal(2.0, 1.0):.3f}, color: {color})")
    return _setting(folder, "lamps", "A room with 200 small lights", "\n".join(lines), 6)


def glossy(folder: Path, _quick: bool = False) -> Setting:
    """Rough white metal and diffuse objects under a sky image with a small sun."""
    write_sky(folder / "sky.exr")
    lines = ['dome("sky.exr")', "polygon([[-8, 0, 8], [8, 0, 8], [8, 0, -8], [-8, 0, -8]], material: lambert(0.4))"]
    swaps = []
    for k, alpha in enumerate((0.015, 0.02, 0.03, 0.04)):
        x = -2.4 + 1.6 * k
        metal = f"principled(color: rgb(1, 1, 1), metallic: 1, roughness: {alpha**0.5:.9f})"
        lines.append(f"sphere(0.7, center: [{x:.1f}, 0.7, 0], material: {metal})")
        lines.append(f"sphere(0.3, center: [{x + 0.7:.1f}, 0.3, 1.3], material: lambert(rgb(0.{k + 3}, 0.5, 0.{7 - k})))")
        swaps.append((_PRINCIPLED, _ROUGH.format(alpha)))
    lines.append("camera(position: [0, 2.2, 6], look_at: [0, 0.6, 0], fov: 55deg)")
    return _setting(folder, "glossy", "Rough metal under a picture of the sky", "\n".join(lines), 6, tuple(swaps))


def glass(folder: Path, _quick: bool = False) -> Setting:
    """Glasses on a table beside a light."""
    text = (
        ROOM
        + """
    box([2.4, 0.1, 1.4], center: [0, 0.75, 0.6], material: lambert(rgb(0.55, 0.4, 0.28)))
    sphere(0.22, center: [-0.5, 1.02, 0.7], material: glass())
    sphere(0.16, center: [0.35, 0.96, 0.95], material: glass(rgb(0.8, 0.95, 0.9)))
    box([0.3, 0.45, 0.3], center: [0.25, 1.025, 0.35], rotate: [0, 30deg, 0], material: glass())
    area([0.4, 2.7, 0.4], size: [1.2, 0.9], luminance: 12)
    """
    )
    return _setting(folder, "glass", "Glass on a table", text.replace("fov: 70deg", "fov: 45deg"), 10)


def interior(folder: Path, quick: bool = False) -> Setting:
    """A room with a knot of many triangles and two lights."""
    mesh = meshes.knot(*((100, 10) if quick else (2000, 125)))
    meshes.write_ply(folder / "knot.ply", mesh)
    text = (
        ROOM
        + """
    mesh("knot.ply", scale: 1.1, translate: [0, 1.3, -0.6], material: lambert(0.6, shading: "flat"))
    box([0.6, 1.8, 0.6], center: [-2.2, 0.9, -1.8], material: lambert(0.4))
    area([0, 2.98, 0.5], size: [1.2, 0.9], luminance: 6)
    area([2.9, 1.5, -1.5], look_at: [0, 1.2, 0], size: [0.4, 0.6], luminance: 9)
    """
    )
    return _setting(folder, "interior", f"An interior of {len(mesh.triangles):,} triangles", text, 6)


def _room(name: str, title: str, depth: int) -> Callable[[Path, bool], Setting]:
    """A room of the examples, as the USD stage that our exporter makes of it, so that all renderers draw the same shapes."""

    def made(folder: Path, _quick: bool = False) -> Setting:
        scene = load(EXAMPLES / f"{name}.scene")
        stage = _stage(scene, folder, name)
        return Setting(title, load(stage), depth, (), stage, staged=True)

    return made


_LIT = ROOM + "area([0, 2.9, 0], size: [1.2, 0.9], luminance: 12)\n"
_MILK = "scattering: [10, 13, 15], absorption: [0.044, 0.096, 0.56]"  # of Jensen and others 2001, 25 times thinner


def slab(folder: Path, _quick: bool = False) -> Setting:
    """A slab of an even medium in a room."""
    text = _LIT + "box([3, 1.6, 0.5], center: [0, 1, -0.5], medium: medium(scattering: 4, absorption: 0.4, phase: 0.5))\n"
    setting = _setting(folder, "slab", "A slab of a medium in a room", text, 130)
    return _with_media(setting, folder, {"box": {"scattering": [4, 4, 4], "absorption": [0.4, 0.4, 0.4], "phase": 0.5}})


def milk(folder: Path, _quick: bool = False) -> Setting:
    """A ball of milk in a room."""
    text = _LIT + f"sphere(0.8, center: [0, 1, 0], medium: medium({_MILK}, phase: 0.3))\n"
    setting = _setting(folder, "milk", "A ball of thin milk in a room", text, 258)
    return _with_media(setting, folder, {"sphere": {"scattering": [10, 13, 15], "absorption": [0.044, 0.096, 0.56], "phase": 0.3}})


def haze(folder: Path, _quick: bool = False) -> Setting:
    """A hazy room with the sun through a window."""
    wall = "polygon([[3, 0, -3], [3, 0, 3], [3, 3, 3], [3, 3, -3]]"
    panes = ("[[3, 0, -3], [3, 0, 3], [3, 1, 3], [3, 1, -3]]", "[[3, 2, -3], [3, 2, 3], [3, 3, 3], [3, 3, -3]]",
             "[[3, 1, 0.5], [3, 1, 3], [3, 2, 3], [3, 2, 0.5]]", "[[3, 1, -3], [3, 1, -1], [3, 2, -1], [3, 2, -3]]")  # fmt: skip
    walls = "\n".join(f"polygon({corners}, material: lambert(rgb(0.25, 0.4, 0.6)))" for corners in panes)
    room_lines = "\n".join(line for line in ROOM.splitlines() if not line.startswith(wall))
    air = "box([5.98, 2.98, 5.98], center: [0, 1.5, 0], medium: medium(scattering: 0.15, absorption: 0.01))"
    text = f"{room_lines}\n{walls}\n{air}\ndirectional(from: [2, 1.2, 0.3], irradiance: 40)\n"
    inside = r'(<sensor type="perspective">)(.*?)(<medium type="homogeneous" name="interior">.*?</medium>)'
    setting = _setting(folder, "haze", "A hazy room with the sun through a window", text, 66, ((inside, r'\1\n\3\2\3'), _OUTSIDE))
    return _with_media(setting, folder, {"box": {"scattering": [0.15] * 3, "absorption": [0.01] * 3, "phase": 0.0}})


_OUTSIDE = (r'(<sensor type="perspective">\s*<medium type="homogeneous") name="interior"', r"\1")


def cloud(folder: Path, quick: bool = False) -> Setting:
    """A cloud of 256³ voxels in a room."""
    side = 32 if quick else 256
    x = np.linspace(-1, 1, side)
    rng, voxels = np.random.default_rng(5), np.zeros((side,) * 3)
    for octave in range(2, 6):
        knots = rng.random((2**octave + 1,) * 3)
        for axis in range(3):
            place = np.linspace(0, 2**octave, side)
            low = np.minimum(place.astype(int), 2**octave - 1)
            part = (place - low).reshape([-1 if k == axis else 1 for k in range(3)])
            knots = np.take(knots, low, axis) * (1 - part) + np.take(knots, low + 1, axis) * part
        voxels += knots * 0.5 ** (octave - 1)
    round_off = 1.1 - np.sqrt(x[:, None, None] ** 2 + x[:, None] ** 2 + x**2)
    voxels = np.clip(4 * (voxels + round_off - 1.0), 0, 1).astype(np.float32)
    np.save(folder / "cloud.npy", voxels)
    head = b"VOL\x03" + np.array([1, side, side, side, 1], "<i4").tobytes() + np.array([0, 0, 0, 1, 1, 1], "<f4").tobytes()
    (folder / "cloud.vol").write_bytes(head + voxels.astype("<f4").tobytes())
    text = _LIT + 'box(2, center: [0, 1.4, 0], medium: medium(scattering: 20, absorption: 0.1, density: volume("cloud.npy")))\n'
    grid = f"""            <ref id="material4"/>
        <medium type="heterogeneous" name="interior">
            <volume type="gridvolume" name="sigma_t">
                <string name="filename" value="{folder / "cloud.vol"}"/>
                <transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale value="2"/><translate y="1.4"/></transform>
            </volume>
            <float name="scale" value="20.1"/>
            <rgb name="albedo" value="0.99502487562"/>
        </medium>
"""
    return _setting(folder, "cloud", f"A cloud of {side}³ voxels in a room", text, 258, ((r' *<ref id="material4"/>\n', grid),))


def write_sky(path: Path) -> None:
    """A latitude-longitude picture: blue above, brown below, a small sun."""
    import OpenImageIO as oiio

    height, width = 256, 512
    up = np.linspace(1.0, -1.0, height)[:, None, None]
    picture: Any = np.where(up > 0.0, 0.25 + np.array([0.1, 0.25, 0.6]) * up, np.array([0.12, 0.1, 0.08])) + np.zeros((height, width, 3))
    picture[60:66, 180:186] = (400.0, 360.0, 300.0)
    picture[90:120, 330:380] = (6.0, 6.0, 7.0)
    out: Any = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(width, height, 3, "float"))
    out.write_image(np.ascontiguousarray(picture, np.float32))
    out.close()


SETTINGS: dict[str, Callable[[Path, bool], Setting]] = {
    "lamps": lamps, "glossy": glossy, "glass": glass, "interior": interior,
    "slab": slab, "milk": milk, "haze": haze, "cloud": cloud,
    "daylight": _room("daylight", "A room by a window, with sun", 10),
    "evening": _room("evening", "A lamp in a shade", 10),
    "door": _room("door", "Light by a door ajar", 10),
}  # fmt: skip
