"""The protocol of the language server with an answer to every wrong request. pygls leaves those that it cannot read without one."""

from __future__ import annotations

import math
from typing import Any

from lsprotocol import types
from pygls.exceptions import JsonRpcException
from pygls.protocol import LanguageServerProtocol

MOST = (1 << 31) - 1  # of an integer of the protocol
_UNSIGNED = ("line", "character", "tabSize")
_SHARES = ("red", "green", "blue", "alpha")


class Protocol(LanguageServerProtocol):
    """Answers requests whose params cannot be read with InvalidParams, and drops such notifications."""

    def structure_message(self, data: Any) -> Any:
        """The message of a JSON object; None for one that was answered already. Objects inside of messages stay as they are."""
        if "jsonrpc" not in data:
            return data
        number = data.get("id")
        sound = isinstance(number, str) or (isinstance(number, int) and not isinstance(number, bool) and abs(number) <= MOST)
        if "id" in data and not sound:
            self._refuse(None, types.ErrorCodes.InvalidRequest, "the id of a request is a text or a number")
            return None
        if why := fault(data.get("params")):
            self._refuse(number, types.ErrorCodes.InvalidParams, why)
            return None
        try:
            return super().structure_message(data)
        except JsonRpcException as error:
            why = str(error.__cause__ or error).splitlines()[0]
            why = f"the params of {str(data.get('method'))[:80]} cannot be read: {why[:200]}"
            self._refuse(number, types.ErrorCodes.InvalidParams, why)
            return None

    def handle_message(self, message: Any) -> None:
        """Handle a message that was not answered yet."""
        if message is not None:
            super().handle_message(message)

    def _refuse(self, number: int | str | None, code: types.ErrorCodes, why: str) -> None:
        """Answer a request; a notification, which has no number, gets none."""
        if number is not None or code == types.ErrorCodes.InvalidRequest:
            self._send_data({"jsonrpc": self.VERSION, "id": number, "error": {"code": code.value, "message": why}})


def fault(params: Any) -> str:
    """What is wrong with a number of a request's params; "" for sound ones."""
    waiting: list[tuple[str, Any]] = [("", params)]
    while waiting:
        name, value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.items()
        elif isinstance(value, list):
            waiting += [(name, each) for each in value]
        elif name in _UNSIGNED and (isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST):
            return f"`{name}` is a whole number from 0 to {MOST}"
        elif name in _SHARES and (isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1):
            return f"`{name}` is a number from 0 to 1"
        elif isinstance(value, float) and not math.isfinite(value):
            return f"`{name}` is not a number of JSON"
        elif isinstance(value, int) and abs(value) > MOST:
            return f"`{name}` is more than {MOST}"
    return ""
