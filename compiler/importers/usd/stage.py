"""Opens USD stages: errors as diagnostics, variant selection, time, up-axis conversion."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from ....lang import color_spaces, file_types, foreign_formats
from ....lang.diagnostics import Diagnostics, Span, suggest
from ...io import color_encoding
from ...io.sandbox import Files
from ..stage_options import StageOptions
from .instancing import prototypes
from .layers import access, crate_check, mtlx_scenes, packages, prim_count, repair
from .layers.reports import Reports, reason
from .layers.spec_tree import SpecTree

Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # −90° about x
_TIME_ROUNDING = 0.005  # time codes: less than three digits of a second hold


@dataclass(slots=True)
class Opened:
    """An open stage. `frame` (4, 4) rotates its up axis to y; `time` is a Usd.TimeCode."""

    stage: Any
    path: Path
    name: str
    time: Any
    frame: np.ndarray
    meters_per_unit: float
    within: Files  # what the stage may read
    stand_ins: tuple[Any, ...] = ()  # layers in place of files; without them a change of variants could read the files

    def wait(self, seconds: float) -> None:
        """Advance the time by `seconds`; a stage read at its earliest time continues from its start."""
        if seconds:
            begin = self.stage.GetStartTimeCode() if self.time == Usd.TimeCode.EarliestTime() else self.time.GetValue()
            self.time = Usd.TimeCode(begin + seconds * self.stage.GetTimeCodesPerSecond())

    def override(self, unit: float | None, up: str | None) -> None:
        """Read lengths in another unit, in metres, or another axis, y or z, as up than the stage says. None: as it says."""
        with Usd.EditContext(self.stage, self.stage.GetSessionLayer()):
            if up is not None:
                UsdGeom.SetStageUpAxis(self.stage, up.upper())
                self.frame = Z_UP if up == "z" else np.eye(4)
            if unit is not None:
                UsdGeom.SetStageMetersPerUnit(self.stage, unit)
                self.meters_per_unit = unit

    def span(self, prim: Any) -> Span:
        return self.span_of(str(prim.GetPath()))

    def span_of(self, path: str) -> Span:
        return Span(f"{self.name}<{path}>")

    def outside(self, name: str, path: str) -> tuple[str, str] | None:
        """Why a picture or profile may not be read, and the fix. `path` may be in a package, as `x.usdz[y.png]`."""
        return self.within.outside(name, access.file_of(path))

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of the layers read from disk, the root layer first."""
        layers = sorted(layer.realPath for layer in self.stage.GetUsedLayers())
        return tuple(dict.fromkeys(path for path in (self.stage.GetRootLayer().realPath, *layers) if path))


@dataclass(slots=True)
class Warnings:
    """Emits warnings at prims, once for each message."""

    opened: Opened
    diagnostics: Diagnostics
    messages: set[str] = field(default_factory=set)

    def tell(self, message: str, prim: Any) -> None:
        if message not in self.messages:
            self.messages.add(message)
            self.diagnostics.warning(message, self.opened.span(prim))


def value(attribute: Any, time: Any) -> Any:
    """An attribute's value; None if absent, or if its type differs from the schema's."""
    authored = attribute.Get(time) if attribute else None
    return _fallback(attribute) if isinstance(authored, Sdf.UnregisteredValue) else authored


def _fallback(attribute: Any) -> Any:
    """The schema's default of an attribute whose value has another type, with a warning; None without one."""
    Tf.Warn(f"the value of <{attribute.GetPath()}> is not of the type {attribute.GetTypeName()}: its default is drawn")
    return attribute.GetPrim().GetPrimDefinition().GetAttributeFallbackValue(attribute.GetName())


def number(attribute: Any, time: Any, fallback: float = 0.0) -> float:
    """An attribute's value as a float; `fallback` if absent, the schema's default for a value of another type."""
    authored = value(attribute, time)
    if authored is None:
        return fallback
    try:
        return float(authored)
    except (TypeError, ValueError):
        default = _fallback(attribute)
        return float(default) if isinstance(default, int | float) else fallback


