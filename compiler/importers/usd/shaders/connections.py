"""Connections of inputs of shaders and node graphs that lead back to themselves."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def tell_circle(shader_input: Any, tell: Callable[[str, Any], None]) -> None:
    """Warn of an input whose connections form a circle: USD then gives it neither a value nor a source.

    The place of the warning is the first prim that is reached twice.
    """
    if not shader_input:
        return
    stage, reached = shader_input.GetPrim().GetStage(), set[Any]()
    waiting = [shader_input.GetAttr().GetPath()]
    while waiting:
        path = waiting.pop()
        attribute = stage.GetAttributeAtPath(path)
        if path in reached:
            message = f"the input `{shader_input.GetBaseName()}` takes its default: its connections form a circle at `{path}`"
            tell(message, attribute.GetPrim())
            return
        reached.add(path)
        waiting += attribute.GetConnections() if attribute else []
