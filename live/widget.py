"""The live window as a widget of notebooks, such as Jupyter and marimo, by anywidget."""

from __future__ import annotations

import base64
from typing import Any

import anywidget

from . import notebook, server
from .scene_files import Opened


class Widget(anywidget.AnyWidget):
    """Shows a scene file and follows its edits; params are controls, dragging moves the camera. `close` ends it."""

    _esm = notebook.module()
    _css = (notebook.PAGE / "widget.css").read_text(encoding="utf-8")

    def __init__(self, opened: Opened, **more: Any) -> None:
        """`opened` has the file and the options of its pictures."""
        super().__init__(**more)
        self.notebook = notebook.NotebookPage(opened, lambda message, buffers: self.send(message, buffers or None))
        self.on_msg(lambda _, message, __: self.notebook.receive(message))

    def _repr_mimebundle_(self, **more: Any) -> Any:
        """The widget, and for viewers of the saved notebook the picture as PNG if there is one already."""
        bundle = super()._repr_mimebundle_(**more)
        current = self.notebook.session.studio.current
        if bundle is None or current is None:
            return bundle
        data, *rest = bundle if isinstance(bundle, tuple) else (bundle,)
        picture = base64.b64encode(server.encoded(current, "png")).decode()
        return ({**data, "image/png": picture}, *rest) if rest else {**data, "image/png": picture}

    def close(self) -> None:
        """End drawing and following, and remove the widget."""
        self.notebook.close()
        super().close()