def numbers(attribute: Any, time: Any, dtype: type, width: int = 0) -> np.ndarray:
    """An attribute's value as an array (n,) or (n, width); empty if absent or of another type, with a warning."""
    authored = value(attribute, time)
    try:
        array = np.array(authored if authored is not None else (), dtype=dtype)
        return array.reshape(-1, width) if width else array.reshape(-1)
    except (TypeError, ValueError, OverflowError):
        _fallback(attribute)
        return np.zeros((0, width) if width else 0, dtype)


_LINEAR = Gf.ColorSpace(Gf.ColorSpaceNames.LinearRec709)
_SAME_SPACES = ("", "lin_rec709_scene", "lin_rec709", "lin_srgb", "raw", "data", "identity", "unknown", "auto")


def fitted_counts(counts: np.ndarray, total: int, words: tuple[str, str, str], diagnostics: Diagnostics, span: Span) -> np.ndarray:
    """Counts (n,) that add up to `total`: 0, with a warning, for negative ones and from the first on whose items are missing.

    `words` name the counts, the items and the parts that a count makes.
    """
    fitted = np.maximum(counts, 0)
    fitted = np.where(np.cumsum(fitted) <= total, fitted, 0)
    if fitted.sum() != total or (fitted != counts).any():
        message = f"{words[0]} add up to {counts.sum()} and there are {total} {words[1]}"
        diagnostics.warning(f"{message}: {np.count_nonzero(fitted)} of {len(counts)} {words[2]} are drawn", span)
    return fitted


def linear(attribute: Any, values: np.ndarray) -> np.ndarray:
    """Values (…, 3) of an attribute as linear colours with the primaries of sRGB, if it is one of colours.

    Their space is the attribute's colorSpace, else the colorSpace:name of its prim or of the nearest ancestor.
    """
    name = str(Usd.ColorSpaceAPI.ComputeColorSpaceName(attribute, None))
    if name in _SAME_SPACES or attribute.GetTypeName().scalarType.role != "Color" or values.shape[-1] != 3:
        return values
    space = Usd.ColorSpaceAPI.ComputeColorSpace(attribute, None)
    if not str(space.GetName()):
        if color_spaces.find(name) is not None:
            encoding = color_encoding.find(name, False)
            flat = encoding.linear(np.asarray(values, np.float64)).reshape(-1, 3)
            return encoding.convert(flat).astype(values.dtype).reshape(values.shape)
        if not Gf.ColorSpace.IsValid(name):
            Tf.Warn(f"the colour space `{name}` of <{attribute.GetPath()}> is not known: its colours are drawn as they are")
            return values
        space = Gf.ColorSpace(name)
    colors = Vt.FloatArray.FromNumpy(np.ascontiguousarray(values, np.float32).reshape(-1))
    space.ConvertRGBSpan(_LINEAR, colors)
    return np.array(colors, values.dtype).reshape(values.shape)


_SPEEDS = ("velocities", "accelerations", "angularVelocities")


def moves(prim: Any, time: Any) -> bool:
    """Whether velocities move the points or instances of a prim at a time away from their samples.

    They do between two samples and for less than a time code after the last; later, points stay as other viewers hold them.
    """
    if time in (Usd.TimeCode.EarliestTime(), Usd.TimeCode.Default()):
        return False
    if not any(attribute.HasAuthoredValue() for name in _SPEEDS if (attribute := prim.GetAttribute(name))):
        return False
    points_attribute = prim.GetAttribute("points") or prim.GetAttribute("positions")
    samples = points_attribute.GetBracketingTimeSamples(time.GetValue()) if points_attribute else ()
    return len(samples) == 2 and (samples[0] < samples[1] or 0.0 <= time.GetValue() - samples[0] < 1.0)


def points(prim: Any, time: Any) -> np.ndarray:
    """The points (n, 3) of a prim: those of the sample before the time, moved by their velocities, if it has these, else interpolated."""
    if moves(prim, time) and (computed := UsdGeom.PointBased(prim).ComputePointsAtTime(time, time)):
        return np.array(computed, np.float64).reshape(-1, 3)
    return numbers(prim.GetAttribute("points"), time, np.float64, 3)


