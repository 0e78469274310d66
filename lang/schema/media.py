"""The schema's participating media: what fills closed shapes, and the fog of a scene."""

from __future__ import annotations

from .argument_types import REQUIRED, Arg, Entry

THINNEST = 1e-9  # metres; coefficients have 10¹⁸ per metre at most


def _coefficients(instead: str) -> tuple[Arg, ...]:
    return tuple(
        Arg(name, "coefficient", None, f"{name} coefficient, in place of {instead}", minimum=0.0, keyword=True)
        for name in ("scattering", "absorption")
    )


def _phase(default: float) -> tuple[Arg, ...]:
    return (
        Arg(
            "phase", "number", default, "g of its phase function (Henyey and Greenstein 1941): 0 scatters evenly, 1 forwards, -1 backwards",
            above=-1.0, below=1.0, keyword=True,
        ),
        Arg(
            "alpha", "number", 0.0, "α of the phase function of Draine 2003: more light on and back; 1 with a `phase` of 0 is Rayleigh's",
            minimum=0.0, keyword=True,
        ),
        Arg(
            "droplet", "length", None, "diameter of water droplets, 5um to 50um, in place of `phase` (Jendersie and d'Eon 2023)",
            minimum=5e-6, maximum=5e-5, keyword=True,
        ),
    )  # fmt: skip


def _either(*firsts: str) -> tuple[tuple[str, str], ...]:
    return tuple((first, second) for first in firsts for second in ("scattering", "absorption"))


MEDIUM = Entry(
    "medium",
    "medium",
    "what fills a closed shape and scatters, absorbs or emits light on its way: milk, wax, smoke or a cloud",
    (
        Arg("color", "color", None, "single-scattering albedo: share of the light that a particle sends on; default white"),
        Arg("depth", "size3", None, "mean free path: how far light goes from particle to particle; default 10 cm", minimum=THINNEST),
        *_coefficients("`color` and `depth`"),
        Arg("emission", "emission", None, "radiance that it emits per metre of its depth", minimum=0.0, keyword=True),
        *_phase(0.0),
        Arg("density", "density", None, "factor of them all: a formula of the point in the frame of the shape, or volume(…)", keyword=True),
        Arg(
            "priority", "number", None, "where media overlap, the one of the highest priority counts; default: that of its glass, or 0",
            minimum=0.0, keyword=True,
        ),
    ),
    exclusive=(*_either("color", "depth"), ("droplet", "phase"), ("droplet", "alpha")),
    example="sphere(0.3, medium: medium(color: #fff4e0, depth: 2cm))",
)  # fmt: skip
FOG = Entry(
    "fog",
    "fog",
    "fog, mist or haze around all shapes of the scene, up to a height: at most one",
    (
        Arg("color", "color", None, "single-scattering albedo: share of the light that a droplet sends on; default white"),
        Arg(
            "visibility", "length", None, "at which a black object has a contrast of 2 % (Koschmieder 1924); default 100 m",
            minimum=THINNEST,
        ),
        Arg("top", "length", None, "height y up to which it has its full density; default 0", keyword=True),
        Arg(
            "falloff", "length", None,
            "height above `top` in which its density falls to 1/e; 0: it ends there; default: an eighth of `visibility`, or 0 with `top`",
            minimum=0.0, keyword=True,
        ),
        *_coefficients("`color` and `visibility`"),
        *_phase(0.5),
    ),
    exclusive=(*_either("color", "visibility"), ("droplet", "phase"), ("droplet", "alpha")),
    example="fog(visibility: 400m, top: 3m, falloff: 20m)",
)  # fmt: skip
INSIDE = Arg("medium", "medium", None, "the medium inside of it, if it is closed; inherited from the enclosing block", keyword=True)
"""The argument of shapes that they are filled by."""
VOLUME = Entry(
    "volume",
    "volume",
    "densities in the box around a shape, interpolated between the middles of voxels",
    (
        Arg("file", "string", REQUIRED, "an array of numpy (.npy), array[z, y, x]; or a picture of the slices, from low to high z"),
        Arg("slices", "int", None, "slices of a picture, below each other", minimum=1, keyword=True),
    ),
    example='box(2, medium: medium(scattering: 5, density: volume("assets/smoke.npy")))',
)
ENTRIES = (MEDIUM, FOG, VOLUME)
"""The elements that are media."""
