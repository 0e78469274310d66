"""Identity of an installation: two with equal identities draw the same bits."""

from __future__ import annotations

from importlib import metadata

from ...lang import distribution
from ..jit import cache_key
from ..simd import target

LIBRARIES = ("numpy", "numba", "llvmlite")


def identity() -> dict[str, str]:
    """Version, digest of the sources of kernels, target of kernels, and versions of the libraries that compute."""
    return {
        "maquette": distribution.VERSION, "kernels": cache_key.version(), "target": target.fingerprint(),
        **{name: metadata.version(name) for name in LIBRARIES},
    }  # fmt: skip


def difference(worker: dict[str, str], client: dict[str, str]) -> tuple[str, str]:
    """(how a worker differs, how to mend that); ("", "") if their pictures are equal."""
    if worker.get("maquette") != client["maquette"]:
        return f"has maquette {worker.get('maquette')}, and this client {client['maquette']}", "install the same version on all"
    if worker.get("kernels") != client["kernels"]:
        return "has other kernels of the same version of maquette", "install the same files on all"
    if worker.get("target") != client["target"]:
        isa, ours = worker.get("target", "").split(" ")[0], client["target"].split(" ")[0]
        lowest = min((isa, ours), key=lambda name: target.BYTES.get(name, 0))
        hint = f"start workers and client with MAQUETTE_SIMD={lowest}" if isa != ours else "use machines of one architecture"
        return f"renders with {isa} instructions, and this client with {ours}", hint
    for name in LIBRARIES:
        if worker.get(name) != client[name]:
            return f"has {name} {worker.get(name)}, and this client {client[name]}", f"install {name}=={client[name]} there"
    return "", ""
