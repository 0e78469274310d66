"""Names of files that other files hold: with backslashes, in another case, or with the folders of another computer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ...io.sandbox import FileError, Files


def find(name: str, folder: Path | None, files: Files, what: str) -> Path:
    """Resolves a name that a file in `folder` holds.

    Candidates: as written, with slashes in place of backslashes, in other case, or its last component beside the file.
    Raises FileError if there is none.
    """
    failure: FileError | None = None
    for tried in _spelled(name, folder or files.root):
        try:
            return files.find(tried, folder, what)
        except FileError as e:
            failure = failure or e
    raise failure or FileError(f"there is no {what} `{name}`")


def existing_path(name: str, folder: Path) -> Path | None:
    """The path of the first candidate of `find` that exists; None for none. The caller decides whether it may be read."""
    with suppress(OSError, ValueError):  # a name that no file can have
        return next((path for tried in _spelled(name, folder) if (path := folder / tried).is_file()), None)
    return None


def _spelled(name: str, folder: Path) -> Iterator[str]:
    turned = name.replace("\\", "/").strip()
    if "\\" in name:
        yield name  # a name may hold backslashes
    for tried in dict.fromkeys((turned, turned.rsplit("/", 1)[-1])):
        yield tried
        with suppress(OSError, ValueError):
            yield _other_case(tried, folder)


def _other_case(name: str, folder: Path) -> str:
    """The name with the spelling on disk, if only case differs."""
    directory, spelled = folder, []
    for part in name.split("/"):
        if part not in ("", ".", "..") and not (directory / part).exists() and directory.is_dir():
            part = next((p.name for p in directory.iterdir() if p.name.lower() == part.lower()), part)
        spelled.append(part)
        directory = directory / part
    return "/".join(spelled)
