"""A scene in the primaries in which its light is computed: a scene in memory is linear Rec.709, and `scene_in` converts all its colours.

Each colour is converted by itself: constants, pictures, patterns, colours of vertices, lights. Products of them are then those of the
working space. Media keep their transmittance: the colour that is left after a mean free path, and the albedo, are converted.
"""

from __future__ import annotations

import weakref
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.formula.opcodes import Op
from ..compiler.formula.tape import INPUTS, Tape, load_tape
from ..compiler.io.color_encoding import multiplied
from ..compiler.plan.decision import Plan, PlanError
from ..compiler.texture_graph import opcodes
from ..lang import color_spaces

Slot, Model, Kind = ir.Slot, ir.MaterialModel, ir.TextureKind
REC709 = "rec709"
MOST_ROWS = 509  # of a pattern's tape, as in render/texture/procedural.py
_ADDED = 15  # operations of the product with a matrix
_OCCLUDED = (Model.PRINCIPLED, Model.PRINCIPLED_SPECULAR)  # whose AMBIENT is a number
_made: weakref.WeakKeyDictionary[ir.Scene, dict[str, ir.Scene]] = weakref.WeakKeyDictionary()
F64 = NDArray[np.float64]


def scene_in(scene: ir.Scene, plan: Plan) -> tuple[ir.Scene, Plan]:
    """The scene and the plan with their colours in the plan's working space. Raises PlanError for a pattern that is too long.

    In Rec.709 they stay as they are, but for pictures with colours beyond it, whose negative components are 0.
    """
    space = plan["working_space"]
    if space == REC709 and not scene.is_wide:
        return scene, plan
    by_space = _made.setdefault(scene, {})
    if space not in by_space:
        by_space.clear()
        by_space[space] = replace(scene, tables=_clipped(scene.tables) if space == REC709 else _Conversion(scene.tables, space).tables())
    if space != REC709 and not isinstance(plan["background"], str):
        color = tuple((_matrix(space) @ np.array(plan["background"])).tolist())
        plan = Plan({**plan.decisions, "background": replace(plan.decisions["background"], value=color)})
    return by_space[space], plan


def _matrix(space: str) -> F64:
    return np.array(color_spaces.matrix(color_spaces.REC709, color_spaces.WORKING[space]))


def _clipped(tables: ir.Tables) -> ir.Tables:
    return tables._replace(images=tables.images._replace(texels=_frozen(np.maximum(tables.images.texels, np.float32(0.0)))))


def color_inputs(materials: ir.Materials) -> NDArray[np.bool_]:
    """(materials, slots) bool: inputs that are colours."""
    colors = np.zeros(materials.textures.shape, bool)
    colors[:, sorted(ir.COLOR_SLOTS)] = True
    colors[ir.is_in(materials.model, _OCCLUDED), Slot.AMBIENT] = False
    return colors