def flattened(primvar: Any, time: Any) -> Any:
    """The values of a primvar with its indices resolved; None where these do not fit.

    An elementSize other than 1 is read as 1, with a warning: only skinning has several values for an element.
    """
    values, indices = value(primvar.GetAttr(), time), primvar.GetIndices(time) if primvar.IsIndexed() else None
    if primvar.GetElementSize() == 1 or not primvar.GetTypeName().isArray or values is None:
        return primvar.ComputeFlattened(time)
    size = f"the primvar `{primvar.GetPrimvarName()}` of <{primvar.GetAttr().GetPrim().GetPath()}> has an elementSize of"
    Tf.Warn(f"{size} {primvar.GetElementSize()}: it is read as 1")
    if indices is None:
        return values
    rows, elements = np.array(indices, np.int64), np.array(values)
    return elements[rows] if len(rows) and 0 <= rows.min() <= rows.max() < len(elements) else None


def primvar_mean(prim: Any, name: str, time: Any) -> tuple[np.ndarray | None, int]:
    """Mean (width,) of a prim's own or inherited primvar, and its number of values; None if absent."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name) if name else None
    flat = flattened(primvar, time) if primvar and primvar.HasValue() else None
    try:
        values = np.array(flat if flat is not None else (), dtype=np.float64)
    except (TypeError, ValueError):
        return None, 0
    if primvar is None or not values.size or not np.isfinite(values).all():
        return None, 0
    if not primvar.GetTypeName().isArray:
        return linear(primvar.GetAttr(), values.reshape(-1)), 1
    return linear(primvar.GetAttr(), values.reshape(len(values), -1)).mean(axis=0), len(values)


def open_(
    path: Path, name: str, files: Files, diagnostics: Diagnostics, span: Span | None, *, seconds: float | None = None,
    time: float | None = None, options: StageOptions | None = None,
) -> Opened | None:  # fmt: skip
    """The stage in a file, or None and an error. `seconds` count from the stage's start, `time` is a time code.

    Without either, the earliest time is read, as usdrecord does. What the stage refers to outside of `files` is left out, with a warning
    for each; with `span`, the place in a scene that uses the stage, each is an error.
    """
    options = options or StageOptions()
    reports = Reports(path)
    place = span or Span(name)
    stand_ins: list[Any] = []
    may = access.Access(files, path, name, diagnostics, span)
    try:
        stage = _open(path, options, may, diagnostics, place, stand_ins)
    except Tf.ErrorException as failure:
        why = packages.fault_of(path) or reason(failure, path)
        location = re.match(rf"{re.escape(path.name)}:(\d+):(\d+): (.*)", why, re.DOTALL)
        if location and span is None:
            line, column = int(location[1]), int(location[2])
            place, why = Span(name, line, column, line, column + 1), location[3]
        other = path.suffix.lower() not in file_types.USD
        diagnostics.error(f"cannot read the stage `{path.name}`: {why}", place, foreign_formats.placed_by(path.name) if other else "")
        return None
    finally:
        reports.tell(diagnostics, place)
    if stage is None:
        if not diagnostics.failed:
            why = packages.fault_of(path) or "usd-core does not say why"
            diagnostics.error(f"cannot read the stage `{path.name}`: {why}", place, "copy or export it again")
        return None
    if path.suffix.lower() == ".usdz" and packages.fault_of(path) == packages.CUT_OFF:
        diagnostics.warning(f"the package may lack files: {packages.CUT_OFF}", place, "copy or export it again")
    for where, choice in options.variants.items():
        _choose(stage, where, choice, diagnostics, place)
    if why := may.leave_out_used(stage):
        other = path.suffix.lower() not in file_types.USD
        diagnostics.error(f"cannot read the stage `{path.name}`: {why}", place, foreign_formats.placed_by(path.name) if other else "")
    if why or may.failed:
        return None
    if excess := prototypes.without_excess(stage):
        message = f"the stage has more than {prim_count.MAX_PRIMS:,} prims, with those of instances: {len(excess)} instances are left out"
        diagnostics.warning(message, Span(f"{name}<{excess[0]}>"))
    code = Usd.TimeCode.EarliestTime()
    if seconds is not None:
        code = Usd.TimeCode(_near_whole(stage.GetStartTimeCode() + seconds * stage.GetTimeCodesPerSecond()))
    if time is not None:
        code = Usd.TimeCode(time)
    frame = Z_UP if _up_axis(stage, diagnostics, place) == UsdGeom.Tokens.z else np.eye(4)
    meters = UsdGeom.GetStageMetersPerUnit(stage)
    return Opened(stage, path, name, code, frame, meters if meters > 0 else 1.0, files, stand_ins=tuple(stand_ins))


def _up_axis(stage: Any, diagnostics: Diagnostics, span: Span) -> Any:
    """The up axis of a stage; the default in place of a string, which usd-core refuses."""
    try:
        return UsdGeom.GetStageUpAxis(stage)
    except Tf.ErrorException:
        stage.GetRootLayer().pseudoRoot.ClearInfo("upAxis")
        diagnostics.warning("the value of `upAxis` has another type: its default is used", span)
        return UsdGeom.GetStageUpAxis(stage)


def _open(path: Path, options: StageOptions, may: access.Access, diagnostics: Diagnostics, span: Span, stand_ins: list[Any]) -> Any:
    """The stage of a layer, with its session layer and population mask. None after an error. See repair.layers for `stand_ins`."""
    bad = [p for p in options.mask if not (Sdf.Path.IsValidPathString(p) and Sdf.Path(p).IsAbsoluteRootOrPrimPath())]
    if bad:
        diagnostics.error(f"`{bad[0]}` is not a path of a prim", span, "write --mask /World/Chair")
        return None
    if why := crate_check.fault(path):
        diagnostics.error(f"cannot read the stage `{path.name}`: {why}", span)
        return None
    root = mtlx_scenes.layer(path, diagnostics) if path.suffix.lower() == ".mtlx" else repair.opened(path, diagnostics, stand_ins)
    if root is None or not root.pseudoRoot:
        return None
    repair.clear_metadata(root, diagnostics)
    session = Sdf.Layer.FindOrOpen(str(options.session_layer)) if options.session_layer else Sdf.Layer.CreateAnonymous(".usda")
    if session is None:
        diagnostics.error(f"cannot read the session layer `{options.session_layer}`", span)
        return None
    may.begin(root, session)
    with may.search_path():
        below, trees = repair.layers(root, session, diagnostics, stand_ins, may)  # which are kept until the stage has them
        if not options.mask and not _has_bounds(root, trees, diagnostics, span):
            return None
    if not options.mask:
        stage = Usd.Stage.Open(root, session)
    else:
        stage = Usd.Stage.OpenMasked(root, session, Usd.StagePopulationMask(list(options.mask)))
        for p in options.mask:
            if not stage.GetPrimAtPath(p):
                diagnostics.warning(f"the stage has no prim `{p}`, which --mask names", span)
        stage.ExpandPopulationMask()  # materials, prototypes and other targets
    below.clear()
    return stage


def _has_bounds(root: Any, trees: dict[str, SpecTree], diagnostics: Diagnostics, span: Span) -> bool:
    """Whether the stage of a layer has no more prims than are read. If not, that is an error."""
    try:
        extent = prim_count.estimate(root, trees)
    except prim_count.TooLongChain:
        message = f"references of the stage lead from one prim to the next more than {prim_count.MAX_CHAIN} times"
        diagnostics.error(message, span, "flatten the stage, as by `usdcat --flatten`, or read a part by --mask")
        return False
    if extent.prims > prim_count.MAX_PRIMS:
        message = f"the stage has about {extent.prims:,} prims, more than {prim_count.MAX_PRIMS:,}"
        diagnostics.error(message, span, "make the prims that are referenced often instanceable, or read a part by --mask")
    elif extent.levels > prim_count.MAX_STAGE_LEVELS:
        message = f"the prims of the stage nest in more than {prim_count.MAX_STAGE_LEVELS:,} levels"
        diagnostics.error(message, span, "read a part by --mask")
    else:
        return True
    return False


def _near_whole(code: float) -> float:
    """A time code without the rounding of the seconds that it was computed from, which would fall beside a held sample."""
    return float(round(code)) if abs(code - round(code)) < _TIME_ROUNDING else code


def time_codes(path: Path) -> tuple[float, float] | None:
    """The start and end time codes of a stage; None without authored ones."""
    root = _root_layer(path)
    return (root.startTimeCode, root.endTimeCode) if root and root.HasStartTimeCode() and root.HasEndTimeCode() else None


def time_codes_per_second(path: Path) -> float:
    """The rate of a stage's time codes, by which frames are numbered."""
    root = _root_layer(path)
    return root.timeCodesPerSecond if root else 24.0


