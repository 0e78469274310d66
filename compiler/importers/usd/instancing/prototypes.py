"""Prototypes of native instances: how many prims they have, and which instances can share the geometry of one."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pxr import Sdf, Usd, UsdGeom

from ..layers.prim_count import MAX_PRIMS

MAX_LEVELS = 32  # of instances in instances that share geometry
_INHERITED = ("primvars:", "material:binding", "colorSpace:", "guideVisibility", "proxyVisibility", "renderVisibility")
_COLLECTION = "material:binding:collection"  # binds by path
_METADATA = ("interpolation", "elementSize", "colorSpace", "bindMaterialAs")
_SHORT = 64  # values of a property that are compared


class Prototype(NamedTuple):
    """A prototype with those of the instances in it."""

    prims: int
    levels: int  # of instances
    alike: bool  # whether its instances differ by transform and inherited state alone


class _Own(NamedTuple):
    """A prototype without those of the instances in it."""

    prims: int
    alike: bool
    nested: list[Any]  # their prototypes


@dataclass(slots=True)
class Prototypes:
    """The prototypes of a stage, each read once."""

    time: Any
    _own: dict[Any, _Own] = field(default_factory=dict)
    _known: dict[Any, Prototype] = field(default_factory=dict)
    _inherited: dict[Any, tuple[Any, ...] | None] = field(default_factory=dict)  # by paths of the parents of instances

    def prototype_of(self, instance: Any) -> Prototype:
        """The prototype of an instance."""
        first = instance.GetPrototype()
        waiting = [first]
        while waiting:
            prototype = waiting[-1]
            if prototype.GetPath() not in self._own:
                self._own[prototype.GetPath()] = _read(prototype)
            contents = self._own[prototype.GetPath()]
            unknown = [other for other in contents.nested if other.GetPath() not in self._known]
            if unknown and prototype.GetPath() not in self._known:
                waiting += unknown
                continue
            waiting.pop()
            nested = [self._known[other.GetPath()] for other in contents.nested]
            levels = 1 + max((other.levels for other in nested), default=0)
            alike = contents.alike and levels <= MAX_LEVELS and all(other.alike for other in nested)
            self._known[prototype.GetPath()] = Prototype(contents.prims + sum(other.prims for other in nested), levels, alike)
        return self._known[first.GetPath()]

    def inherited(self, prim: Any) -> tuple[Any, ...] | None:
        """The properties of a prim and its ancestors that its descendants inherit, with their values; None if they depend on the path."""
        chain, top = [], prim
        while not top.IsPseudoRoot() and top.GetPath() not in self._inherited:
            chain.append(top)
            top = top.GetParent()
        properties = () if top.IsPseudoRoot() else self._inherited[top.GetPath()]
        for ancestor in reversed(chain):
            own_properties = self._properties(ancestor)
            properties = None if properties is None or own_properties is None else properties + own_properties
            if ancestor is not prim:
                self._inherited[ancestor.GetPath()] = properties
        return properties

    def _properties(self, prim: Any) -> tuple[Any, ...] | None:
        if prim.GetTypeName() == "SkelRoot":
            return None
        names = [name for name in prim.GetAuthoredPropertyNames() if name.startswith(_INHERITED)]
        values = tuple(self._value(prim, prim.GetProperty(name)) for name in names)
        return None if None in values else values

    def _value(self, prim: Any, prop: Any) -> tuple[Any, ...] | None:
        """A property's name, value and metadata; None if the value depends on the path of the prim, or is a long array."""
        name = str(prop.GetName())
        if name.startswith(_COLLECTION):
            return None
        prim_path = prim.GetPath()
        if isinstance(prop, Usd.Relationship):
            value: Any = tuple(str(t.MakeRelativePath(prim_path) if t.HasPrefix(prim_path) else t) for t in prop.GetTargets())
        else:
            value = prop.Get(self.time)
            if hasattr(value, "__len__") and len(value) > _SHORT:
                return None
        return (name, str(value), *(str(prop.GetMetadata(key)) for key in _METADATA))


def _read(prototype: Any) -> _Own:
    prims = list(Usd.PrimRange(prototype))
    alike = not any(
        prim.GetTypeName() in ("Camera", "SkelRoot")
        or prim.HasAPI("LightAPI")
        or ((placed := UsdGeom.Xformable(prim)) and placed.GetResetXformStack())
        for prim in prims
    )
    return _Own(len(prims), alike, [prim.GetPrototype() for prim in prims if prim.IsInstance()])


def without_excess(stage: Any) -> list[Any]:
    """Deactivate instances by which the stage would have more than MAX_PRIMS prims. Returns their paths; no file changes."""
    if not stage.GetPrototypes():
        return []
    prototypes, prims, excess = Prototypes(Usd.TimeCode.Default()), 0, []
    for prim in stage.Traverse():
        size = prototypes.prototype_of(prim).prims if prim.IsInstance() else 1
        if prims + size > MAX_PRIMS and prim.IsInstance():
            excess.append(prim.GetPath())
        else:
            prims += size
    with Sdf.ChangeBlock():
        for path in excess:
            Sdf.CreatePrimInLayer(stage.GetSessionLayer(), path).active = False
    return excess
