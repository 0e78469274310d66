"""Nodes of MaterialX as prims of a stage."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from typing import Any

from pxr import Gf, Sdf, UsdShade

_TYPES = {
    "float": Sdf.ValueTypeNames.Float, "integer": Sdf.ValueTypeNames.Int, "boolean": Sdf.ValueTypeNames.Bool,
    "color3": Sdf.ValueTypeNames.Color3f, "vector2": Sdf.ValueTypeNames.Float2, "vector3": Sdf.ValueTypeNames.Float3,
    "string": Sdf.ValueTypeNames.String, "filename": Sdf.ValueTypeNames.Asset, "surfaceshader": Sdf.ValueTypeNames.Token,
}  # fmt: skip


class Nodes:
    """Nodes whose paths begin alike; equal ones are written once."""

    def __init__(self, stage: Any, path: str) -> None:
        self._stage, self._path = stage, path
        self._counts: dict[str, int] = {}
        self._known: dict[Any, Any] = {}

    def add(self, name: str, definition: str, output: str, **inputs: tuple[str, Any]) -> Any:
        """The output of a node. Inputs have a type, and a value or an output of another node."""
        key = (definition, output, tuple((k, t, str(getattr(v, "GetAttr", lambda v=v: v)())) for k, (t, v) in inputs.items()))
        if key in self._known:
            return self._known[key]
        count = self._counts[name] = self._counts.get(name, 0) + 1
        shader = UsdShade.Shader.Define(self._stage, f"{self._path}{name}{count if count > 1 else ''}")
        shader.CreateIdAttr(definition)
        for label, (kind, value) in inputs.items():
            set_input(shader, label, kind, value)
        self._known[key] = shader.CreateOutput("surface" if output == "surfaceshader" else "out", _TYPES[output])
        return self._known[key]


def set_input(shader: Any, name: str, kind: str, value: Any) -> Any:
    """An input of a shader: a value, or the output of a node."""
    slot = shader.CreateInput(name, _TYPES[kind])
    if isinstance(value, UsdShade.Output):
        slot.ConnectToSource(value)
    elif kind in ("color3", "vector3"):
        slot.Set(Gf.Vec3f(*map(float, value)))
    elif kind == "vector2":
        slot.Set(Gf.Vec2f(*map(float, value)))
    elif kind == "float":
        slot.Set(float(value))
    else:
        slot.Set(value)
    return slot