class _Conversion:
    """Converts the tables of a scene."""

    def __init__(self, tables: ir.Tables, space: str) -> None:
        self._tables, self._matrix = tables, _matrix(space)

    def tables(self) -> ir.Tables:
        """The tables, of which those without colours are the same."""
        old, matrix = self._tables, self._matrix
        lights = old.lights._replace(color=_frozen(old.lights.color @ matrix.T))
        changed = old._replace(lights=lights, media=self._media(), pools=self._vertex_colors())
        colors, values = color_inputs(old.materials), old.materials.values.copy()
        values[colors] = values[colors] @ matrix.T
        values[:, Slot.ABSORPTION] = _absorption(old.materials.values[:, Slot.ABSORPTION], matrix)
        self._tables = changed
        return self._textures(values, colors)

    def _media(self) -> ir.Media:
        media, matrix = self._tables.media, self._matrix
        extinction = media.scattering + media.absorption
        with np.errstate(divide="ignore", invalid="ignore"):
            albedo = np.where(extinction > 0.0, media.scattering / extinction, np.nan)
        mean = np.nan_to_num(np.nanmean(np.column_stack([albedo, np.where(np.isnan(albedo).all(axis=1), 0.0, np.nan)]), axis=1))
        albedo = np.where(np.isnan(albedo), mean[:, None], albedo)
        converted = np.clip(albedo @ matrix.T, 0.0, 1.0)
        total = _absorption(extinction, matrix)
        emission = np.maximum(media.emission @ matrix.T, 0.0)
        return media._replace(
            scattering=_frozen(total * converted), absorption=_frozen(total * (1.0 - converted)), emission=_frozen(emission)
        )

    def _vertex_colors(self) -> ir.Pools:
        pools, attributes = self._tables.pools, self._tables.attributes
        rows = np.unique(self._tables.geometries.colors)
        rows = rows[rows >= 0]
        if not len(rows):
            return pools
        values = pools.values.copy()
        for row in rows:
            width, first = int(attributes.width[row]), int(attributes.first[row])
            part = values[first : first + width * int(attributes.count[row])].reshape(-1, width)
            part[:, :3] = multiplied(part[:, :3], self._matrix)
        return pools._replace(values=_frozen(values))

    def _textures(self, values: F64, colors: NDArray[np.bool_]) -> ir.Tables:
        """The tables with converted textures: of inputs that are colours; those that numbers use as well have a row of their own."""
        old = self._tables
        rows, used = old.materials.textures, old.textures
        as_color = np.zeros(len(used.kind), bool)
        as_color[rows[colors & (rows >= 0)]] = True
        as_number = np.zeros(len(used.kind), bool)
        as_number[rows[~colors & (rows >= 0)]] = True
        as_number[old.media.density[old.media.density >= 0]] = True
        as_number[self._looked_up()] = True  # the result of the tape is converted
        first = len(used.kind)
        shared = np.flatnonzero(as_color & as_number)
        new_row = np.arange(first)
        new_row[shared] = first + np.arange(len(shared))
        columns = {name: np.concatenate([column, column[shared]]) for name, column in used._asdict().items()}
        converted = np.concatenate([as_color & ~as_number, np.ones(len(shared), bool)])
        for name in ("color_a", "color_b", "gain", "bias"):
            columns[name][converted] = columns[name][converted] @ self._matrix.T
        textures = np.where(colors & (rows >= 0), new_row[np.maximum(rows, 0)] if first else rows, rows).astype(np.int32)
        pools, tapes, columns["tape"] = self._patterns(columns["tape"], converted & (columns["kind"] == Kind.FORMULA))
        images, columns["image"], light_images = self._images(columns, converted)
        return old._replace(
            pools=pools, tapes=tapes, images=images, textures=ir.table_of("textures", columns),
            lights=old.lights._replace(image=_frozen(light_images)),
            materials=old.materials._replace(values=_frozen(values), textures=_frozen(textures)),
        )  # fmt: skip

    def _looked_up(self) -> list[int]:
        """The rows of textures whose pictures tapes of texture graphs look up."""
        rows: list[int] = []
        for tape in np.unique(self._tables.textures.tape[self._tables.textures.tape >= 0]).tolist():
            loaded = load_tape(self._tables, tape)
            rows += loaded.constants[~loaded.code[loaded.code[:, 0] == opcodes.Op.LOOK_UP, 3]].astype(int).tolist()
        return rows

    def _images(self, textures: dict[str, NDArray[Any]], converted: NDArray[np.bool_]) -> tuple[ir.Images, NDArray[Any], NDArray[Any]]:
        """(Images, the column of Textures, the column of Lights): pictures that are used both ways are there twice."""
        images, lights = self._tables.images, self._tables.lights
        rows = textures["image"]
        as_color, as_number = np.zeros(len(images.first), bool), np.zeros(len(images.first), bool)
        colored = converted & (textures["channel"] < 0)
        as_color[rows[colored & (rows >= 0)]] = True
        as_number[rows[~colored & (textures["channel"] != 3) & (rows >= 0)]] = True  # alpha is the same in both
        as_color[lights.image[lights.image >= 0]] = True
        new_row, texels, first = np.arange(len(images.first)), [images.texels.copy()], images.first.tolist()
        width, height = images.width.tolist(), images.height.tolist()
        end = len(images.texels)
        for row in np.flatnonzero(as_color).tolist():
            begin, count = first[row], width[row] * height[row]
            part = images.texels[begin : begin + count].copy()
            part[:, :3] = multiplied(part[:, :3], self._matrix)
            if not as_number[row]:
                texels[0][begin : begin + count] = part
                continue
            new_row[row] = len(first)
            texels.append(part)
            first, width, height, end = [*first, end], [*width, width[row]], [*height, height[row]], end + count
        image_rows = np.where(colored & (rows >= 0), new_row[np.maximum(rows, 0)] if len(new_row) else rows, rows)
        of_lights = np.where(lights.image >= 0, new_row[np.maximum(lights.image, 0)] if len(new_row) else lights.image, lights.image)
        table = {"first": first, "width": width, "height": height, "texels": np.concatenate(texels)}
        return ir.table_of("images", table), image_rows.astype(np.int32), of_lights.astype(np.int32)

    def _patterns(self, tape_of: NDArray[Any], converted: NDArray[np.bool_]) -> tuple[ir.Pools, ir.Tapes, NDArray[Any]]:
        """(Pools, Tapes, the column of Textures) with the tapes of patterns times the matrix. Tapes of one result are grey."""
        pools, tapes, tape_of = self._tables.pools, self._tables.tapes, tape_of.copy()
        code, constants = [pools.code], [pools.constants]
        columns = {name: column.tolist() for name, column in tapes._asdict().items()}
        done: dict[int, int] = {}
        for texture in np.flatnonzero(converted).tolist():
            row = int(tape_of[texture])
            if row not in done and tapes.result_count[row] >= 3:
                done[row] = len(columns["first"])
                tape = _times_matrix(load_tape(self._tables, row), self._matrix)
                begin, constant = sum(map(len, code)), sum(map(len, constants))
                results = [*tape.results, *[0] * (4 - len(tape.results))]
                for name, value in zip(ir.Tapes._fields, (begin, len(tape.code), constant, len(tape.constants), results, 3), strict=True):
                    columns[name].append(value)
                code.append(tape.code)
                constants.append(tape.constants)
            tape_of[texture] = done.get(row, row)
        if not done:
            return pools, tapes, tape_of
        joined = pools._replace(code=_frozen(np.concatenate(code)), constants=_frozen(np.concatenate(constants)))
        return joined, ir.table_of("tapes", columns), tape_of


