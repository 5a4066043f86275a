# SPDX-License-Identifier: Apache-2.0
"""What all messages have. The messages themselves: `regista.position2d`, `regista.kicker` and so on."""

from __future__ import annotations

import typing
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

R_co = TypeVar("R_co", covariant=True)
D_co = TypeVar("D_co", bound="Data", covariant=True)


class Struct:
    """Named values in the order of the wire. What `read()` brings is yours: the next `read()` brings another."""

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        """Same class and same values; arrays element by element."""
        if type(self) is not type(other):
            return NotImplemented
        return all(_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))  # type: ignore[arg-type]

    def to_dict(self) -> dict[str, Any]:
        """As dicts, lists, numbers, strings and bytes."""
        return {f.name: _plain(getattr(self, f.name)) for f in fields(self)}  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The reverse of `to_dict`. What is left out has its default; an unknown name is a TypeError."""
        types = _types(cls)
        return cls(**{name: _rich(types.get(name), value) for name, value in values.items()})


class Data(Struct):
    """What a device says of itself."""

    __slots__ = ()
    INTERFACE: ClassVar[str]
    NAME: ClassVar[str]
    SUBTYPE: ClassVar[int]


class Command(Struct):
    """What a device shall do; there is no answer."""

    __slots__ = ()
    INTERFACE: ClassVar[str]
    NAME: ClassVar[str]
    SUBTYPE: ClassVar[int]


class Request(Struct, Generic[R_co]):
    """What wants an answer, a `R_co`; None: it only succeeds or fails."""

    __slots__ = ()
    INTERFACE: ClassVar[str]
    NAME: ClassVar[str]
    SUBTYPE: ClassVar[int]


@dataclass(slots=True, frozen=True)
class Sample(Generic[D_co]):
    """What came last of one data message. Until `count` is 1, `value` holds defaults."""

    value: D_co
    count: int
    """How many have come."""
    arrival: float
    """When it was read here: seconds of `time.monotonic()`."""
    stamp: float
    """The server's: seconds since the epoch."""


class Received(typing.NamedTuple):
    """One data message out of `Robot.messages()`."""

    device: str
    """Such as "position2d:0"."""
    message: Data
    arrival: float
    """When it was read here: seconds of `time.monotonic()`."""
    stamp: float
    """The server's: seconds since the epoch."""


def _equal(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return bool(np.array_equal(a, b))  # type: ignore[arg-type]
    return a == b


def _plain(value: Any) -> Any:
    if isinstance(value, Struct):
        return value.to_dict()
    if isinstance(value, IntEnum):
        return int(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [_plain(element) for element in value]
    return value


def _rich(kind: Any, value: Any) -> Any:
    if isinstance(value, dict) and isinstance(kind, type) and issubclass(kind, Struct):
        return kind.from_dict(value)
    if isinstance(value, list) and typing.get_origin(kind) is list:
        return [_rich(typing.get_args(kind)[0], element) for element in value]
    if isinstance(value, list) and typing.get_origin(kind) is np.ndarray:
        return np.asarray(value, typing.get_args(typing.get_args(kind)[1])[0])
    if isinstance(kind, type) and issubclass(kind, IntEnum):
        return kind(value)
    return value


_known_types: dict[type, dict[str, Any]] = {}


def _types(kind: type) -> dict[str, Any]:
    if kind not in _known_types:
        _known_types[kind] = typing.get_type_hints(kind)
    return _known_types[kind]
