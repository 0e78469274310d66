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

    def of(self, instance: Any) -> Prototype:
        """The prototype of an instance."""
        first = instance.GetPrototype()
        waiting = [first]
        while waiting:
            one = waiting[-1]
            if one.GetPath() not in self._own:
                self._own[one.GetPath()] = _read(one)
            own = self._own[one.GetPath()]
            unknown = [other for other in own.nested if other.GetPath() not in self._known]
            if unknown and one.GetPath() not in self._known:
                waiting += unknown
                continue
            waiting.pop()
            nested = [self._known[other.GetPath()] for other in own.nested]
            levels = 1 + max((other.levels for other in nested), default=0)
            alike = own.alike and levels <= MAX_LEVELS and all(other.alike for other in nested)
            self._known[one.GetPath()] = Prototype(own.prims + sum(other.prims for other in nested), levels, alike)
        return self._known[first.GetPath()]

    def inherited(self, prim: Any) -> tuple[Any, ...] | None:
        """The properties of a prim and its ancestors that its descendants inherit, with their values; None if they depend on the path."""
        chain, at = [], prim
        while not at.IsPseudoRoot() and at.GetPath() not in self._inherited:
            chain.append(at)
            at = at.GetParent()
        found = () if at.IsPseudoRoot() else self._inherited[at.GetPath()]
        for one in reversed(chain):
            own = self._properties(one)
            found = None if found is None or own is None else found + own
            if one is not prim:
                self._inherited[one.GetPath()] = found
        return found

    def _properties(self, prim: Any) -> tuple[Any, ...] | None:
        if prim.GetTypeName() == "SkelRoot":
            return None
        names = [name for name in prim.GetAuthoredPropertyNames() if name.startswith(_INHERITED)]
        found = tuple(self._value(prim, prim.GetProperty(name)) for name in names)
        return None if None in found else found

    def _value(self, prim: Any, given: Any) -> tuple[Any, ...] | None:
        """A property's name, value and metadata; None if the value depends on the path of the prim, or is a long array."""
        name = str(given.GetName())
        if name.startswith(_COLLECTION):
            return None
        own = prim.GetPath()
        if isinstance(given, Usd.Relationship):
            value: Any = tuple(str(t.MakeRelativePath(own) if t.HasPrefix(own) else t) for t in given.GetTargets())
        else:
            value = given.Get(self.time)
            if hasattr(value, "__len__") and len(value) > _SHORT:
                return None
        return (name, str(value), *(str(given.GetMetadata(key)) for key in _METADATA))


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
    found, prims, excess = Prototypes(Usd.TimeCode.Default()), 0, []
    for prim in stage.Traverse():
        size = found.of(prim).prims if prim.IsInstance() else 1
        if prims + size > MAX_PRIMS and prim.IsInstance():
            excess.append(prim.GetPath())
        else:
            prims += size
    with Sdf.ChangeBlock():
        for path in excess:
            Sdf.CreatePrimInLayer(stage.GetSessionLayer(), path).active = False
    return excess
