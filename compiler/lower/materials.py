"""Lowers materials and textures: each element once, equal rows shared."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from ...lang.elements import Element
from ...lang.formula_graph import Formula
from ...materials.catalogue import ELEMENTS
from ...materials.contract import Lobes
from .. import ir
from ..formula.tape import Tape
from ..importers import images
from ..importers.images import ImageError
from ..io.sandbox import FileError
from ..scene import partial_coverage
from ..scene.row_records import BLACK, WHITE, Input, MaterialData, MediumData, TextureData, scale_color
from ..texture_graph.from_formula import PictureRow, needs_graph
from . import flakes, patterns
from .context import Context

Slot = ir.Slot
_PLAIN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
_SHADING = {"phong": ir.Shading.SMOOTH, "gouraud": ir.Shading.GOURAUD, "flat": ir.Shading.FLAT}
_MAPPINGS = {m.name.lower(): m for m in ir.TextureMapping}
_WRAPS = {w.name.lower(): w for w in ir.Wrap}


class Materials:
    """Rows of the material elements of one scene."""

    def __init__(self, lowering: Context) -> None:
        self._lowering = lowering
        self._materials: dict[int, int] = {}  # by the element's identity; the document keeps elements alive
        self._rows: dict[tuple[int, bool, bool, bool], int] = {}  # of textures, likewise

    def row(self, element: Element) -> int:
        """The row of a material element."""
        row = self._materials.get(id(element))
        if row is None:
            self._lowering.photometric |= element.photometric
            self._warn_of_bright_color(element)
            row = self._materials[id(element)] = self._lowering.builder.material(self._data(element), element.place)
        return row

    def _warn_of_bright_color(self, element: Element) -> None:
        """Warn of a colour that reflects more light than arrives, as of channels from 0 to 255."""
        color = element.args.get("color")
        if Lobes.EMISSION in ELEMENTS[element.kind][0].LOBES or not isinstance(color, tuple) or max(color) <= 1.0:
            return
        bytes_of_it = all(c == int(c) and c <= 255 for c in color) and max(color) > 15
        hint = "write #" + "".join(f"{int(c):02x}" for c in color) if bytes_of_it else "channels of a material's colour are 0 to 1"
        message = f"this {element.kind} reflects more light than it gets: a channel of its colour is {max(color):g}"
        self._lowering.warn(element, message, hint)

    def _data(self, element: Element) -> MaterialData:
        plain = ELEMENTS[element.kind][1].lower(_Arguments(self, element))
        if plain.first >= 0:
            plain = replace(plain, medium=self.inside_of_parts(element, plain.first, plain.second))
        if (pattern := element.args.get("normal_map")) is not None and pattern.kind == "flakes":
            plain = self._with_flakes(element, plain, pattern)
        plain = replace(plain, inputs={**plain.inputs, **self._maps(element)})
        return partial_coverage.with_opacity(plain, self._opacity(element.args["opacity"]), element.args["opacity_threshold"])

    def inside_of_parts(self, element: Element, first: int, second: int) -> int:
        """The medium inside of a blend of two materials: that of the one that has it. -1 without, or after a diagnostic."""
        media = {self._lowering.builder.material_data(part).medium for part in (first, second)} - {-1}
        if len(media) > 1:
            message = "both parts of this material have a medium inside of them, and a shape is filled by one"
            self._lowering.error(element, message, "give one of them to the whole, as medium: of the shape")
        return media.pop() if len(media) == 1 else -1

    def _maps(self, element: Element) -> dict[ir.Slot, Input]:
        """Normal and bump maps of a material."""
        args = element.args
        for number, texture in (("normal_strength", "normal_map"), ("bump_height", "bump_map")):
            if args.get(number) is not None and args[texture] is None:
                self._lowering.error(element, f"`{number}` is given without a `{texture}`", f"give a `{texture}`, or leave it out")
        for texture in ("normal_map", "bump_map"):
            if args.get(texture) is not None and args.get("shading") == "gouraud":
                message = f"a `{texture}` turns no normals where light is computed at vertices"
                self._lowering.error(element, message, 'leave out `shading: "gouraud"`')
        inputs = {}
        if args.get("normal_map") is not None and args["normal_map"].kind != "flakes":
            strength = 1.0 if args["normal_strength"] is None else args["normal_strength"]
            row = self.texture(args["normal_map"], color=True, directions=True)
            inputs[Slot.NORMAL] = Input((strength, strength, 1.0), row) if row >= 0 else Input(BLACK)
        if args.get("bump_map") is not None:
            row = self.texture(args["bump_map"], color=False)
            height = 0.01 if args["bump_height"] is None else args["bump_height"]
            inputs[Slot.BUMP] = Input.number(height, row) if row >= 0 else Input(BLACK)
        return inputs

    def _with_flakes(self, element: Element, row: MaterialData, pattern: Element) -> MaterialData:
        """A material with flakes in its base; the material itself after a diagnostic."""
        if element.args.get("normal_strength") is not None:
            self._lowering.error(element, "flakes have no `normal_strength`", "give flakes(…) another `tilt`")
        args = pattern.args
        try:
            return flakes.with_flakes(row, args["size"], self.number(args["tilt"]), self.number(args["coverage"]), args["seed"])
        except flakes.NoFacetsError as unfit:
            self._lowering.error(element, str(unfit), unfit.hint)
            return row

    def normals(self, element: Element) -> Input:
        """A normal map of strength 1."""
        row = self.texture(element, color=True, directions=True)
        return Input(WHITE, row) if row >= 0 else Input(BLACK)

    def _opacity(self, value: Any) -> Input:
        if isinstance(value, Element) and value.kind == "image":
            return Input.number(1.0, self.texture(value, color=False, alpha=True))
        return self.number(value)

    def error(self, element: Element, message: str, hint: str = "") -> None:
        """Report an error at an element."""
        self._lowering.error(element, message, hint)

    def medium(self, element: Element, medium: MediumData) -> int:
        """The row of the medium inside of a material."""
        return self._lowering.builder.medium(medium, element.place)

    def color(self, value: Any) -> Input:
        if isinstance(value, Element):
            return Input(WHITE, self.texture(value, color=True))
        r, g, b = value
        return Input((r, g, b))

    def number(self, value: Any) -> Input:
        return Input.number(1.0, self.texture(value, color=False)) if isinstance(value, Element) else Input.number(value)

    def texture(self, element: Element, color: bool, alpha: bool = False, directions: bool = False) -> int:
        """The row of a texture, for a colour or a number; -1, after a diagnostic, if its file cannot be read.

        A number is a picture's first channel, or with `alpha` that one where the picture has it. `directions` are colours that stand
        for −1 to 1.
        """
        key = (id(element), color, alpha, directions)
        if key not in self._rows:
            data = self._texture(element, color, directions)
            if data is not None and directions:
                r, g, b = scale_color(data.bias, 2.0)
                data = replace(data, gain=scale_color(data.gain, 2.0), bias=(r - 1.0, g - 1.0, b - 1.0))
            if data is not None and alpha and element.args["channel"] is None and self._lowering.builder.has_holes(data.image):
                data = replace(data, channel=3)
            self._rows[key] = -1 if data is None else self._lowering.builder.texture(data, element.place)
        return self._rows[key]

    def _texture(self, element: Element, color: bool, data: bool) -> TextureData | None:
        args = element.args
        if element.kind == "flakes":
            self._lowering.error(element, "flakes(…) tilt facets: they are no colour and no number", "give them as `normal_map`")
            return None
        if element.kind == "pattern":
            return self._pattern(element, args["formula"], color)
        common: dict[str, Any] = {"mapping": _MAPPINGS[args["mapping"]], "frame": _frame(args), "channel": -1 if color else 0}
        if element.kind == "image":
            row = self.image(element, args["file"], args["space"], color and not data)
            if args["channel"] is not None:
                common["channel"] = "rgba".index(args["channel"])
            wrap, wrap_v = _WRAPS[args["wrap"]], _WRAPS[args["wrap_v"] or args["wrap"]]
            more = {"nearest": args["filter"] == "nearest", "gain": args["gain"], "bias": args["bias"], **common}
            return None if row < 0 else TextureData(ir.TextureKind.IMAGE, row, wrap_u=wrap, wrap_v=wrap_v, **more)
        kind = ir.TextureKind.CHECKER if element.kind == "checker" else ir.TextureKind.STRIPES
        return TextureData(kind, size=args["size"] or 0.0, color_a=args["a"], color_b=args["b"], **common)

    def _pattern(self, element: Element, formula: Formula, color: bool) -> TextureData | None:
        """A pattern; coordinates are in the unit of its file, frames are in metres."""
        if needs_graph(formula):
            tape = patterns.graph(self._lowering, element, formula, color, self._picture_row)
        else:
            tape = self.pattern_tape(element, formula, color, formula.unit)
        return None if tape is None else TextureData(ir.TextureKind.FORMULA, tape=self._lowering.builder.tape(tape), channel=-1)

    def pattern_tape(self, element: Element, formula: Formula, color: bool, unit: float, what: str = "pattern") -> Tape | None:
        """The tape of a pattern of the point, or of a density; `what` is its name in messages."""
        return patterns.of_point(self._lowering, element, formula, color, unit, what)

    def _picture_row(self, element: Element) -> PictureRow | None:
        """The image texture that a formula looks up; None after a diagnostic."""
        args = element.args
        data = self._texture(element, color=args["channel"] in (None, "a"), data=False)
        if data is None:
            return None
        plain = replace(data, frame=_PLAIN, gain=WHITE, bias=BLACK, channel=-1)
        return PictureRow(self._lowering.builder.texture(plain, element.place), data.frame, data.gain, data.bias)

    def image(self, element: Element, name: str, space: str, color: bool) -> int:
        """The row of an image file; -1 after a diagnostic."""
        lowering = self._lowering
        try:
            path = lowering.files.find(name, lowering.folder(element), "picture")
            return images.row(lowering.builder, path, space, color, element.place)
        except (FileError, ImageError) as failure:
            lowering.error(element, failure.message, failure.hint)
            return -1


class _Arguments:
    """The arguments of an element, as materials/contract.py describes them."""

    def __init__(self, materials: Materials, element: Element) -> None:
        self._materials, self._element, self.args = materials, element, element.args

    @property
    def shading(self) -> ir.Shading:
        return _SHADING[self.args["shading"]]

    def color(self, name: str) -> Input:
        return self._materials.color(self.args[name])

    def number(self, name: str) -> Input:
        return self._materials.number(self.args[name])

    def normals(self, element: Any) -> Input:
        return self._materials.normals(element)

    def error(self, message: str, hint: str = "") -> None:
        self._materials.error(self._element, message, hint)

    def medium(self, medium: MediumData) -> int:
        return self._materials.medium(self._element, medium)

    def part(self, name: str) -> int:
        part = self.args[name]
        if part.args["opacity"] != 1.0:
            self._materials.error(part, "a blend's materials have no opacity of their own", "give the blend the opacity")
        if part.args.get("shading") == "gouraud":
            message = "light of a blend is computed at points, not at vertices"
            self._materials.error(part, message, 'leave out `shading: "gouraud"`')
        return self._materials.row(part)


def _frame(args: Any) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """uv' = turn · (scale · (uv − offset)): `offset` moves the picture, `scale` repeats it, `angle` turns stripes."""
    su, sv = args["scale"]
    ou, ov = args["offset"]
    angle = args.get("angle") or 0.0
    c, s = math.cos(angle), math.sin(angle)
    rows = ((c * su, s * sv), (-s * su, c * sv))
    return tuple((a, b, -(a * ou + b * ov) + 0.0) for a, b in rows)  # type: ignore[return-value]
