"""Reports contents of a stage that are not drawn: prim types, applied schemas, authored properties, shaders and their inputs."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import UsdShade

from ..materialx import library
from . import tables
from .stage import Warnings


@dataclass(slots=True)
class Audit:
    """Looks up each prim in the tables."""

    warnings: Warnings
    _known: dict[tuple[str, ...], tuple[tuple[str, str], ...]] = field(default_factory=dict)

    def prim(self, prim: Any, kind: str) -> None:
        """Report undrawn parts of a prim: its type, else its applied schemas and its authored properties."""
        if kind and (message := tables.PRIM_TYPES.report(kind if tables.PRIM_TYPES.find(kind) else f"`{kind}`", kind)):
            self.warnings.tell(message, prim)
            return
        for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            name = str(schema).partition(":")[0]
            if message := tables.API_SCHEMAS.report(f"the applied schema `{name}`", name):
                self.warnings.tell(message, prim)
        self._properties(prim, kind)

    def variants(self, prim: Any) -> None:
        """Report selections of variants that do not exist."""
        if not prim.HasVariantSets():
            return
        sets = prim.GetVariantSets()
        for name, choice in sets.GetAllVariantSelections().items():
            variants = list(sets.GetVariantSet(name).GetVariantNames())
            if choice and variants and choice not in variants:
                message = f"the variant set `{name}` has no variant `{choice}`, which is selected: none is drawn"
                self.warnings.tell(f"{message} (it has {', '.join(variants[:12])})", prim)

    def shader(self, node: Any, kind: str) -> None:
        """Report the inputs of a shader that are not drawn; those of MaterialX surfaces are reported where they are read."""
        for shader_input in UsdShade.Shader(node).GetInputs():
            message = tables.INPUTS.report(f"the input `{shader_input.GetBaseName()}` of {kind}", str(shader_input.GetBaseName()))
            if shader_input.GetBaseName() == "space" and str(shader_input.Get()) in ("tangent", "None"):
                continue  # the default of ND_normalmap
            if message and self._is_default(shader_input, kind):
                continue
            if message and self._matters(node, str(shader_input.GetFullName())):
                self.warnings.tell(message, node)

    def _is_default(self, shader_input: Any, kind: str) -> bool:
        """Whether an input of a MaterialX node has the value that its definition gives it."""
        defined = library.definition(kind)
        port = defined.inputs.get(str(shader_input.GetBaseName())) if defined else None
        value = shader_input.Get(self.warnings.opened.time)
        if port is None or value is None or shader_input.HasConnectedSource():
            return False
        return np.array_equal(np.asarray(value), np.asarray(port.value))

    def _properties(self, prim: Any, kind: str) -> None:
        names = tuple(map(str, prim.GetAuthoredPropertyNames()))
        key = (kind, *names)
        if key not in self._known:
            self._known[key] = tuple((name, message) for name in names if (message := _report(name, kind)))
        for name, message in self._known[key]:
            if self._matters(prim, name):
                self.warnings.tell(message, prim)

    def _matters(self, prim: Any, name: str) -> bool:
        """Whether a property has a value other than the one that is drawn."""
        relation = prim.GetRelationship(name)
        if relation:
            return bool(relation.GetTargets())
        attribute = prim.GetAttribute(name)
        if attribute.HasAuthoredConnections():
            return True
        value = attribute.Get(self.warnings.opened.time)
        if value is None:
            return False
        if not attribute.IsCustom() and str(value) == str(prim.GetPrimDefinition().GetAttributeFallbackValue(name)):
            return False
        if attribute.GetTypeName().type.typeName == "SdfAssetPath":
            return bool(value.path)
        return not attribute.GetTypeName().isArray or np.size(value) > 0


def _report(name: str, kind: str) -> str:
    """The warning for a property of a prim type; "" for one that is drawn, without effect, or outside of all schemas."""
    entry = tables.PROPERTIES.find(f"{kind}.{name}", name)
    if entry is None and not name.startswith("inputs:"):
        return ""  # data of the user
    return tables.PROPERTIES.report(f"`{name.removeprefix('inputs:')}` of {kind or 'a prim without a type'}", f"{kind}.{name}", name)
