# SPDX-License-Identifier: Apache-2.0
"""Messages in shapes that Foxglove and Lichtblick draw by themselves: schemas of github.com/foxglove/foxglove-sdk."""

from __future__ import annotations

import math
from typing import Any

INFO, WARNING, ERROR = 2, 3, 4  # foxglove.LogLevel


def _object(title: str, **properties: dict[str, Any]) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0}},
    "description": "seconds and nanoseconds since the epoch",
}
_NUMBER = {"type": "number"}
_TEXT = {"type": "string"}

POSE_IN_FRAME = _object(
    "foxglove.PoseInFrame",
    timestamp=_TIME,
    frame_id=_TEXT,
    pose=_object(
        "foxglove.Pose",
        position=_object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER),
        orientation=_object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
    ),
)
LOCATION_FIX = _object(
    "foxglove.LocationFix",
    timestamp=_TIME,
    frame_id=_TEXT,
    latitude={"type": "number", "description": "degrees"},
    longitude={"type": "number", "description": "degrees"},
    altitude={"type": "number", "description": "m"},
)
LOG = _object(
    "foxglove.Log",
    timestamp=_TIME,
    level={"type": "integer", "description": "2 info, 3 warning, 4 error"},
    message=_TEXT,
    name=_TEXT,
    file=_TEXT,
    line={"type": "integer", "minimum": 0},
)


def _time(ns: int) -> dict[str, int]:
    return {"sec": ns // 1_000_000_000, "nsec": ns % 1_000_000_000}


def pose(ns: int, frame: str, x: float, y: float, heading: float) -> dict[str, Any]:
    """x, y [m], heading [rad] counter-clockwise from x."""
    return {
        "timestamp": _time(ns),
        "frame_id": frame,
        "pose": {
            "position": {"x": x, "y": y, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)},
        },
    }


def location(ns: int, frame: str, latitude: float, longitude: float, altitude: float) -> dict[str, Any]:
    """Degrees and metres."""
    return {
        "timestamp": _time(ns),
        "frame_id": frame,
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
    }


def log(ns: int, level: int, message: str, name: str = "regista") -> dict[str, Any]:
    return {"timestamp": _time(ns), "level": level, "message": message, "name": name, "file": "", "line": 0}
