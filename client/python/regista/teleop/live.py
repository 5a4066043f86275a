# SPDX-License-Identifier: Apache-2.0
"""What robots say, live for Foxglove and Lichtblick: the topics of a recording. Wants the extra `regista[foxglove]`."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable
from typing import Any

import foxglove

from regista.recording import Channel


class Foxglove:
    """A server of the Foxglove WebSocket protocol on 127.0.0.1, which takes no commands.

    Args:
        port: 0: any free one.

    Raises:
        OSError: The port is taken.
    """

    def __init__(self, port: int) -> None:
        self._context = foxglove.Context()
        self._prefixes: set[str] = set()
        try:
            self._server = foxglove.start_server(name="regista", host="127.0.0.1", port=port, context=self._context)
        except Exception as error:
            raise OSError(f"cannot listen on 127.0.0.1:{port} for Foxglove: {error}") from error
        self.url = f"ws://127.0.0.1:{self._server.port}"

    def topics(self, label: str) -> Topics:
        """Of one robot, all below its name; one whose name looks the same here gets a number."""
        stem = "/" + re.sub(r"[^A-Za-z0-9.]+", "_", label).strip("_")
        prefixes = itertools.chain([stem], (f"{stem}_{number}" for number in itertools.count(2)))
        prefix = next(prefix for prefix in prefixes if prefix not in self._prefixes)
        self._prefixes.add(prefix)
        return Topics(self._context, prefix, self._prefixes.discard)

    def close(self) -> None:
        """Nobody is told anything any more."""
        self._server.stop()


class Topics:
    """Takes what `regista.recording.Log` makes of the messages of a robot."""

    def __init__(self, context: Any, prefix: str, closed: Callable[[str], None]) -> None:
        self._context, self._prefix, self._closed = context, prefix, closed
        self._made: dict[str, Any] = {}

    def put(self, channel: Channel, message: dict[str, Any], log_time_ns: int, publish_time_ns: int) -> bool:
        """Tell whoever subscribed. Never waits: of a client that is slow, the oldest are dropped."""
        made = self._made.get(channel.topic)
        if made is None:
            schema = foxglove.Schema(
                name=channel.schema_name, encoding="jsonschema", data=json.dumps(channel.schema).encode()
            )
            made = self._made[channel.topic] = foxglove.Channel(
                self._prefix + channel.topic, schema=schema, message_encoding="json", context=self._context
            )
        if made.has_sinks():
            made.log(json.dumps(message, separators=(",", ":")).encode(), log_time=log_time_ns)
        return True

    def close(self) -> None:
        """The robot has gone for good."""
        for made in self._made.values():
            made.close()
        self._made.clear()
        self._closed(self._prefix)