def _root_layer(path: Path) -> Any:
    """The root layer of a stage, repaired, which alone holds its metadata; None for one that cannot be read. A load of it tells why."""
    reports, unread = Reports(path), Diagnostics()
    stand_ins: list[Any] = []
    try:
        root = None if crate_check.fault(path) else repair.opened(path, unread, stand_ins)
        if root is None or not root.pseudoRoot:
            return None
        repair.clear_metadata(root, unread)
        return root
    except Tf.ErrorException:
        return None
    finally:
        reports.tell(unread, Span(path.name))


def assets_of(path: Path) -> list[Path]:
    """The files that a stage and its layers refer to, without layers: pictures, profiles and packages of them."""
    _, assets, _ = UsdUtils.ComputeAllDependencies(str(path))
    return [Path(access.file_of(str(asset))) for asset in assets]


def summary(path: Path, options: StageOptions, files: Files) -> list[str]:
    """Lines about a stage: its prims by type, up axis and unit, time codes, and variant sets with their choice."""
    diagnostics = Diagnostics()
    opened = open_(path, str(path), files, diagnostics, None, options=options)
    if opened is None:
        return []
    stage = opened.stage
    kinds = Counter(str(prim.GetTypeName()) or "untyped" for prim in stage.Traverse(Usd.TraverseInstanceProxies()))
    listed = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    lines = [f"prims: {kinds.total()}{f' ({listed})' if listed else ''}"]
    lines.append(f"axes: {UsdGeom.GetStageUpAxis(stage)} up, {UsdGeom.GetStageMetersPerUnit(stage):g} m a unit")
    if stage.HasAuthoredTimeCodeRange():
        begin, end, codes = stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()
        lines.append(f"time codes: {begin:g} to {end:g}, {codes:g} a second")
    for prim in stage.Traverse():
        for name in prim.GetVariantSets().GetNames():
            chosen = prim.GetVariantSets().GetVariantSet(name)
            names = ", ".join(chosen.GetVariantNames())
            lines.append(f"variants: {prim.GetPath()}:{name}={chosen.GetVariantSelection()} ({names})")
    return lines


