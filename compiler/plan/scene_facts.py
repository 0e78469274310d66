"""Predicates over scene tables: materials by their scattering, opacity, motion, a ground plane, extents."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .. import ir

MAX_REFLECTION_ROUGHNESS = 0.3  # roughness below which the highlight of a dielectric shows recognizable reflections


def ground(tables: ir.Tables) -> int:
    """The instance of a plane that casts shadows and has everything else on its upper side, or -1.

    Objects may touch it, within 1e-9 of their coordinates.
    """
    instances, geometries, transforms = tables.instances, tables.geometries, tables.transforms
    boxes, matrix = geometries.bounds[instances.geometry], transforms.matrix[instances.transform]
    solid = (geometries.kind[instances.geometry] == ir.GeometryKind.PLANE) & (instances.visible & ir.Visibility.SHADOW != 0)
    solid &= ~partial(tables)[instances.material]
    for row in np.flatnonzero(solid)[:4].tolist():
        others = np.arange(len(boxes)) != row
        below = transforms.inverse[instances.transform[row], 1]  # height over the plane, of a point of the world
        along = np.einsum("j,njk->nk", below[:3], matrix[others, :, :3])
        with np.errstate(invalid="ignore"):
            middle, half = boxes[others].mean(axis=1), 0.5 * (boxes[others, 1] - boxes[others, 0])
            height = np.sum(along * middle, axis=1) + matrix[others, :, 3] @ below[:3] + below[3]
            reach = np.sum(np.abs(along) * half, axis=1)
            size = np.abs(height) + reach + np.abs(below[3])
            if np.all(height - reach >= -1e-9 * size):  # nan and inf of unbounded shapes compare false
                return row
    return -1


def used_rows(rows: np.ndarray) -> np.ndarray:
    """The distinct rows of a column in ascending order, without −1. np.unique sorts, and loads numpy.ma."""
    return np.flatnonzero(np.bincount(rows.ravel() + 1))[1:] - 1 if (rows < 0).any() else np.flatnonzero(np.bincount(rows.ravel()))


def partial(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials with an opacity below 1 anywhere."""
    materials = tables.materials
    return (materials.values[:, ir.Slot.OPACITY, 0] < 1.0) | (materials.textures[:, ir.Slot.OPACITY] >= 0)


def profiled(tables: ir.Tables) -> np.ndarray:
    """(lights,) bool: lights whose emission depends on the direction by an image."""
    return (tables.lights.image >= 0) & (tables.lights.kind != ir.LightKind.DOME)


