"""Light groups: one channel for the light of each group of lights; the picture is exactly their sum.

A renderer for each group draws a scene in which only that group emits, with the same samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import channels
from ...compiler.plan.plan import Plan
from ..film.deadline import Deadline
from ..film.tile_queue import TileKernel
from ..image.image import Image
from ..types import Film, FirstHits, Tile
from . import combined_tiles

Make = Callable[[ir.Scene, Plan], Any]


class Sums:
    """Sums of the light of each group over the samples of a picture."""

    def __init__(self, plan: Plan) -> None:
        self.x0, self.y0, x1, y1 = plan["crop"]
        self.count = np.zeros((y1 - self.y0, x1 - self.x0), np.int64)
        names = *channels.light_groups(plan), ""
        self.of_all = np.zeros((len(names), *self.count.shape, 3))
        self.light = dict(zip(names, self.of_all, strict=True))

    def add(self, tile: Tile, count: NDArray[np.int64], light: Mapping[str, NDArray[np.float64]]) -> None:
        """Add the light of `count` samples of each pixel of a tile, (h, w, 3) of each group."""
        window = slice(tile.y0 - self.y0, tile.y1 - self.y0), slice(tile.x0 - self.x0, tile.x1 - self.x0)
        self.count[window] += count
        for name, group_light in light.items():
            self.light[name][window] += group_light

    def put(self, image: Image) -> None:
        """Write the groups' channels of a picture, and their sum to its `rgba`."""
        count = np.maximum(self.count, 1)[..., None]
        total = np.zeros((image.height, image.width, 3), np.float32)
        for name, light in self.light.items():
            mean = (light / count).astype(np.float32)
            total += mean
            if f"light:{name}" in image.channels:
                image.channels[f"light:{name}"][...] = mean
        image.channels["rgba"][..., :3] = total


class Renderer:
    """Renders a picture group by group; see film.Renderer. `make` makes the renderer of a scene and a plan."""

    whole = None

    def __init__(self, scene: ir.Scene, plan: Plan, make: Make) -> None:
        groups = groups_of(scene, plan)
        chosen = channels.light_groups(plan)
        named = [name for name in groups if name in chosen]
        others = {name for name in groups if name not in chosen}
        parts = [(name, {name}) for name in named] + ([("", others)] if others else [])
        self.parts = [(name, make(*isolate_groups(scene, plan, names))) for name, names in parts]
        self.sums = Sums(plan)
        if not self.parts:
            self.parts = [("", make(scene, plan))]
        renderer = self.parts[0][1]
        self.by_tile, self.cell, self.side, self.prepared = (
            renderer.by_tile,
            renderer.cell,
            renderer.side,
            getattr(renderer, "prepared", None),
        )

    @property
    def tile_kernel(self) -> TileKernel | None:
        """See film.Renderer."""
        drawings = [part.tile_kernel for _, part in self.parts]
        if None in drawings:
            return None
        sums, names = self.sums, list(self.sums.light)
        rows = np.array([names.index(name) for name, _ in self.parts], np.int64)
        pixels, width = sums.count.size, sums.count.shape[1]
        scene = combined_tiles.GroupScene(
            combined_tiles.parts_of(drawings), rows * pixels, sums.of_all.reshape(-1, 3), sums.count.reshape(-1), width, sums.x0, sums.y0
        )
        shares = not self.by_tile and getattr(self.parts[0][1], "packets", None) is None  # memory of triangles and of packets differs
        return combined_tiles.link(combined_tiles.draw_groups, scene, drawings, self.side, shares=shares)

    def limit_time(self, deadline: Deadline) -> None:
        """See film.Renderer."""
        for _, part in self.parts:
            part.limit_time(deadline)

    def resize(self, width: int, height: int) -> bool:
        """It cannot: the sums are those of the whole picture."""
        return False

    @property
    def round(self) -> int | None:
        """The smallest of all groups'; see film.Renderer."""
        return min((part.round for _, part in self.parts if part.round is not None), default=None)

    def refresh(self, samples: int) -> None:
        """Trace photons again, in each group that has photons."""
        for _, part in self.parts:
            if part.round is not None:
                part.refresh(samples)

    def shared(self) -> tuple[int, ...]:
        """The states of all groups, one after the other; see film.Renderer."""
        return tuple(number for _, part in self.parts for number in part.shared())

    def share(self, state: tuple[int, ...]) -> None:
        """Set the states of all groups."""
        for _, part in self.parts:
            size = len(part.shared())
            part.share(state[:size])
            state = state[size:]

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples to the film and to each group's sums."""
        self.sums.add(tile, count, self.sample_groups(tile, first, count, total, film))

    def sample_groups(
        self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film
    ) -> dict[str, NDArray[np.float64]]:  # fmt: skip
        """Add samples to the film; return the light of each group, (h, w, 3)."""
        light: dict[str, NDArray[np.float64]] = {}
        for k, (name, renderer) in enumerate(self.parts):
            part_film = Film(np.zeros_like(film.color), np.zeros_like(film.alpha), np.zeros_like(film.issues))
            renderer.sample(tile, first, count, total, part_film)
            light[name] = part_film.color
            film.color[...] += part_film.color
            film.issues[...] += part_film.issues
            if k == 0:
                film.alpha[...] += part_film.alpha
        return light

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels, which are the same in all groups."""
        self.parts[0][1].channels(tile, names, out)

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """First hits, which are the same in all groups."""
        return self.parts[0][1].first(tile, samples, total)

    def put(self, image: Image) -> None:
        """See Sums.put."""
        self.sums.put(image)


def groups_of(scene: ir.Scene, plan: Plan) -> tuple[str, ...]:
    """The names of a scene's light groups, sorted; channels.REST holds lights without a name, emissive shapes, media and a background."""
    tables = scene.tables
    groups = scene.names.groups or ("",) * len(tables.lights.kind)
    shining = tables.lights.color.max(axis=1, initial=0.0) > 0.0
    named = {group or channels.REST for group, lit in zip(groups, shining.tolist(), strict=True) if lit}
    alone = tables.instances.material[tables.instances.light < 0]
    if tables.media.emission.max(initial=0.0) > 0.0:
        named.add(channels.REST)
    if tables.materials.values[alone, ir.Slot.EMISSION].max(initial=0.0) > 0.0 or not isinstance(plan["background"], str):
        named.add(channels.REST)
    return tuple(sorted(named))


