"""Traverses a USD stage: collects geometry with materials and transforms, lights and cameras."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pxr import Tf, UsdGeom, UsdShade

from ....lang.diagnostics import Span
from ... import ir
from ...scene import transforms
from ...scene.builder import NONE, SceneBuilder
from . import curves, displacement, draw_modes, levels_of_detail, lights, links, mesh_inputs, patches, shape_meshes, skeletons
from . import geometry as geometry_module
from .instancing import instancers
from .instancing.pieces import Piece, merged
from .instancing.prototypes import Prototypes
from .layers.reports import left_out
from .materials import DEFAULT_COLOR, DISPLAY_COLOR, DISPLAY_OPACITY, Materials
from .shaders.network import Fit, Network, Picture
from .stage import Opened, numbers, primvar_mean

MAX_INSTANCES = 4_000_000
MAX_BALLS = 5_000  # points drawn as exact spheres
MESHES = ("Mesh", "TetMesh", "NurbsPatch")
MAX_LIGHTS = 10_000  # of point instancers
_BATCH = 10_000  # pieces that are placed at once
LIGHT = -2  # in place of a geometry: a light of a prototype
MAX_NESTING = 32  # levels of nested point instancers
CAGES = "subdivision surfaces, as meshes are that do not say otherwise, are drawn as their cages with smooth normals"
REFINE = "--complexity medium, high or veryhigh refines them"


@dataclass(frozen=True, slots=True, eq=False)
class _Inherited:
    """Inherited state of a prim during traversal."""

    matrix: np.ndarray
    base: np.ndarray  # the frame that !resetXformStack! returns to
    purpose: str
    instancers: int = 0
    draw_mode: str = "default"
    detail: levels_of_detail.Override = None


@dataclass(slots=True)
class Walk:
    """One traversal of a stage. `pieces` holds geometry by purpose; lights go to the builder directly.

    `purposes` are drawn beside default; None: render, or proxy where there is nothing else.
    """

    opened: Opened
    builder: SceneBuilder
    unit: float = 1.0
    material: int = NONE  # for prims without a material
    prefix: str = ""  # prefix of instance names
    purposes: tuple[str, ...] | None = None
    complexity: int = 0  # refinements of subdivision surfaces
    cull: bool = False  # whether meshes that are not doubleSided are seen from their front alone
    pieces: dict[str, list[Piece]] = field(default_factory=lambda: {"default": [], "render": [], "proxy": [], "guide": []})
    cameras: list[tuple[Any, np.ndarray]] = field(default_factory=list)
    mesh_lights: int = 0  # prims with MeshLightAPI that emit light
    materials: Materials = field(init=False)
    _prototypes: Prototypes = field(init=False)
    _shared: dict[Any, tuple[str, dict[str, list[Piece]]]] = field(default_factory=dict)  # see _gathered
    _geometries: dict[Any, int] = field(default_factory=dict)
    _faces: dict[Any, geometry_module.Faces | None] = field(default_factory=dict)
    _stand_ins: dict[tuple[str, str], list[tuple[int, int]]] = field(default_factory=dict)
    _count: int = 0  # instances of point instancers
    _reported_cages: bool = False
    _audited: set[str] = field(default_factory=set)
    _skins: dict[str, skeletons.Skin] = field(default_factory=dict)  # of the SkelRoots so far, by path
    _skin_frame: np.ndarray = field(default_factory=lambda: np.eye(4))  # of the last SkelRoot

    def __post_init__(self) -> None:
        self.materials = Materials(self.opened, self.builder)
        self._prototypes = Prototypes(self.opened.time)

    def run(self, root: Any, matrix: np.ndarray, base: np.ndarray) -> None:
        """Traverse `root` and its descendants. `matrix` (4, 4) is its parent's transform, `base` the world's."""
        purpose, draw_mode, detail, self.materials.base = "default", "default", None, base
        if not root.IsPseudoRoot():
            imageable = UsdGeom.Imageable(root)
            if imageable and imageable.ComputeVisibility(self.opened.time) == UsdGeom.Tokens.invisible:
                self.builder.diagnostics.warning("this prim is invisible: nothing of it is drawn", self.opened.span(root))
                return
            purpose = str(imageable.ComputePurpose()) if imageable else purpose
            draw_mode = str(UsdGeom.ModelAPI(root).ComputeModelDrawMode())
            detail = levels_of_detail.inherited(root, self.opened.time)
        self._below(root, _Inherited(matrix, base, purpose, 0, draw_mode, detail), self.pieces)

    def drawn(self) -> list[Piece]:
        """Geometry to draw, by purpose. Other geometry is reported in a note."""
        shown = ("default", *(p for p in self.purposes or ("render",) if p != "default"))
        geometry = [piece for purpose in shown for piece in self.pieces.get(purpose, ())]
        if not geometry and self.purposes is None:
            shown = ("proxy",)
            geometry = self.pieces["proxy"]
        for purpose, pieces in self.pieces.items():
            if pieces and purpose not in shown:
                are = "prim of the purpose {} is" if len(pieces) == 1 else "prims of the purpose {} are"
                message = f"{len(pieces)} {are.format(purpose)} not drawn"
                hint = f"--purposes {','.join(shown)},{purpose} draws them too"
                self.builder.diagnostics.note(message, self.opened.span_of(pieces[0].path), hint)
        return geometry

    def place(self) -> None:
        """Make instances of all drawn geometry, and free its pieces: the matrices of many copies take much memory."""
        waiting, single = self.drawn()[::-1], []
        self.pieces, self._shared = {}, {}
        while waiting:
            piece = waiting.pop()
            if piece.ids is None:
                single.append(piece)
            if single and (piece.ids is not None or len(single) == _BATCH or not waiting):
                self._place_single(single)
                single = []
            if piece.ids is not None:
                self._place_copies(piece, self.opened.span_of(piece.path))

    def _place_single(self, pieces: list[Piece]) -> None:
        spans = [self.opened.span_of(piece.path) for piece in pieces]
        rows = self.builder.transforms(np.stack([piece.matrix[:3] for piece in pieces]), spans)
        materials = [int(piece.material) if piece.material != NONE else self.material for piece in pieces]
        names = [self.prefix + piece.name for piece in pieces]
        self.builder.instances([piece.geometry for piece in pieces], rows, materials, names, spans)

    def _place_copies(self, piece: Piece, span: Span) -> None:
        assert piece.ids is not None
        n = len(piece.ids)
        if piece.geometry == LIGHT:
            self._place_lights(piece)
            return
        materials = np.broadcast_to(piece.material, n)
        rows = np.where(materials == NONE, self.material, materials)
        self.builder.copies(piece.geometry, piece.matrix, rows, self.prefix + piece.name, piece.ids, span)

    def _place_lights(self, piece: Piece) -> None:
        """Add the copies of a light that point instancers place."""
        room = max(MAX_LIGHTS - self.builder.count("lights"), 0)
        if len(piece.matrix) > room:
            self.materials.tell(f"the stage has more than {MAX_LIGHTS:,} lights: the rest is left out", piece.prim)
        for matrix in piece.matrix[:room]:
            if transforms.inverse(matrix) is not None:
                lights.light(piece.prim, matrix, self.unit, self.opened, self.builder, self.materials, self.prefix)

    def _below(self, root: Any, state: _Inherited, into: dict[str, list[Piece]]) -> None:
        """Traverse a prim and its descendants; recursive only for point instancers and prototypes."""
        waiting = [(root, state)]
        while waiting:
            prim, above = waiting.pop()
            try:
                now = self._state(prim, above)
                kind = str(prim.GetTypeName())
                if now is not None and draw_modes.is_replaced(prim, now.draw_mode):
                    self._audit_once(prim, kind)
                    into.setdefault(now.purpose, []).extend(self._stand_in(prim, now))
                    continue
                if now is not None and kind == "PointInstancer":
                    self._audit_once(prim, kind)
                    self._instancer(UsdGeom.PointInstancer(prim), now, into)
                elif now is not None:
                    self._prim(prim, kind, now, into)
            except (Tf.ErrorException, TypeError, ValueError) as failure:  # values of other types and names that are not text
                self.builder.diagnostics.warning(left_out(failure, self.opened.path), self.opened.span(prim))
                continue
            if now is None or kind == "PointInstancer" or (prim.IsInstance() and self._shares(prim, now, into)):
                continue
            waiting += [(child, now) for child in reversed(levels_of_detail.children(prim, now.detail, self.opened.time))]

    def _state(self, prim: Any, above: _Inherited) -> _Inherited | None:
        """The traversal state of a prim; None if invisible."""
        if prim.IsPseudoRoot():
            return above
        draw_mode = draw_modes.resolved_mode(prim, above.draw_mode)
        detail = levels_of_detail.override(prim, above.detail, self.opened.time)
        imageable = UsdGeom.Imageable(prim)
        if not imageable:
            return replace(above, draw_mode=draw_mode, detail=detail)
        if imageable.GetVisibilityAttr().Get(self.opened.time) == UsdGeom.Tokens.invisible:
            return None
        authored = imageable.GetPurposeAttr()
        purpose = str(authored.Get()) if authored.HasAuthoredValue() else above.purpose
        if purpose in ("render", "proxy") and imageable.ComputeEffectiveVisibility(purpose, self.opened.time) == UsdGeom.Tokens.invisible:
            return None
        matrix, base = above.matrix, above.base
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            local = np.array(xformable.GetLocalTransformation(self.opened.time)).T
            if local[3, 3] not in (0.0, 1.0):
                local = local / local[3, 3]  # homogeneous coordinates
            matrix = (base if xformable.GetResetXformStack() else matrix) @ local
        return _Inherited(matrix, base, purpose, above.instancers, draw_mode, detail)

    def _prim(self, prim: Any, kind: str, state: _Inherited, into: dict[str, list[Piece]]) -> None:
        if state.purpose == "guide" and "guide" not in (self.purposes or ()):
            return
        self._audit_once(prim, kind)
        if kind in MESHES:
            skin = self._skins.get(str(prim.GetPath()))
            into.setdefault(state.purpose, []).extend(self._mesh(prim, state.matrix if skin is None else self._skin_frame @ skin.frame))
        elif kind in geometry_module.SHAPES:
            into.setdefault(state.purpose, []).extend(self._shape(prim, state.matrix))
        elif kind == "SkelRoot":
            self._skins |= skeletons.skins(prim, self.opened.time, self.materials.warnings)
            self._skin_frame = state.matrix
        elif kind in curves.KINDS:
            into.setdefault(state.purpose, []).extend(self._strands(prim, kind, state.matrix))
        elif kind == "Camera":
            self.cameras.append((prim, state.matrix))
        elif kind in lights.KINDS:
            self._light(prim, state, into)

    def _audit_once(self, prim: Any, kind: str) -> None:
        """Report undrawn parts of a prim, once for all instances of a prototype. Materials are reported where they are bound."""
        source = self._source(prim)
        if source in self._audited:
            return
        self._audited.add(source)
        self.materials.audit.variants(prim)
        links.remove_bindings(prim, self.materials.warnings)
        if kind not in ("Material", "Shader", "NodeGraph"):
            self.materials.audit.prim(prim, kind)

    def _light(self, prim: Any, state: _Inherited, into: dict[str, list[Piece]]) -> None:
        if state.instancers:
            into.setdefault(state.purpose, []).append(Piece(LIGHT, NONE, state.matrix, prim, str(prim.GetPath())))
        elif transforms.inverse(state.matrix) is not None:
            lights.light(prim, state.matrix, self.unit, self.opened, self.builder, self.materials, self.prefix)

    # --- geometry with its material ---

    def _source(self, prim: Any) -> str:
        """Key of a prim's geometry: the prototype's path for native instances."""
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() and str(prim.GetPath()) not in self._skins else prim
        return str(source.GetPath())

    def _shape(self, prim: Any, matrix: np.ndarray) -> list[Piece]:
        key = self._source(prim)
        if key not in self._faces:
            self._faces[key] = geometry_module.shape(prim, self.opened.time, self.builder, self.opened.span(prim))  # type: ignore[assignment]
        shape: Any = self._faces[key]
        if shape is None or shape.geometry == NONE:
            return []
        network = self.materials.bound(prim)
        if shape_meshes.is_wanted(prim, mesh_inputs.reads(network, prim), self.builder.diagnostics, self.opened.span(prim)):
            return self._part(prim, prim, None, "", matrix)
        row, has_color = self._material(network, prim, Fit(), matrix, shape.matrix), network is not None or self._has_color(prim)
        return [Piece(shape.geometry, row, matrix @ shape.matrix, prim, str(prim.GetPath()), has_color)]

    def _stand_in(self, prim: Any, state: _Inherited) -> list[Piece]:
        """What is drawn for a model by its draw mode, made once for all instances."""
        key = (self._source(prim), state.draw_mode)
        if key not in self._stand_ins:
            self._stand_ins[key] = draw_modes.stand_in(prim, state.draw_mode, self.materials)
        every = self.materials.replaced.every
        return [
            Piece(row, bound if every == NONE else every, state.matrix, prim, str(prim.GetPath())) for row, bound in self._stand_ins[key]
        ]

    def _mesh(self, prim: Any, matrix: np.ndarray) -> list[Piece]:
        """A mesh's pieces: one for each subset with a material, and one for the remaining faces."""
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        if not subsets:
            return self._part(prim, prim, None, "", matrix)
        pieces, taken = [], []
        for subset in subsets:
            faces = numbers(subset.GetIndicesAttr(), self.opened.time, np.int64)
            taken.append(faces)
            name = str(subset.GetPrim().GetName())
            pieces += self._part(prim, subset.GetPrim(), faces, name, matrix)
        count = len(numbers(prim.GetAttribute("faceVertexCounts"), self.opened.time, np.int64))
        outside = sum(int(((faces < 0) | (faces >= count)).sum()) for faces in taken)
        if outside:
            self.materials.tell(f"{outside} indices of the subsets of this mesh are not faces of it: they are left out", prim)
        rest = np.setdiff1d(np.arange(count), np.concatenate(taken))
        return pieces + (self._part(prim, prim, rest, "rest", matrix) if len(rest) else [])

    def _part(self, prim: Any, owner: Any, faces: np.ndarray | None, name: str, matrix: np.ndarray) -> list[Piece]:
        network = self.materials.bound(owner)
        reads = mesh_inputs.reads(network, prim)
        pieces = []
        for part in mesh_inputs.parts(network, prim, reads, faces, self.materials):
            geometry = self._geometry(prim, reads, part, name, network, matrix)
            if geometry == NONE:
                continue
            has_color = network is not None or reads.color is not None or self._has_color(prim)
            pieces.append(Piece(geometry, self._material(network, prim, part.fit, matrix), matrix, prim, str(owner.GetPath()), has_color))
        return pieces

    def _geometry(
        self, prim: Any, reads: geometry_module.Reads, part: mesh_inputs.Part, name: str, network: Network | None, matrix: np.ndarray
    ) -> int:  # fmt: skip
        """The row of a part of a mesh, made once for all instances, if it is displaced for all of one scale."""
        moved = network if network is not None and network.displaced else None
        metric = displacement.metric(matrix / self.unit) if moved else ()
        key = (self._source(prim), name, part.name, reads, moved.path if moved else "", metric)
        if key not in self._geometries:
            read = (self._source(prim), reads)
            span = self.opened.span(prim)
            if read not in self._faces:
                said, skin = self.builder.diagnostics, self._skins.get(str(prim.GetPath()))
                if str(prim.GetTypeName()) == "NurbsPatch":
                    self._faces[read] = patches.faces(prim, self.opened.time, reads, said, span)
                elif str(prim.GetTypeName()) in geometry_module.SHAPES:
                    self._faces[read] = shape_meshes.faces(prim, self.opened.time, reads, said, span)
                else:
                    self._faces[read] = geometry_module.mesh(prim, self.opened.time, reads, said, span, self.complexity, skin)
            faces = self._faces[read]
            if faces is not None and moved is not None:
                self._tell_coarse(moved, prim)
                faces = displacement.displaced(faces, self.materials.heights(moved, prim), metric)
            if faces is not None and faces.subdivided and not self._reported_cages:
                self._reported_cages = True
                self.builder.diagnostics.note(CAGES, span, REFINE)
            part_mesh = None if faces is None else faces.part(part.faces)
            self._geometries[key] = geometry_module.row(part_mesh, self.builder, span, str(prim.GetName()))
            if self.cull and not UsdGeom.Gprim(prim).GetDoubleSidedAttr().Get(self.opened.time):
                self.builder.single_sided.add(self._geometries[key])
        return self._geometries[key]

    def _strands(self, prim: Any, kind: str, matrix: np.ndarray) -> list[Piece]:
        """Curves as one mesh; points as spheres: exact ones if they are few and of one colour, else one mesh."""
        network = self.materials.bound(prim)
        reads = mesh_inputs.reads(network, prim)
        uv_name, color_name = None if reads.ramp else reads.uv, reads.color
        span, said, time = self.opened.span(prim), self.builder.diagnostics, self.opened.time
        material = self._material(network, prim, Fit(color_name is not None), matrix)
        has_color = network is not None or color_name is not None or self._has_color(prim)
        if kind == "Points" and color_name is None:
            centers, radii, _ = curves.balls(prim, time, said, span)
            if len(centers) <= MAX_BALLS:
                places = np.tile(np.eye(4), (len(centers), 1, 1))
                places[:, :3, 3] = centers
                name = str(prim.GetPath())
                return [
                    Piece(self.builder.geometry(ir.GeometryKind.SPHERE, (r,), span, name), material, m, prim, f"{name}[{k}]", has_color)
                    for k, (r, m) in enumerate(zip(radii, matrix @ places, strict=True))
                ]
        key = (self._source(prim), "", uv_name, color_name)
        if key not in self._geometries:
            polygons = curves.mesh(prim, time, uv_name, color_name, said, span)
            self._geometries[key] = geometry_module.row(polygons, self.builder, span, str(prim.GetName()))
        if self._geometries[key] == NONE:
            return []
        return [Piece(self._geometries[key], material, matrix, prim, str(prim.GetPath()), has_color)]

    def _has_color(self, prim: Any) -> bool:
        return primvar_mean(prim, DISPLAY_COLOR, self.opened.time)[0] is not None

    def _material(self, network: Network | None, prim: Any, fit: Fit, matrix: np.ndarray, shape_matrix: np.ndarray | None = None) -> int:
        radiance = lights.mesh_radiance(prim, matrix, self.unit, self.opened, self.materials)
        if network is not None and network.displaced and str(prim.GetTypeName()) not in MESHES:
            self.materials.tell("displacement is drawn on meshes alone", prim)
        if network is not None and radiance is None:
            return self.materials.row(network, prim, fit, matrix if shape_matrix is None else matrix @ shape_matrix)
        color, colors = (np.ones(3), 1) if fit.colored else primvar_mean(prim, DISPLAY_COLOR, self.opened.time)
        opacity, opacities = primvar_mean(prim, DISPLAY_OPACITY, self.opened.time)
        if colors > 1:
            self.materials.tell("the displayColor varies over this shape: its mean is drawn", prim)
        if opacities > 1 and fit.number is None:
            self.materials.tell("the displayOpacity varies over this prim: its mean is drawn", prim)
        if color is None and self.material != NONE:
            return self.material
        r, g, b = DEFAULT_COLOR if color is None or len(color) != 3 else map(float, color)
        r, g, b = self.materials.without_negatives((r, g, b), prim, "this prim's displayColor")
        if radiance is not None:
            self.mesh_lights += any(radiance)
            return self.materials.matt_light((r, g, b), radiance, str(prim.GetPath()))
        alpha = 1.0 if opacity is None else float(np.clip(opacity[0], 0.0, 1.0))
        return self.materials.plain((r, g, b), alpha, DISPLAY_COLOR, fit.number is not None)

    def _tell_coarse(self, network: Network, prim: Any) -> None:
        if self.complexity == 0 and isinstance(network.inputs["displacement"], Picture):
            message = "displacement moves the points of the meshes as they are"
            self.builder.diagnostics.note(message, self.opened.span(prim), REFINE)

    # --- instances ---

    def _gathered(self, owner: str, prims: Sequence[Any], which: tuple[Any, ...], state: _Inherited) -> tuple[str, dict[str, list[Piece]]]:
        """The pieces of a prototype in its own frame, by purpose, collected once; and the path of the first prim that asked for them."""
        key = (*which, state.purpose, state.draw_mode, state.detail, state.instancers)
        if key not in self._shared:
            pieces: dict[str, list[Piece]] = {}
            inside = replace(state, matrix=np.eye(4), base=np.eye(4))
            base, self.materials.base = self.materials.base, None
            for prim in prims:
                self._below(prim, inside, pieces)
            self.materials.base = base
            self._shared[key] = (owner, pieces)
        return self._shared[key]

    def _shares(self, prim: Any, state: _Inherited, into: dict[str, list[Piece]]) -> bool:
        """Adds the pieces of a native instance, collected once for all instances that are alike; False where an instance has its own."""
        if not self._prototypes.prototype_of(prim).alike or prim.HasAPI("LODRootAPI"):
            return False
        inherited = self._prototypes.inherited(prim)
        if inherited is None:
            return False
        path = str(prim.GetPath())
        children = levels_of_detail.children(prim, state.detail, self.opened.time)
        first, gathered = self._gathered(path, children, (prim.GetPrototype().GetPath(), inherited), state)
        for purpose, pieces in gathered.items():
            into.setdefault(purpose, []).extend(piece.moved(state.matrix, first, path) for piece in pieces)
        return True

    def _instancer(self, instancer: Any, state: _Inherited, into: dict[str, list[Piece]]) -> None:
        """Collects each prototype once, in its own frame, and places it at each instance."""
        prim, time = instancer.GetPrim(), self.opened.time
        if state.instancers >= MAX_NESTING:
            self.materials.tell("point instancers contain each other", prim)
            return
        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        instances = instancers.read(instancer, time, len(targets), lambda message: self.materials.tell(message, prim))
        for which, target in enumerate(targets):
            chosen = np.flatnonzero(instances.prototypes == which)
            prototype = prim.GetStage().GetPrimAtPath(target)
            if len(chosen) and not prototype:
                message = f"the prototype {target} of this instancer does not exist: its {len(chosen)} instances are left out"
                self.materials.tell(message, prim)
            if not len(chosen) or not prototype:
                continue
            _, gathered = self._gathered("", [prototype], (target,), replace(state, instancers=state.instancers + 1))
            self._spread(gathered, state.matrix @ instances.places(chosen), instances.ids[chosen], prim, into)

    def _spread(
        self, gathered: dict[str, list[Piece]], places: np.ndarray, ids: np.ndarray, prim: Any, into: dict[str, list[Piece]]
    ) -> None:
        tints = instancers.colors(prim, self.opened.time, self.materials)
        for purpose, group in gathered.items():
            pieces = merged(group)
            self._count += sum(piece.copies for piece in pieces) * len(places)
            if self._count > MAX_INSTANCES:
                message = f"the stage has more than {MAX_INSTANCES:,} instances: the rest is left out"
                self.materials.tell(message, prim)
                return
            to = into.setdefault(purpose, [])
            for piece in pieces:
                untinted, n = piece.colored or not tints, piece.copies
                matrix = (places[:, None] @ piece.matrix.reshape(1, n, 4, 4)).reshape(-1, 4, 4)
                material = np.tile(np.broadcast_to(piece.material, n), len(places)) if untinted else np.repeat(np.array(tints)[ids], n)
                colored = piece.colored or bool(tints)
                to.append(Piece(piece.geometry, material, matrix, piece.prim, str(prim.GetPath()), colored, np.repeat(ids, n), piece.owner))
