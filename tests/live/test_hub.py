"""Messages to pages: the newest of each kind, in order, however slow a page is."""

from __future__ import annotations

import asyncio
import json

from maquette.live.hub import Hub


def test_a_slow_page_gets_the_newest_of_each_kind() -> None:
    async def run() -> tuple[int, list[str | bytes]]:
        hub = Hub()
        hub.loop = asyncio.get_running_loop()
        page = hub.open()
        for k in range(1000):
            hub.tell({"type": "progress", "share": k})
            hub.show({"version": k}, b"\0" * 4)
            hub.tell({"type": "text", "path": "a", "text": str(k)}, "text a")
        await asyncio.sleep(0)
        waiting = len(page.pending)
        sent: list[str | bytes] = []

        async def send(data: str | bytes) -> None:
            sent.append(data)

        sender = asyncio.create_task(page.run(send))
        await asyncio.sleep(0.01)
        sender.cancel()
        return waiting, sent

    waiting, sent = asyncio.run(run())
    assert waiting == 2
    assert [json.loads(data)["type"] for data in sent if isinstance(data, str)] == ["progress", "text"]
    assert json.loads(sent[0])["share"] == 999
    (picture,) = (data for data in sent if isinstance(data, bytes))
    assert (picture[4 : 4 + picture[0]].strip(), len(picture) % 4) == (b'{"version": 999}', 0)


def test_a_message_skips_the_page_that_caused_it_and_waits_for_later_ones() -> None:
    async def run() -> tuple[list[str], list[str], list[str]]:
        hub = Hub()
        hub.loop = asyncio.get_running_loop()
        one, two = hub.open(), hub.open()
        hub.tell({"type": "state", "state": 1}, but=one.number)
        hub.tell({"type": "toast"})
        await asyncio.sleep(0)
        late = hub.open()
        hub.greet(late)
        return list(one.pending), list(two.pending), list(late.pending)

    assert asyncio.run(run()) == (["toast"], ["state", "toast"], ["state"])
