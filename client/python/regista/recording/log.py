# SPDX-License-Identifier: Apache-2.0
"""What a robot says, as records of a file."""

from __future__ import annotations

import time
from typing import Any, Protocol

from regista import gps, message, position2d

from . import foxglove
from .schema import schema, write
from .writer import LOG, Channel

POSE = "foxglove.PoseInFrame"
LOCATION = "foxglove.LocationFix"
LEVELS = (foxglove.INFO, foxglove.WARNING, foxglove.ERROR)


class Sink(Protocol):
    """Where records go, such as a `Recorder`."""

    def put(self, channel: Channel, message: dict[str, Any], log_time_ns: int, publish_time_ns: int) -> bool: ...


class Log:
    """Turns what a robot says into records."""

    def __init__(self, recorder: Sink) -> None:
        self._recorder = recorder
        self._channels: dict[tuple[str, type], Channel] = {}
        # One offset for the whole recording: a clock that is set meanwhile does not shift what comes after.
        self._epoch_ns = time.time_ns() - time.monotonic_ns()

    def data(self, received: message.Received) -> None:
        log_ns = self._epoch_ns + round(received.arrival * 1e9)
        stamp_ns = round(received.stamp * 1e9)
        said = received.message
        self._recorder.put(self._channel(received.device, type(said)), write(said), log_ns, stamp_ns)
        if isinstance(said, position2d.State):
            pose = foxglove.pose(stamp_ns, "odom", said.pose.x, said.pose.y, said.pose.heading)
            channel = Channel(f"{_topic(received.device)}/pose", POSE, foxglove.POSE_IN_FRAME)
            self._recorder.put(channel, pose, log_ns, stamp_ns)
        elif isinstance(said, gps.State):
            where = (said.latitude / 1e7, said.longitude / 1e7, said.altitude_mm / 1e3)
            channel = Channel(f"{_topic(received.device)}/location", LOCATION, foxglove.LOCATION_FIX)
            self._recorder.put(channel, foxglove.location(stamp_ns, "gps", *where), log_ns, stamp_ns)

    def answer(self, device: str, request: Any, reply: Any) -> None:
        """What a device is, such as its geometry: replayed as the answer to the same request."""
        now = time.time_ns()
        metadata = {"device": device, "kind": "answer", "subtype": str(type(request).SUBTYPE)}
        topic = f"{_topic(device)}/{type(request).NAME.lower()}"
        channel = Channel(topic, _name(device, type(reply)), schema(type(reply)), metadata)
        self._recorder.put(channel, write(reply), now, now)

    def event(self, event: Any) -> None:
        now = time.time_ns()
        level = LEVELS[min(event.severity, len(LEVELS) - 1)]
        self._recorder.put(LOG, foxglove.log(now, level, event.text), now, now)

    def _channel(self, device: str, kind: Any) -> Channel:
        channel = self._channels.get((device, kind))
        if channel is None:
            metadata = {"device": device, "kind": "data", "subtype": str(kind.SUBTYPE)}
            topic = f"{_topic(device)}/{kind.NAME.lower()}"
            channel = Channel(topic, _name(device, kind), schema(kind), metadata)
            self._channels[device, kind] = channel
        return channel


def _topic(device: str) -> str:
    """/position2d/0"""
    return "/" + device.replace(":", "/")


def _name(device: str, kind: Any) -> str:
    return f"regista.{device.partition(':')[0]}.{kind.__name__}"
