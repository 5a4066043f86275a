# SPDX-License-Identifier: Apache-2.0
"""Bytes of the wire to dicts and back, for tools: the same JSON as `regista-wire` speaks, with Player's names."""

from __future__ import annotations

import json
from typing import Any

from regista import _core
from regista.message import Struct


def decode(data: bytes) -> list[dict[str, Any]]:
    """Whole messages, one after the other, each as {"header": …, "fields": …}. ValueError: where, and what is wrong."""
    messages, rest = _core.wire_decode(data)
    if rest:
        raise ValueError(f"byte {len(data) - rest}: {rest} bytes are no whole message")
    return [json.loads(message) for message in messages]


def frame(message: Struct, device: str, subtype: int, *, answer: bool = False) -> bytes:
    """A message as a server sends it: data of a device such as "position2d:0", or the answer to a request `subtype`."""
    return _core.wire_frame(message, device, subtype, answer)


def encode(message: dict[str, Any]) -> bytes:
    """The reverse, of one message. Counts and the header's size may be left out; NaN and the infinities are the strings
    "nan", "inf", "-inf". ValueError: what is wrong."""
    return _core.wire_encode(json.dumps(message, allow_nan=False, ensure_ascii=False).encode())
