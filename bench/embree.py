"""Calls Embree ray by ray from a compiled loop, with the library of embreex.

This is Embree's default single-ray speed. The `run` of embreex fills further outputs and has no instances.
Structures are those of Embree 4's rtcore_ray.h (RTCRayHit, 16-byte aligned).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from . import limits
from .harness import Missing, need
from .meshes import F32, Mesh, Rays

TRIANGLES, INSTANCE = 0, 121  # RTC_GEOMETRY_TYPE_…
INDICES, VERTICES = 0, 1  # RTC_BUFFER_TYPE_…
UINT3, FLOAT3, FLOAT3X4_ROWS = 0x5003, 0x9003, 0x9134  # RTC_FORMAT_…
SINGLE_THREAD = "threads=1,set_affinity=0"
INVALID = 0xFFFFFFFF
_RAY_WORDS = 32  # 4 bytes each: 12 of the ray, up to 12 of the hit, and padding
INSTALL = "pip install embreex"

Pointer = ctypes.c_void_p
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "rtcNewDevice": (Pointer, [ctypes.c_char_p]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [Pointer, ctypes.c_int]),
    "rtcSetDeviceMemoryMonitorFunction": (None, [Pointer, Pointer, Pointer]),
    "rtcNewScene": (Pointer, [Pointer]),
    "rtcCommitScene": (None, [Pointer]),
    "rtcReleaseScene": (None, [Pointer]),
    "rtcNewGeometry": (Pointer, [Pointer, ctypes.c_int]),
    "rtcSetNewGeometryBuffer": (Pointer, [Pointer, ctypes.c_int, ctypes.c_uint, ctypes.c_int, ctypes.c_size_t, ctypes.c_size_t]),
    "rtcCommitGeometry": (None, [Pointer]),
    "rtcAttachGeometry": (ctypes.c_uint, [Pointer, Pointer]),
    "rtcReleaseGeometry": (None, [Pointer]),
    "rtcSetGeometryInstancedScene": (None, [Pointer, Pointer]),
    "rtcSetGeometryTransform": (None, [Pointer, ctypes.c_uint, ctypes.c_int, Pointer]),
    "rtcIntersect1": (None, [Pointer, Pointer, Pointer]),
    "rtcOccluded1": (None, [Pointer, Pointer, Pointer]),
}
_Monitor = ctypes.CFUNCTYPE(ctypes.c_bool, Pointer, ctypes.c_ssize_t, ctypes.c_bool)


def library() -> ctypes.CDLL:
    """The Embree 4 library of embreex. Raises Missing if it is not found."""
    need("embreex.rtcore_scene", INSTALL)  # also loads the library's dependencies
    files = [Path(str(f.locate())) for f in metadata.files("embreex") or () if "embree4" in f.name]
    if not files:
        raise Missing(f"embreex brings no Embree 4 library here ({INSTALL})")
    embree = ctypes.CDLL(str(files[0]))
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(embree, name)
        function.restype, function.argtypes = result, arguments
    return embree


class Device:
    """An Embree device on one thread that counts its allocated bytes."""

    def __init__(self) -> None:
        self.lib = library()
        isa = f",max_isa={limits.EMBREE[limits.simd()]}" if limits.simd() else ""
        self.handle = self.lib.rtcNewDevice((SINGLE_THREAD + isa).encode())
        self.bytes = 0
        self._monitor = _Monitor(self._count)
        self.lib.rtcSetDeviceMemoryMonitorFunction(self.handle, self._monitor, None)
        self.closest, self.occluded = _loops(self.lib.rtcIntersect1, self.lib.rtcOccluded1)
        scene = Scene(self, Mesh(np.zeros((3, 3), np.float32), np.zeros((3, 3), np.float32), np.zeros((1, 3), np.int32)))
        scene.commit()
        nothing = Rays("none", np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
        for work in (scene.intersect(nothing), scene.occluded(nothing)):
            work()  # compiles the loops outside of the measurement

    def _count(self, _: Any, size: int, __: bool) -> bool:
        self.bytes += size
        return True

    def version(self) -> str:
        return ".".join(str(self.lib.rtcGetDeviceProperty(self.handle, k)) for k in (1, 2, 3))


class Scene:
    """A scene of one mesh or of its instances. The mesh is copied at construction; `commit` builds the BVH."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        lib = self.lib = device.lib
        self.device = device
        self.handle = self._bottom = lib.rtcNewScene(device.handle)
        geometry = lib.rtcNewGeometry(device.handle, TRIANGLES)
        for kind, layout, values in ((VERTICES, FLOAT3, mesh.positions), (INDICES, UINT3, mesh.triangles)):
            ctypes.memmove(lib.rtcSetNewGeometryBuffer(geometry, kind, 0, layout, 12, len(values)), values.ctypes.data, values.nbytes)
        lib.rtcCommitGeometry(geometry)
        lib.rtcAttachGeometry(self.handle, geometry)
        lib.rtcReleaseGeometry(geometry)

    def commit(self) -> None:
        self.lib.rtcCommitScene(self.handle)

    def place(self, transforms: NDArray[np.float64]) -> None:
        """Make and commit a scene of instances with (n, 3, 4) transforms."""
        self.commit()
        self.handle = self.lib.rtcNewScene(self.device.handle)
        for matrix in np.ascontiguousarray(transforms, np.float32):
            geometry = self.lib.rtcNewGeometry(self.device.handle, INSTANCE)
            self.lib.rtcSetGeometryInstancedScene(geometry, self._bottom)
            self.lib.rtcSetGeometryTransform(geometry, 0, FLOAT3X4_ROWS, matrix.ctypes.data)
            self.lib.rtcCommitGeometry(geometry)
            self.lib.rtcAttachGeometry(self.handle, geometry)
            self.lib.rtcReleaseGeometry(geometry)
        self.commit()

    def __del__(self) -> None:
        for handle in {self.handle, self._bottom}:
            self.lib.rtcReleaseScene(handle)

    def intersect(self, rays: Rays) -> Callable[[], tuple[F32, NDArray[np.int32], NDArray[np.int32]]]:
        """A callable that returns t (inf: no hit), triangle and instance (-1: none) of every ray."""
        n = len(rays.limit)
        (t, u, v), (triangle, instance) = np.zeros((3, n), np.float32), np.zeros((2, n), np.int32)

        def run() -> tuple[F32, NDArray[np.int32], NDArray[np.int32]]:
            self.device.closest(self.handle, rays.origin, rays.direction, rays.limit, t, triangle, instance, u, v)
            return t, triangle, instance

        return run

    def occluded(self, rays: Rays) -> Callable[[], NDArray[np.bool_]]:
        """A callable that returns whether each ray is occluded."""
        blocked = np.zeros(len(rays.limit), np.bool_)

        def run() -> NDArray[np.bool_]:
            self.device.occluded(self.handle, rays.origin, rays.direction, rays.limit, blocked)
            return blocked

        return run