def _absorption(coefficients: F64, matrix: F64) -> F64:
    """Coefficients per metre, (n, 3), whose transmittance over a mean free path is that colour, converted. Equal ones stay."""
    mean = coefficients.mean(axis=1, keepdims=True)
    length = 1.0 / np.where(mean > 0.0, mean, 1.0)
    transmitted = np.exp(-coefficients * length) @ matrix.T
    converted = np.maximum(-np.log(np.maximum(transmitted, 1e-300)), 0.0) / length
    return np.where(np.ptp(coefficients, axis=1, keepdims=True) > 0.0, converted, coefficients)


def _times_matrix(tape: Tape, matrix: F64) -> Tape:
    """A tape whose three results are multiplied by a matrix."""
    most = (opcodes.MOST_ROWS if opcodes.is_graph(tape.code, tape.results) else MOST_ROWS) - _ADDED
    if len(tape.code) > most:
        raise PlanError(f"a pattern has {len(tape.code)} operations: with a working space at most {most} are drawn; leave it out")
    code, constants = tape.code.tolist(), [*tape.constants.tolist(), *matrix.ravel().tolist()]
    first = len(tape.constants)

    def add(op: Op, a: int, b: int) -> int:
        code.append([int(op), a, b, 0])
        return INPUTS + len(code) - 1

    results = []
    for k in range(3):
        r, g, b = (add(Op.MULTIPLY, tape.results[j], ~(first + 3 * k + j)) for j in range(3))
        results.append(add(Op.ADD, add(Op.ADD, r, g), b))
    return Tape(np.array(code, np.int32), np.array(constants, np.float64), tuple(results))


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    """A contiguous array that cannot be written."""
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array
