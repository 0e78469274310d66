"""Tessellates the shapes of one view to a tolerance in pixels."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...shapes import SHAPES, surfaces
from ..geometry.bounds import world_bounds
from ..types import View
from . import analytic_shapes, pixel_tolerance


class ViewTessellator:
    """Tessellates the analytic instances of a view, once for each geometry and tolerance."""

    def __init__(self, tables: ir.Tables, view: View, pixels: float) -> None:
        self.tables, self.pixels = tables, pixels
        self.eye = tables.transforms.matrix[tables.cameras.transform[view.camera], :, 3]
        self.view = view
        self._tessellations: dict[tuple[int, float], analytic_shapes.Tessellation] = {}

    @cached_property
    def tolerances(self) -> NDArray[np.float64]:
        """(instances,) see `pixel_tolerance.instance_tolerances`."""
        return pixel_tolerance.instance_tolerances(self.tables, self.view, self.pixels)

    def tessellations(self, tables: ir.Tables) -> dict[int, analytic_shapes.Tessellation]:
        """The tessellations of all instances that the rasterizer fills, by instance.

        Meshes, implicit surfaces and quadrics have none. Neither do round shapes so near to the eye that the tolerance needs too many
        triangles. The rasterizer intersects a ray with these for each sample.
        """
        boxes = world_bounds(tables)
        with np.errstate(all="ignore"):
            nearest, least = pixel_tolerance.nearest_depths(tables, self.view, boxes)
        perspective = tables.cameras.projection[self.view.camera] == ir.Projection.PERSPECTIVE
        close = perspective & ~(nearest >= least)
        geometries, by_instance = tables.geometries, {}
        for i in analytic_shapes.visible_analytic(tables).tolist():
            g = tables.instances.geometry[i]
            kind = int(geometries.kind[g])
            shape, parameters = SHAPES.get(kind), geometries.parameters[g].tolist()
            if shape is None or not (shape.EXACT or shape.circles(parameters)):
                continue
            if shape.EXACT or not (close[i] or analytic_shapes.exceeds_limit(kind, parameters, self.key(i)[1])):
                by_instance[i] = self.tessellate(i)
        return by_instance

    def key(self, instance: int) -> tuple[int, float]:
        """The geometry and tolerance of an instance; equal keys share a tessellation."""
        tolerance = float(self.tolerances[instance])
        return int(self.tables.instances.geometry[instance]), 0.0 if math.isnan(tolerance) else tolerance

    def tessellate(self, instance: int) -> analytic_shapes.Tessellation:
        """The tessellation of one instance in its own frame; unbounded quadrics have none."""
        key, geometries = self.key(instance), self.tables.geometries
        if geometries.kind[key[0]] == ir.GeometryKind.PLANE:  # its centre lies below the eye
            x, _, z = self.tables.transforms.inverse[self.tables.instances.transform[instance]] @ [*self.eye, 1.0]
            return surfaces.endless(float(x), float(z))
        if key not in self._tessellations and geometries.kind[key[0]] == ir.GeometryKind.FORMULA:
            from . import implicit_surfaces

            self._tessellations[key] = implicit_surfaces.tessellate(self.tables, *key)
        if key not in self._tessellations:
            self._tessellations[key] = analytic_shapes.tessellate(int(geometries.kind[key[0]]), geometries.parameters[key[0]], key[1])
        return self._tessellations[key]