def shines(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: emissive materials."""
    return tables.materials.values[:, ir.Slot.EMISSION].max(axis=1, initial=0.0) > 0.0  # a texture multiplies it


def moving(tables: ir.Tables, camera: int) -> bool:
    """Whether an instance or the camera moves while the camera's shutter is open."""
    rows = np.append(tables.instances.transform, tables.cameras.transform[camera])
    return bool(tables.cameras.shutter[camera] > 0.0 and (tables.transforms.first_key[rows] >= 0).any())


def open_during(tables: ir.Tables, camera: int) -> tuple[float, float]:
    """(opening, duration) of a camera's shutter, as shares of the time that the keys span."""
    cameras = tables.cameras
    of = cameras.shutter > 0.0
    start, end = cameras.opening[of].min(), (cameras.opening + cameras.shutter)[of].max()
    return float((cameras.opening[camera] - start) / (end - start)), float(cameras.shutter[camera] / (end - start))


def specular_materials(scene: ir.Scene) -> np.ndarray:
    """(materials,) bool: materials that reflect or refract specularly."""
    m = scene.tables.materials
    slots = m.values[:, [ir.Slot.REFLECTION, ir.Slot.TRANSMISSION]].max(axis=(1, 2), initial=0.0) > 0
    slots |= glossy_materials(scene)
    return slots | ir.is_in(m.model, (ir.MaterialModel.MIRROR, ir.MaterialModel.GLASS))


def used_materials(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials of instances, and the parts of their blends."""
    m = tables.materials
    found = np.zeros(len(m.model), bool)
    found[tables.instances.material] = True
    for row in np.flatnonzero(m.model == ir.MaterialModel.BLEND)[::-1]:  # parts have lower rows than their blends
        if found[row]:
            found[[m.first[row], m.second[row]]] = True
    return found


def with_parts(tables: ir.Tables, of: np.ndarray) -> np.ndarray:
    """(materials,) bool: `of`, and blends of which a part is."""
    m, found = tables.materials, of.copy()
    for row in np.flatnonzero(m.model == ir.MaterialModel.BLEND):  # parts have lower rows than their blends
        found[row] |= found[m.first[row]] | found[m.second[row]]
    return found


def glossy_materials(scene: ir.Scene) -> np.ndarray:
    """(materials,) bool: microfacet materials with recognizable reflections: metals, polished dielectrics, rough glass."""
    m, slot = scene.tables.materials, ir.Slot

    def may_be(wanted: Callable[[np.ndarray], np.ndarray], which: int) -> np.ndarray:
        return wanted(m.values[:, which, 0]) | (m.textures[:, which] >= 0)

    polished = may_be(lambda x: x < MAX_REFLECTION_ROUGHNESS, slot.ROUGHNESS) | may_be(lambda x: x > 0.0, slot.METALLIC)
    polished |= may_be(lambda x: x > 0.0, slot.COAT) & may_be(lambda x: x < MAX_REFLECTION_ROUGHNESS, slot.COAT_ROUGHNESS)
    principled = ir.is_in(m.model, (ir.MaterialModel.PRINCIPLED, ir.MaterialModel.PRINCIPLED_SPECULAR))
    frosted = (m.model == ir.MaterialModel.GLASS) & may_be(lambda x: x > 0.0, slot.ROUGHNESS)
    return (m.model == ir.MaterialModel.METAL) | (principled & polished) | frosted


def lit_materials(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials with direct light: diffuse, with a highlight, or rough glass."""
    m, slots = tables.materials, [ir.Slot.DIFFUSE, ir.Slot.SPECULAR]
    plain = (m.values[:, slots].max(axis=(1, 2), initial=0.0) > 0.0) | (m.textures[:, slots] >= 0).any(axis=1)
    rough = (m.values[:, ir.Slot.ROUGHNESS, 0] > 0.0) | (m.textures[:, ir.Slot.ROUGHNESS] >= 0)
    facets = ir.is_in(m.model, (ir.MaterialModel.METAL, ir.MaterialModel.PRINCIPLED, ir.MaterialModel.PRINCIPLED_SPECULAR))
    return plain | facets | (m.model == ir.MaterialModel.BLEND) | (rough & (m.model == ir.MaterialModel.GLASS))


def extents(tables: ir.Tables) -> tuple[float, float]:
    """(largest coordinate of bounded instances and cameras, half diagonal of the smallest instance), in metres; 1 without instances."""
    instances, matrix = tables.instances, tables.transforms.matrix[tables.instances.transform]
    bounds = tables.geometries.bounds[instances.geometry]
    finite = np.isfinite(bounds).all(axis=(1, 2))
    middle, half = bounds[finite].mean(axis=1), 0.5 * (bounds[finite, 1] - bounds[finite, 0])
    centre = np.einsum("nij,nj->ni", matrix[finite, :, :3], middle) + matrix[finite, :, 3]
    reach = np.einsum("nij,nj->ni", np.abs(matrix[finite, :, :3]), half)
    eyes = np.abs(tables.transforms.matrix[tables.cameras.transform, :, 3])
    largest = max(float(np.abs(centre).max(initial=0.0) + reach.max(initial=0.0)), float(eyes.max(initial=0.0)))
    return largest, float(np.linalg.norm(reach, axis=1).min(initial=np.inf)) if finite.any() else 1.0