def _loops(intersect1: Any, occluded1: Any) -> tuple[Any, Any]:
    """Compiled loops over single rays. They contain the addresses of the functions, so they are not cached on disk."""
    infinite = np.float32(np.inf)

    @njit(nogil=True)
    def begin(words, integers, origin, direction, limit, k):
        for axis in range(3):
            words[axis], words[4 + axis] = origin[k, axis], direction[k, axis]
        words[3], words[7], words[8] = 0.0, 0.0, limit[k]  # tnear, time, tfar
        integers[9], integers[10], integers[11] = INVALID, 0, 0  # mask, id, flags
        integers[17], integers[18], integers[19], integers[20] = INVALID, INVALID, INVALID, INVALID  # primID, geomID, instances

    @njit(nogil=True)
    def closest(scene, origin, direction, limit, t, triangle, instance, u, v):
        memory = np.empty(_RAY_WORDS + 16, np.uint32)
        start = (64 - memory.ctypes.data % 64) % 64 // 4
        integers = memory[start : start + _RAY_WORDS]
        words = integers.view(np.float32)
        for k in range(len(t)):
            begin(words, integers, origin, direction, limit, k)
            intersect1(scene, integers.ctypes, 0)
            hit = integers[18] != INVALID
            t[k] = words[8] if hit else infinite
            triangle[k], instance[k] = np.int32(integers[17]), np.int32(integers[19])
            u[k], v[k] = words[15], words[16]

    @njit(nogil=True)
    def occluded(scene, origin, direction, limit, blocked):
        memory = np.empty(_RAY_WORDS + 16, np.uint32)
        start = (64 - memory.ctypes.data % 64) % 64 // 4
        integers = memory[start : start + _RAY_WORDS]
        words = integers.view(np.float32)
        for k in range(len(blocked)):
            begin(words, integers, origin, direction, limit, k)
            occluded1(scene, integers.ctypes, 0)
            blocked[k] = words[8] < 0.0

    return closest, occluded
