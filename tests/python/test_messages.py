# SPDX-License-Identifier: Apache-2.0
"""The classes of the messages, and the values that pass through them."""

import copy
import dataclasses
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import regista
from regista import _core, actarray, joystick, kicker, message, opaque, planner, player, position2d

GOLDEN = [
    vector
    for vector in json.loads((Path(__file__).resolve().parents[1] / "data/player-golden.json").read_text())
    if "message_hex" in vector and _core.device_name(vector["interface"], 0)[:10] != "interface "
]
MODULES = [
    getattr(regista, name)
    for name in regista.__all__
    if getattr(regista, name).__class__.__name__ == "module" and name not in ("wire",)
]
INTERFACES = {module.__name__.removeprefix("regista.") for module in MODULES} - {"geometry"}


def structs():
    return [
        kind
        for module in MODULES
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, message.Struct) and kind.__module__ == module.__name__
    ]


def test_every_message_of_the_stock_library_has_its_class():
    """What the golden vectors name, Python has, under the same interface, kind and subtype."""
    universal = 247  # the first subtype of those that every interface has: Python has methods for them
    codes = {name: _core.device_code(f"{name}:0")[0] for name in INTERFACES - {"player"}} | {"player": 1}
    kinds = {message.Data: 1, message.Command: 2, message.Request: 3}
    ours = {
        (codes[kind.INTERFACE], kinds[next(k for k in kinds if issubclass(kind, k))], kind.SUBTYPE)
        for kind in structs()
        if hasattr(kind, "INTERFACE")
    }
    theirs = {(v["interface"], v["type"], v["subtype"]) for v in GOLDEN if v["type"] in (1, 2, 3)}
    theirs = {key for key in theirs if key[2] < universal}
    assert len(theirs) > 30
    assert theirs - ours == set()


@pytest.mark.parametrize("kind", structs(), ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
def test_structs_copy_compare_and_go_through_dicts(kind):
    value = kind()
    assert kind.__doc__ and "(" not in kind.__doc__.splitlines()[0]
    assert kind.from_dict(value.to_dict()) == value
    assert copy.deepcopy(value) == value
    assert pickle.loads(pickle.dumps(value)) == value
    json.dumps(_bytes_as_lists(value.to_dict()))
    for field in dataclasses.fields(value):
        assert field.name in kind.__doc__


def _bytes_as_lists(value):
    if isinstance(value, bytes):
        return list(value)
    return {k: _bytes_as_lists(v) for k, v in value.items()} if isinstance(value, dict) else value


def test_numbers_are_arrays_and_lists_become_them():
    state = joystick.State.from_dict({"positions": [1, 2, 3, 4, 5, 6, 7, 8]})
    assert state.positions.dtype == np.int32
    assert state != joystick.State()
    assert state == joystick.State(positions=np.arange(1, 9, dtype=np.int32))


def test_nested_lists_of_structs_come_back_as_structs():
    waypoints = planner.Waypoints(waypoints=[regista.Pose2d(1, 2, 3)])
    assert planner.Waypoints.from_dict(waypoints.to_dict()) == waypoints


def test_unknown_names_are_refused():
    with pytest.raises(TypeError, match="velocitty"):
        position2d.VelocityCommand(velocitty=1)  # type: ignore[call-arg]


def test_units_are_in_the_docs():
    assert "x: [m/s]" in (regista.BodyVelocity.__doc__ or "")
    assert "speed_mps: [m/s] of the ball" in (kicker.KickCommand.__doc__ or "")


@pytest.mark.parametrize(
    ("command", "error", "text"),
    [
        (kicker.ChargeCommand(on=256), ValueError, r"kicker.ChargeCommand.on: .*from 0 to 255, not 256"),
        (kicker.ChargeCommand(on=2**70), ValueError, r"from 0 to 255"),
        (kicker.ChargeCommand(on=0.5), TypeError, r"ChargeCommand.on: wants a whole number, not 'float'"),
        (kicker.KickCommand(speed_mps=1e300), ValueError, r"KickCommand.speed_mps: .*too large for 32 bits"),
        (kicker.KickCommand(speed_mps="fast"), TypeError, r"KickCommand.speed_mps: wants a number, not 'str'"),
        (kicker.GetLimits(), TypeError, r"wants a command, not 'GetLimits'"),
        (5.0, TypeError, r"wants a command, not 'float'"),
    ],
)
def test_what_is_no_command_is_told_by_name(port, command, error, text):
    with regista.Robot("127.0.0.1", port) as robot, pytest.raises(error, match=text):
        robot.kicker().send(command)


def test_fields_that_are_not_what_they_should_be_are_told_with_their_path(port):
    with regista.Robot("127.0.0.1", port) as robot:
        base = robot.device("position2d:0")
        wrong = position2d.VelocityCommand(velocity=regista.Pose2d())  # type: ignore[arg-type]
        with pytest.raises(TypeError, match=r"position2d.VelocityCommand.velocity: wants a BodyVelocity, not 'Pose2d'"):
            base.send(wrong)
        with pytest.raises(TypeError, match=r"opaque.Command.bytes: wants bytes, not 'str'"):
            robot.opaque().send(opaque.Command(bytes="abc"))  # type: ignore[arg-type]
        with pytest.raises(TypeError, match=r"is no data of interface position2d"):
            base.latest(actarray.State)
        with pytest.raises(regista.Error, match="holds too many elements"):
            robot._core.post(player.Take(group="g" * 40), lambda value, error: None)


def test_wire_round_trips_the_golden_vectors():
    for vector in GOLDEN:
        data = bytes.fromhex(vector["message_hex"])
        (decoded,) = regista.wire.decode(data)
        assert decoded["header"] == vector["header"]
        if vector["type"] in (1, 2):
            assert decoded["fields"] == vector["fields"]
        assert regista.wire.encode(decoded) == data
    everything = b"".join(bytes.fromhex(vector["message_hex"]) for vector in GOLDEN)
    assert len(regista.wire.decode(everything)) == len(GOLDEN)


def test_wire_tells_what_is_wrong():
    with pytest.raises(ValueError, match="byte 0: 5 bytes are no whole message"):
        regista.wire.decode(b"12345")
    with pytest.raises(ValueError, match="missing"):
        regista.wire.encode({"header": {}})