def _choose(stage: Any, where: str, choice: str, diagnostics: Diagnostics, span: Span) -> None:
    """Select a variant in the session layer; no file changes."""
    path, _, set_name = where.rpartition(":")
    if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsAbsoluteRootOrPrimPath():
        diagnostics.error(f"`{where}` names no variant set", span, "write --variant /prim:set=name")
        return
    prim = stage.GetPrimAtPath(path)
    if not prim:
        paths = [str(p.GetPath()) for p in stage.TraverseAll() if p.HasVariantSets()]
        diagnostics.error(f"the stage has no prim `{path}`", span, suggest(path, paths) or _listed("prims with variants", paths))
        return
    sets = prim.GetVariantSets()
    if set_name not in sets.GetNames():
        names = list(sets.GetNames())
        hint = suggest(set_name, names) or _listed("it has", names)
        diagnostics.error(f"`{path}` has no variant set `{set_name}`", span, hint)
        return
    names = list(sets.GetVariantSet(set_name).GetVariantNames())
    if choice not in names:
        hint = suggest(choice, names) or _listed("it has", names)
        diagnostics.error(f"the variant set `{where}` has no variant `{choice}`", span, hint)
        return
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        sets.GetVariantSet(set_name).SetVariantSelection(choice)


def _listed(what: str, names: list[str]) -> str:
    return f"{what}: {', '.join(names[:12])}" if names else ""
