"""Directions that surface shaders read: the surface's own normal and tangent, and tangents that are turned."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from typing import Any

from pxr import UsdShade

TURNED = {"specular_rotation": "geometry_tangent", "coat_rotation": "geometry_coat_tangent"}


def angle(shader_input: Any) -> Any:
    """The input of the degrees by which a direction is the tangent of the surface, turned about its normal; None of other directions."""
    for attribute in shader_input.GetValueProducingAttributes() if shader_input else ():
        node = UsdShade.Shader(attribute.GetPrim())
        if node and node.GetIdAttr().Get() == "ND_rotate3d_vector3" and node.GetInput("in") and is_of_surface(node.GetInput("in")):
            return node.GetInput("amount") or None
    return None


def is_of_surface(shader_input: Any) -> bool:
    """Whether a direction is the surface's own normal or tangent."""
    for attribute in shader_input.GetValueProducingAttributes():
        identifier = attribute.GetPrim().GetAttribute("info:id")
        return bool(identifier) and str(identifier.Get()) in ("ND_tangent_vector3", "ND_normal_vector3")
    return True
