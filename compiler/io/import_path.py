"""Keeps files of the current folder out of this process: Python's modules, and the settings and plug-ins of libraries.

`maquette/__init__.py` calls `isolate_command` before it imports any other module. So this file imports only what Python has loaded by then.
"""

import os
import sys

# Numba and Matplotlib look for these names in the current folder, and have no option against it.
_SETTINGS = (".numba_config.yaml", "matplotlibrc")
# Lists of folders from which programs and libraries load code or settings, and variables that each name one file or folder.
_LISTS = (
    "PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "DYLD_FALLBACK_LIBRARY_PATH", "PYTHONPATH", "PXR_PLUGINPATH_NAME",
    "PXR_AR_DEFAULT_SEARCH_PATH", "PXR_MTLX_PLUGIN_SEARCH_PATHS", "PXR_MTLX_STDLIB_SEARCH_PATHS", "PXR_SDR_FS_PLUGIN_SEARCH_PATHS",
    "PXR_USDMTLX_PLUGIN_SEARCH_PATHS", "PXR_USDMTLX_STDLIB_SEARCH_PATHS", "MATERIALX_SEARCH_PATH", "OIIO_LIBRARY_PATH",
    "OPENIMAGEIO_PLUGIN_PATH", "OPENIMAGEIO_FONTS", "OSL_LIBRARY_PATH",
)  # fmt: skip
_SINGLE = (
    "OCIO", "DRJIT_LIBLLVM_PATH", "MATPLOTLIBRC", "MPLCONFIGDIR", "NUMBA_CACHE_DIR", "NUMBA_GDB_BINARY", "DASK_CONFIG", "DASK_ROOT_CONFIG",
    "SSL_CERT_FILE", "SSL_CERT_DIR", "PYTHONHOME", "PYTHONUSERBASE", "PYTHONPYCACHEPREFIX", "XDG_CONFIG_HOME", "XDG_CACHE_HOME",
    "XDG_DATA_HOME",
)  # fmt: skip
_exists = os.path.exists


def isolate_command(package: str, folder: str) -> None:
    """Isolate this process if it is the command: `maquette`, `python -m maquette` or `python -m` of a module of the package.

    A program that imports the package keeps its own import path and environment. `folder` is the package's.
    """
    first = sys.argv[0] if sys.argv else ""
    if first == "-m":  # Python looks for the module, and imports its package first
        words = [word.removeprefix("-m") for word in sys.orig_argv[1:]]
        if any(word == package or word.startswith(f"{package}.") for word in words):
            if not sys.flags.safe_path:
                _leave_out(sys.path[0], package, folder)
            isolate()
    elif os.path.basename(first) in (package, f"{package}.exe") or first == os.path.join(folder, "__main__.py"):
        isolate()


def isolate() -> None:
    """Isolate this process for good: its import path, its environment, the settings of libraries, and the processes that it starts."""
    current = _current_folder()
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    relative = [os.path.normpath(os.path.join(current, entry)) for entry in entries if not os.path.isabs(entry)]
    if "PYTHONPATH" in os.environ and not sys.flags.ignore_environment:
        sys.path[:] = [entry for entry in sys.path if entry not in relative or _is_site_folder(entry)]
    variables = environment()
    for name in [name for name in os.environ if name not in variables]:
        del os.environ[name]
    os.environ.update(variables)
    os.path.exists = _exists_elsewhere


def environment() -> dict[str, str]:
    """The environment without folders that depend on the current one. Python processes with it do not look into their current folder."""
    variables = dict(os.environ)
    for name in _LISTS:
        if name in variables:
            entries = [entry for entry in variables[name].split(os.pathsep) if os.path.isabs(entry)]
            variables[name] = os.pathsep.join(entries)
            if not entries:
                del variables[name]
    for name in _SINGLE:
        if not os.path.isabs(variables.get(name, os.sep)) and not variables[name].startswith("ocio://"):  # one inside of the library
            del variables[name]
    return {**variables, "PYTHONSAFEPATH": "1"}


def search_path() -> list[str]:
    """The import path for another process: that of this one without the current folder and without relative entries."""
    current = _current_folder()
    return [entry for entry in sys.path if os.path.isabs(entry) and (not _is_same(entry, current) or _is_site_folder(entry))]


def _leave_out(entry: str, package: str, folder: str) -> None:
    """Remove the current folder from the import path. Where the package itself lies in it, it comes last."""
    current = _current_folder()
    if entry not in ("", current) or _is_site_folder(entry):
        return
    del sys.path[0]
    if _is_same(os.path.join(current, package), folder):
        sys.path.append(current)


def _is_site_folder(entry: str) -> bool:
    """Whether a folder holds installed packages, so that it stays on the path when it is the current one."""
    return os.path.basename(entry) in ("site-packages", "dist-packages") and entry.startswith((sys.prefix, sys.base_prefix))


def _current_folder() -> str:
    """The current folder, or "" if it was removed."""
    try:
        return os.getcwd()
    except OSError:
        return ""


def _is_same(a: str, b: str) -> bool:
    try:
        return os.path.samefile(a, b)
    except OSError:
        return False


def _exists_elsewhere(path):
    """os.path.exists, which does not find the settings of libraries in the current folder."""
    return not (isinstance(path, str) and path in _SETTINGS) and _exists(path)
