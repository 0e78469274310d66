"""Keyword arguments in Python: wrong values are errors that say the correct form, and texts are read as on the command line."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang.schema.picture_settings import PICTURE_SETTINGS
from maquette.render.python_options import picture_settings

WRONG: tuple[tuple[dict[str, Any], str], ...] = (
    ({"denoise": "off"}, "denoise='off': write True or False"),
    ({"denoise": 0}, "denoise=0: write True or False"),
    ({"size": (16.5, 12)}, "size=(16.5, 12): a size is (width, height) in whole pixels"),
    ({"size": (0, 4)}, "size=(0, 4): a picture's sides are 1 to 65536 pixels"),
    ({"size": "16 by 12"}, "size='16 by 12': a size is written 800x600, or 512 for a square"),
    ({"samples": -1}, "samples=-1: write a whole number from 1 to 1048576"),
    ({"samples": 1.5}, "samples=1.5: write a whole number from 1 to 1048576"),
    ({"samples": True}, "samples=True: write a whole number from 1 to 1048576"),
    ({"backend": "rast"}, "backend='rast': write one of auto, ray, raster, reference"),
    ({"filter": "boxx"}, "filter='boxx': write one of box, tent, gaussian, blackman-harris"),
    ({"error": 3}, "error=3: that is 300%: write 3%"),
    ({"error": float("nan")}, "error=nan: a share is written 1% or 0.01, and is more than 0"),
    ({"budget": -1}, "budget=-1: a budget is more than 0 seconds"),
    ({"budget": "5 apples"}, "budget='5 apples': a time is written 20s, 500ms or 2min"),
    ({"bounces": "many"}, "bounces='many': write a whole number from 0 to 1024"),
    ({"seed": 1 << 63}, "seed=9223372036854775808: write a whole number from 0 to 9223372036854775807"),
    ({"threads": 0}, "threads=0: write a whole number from 1 to 1024"),
    ({"camera": 3}, "camera=3: write a name"),
    ({"exposure": float("inf")}, "exposure=inf: an exposure is a number of stops, like -1.5 or 2ev"),
    ({"crop": (5, 5, 1, 1)}, "crop=(5, 5, 1, 1): a crop has x0 < x1 and y0 < y1"),
    ({"crop": (0, 0, 4, 4, 4)}, "crop=(0, 0, 4, 4, 4): a crop is written x0,y0,x1,y1, in pixels from the top left"),
    (
        {"background": (1, -1, 0)},
        "background=(1, -1, 0): a background is sky, transparent or a colour like #87b5e0, or three linear numbers from 0",
    ),
    ({"tolerance": 0}, "tolerance=0: write a number above 0"),
    ({"aov": 3}, "aov=3: channels are written depth,normal,albedo"),
    ({"aov": (3,)}, "aov=(3,): channels are names, like depth,normal,albedo"),
    ({"samples": 4, "error": 0.1}, "samples and error exclude each other: samples sets the work, error the quality"),
)


@pytest.mark.parametrize(("settings", "message"), WRONG, ids=[str(settings) for settings, _ in WRONG])
def test_wrong_values(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=r".") as error:
        picture_settings(settings)
    assert str(error.value) == message


def test_texts_and_values() -> None:
    texts = {"size": "8x6", "error": "2%", "budget": "500ms", "aov": "depth, normal", "crop": "0,0,4,4", "background": "#fff", "seed": "7"}
    values = {
        "size": np.array([8, 6]), "error": np.float32(0.02), "budget": 0.5, "aov": ["depth", "normal"], "crop": [0, 0, 4, 4],
        "background": (1, 1, 1), "seed": np.int64(7),
    }  # fmt: skip
    read, same = picture_settings(texts), picture_settings(values)
    for name in texts:
        assert getattr(read, name) == pytest.approx(getattr(same, name), rel=1e-6) if name != "aov" else read.aov == same.aov
    assert picture_settings({"samples": None, "error": None}) == ir.Settings()


def test_each_setting_is_one_row() -> None:
    assert set(PICTURE_SETTINGS) == {field.name for field in fields(ir.Settings)}
    for arg in CATALOGUE["render"].args:
        assert PICTURE_SETTINGS[arg.name].arg is arg


def test_other_arguments() -> None:
    text = "param r = 1\nsphere(r)"
    with pytest.raises(ValueError, match=r"^time='soon': a time is written 20s, 500ms or 2min$"):
        maquette.load_text(text, time="soon")
    with pytest.raises(ValueError, match=r"^max_elements=0: write a whole number from 1 to"):
        maquette.load_text(text, max_elements=0)
    with pytest.raises(TypeError, match=r"^load_text takes the text of a scene, not int$"):
        maquette.load_text(3)  # type: ignore[arg-type]
    scene = maquette.load_text(text, sets={"r": 2}, allow=".")
    with pytest.raises(TypeError, match=r"^plan is a dict of decisions by name, not str$"):
        scene.render(plan="ray")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^samples=0: write a whole number"):
        scene.render(samples=0)


def test_no_value_to_sweep(tmp_path: Any) -> None:
    (tmp_path / "a.scene").write_text("param r = 1\nsphere(r)")
    with pytest.raises(ValueError, match=r"^r=\[\]: the list of its values is empty$"):
        maquette.sweep(tmp_path / "a.scene", r=[])
