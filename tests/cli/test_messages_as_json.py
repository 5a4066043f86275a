# SPDX-License-Identifier: Apache-2.0
"""Every message that can be recorded: as JSON and back, and as the bytes that a replay sends."""

import dataclasses
import enum
import importlib
import itertools
import json
import pkgutil
import types
import typing

import jsonschema
import numpy as np
import pytest
import regista
from regista import message, recording

INTERFACES = [info.name for info in pkgutil.iter_modules(regista.__path__) if not info.ispkg]


def kinds(base):
    """[(interface, class)]"""
    found = []
    for name in INTERFACES:
        for kind in vars(importlib.import_module(f"regista.{name}")).values():
            if isinstance(kind, type) and issubclass(kind, base) and getattr(kind, "INTERFACE", None) == name:
                found.append((name, kind))
    return found


DATA = [(name, kind, kind.SUBTYPE, False) for name, kind in kinds(message.Data) if name != "player"]
ANSWERS = [
    (name, recording.reply_class(kind), kind.SUBTYPE, True)
    for name, kind in kinds(message.Request)
    if name != "player" and recording.reply_class(kind) is not None
]


def filled(kind, numbers):
    """A message in which no field has its default."""
    hints = typing.get_type_hints(kind)
    made = kind()
    for field in dataclasses.fields(kind):
        setattr(made, field.name, value(hints[field.name], getattr(made, field.name), numbers))
    return made


def value(hint, default, numbers):
    if typing.get_origin(hint) is types.UnionType:
        hint = next(each for each in typing.get_args(hint) if each is not types.NoneType)
    if typing.get_origin(hint) is list:
        return [filled(typing.get_args(hint)[0], numbers) for _ in range(2)]
    if typing.get_origin(hint) is np.ndarray:
        return np.array([next(numbers) for _ in range(len(default) or 3)], default.dtype)
    if issubclass(hint, message.Struct):
        return filled(hint, numbers)
    if issubclass(hint, enum.IntEnum):
        return list(hint)[-1]
    number = next(numbers)
    return {int: number, float: number + 0.5, str: f"text {number} \u00e9", bytes: bytes([number, 0, 255])}[hint]


@pytest.mark.parametrize(
    ("interface", "kind", "subtype", "answer"),
    [*DATA, *ANSWERS],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_a_message_is_the_same_on_the_wire_after_it_was_recorded(interface, kind, subtype, answer):
    before = filled(kind, itertools.cycle(range(1, 100)))
    text = json.dumps(recording.write(before), allow_nan=False)
    jsonschema.validate(json.loads(text), recording.schema(kind))
    find = recording.answer_class if answer else recording.data_class
    after = recording.read(find(interface, subtype), json.loads(text))
    assert after == before
    frame = regista.wire.frame(after, f"{interface}:7", subtype, answer=answer)
    assert frame == regista.wire.frame(before, f"{interface}:7", subtype, answer=answer)
    (decoded,) = regista.wire.decode(frame)
    header = decoded["header"]
    assert (header["addr"]["index"], header["type"], header["subtype"]) == (7, 4 if answer else 1, subtype)
    assert numbers_in(without_counts(decoded["fields"])) == numbers_in(before.to_dict())


def numbers_in(fields):
    """In order, without texts."""
    if isinstance(fields, dict):
        return [number for inner in fields.values() for number in numbers_in(inner)]
    if isinstance(fields, list | bytes):
        return [number for inner in fields for number in numbers_in(inner)]
    return [] if isinstance(fields, str) else [pytest.approx(fields)]


def without_counts(fields):
    """Of arrays: only the wire has them."""
    if isinstance(fields, dict):
        kept = (key for key in fields if not key.endswith("_count") or key.removesuffix("_count") not in fields)
        return {key: without_counts(fields[key]) for key in kept}
    return [without_counts(inner) for inner in fields] if isinstance(fields, list) else fields


def test_there_are_messages():
    assert len(DATA) > 15 and len(ANSWERS) > 5
