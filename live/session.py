"""One scene in the live window: its studio, the watch of its files, and the messages of the pages."""

from __future__ import annotations

import logging
import secrets
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..compiler.io.replace_file import replace_file
from . import outlines, page_messages, params, picking, scene_files, watch
from .hub import Hub, Page
from .scene_files import Opened
from .state import State, StateError
from .studio import Current, Studio


class Session:
    """Draws a scene, follows its files, and answers pages."""

    def __init__(
        self, opened: Opened, hub: Hub, finished: Callable[[Current, State], None] | None = None,
        edited: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:  # fmt: skip
        """`finished` and `edited` are those of Studio."""
        self.boot = secrets.token_hex(8)  # tells a page that the server has restarted
        self.opened, self.hub = opened, hub
        self.studio = Studio(opened, self._tell, hub.show, finished, edited)
        self._touched = False  # whether a page has set something
        self._stop = threading.Event()
        self._watcher = threading.Thread(target=self._follow, name="watch", daemon=True)
        self._disk: dict[str, str | None] = {}  # the texts of the files as the pages know them

    def start(self) -> None:
        """Draw and watch."""
        self.studio.start()
        self._watcher.start()

    def stop(self) -> None:
        """End both threads."""
        self._stop.set()
        self.studio.stop()
        self._watcher.join(timeout=5.0)

    def _follow(self) -> None:
        files: list[tuple[Path, ...]] = [()]

        def build() -> tuple[Path, ...]:
            files[0] = self.studio.files
            self.studio.files_changed()
            self._tell_files()
            return files[0]

        watch.follow(build, self._stop, lambda: self.studio.files != files[0], at_once=True)

    # --- to the pages ---

    def _tell(self, message: dict[str, Any]) -> None:
        if message["type"] == "files":
            self._tell_files()
        else:
            self.hub.tell(message)

    def sources(self) -> list[Path]:
        """The files that pages may edit."""
        return scene_files.of_scene(self.studio.files, self.opened.path)

    def _tell_files(self) -> None:
        """Send the texts of the sources, on disk and unsaved."""
        paths = self.sources()
        texts = {str(path): scene_files.read_text(path) for path in paths}
        self._disk = texts
        unsaved = self.studio.state.texts
        items = [
            {"path": path, "name": _short_name(Path(path), self.opened.path), "text": text, "saved": scene_files.digest(text),
             "unsaved": unsaved.get(path)}
            for path, text in texts.items()
        ]  # fmt: skip
        self.hub.tell({"type": "files", "items": items})

    def _tell_state(self, state: State, page: Page) -> None:
        self.hub.tell({"type": "state", "state": state.to_json(), "from": page.number})

    # --- from the pages, in the event loop ---

    def handle(self, page: Page, message: Any) -> None:
        """Answer a message of a page. Wrong messages get an answer of type `refused`, whatever is wrong."""
        try:
            _HANDLERS[page_messages.check(message)](self, page, message)
        except (StateError, ValueError, OSError) as error:
            page.refuse(str(error))
        except Exception as fault:  # of ours: the connection stays
            logging.getLogger(__name__).exception("a message of a page")
            page.refuse(f"internal error: {type(fault).__name__}: {fault}")

    def _hello(self, page: Page, message: dict[str, Any]) -> None:
        """Greet a page; one of a server that is gone brings its state."""
        if message.get("boot") not in (None, self.boot) and not self._touched and isinstance(message.get("state"), dict):
            self._touched = True
            self._adopt(message["state"], message.get("texts"))
        page.put("hello", {"type": "hello", "boot": self.boot, "page": page.number})
        self.hub.greet(page)
        page.put("state", {"type": "state", "state": self.studio.state.to_json(), "from": 0})

    def _adopt(self, changes: dict[str, Any], texts: Any) -> None:
        folder = scene_files.real_path(self.opened.path).parent

        def update(state: State) -> State:
            for name in changes:  # fields that this version does not take are left out
                try:
                    state = state.changed({name: changes[name]})
                except StateError:
                    continue
            for path, text in texts.items() if isinstance(texts, dict) else ():
                if isinstance(text, str) and path.endswith(".scene") and Path(path).is_relative_to(folder):
                    state = state.with_text(path, text)
            return state

        self.studio.change(update)
        self._tell_files()

    def _change(self, page: Page, message: dict[str, Any]) -> None:
        changes = message["state"]
        self._touched = True
        self._tell_state(self.studio.change(lambda state: state.changed(changes)), page)

    def _text(self, page: Page, message: dict[str, Any]) -> None:
        path, text = self._path(message), message["text"]
        self._touched = True
        unsaved = None if text == self._disk.get(path) else text
        self.studio.change(lambda state: state.with_text(path, unsaved))
        self.hub.tell({"type": "text", "path": path, "text": text}, f"text {path}", page.number)
        self._keep_unsaved(path, unsaved)

    def _keep_unsaved(self, path: str, unsaved: str | None) -> None:
        """Put an unsaved text into the message that later pages get."""
        for item in self.hub.kept.get("files", {}).get("items", ()):
            if item["path"] == path:
                item["unsaved"] = unsaved

    def _save(self, page: Page, message: dict[str, Any]) -> None:
        """Write a file, unless it was changed on disk after the page read it."""
        path, text = self._path(message), message["text"]
        now = scene_files.digest(scene_files.read_text(Path(path)))
        if now != message.get("saved") and not message.get("force"):
            page.put("conflict", {"type": "conflict", "path": path})
            return
        self._write(path, text)
        page.put("saved", {"type": "saved", "path": path, "saved": scene_files.digest(text)})

    def _write(self, path: str, text: str) -> None:
        replace_file(Path(path), text.encode("utf-8"))
        self._disk[path] = text
        self.studio.change(lambda state: state.with_text(path, None))
        self._tell_files()

    def _path(self, message: dict[str, Any]) -> str:
        path = message.get("path")
        if path not in {str(source) for source in self.sources()}:
            raise StateError("that is not a file of the scene")
        return str(path)

    def _write_params(self, page: Page, message: dict[str, Any]) -> None:
        """Put the values of params into the source: into the unsaved text if there is one, else into the file."""
        state, path = self.studio.state, str(scene_files.real_path(self.opened.path))
        names = message.get("names")
        values = {name: text for name, text in state.sets.items() if names is None or name in names}
        if not values or not self.opened.scene:
            return
        unsaved = state.texts.get(path)
        text = scene_files.read_text(Path(path)) if unsaved is None else unsaved
        if text is None:
            raise StateError(f"{path} cannot be read")
        new = params.write_back(text, self.opened.path.name, values)
        if unsaved is None:
            self._write(path, new)
        else:
            self.studio.change(lambda state: state.with_text(path, new))
            self.hub.tell({"type": "text", "path": path, "text": new}, f"text {path}")
            self._keep_unsaved(path, new)
        changed = self.studio.change(lambda state: state.changed({"sets": dict.fromkeys(values)}))
        self.hub.tell({"type": "state", "state": changed.to_json(), "from": 0})
        page.put("written", {"type": "written", "names": list(values), "saved": unsaved is None})

    def _pick(self, page: Page, message: dict[str, Any]) -> None:
        x, y = message["x"], message["y"]
        current = self.studio.current
        if current is None or "id" not in current.shown.channels:
            raise StateError("the picture is not ready for clicks yet")
        page.put("pick", {"type": "pick", **picking.pick(current.scene, current.shown, float(x), float(y))})

    def _outline(self, page: Page, message: dict[str, Any]) -> None:
        """Send the outlines of the instances that a line of a source makes."""
        path, line = self._path(message), message["line"]
        current = self.studio.current
        if current is not None and "id" in current.shown.channels:
            outline = outlines.of_line(current.scene, current.shown.channels["id"], path, line)
            page.put("outline", {"type": "outline", "path": path, "line": line, **outline})

    def _camera(self, page: Page, message: dict[str, Any]) -> None:
        page.put("camera", {"type": "camera", "text": self.studio.camera_source()})


def _short_name(path: Path, main: Path) -> str:
    folder = scene_files.real_path(main).parent
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name


_HANDLERS: dict[str, Callable[[Session, Page, dict[str, Any]], None]] = {
    "hello": Session._hello, "change": Session._change, "text": Session._text, "save": Session._save,
    "write_params": Session._write_params, "pick": Session._pick, "outline": Session._outline, "camera": Session._camera,
}  # fmt: skip