def isolate_groups(scene: ir.Scene, plan: Plan, names: set[str]) -> tuple[ir.Scene, Plan]:
    """The scene in which only these groups emit, and its plan; a background of one colour belongs to channels.REST."""
    tables = scene.tables
    groups = scene.names.groups or ("",) * len(tables.lights.kind)
    off = np.array([(group or channels.REST) not in names for group in groups], bool).reshape(-1)
    color = np.where(off[:, None], 0.0, tables.lights.color)
    light = tables.instances.light
    dark = np.where(light >= 0, np.append(off, False)[light], channels.REST not in names)
    materials, material = _without_emission(tables, np.flatnonzero(dark))
    glow = tables.media.emission * float(channels.REST in names)
    lit = tables._replace(
        media=tables.media._replace(emission=glow),
        lights=ir.table_of("lights", {**tables.lights._asdict(), "color": color}),
        materials=materials,
        instances=ir.table_of("instances", {**tables.instances._asdict(), "material": material}),
    )  # fmt: skip
    if channels.REST not in names and not isinstance(plan["background"], str):
        black = replace(plan.decisions["background"], value="transparent")
        plan = Plan({**plan.decisions, "background": black})
    return replace(scene, tables=lit), plan


def _without_emission(tables: ir.Tables, rows: Sequence[int] | NDArray[np.intp]) -> tuple[ir.Materials, NDArray[np.int32]]:
    """(materials, material of each instance) in which the instances at `rows` do not emit."""
    material = tables.instances.material.copy()
    used = np.unique(material[rows])
    used = used[tables.materials.values[used, ir.Slot.EMISSION].max(axis=1, initial=0.0) > 0.0]
    columns = {name: np.concatenate([column, column[used]]) for name, column in tables.materials._asdict().items()}
    start = len(tables.materials.model)
    columns["values"][start:, ir.Slot.EMISSION] = 0.0
    for k, row in enumerate(used.tolist()):
        chosen = np.zeros(len(material), bool)
        chosen[rows] = True
        material[chosen & (material == row)] = start + k
    return ir.table_of("materials", columns), material
