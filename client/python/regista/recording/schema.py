# SPDX-License-Identifier: Apache-2.0
"""Messages as JSON: their schemas, derived from the descriptions of their fields, and their values."""

from __future__ import annotations

import base64
import dataclasses
import enum
import functools
import importlib
import inspect
import math
import re
import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from regista import message

S = TypeVar("S", bound=message.Struct)
F = TypeVar("F", bound=Callable[..., Any])


def _cache(function: F) -> F:
    """For mypy, to which a class is not hashable when its instances are not."""
    return typing.cast("F", functools.cache(function))


# "        voltage: [V] of the pack": a line of a class's docstring.
_FIELD = re.compile(r"^ +(\w+): *(.*)$", re.MULTILINE)


@_cache
def schema(kind: type[message.Struct]) -> dict[str, Any]:
    """The JSON Schema of a message; units and meanings are its descriptions."""
    docs = dict(_FIELD.findall((inspect.getdoc(kind) or "").partition("Attributes:")[2]))
    properties = {}
    for name, hint in _hints(kind).items():
        properties[name] = _schema_of(hint)
        if docs.get(name):
            properties[name] = {**properties[name], "description": docs[name]}
    return {"title": _title(kind), "type": "object", "properties": properties}


def write(value: message.Struct) -> dict[str, Any]:
    """What the schema describes. Bytes are base64; what JSON cannot say of numbers are the strings nan, inf, -inf."""
    return typing.cast("dict[str, Any]", _write(value.to_dict()))


def read(kind: type[S], values: dict[str, Any]) -> S:
    """The reverse of `write`."""
    return kind.from_dict({name: _read(hint, values[name]) for name, hint in _hints(kind).items() if name in values})


@_cache
def data_class(interface: str, subtype: int) -> type[message.Data] | None:
    """The class of a data message; None when this version does not know it."""
    return next((kind for kind in _messages(interface, message.Data) if subtype == kind.SUBTYPE), None)


@_cache
def answer_class(interface: str, subtype: int) -> type[message.Struct] | None:
    """The class of the answer to a request; None when this version does not know it."""
    asked = next((kind for kind in _messages(interface, message.Request) if subtype == kind.SUBTYPE), None)
    return None if asked is None else reply_class(asked)


def _messages(interface: str, base: type[S]) -> list[type[S]]:
    try:
        module = importlib.import_module(f"regista.{interface}")
    except ModuleNotFoundError:
        return []
    found = (kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, base))
    return [kind for kind in found if hasattr(kind, "SUBTYPE")]


@_cache
def _hints(kind: type[message.Struct]) -> dict[str, Any]:
    hints = typing.get_type_hints(kind)
    fields = dataclasses.fields(typing.cast(Any, kind))  # all messages are dataclasses, though Struct is none
    return {field.name: hints[field.name] for field in fields}


def _title(kind: type[message.Struct]) -> str:
    return f"{kind.__module__.rpartition('.')[2]}.{kind.__name__}"


def _optional(hint: Any) -> Any:
    """T of "T | None", else nothing."""
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        return next(argument for argument in typing.get_args(hint) if argument is not type(None))
    return None


def _schema_of(hint: Any) -> dict[str, Any]:
    if (inner := _optional(hint)) is not None:
        return _schema_of(inner)
    if typing.get_origin(hint) is list:
        return {"type": "array", "items": _schema_of(typing.get_args(hint)[0])}
    if typing.get_origin(hint) is np.ndarray:
        element = typing.get_args(typing.get_args(hint)[1])[0]
        return {"type": "array", "items": {"type": "integer" if issubclass(element, np.integer) else "number"}}
    if issubclass(hint, message.Struct):
        return schema(hint)
    if issubclass(hint, enum.IntEnum):
        return {"type": "integer", "oneOf": [{"title": each.name, "const": each.value} for each in hint]}
    if issubclass(hint, bytes):
        return {"type": "string", "contentEncoding": "base64"}
    return {"type": {bool: "boolean", int: "integer", float: "number", str: "string"}[hint]}


def _write(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _write(element) for key, element in value.items() if element is not None}
    if isinstance(value, list):
        return [_write(element) for element in value]
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def _read(hint: Any, value: Any) -> Any:
    if (inner := _optional(hint)) is not None:
        return None if value is None else _read(inner, value)
    if isinstance(value, list):
        if typing.get_origin(hint) is np.ndarray:
            return [float(element) if isinstance(element, str) else element for element in value]
        return [_read(typing.get_args(hint)[0], element) for element in value]
    if isinstance(hint, type) and issubclass(hint, message.Struct):
        return {name: _read(inner, value[name]) for name, inner in _hints(hint).items() if name in value}
    if hint is float and isinstance(value, str):
        return float(value)
    if hint is bytes:
        return base64.b64decode(value)
    return value


@_cache
def descriptions(interface: str) -> tuple[message.Request[Any], ...]:
    """The requests that ask a device of this interface what it is, such as its geometry, and change nothing."""
    asking = (kind for kind in _messages(interface, message.Request) if kind.__name__.startswith("Get"))
    return tuple(kind() for kind in asking if not _hints(kind) and reply_class(kind) is not None)


def reply_class(kind: type[message.Request[Any]]) -> type[message.Struct] | None:
    """What answers a request; None: it only succeeds or fails."""
    (reply,) = typing.get_args(kind.__orig_bases__[0])  # type: ignore[attr-defined]
    if isinstance(reply, typing.ForwardRef):
        reply = getattr(inspect.getmodule(kind), reply.__forward_arg__)
    return None if reply in (None, type(None)) else reply


def text(values: Any) -> str:
    """For people: "pose (x 1.2, y 0, heading 0.3) stalled 0"."""
    if isinstance(values, dict):
        return " ".join(
            f"{name} ({', '.join(text({key: value}) for key, value in inner.items())})"
            if isinstance(inner, dict)
            else f"{name} {text(inner)}"
            for name, inner in values.items()
        )
    if isinstance(values, list):
        return "[" + " ".join(text(value) for value in values) + "]"
    return f"{values:.6g}" if isinstance(values, float) else str(values)
