"""An environment map: a latitude-longitude image around the scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula import numpy_interpreter
from ..compiler.formula.tape import Tape
from ..lang.schema.argument_types import Arg
from .arguments import light_entry
from .contract import Element, Form, LightError, Lowering, Row
from .sky import usd as usd

HEIGHT = 512  # texels of a pattern from pole to pole


def _lower(args: Mapping[str, Any], lowering: Lowering) -> Row | None:
    if (args["file"] is None) == (args["pattern"] is None):
        raise LightError("a dome has a picture or a pattern", 'write dome("sky.exr") or dome(pattern: |x, y, z| …)')
    image = _patterned(args, lowering) if args["file"] is None else lowering.image_file(args["file"])
    turn = lowering.block if args["rotate"] is None else lowering.block @ lowering.rotation(args["rotate"])
    frame, _, _ = lowering.rigid(turn)
    frame[:3, 3] = 0.0
    return Row(KIND, args["luminance"], frame=frame, image=image) if image >= 0 else None


def _patterned(args: Mapping[str, Any], lowering: Lowering) -> int:
    """The image of a pattern on a dome; -1 after a diagnostic."""
    tape = lowering.pattern(args["pattern"])
    if tape is None:
        return -1
    key = ("pattern of a dome", tape.structure(), tape.constants.tobytes())
    return lowering.image(key, "pattern", lambda: picture(tape))


def picture(tape: Tape) -> np.ndarray:
    """(HEIGHT, 2 HEIGHT, 4) values of a tape of the direction. Negative and undefined values are 0."""
    latitude = np.pi * (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT)[:, None]
    turn = 2.0 * np.pi * (0.5 - (np.arange(2 * HEIGHT) + 0.5) / (2 * HEIGHT))[None]
    x, y, z = np.cos(latitude) * np.sin(turn), np.sin(latitude) + 0.0 * turn, np.cos(latitude) * np.cos(turn)
    values = [np.broadcast_to(v, x.size).reshape(x.shape) for v in numpy_interpreter.points(tape, x.ravel(), y.ravel(), z.ravel())]
    rgba = np.stack([*(values if len(values) == 3 else values * 3), np.ones(x.shape)], axis=-1)
    return np.where(np.isfinite(rgba), np.maximum(rgba, 0.0), 0.0).astype(np.float32)


KIND = ir.LightKind.DOME
ELEMENTS = (
    Element(
        light_entry(
            "dome",
            "an environment map: a latitude-longitude image or a formula of the direction, visible as the background",
            Arg("file", "string", None, "file of the image"),
            Arg(
                "pattern",
                "formula",
                None,
                "in place of `file`: the light from the unit direction x, y, z, a number or a colour",
                keyword=True,
            ),
            Arg("luminance", "luminance", 1.0, "nit where the image is 1", aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("rotate", "rotation", None, "its rotation", keyword=True),
        ),
        _lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.SKY, False, True
profile = widest = source = gltf = povray = mitsuba = None
