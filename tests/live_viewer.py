"""A viewer as Foxglove is one, by the protocol's own words: subprotocol foxglove.sdk.v1 over a WebSocket of aiohttp."""

from __future__ import annotations

import asyncio
import base64
import json
import struct
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from typing import Any

from aiohttp import ClientError, ClientSession, ClientWebSocketResponse, WSMsgType

_DATA = struct.Struct("<BIQ")


class Viewer:
    """What it is told: channels by topic, and of those that it subscribes to (log time [ns], bytes)."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self._socket = socket
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}
        self.times_ns: list[int] = []
        """What the server says is now."""
        self._topics: dict[int, str] = {}

    async def listen(self) -> None:
        async for message in self._socket:
            if message.type is WSMsgType.TEXT:
                told = json.loads(message.data)
                if told["op"] == "serverInfo":
                    self.info = told
                elif told["op"] == "advertise":
                    self.channels |= {one["topic"]: one for one in told["channels"]}
            elif message.type is WSMsgType.BINARY and message.data[0] == 1:
                _, number, t_ns = _DATA.unpack_from(message.data)
                self.messages.setdefault(self._topics[number], []).append((t_ns, message.data[_DATA.size :]))

            elif message.type is WSMsgType.BINARY and message.data[0] == 2:
                self.times_ns.append(int.from_bytes(message.data[1:9], "little"))

    async def subscribe(self, topics: Iterable[str]) -> None:
        asked = []
        for topic in topics:
            number = len(self._topics) + 1
            self._topics[number] = topic
            asked.append({"id": number, "channelId": self.channels[topic]["id"]})
        await self._socket.send_str(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def schema(self, topic: str) -> tuple[str, str, bytes]:
        """Name, encoding and text, as `companion.log.encoding.schema_of` has them."""
        one = self.channels[topic]
        kind = one.get("schemaEncoding", "")
        return (
            one["schemaName"],
            kind,
            base64.b64decode(one["schema"]) if kind == "protobuf" else one["schema"].encode(),
        )


@asynccontextmanager
async def viewing(url: str, timeout_s: float = 60.0) -> AsyncIterator[Viewer]:
    """Comes in as soon as the server listens."""
    async with ClientSession() as session:
        deadline_s = asyncio.get_running_loop().time() + timeout_s
        while True:
            try:
                socket = await session.ws_connect(url, protocols=["foxglove.sdk.v1"], max_msg_size=1 << 24)
                break
            except ClientError:
                if asyncio.get_running_loop().time() > deadline_s:
                    raise
                await asyncio.sleep(0.1)
        viewer = Viewer(socket)
        listening = asyncio.create_task(viewer.listen())
        try:
            yield viewer
        finally:
            listening.cancel()
            await asyncio.wait({listening})
            await socket.close()
