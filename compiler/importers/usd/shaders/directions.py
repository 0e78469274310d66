"""Directions that surface shaders read: the surface's own normal and tangent, and tangents that are turned."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from typing import Any

from pxr import UsdShade

TURNED = {"specular_rotation": "geometry_tangent", "coat_rotation": "geometry_coat_tangent"}


def turn(shader_input: Any) -> float | None:
    """The turns of a direction that is the tangent of the surface, turned by a number of degrees about its normal; None of others."""
    for attribute in shader_input.GetValueProducingAttributes() if shader_input else ():
        node = UsdShade.Shader(attribute.GetPrim())
        if node and node.GetIdAttr().Get() == "ND_rotate3d_vector3" and node.GetInput("in") and is_of_surface(node.GetInput("in")):
            amount = node.GetInput("amount")
            return None if not amount or amount.HasConnectedSource() else float(amount.Get() or 0.0) / 360.0
    return None


def is_of_surface(shader_input: Any) -> bool:
    """Whether a direction is the surface's own normal or tangent."""
    for attribute in shader_input.GetValueProducingAttributes():
        identifier = attribute.GetPrim().GetAttribute("info:id")
        return bool(identifier) and str(identifier.Get()) in ("ND_tangent_vector3", "ND_normal_vector3")
    return True
