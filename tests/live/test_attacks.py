"""The live window against hostile pages: each message has an answer."""

from __future__ import annotations

from pathlib import Path

from . import windows
from .windows import client, served


def test_long_and_wrong_messages_are_refused(tmp_path: Path) -> None:
    with served(windows.write(tmp_path)) as shown, client(shown) as page:
        page.finished()
        long = "x" * 1_000_000
        for text in (
            long,
            '{"type": "' + long + '"}',
            "[" * 1_000_000,
            '{"type": "pick"',
            '{"type": "change", "state": {"' + long + '": 1}}',
        ):
            page.last.pop("refused", None)
            page.socket.send(text)
            page.wait(lambda: "refused" in page.last)
            assert len(page.last["refused"]["message"]) < 1000
        assert "text" in page.ask("camera", "camera")
