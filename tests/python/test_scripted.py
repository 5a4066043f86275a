# SPDX-License-Identifier: Apache-2.0
"""Devices that no simulation has, and a recorded stock server, from a socket that says what the test says."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import regista
from regista import aio, imu, localize
from scripted import ACK, COMMAND, DATA, NACK, REQUEST, obliging, pack

SESSIONS = Path(__file__).resolve().parents[1] / "data"


def serve(sent, *data):
    """Obliges, notes what is asked of devices, and sends the data once one is open."""

    def script(peer):
        while True:
            message = peer.next()
            if message.interface != 1:
                sent.append(message)
            peer.serve(message)
            if message.interface == 1 and message.subtype == 3 and message.body[16:20] == b"\0\0\0\1":
                for one in data:
                    peer.socket.sendall(one)

    return script


def test_gps(scripted):
    body = struct.pack(">IIiii4d", 1700000000, 500000, 522345678, 133456789, 81500, 0.5, 0.1, 1e5, 2e5)
    body += struct.pack(">4Idd", 1, 9, 11, 12, 1.5, 2.5)
    server = scripted(serve([], pack(13, 0, DATA, 1, body)))
    with regista.Robot("127.0.0.1", server.port) as robot:
        gps = robot.gps()
        assert robot.read(timeout=2)
        assert gps.latitude_deg == pytest.approx(52.2345678, abs=1e-9)
        assert gps.longitude_deg == pytest.approx(13.3456789, abs=1e-9)
        assert gps.altitude_m == pytest.approx(81.5)
        assert (gps.state.satellites, gps.state.vertical_error_m) == (9, 2.5)


def test_imu(scripted):
    sent = []
    samples = struct.pack(">9f", *range(1, 10))
    server = scripted(
        serve(
            sent,
            pack(60, 0, DATA, 1, struct.pack(">6d", 1, 2, 3, 4, 5, 6)),
            pack(60, 0, DATA, 2, samples),
            pack(60, 0, DATA, 3, samples + struct.pack(">4f", 1, 0, 0, 0)),
            pack(60, 0, DATA, 4, samples + struct.pack(">3d", 0.1, 0.2, 0.3)),
            pack(60, 0, DATA, 5, struct.pack(">18d", *range(18))),
        )
    )
    with regista.Robot("127.0.0.1", server.port) as robot:
        device = robot.imu()
        while device.count < 5:
            assert robot.read(timeout=2)
        assert device.state.pose.yaw == 6
        assert device.calibrated.rate_z == 6
        assert device.quaternion.q0 == 1
        assert device.quaternion.samples == device.calibrated
        assert device.euler.orientation.yaw == pytest.approx(0.3)
        assert device.full_state.acceleration.yaw == 17
        device.set_data_type(imu.Calibrated)
        device.reset_orientation()
        assert [(m.subtype, m.body[-1]) for m in sent] == [(1, 2), (2, 0)]


def test_dio_and_aio(scripted):
    sent = []
    server = scripted(
        serve(
            sent,
            pack(20, 0, DATA, 1, struct.pack(">II", 3, 0b101)),
            pack(21, 0, DATA, 1, struct.pack(">II4f", 4, 4, 1, 2, 3, 4)),
        )
    )
    with regista.Robot("127.0.0.1", server.port) as robot:
        dio, analog = robot.dio(), robot.device("aio:0")
        while not (dio.count and analog.count):
            assert robot.read(timeout=2)
        assert [dio.input(i) for i in range(4)] == [True, False, True, False]
        volts = analog.latest(aio.State).value.voltages_v
        assert volts.dtype == np.float32 and volts.tolist() == [1, 2, 3, 4]
        assert not volts.flags.owndata  # the message's own memory
        dio.set_outputs(2, 0b10)
        analog.send(aio.OutputCommand())
        robot.close()
    assert next((m.kind, m.body) for m in sent) == (COMMAND, struct.pack(">II", 2, 2))


def test_arrays_outlive_the_messages_that_brought_them(scripted):
    server = scripted(serve([], *(pack(21, 0, DATA, 1, struct.pack(">II2f", 2, 2, i, -i)) for i in range(1, 1001))))
    with regista.Robot("127.0.0.1", server.port) as robot:
        analog = robot.device("aio:0")
        robot.record()
        while analog.count < 1000 - robot.counters()["superseded"]:
            assert robot.read(timeout=2)
        arrays = [m.message.voltages_v for m in robot.messages()]
    assert arrays[-1].tolist() == [1000, -1000]
    assert all(array[0] == -array[1] for array in arrays)


def test_lists_of_structs(scripted):
    body = struct.pack(">IdII", 0, 0.0, 2, 2)
    body += struct.pack(">3d6dd", 1, 2, 3, *range(6), 0.25) + struct.pack(">3d6dd", 4, 5, 6, *range(6), 0.75)
    server = scripted(serve([], pack(25, 0, DATA, 1, body)))
    with regista.Robot("127.0.0.1", server.port) as robot:
        device = robot.device("localize:0")
        while not device.count:
            assert robot.read(timeout=2), robot.counters()
        hypotheses = device.latest(localize.State).value.hypotheses
        assert [h.mean.x for h in hypotheses] == [1, 4]
        assert hypotheses[1].covariance.tolist() == list(range(6))


def test_bytes_that_are_no_text_survive(scripted):
    def script(peer):
        while True:
            message = peer.next()
            if message.kind == REQUEST and message.subtype == 250:
                text = b"caf\xe9\0"
                name = struct.pack(">II", len(text), len(text)) + text.ljust(8, b"\0")
                peer.answer(message, ACK, name + name)
            else:
                peer.serve(message)

    server = scripted(script)
    with regista.Robot("127.0.0.1", server.port) as robot:
        value = robot.position2d().property("name", str)
        assert value.encode("utf-8", "surrogateescape") == b"caf\xe9"


def test_a_stock_server_says_no_without_a_reason(scripted):
    def script(peer):
        while True:
            message = peer.next()
            if message.interface == 4:
                peer.answer(message, NACK)
            else:
                peer.serve(message)

    server = scripted(script)
    with regista.Robot("127.0.0.1", server.port) as robot:
        base = robot.position2d()
        assert not robot.extended
        assert base.motion() is None
        base.take()  # everybody may
        with pytest.raises(regista.RefusedError, match="SET_ODOM refused: no reason given"):
            base.reset_odometry()
        with pytest.raises(regista.RefusedError, match="a stock Player server cannot do this"):
            robot.status()


def test_a_recorded_stock_session_drives_our_proxies_to_the_recorded_values(scripted):
    """The stock server's side byte for byte; what our client says must be what the stock client said."""
    session = json.loads((SESSIONS / "player-session-playerprint.json").read_text())
    mismatches = []

    def script(peer):
        for chunk in session["chunks"]:
            if "hex" not in chunk:
                break
            data = bytes.fromhex(chunk["hex"])
            if chunk["dir"] == "s2c":
                if data.startswith(b"Player v."):
                    data = data[32:]  # the greeting
                peer.socket.sendall(data)
                continue
            while data:
                size = 40 + struct.unpack(">I", data[36:40])[0]
                expected = struct.unpack(">6I", data[:24])[2:]
                message = peer.next()
                if (message.interface, message.subtype) == (1, 100):
                    peer.answer(message, NACK)  # EXTEND: unknown to a stock server
                    message = peer.next()
                if (message.interface, message.index, message.kind, message.subtype) != expected:
                    mismatches.append((expected, message))
                    return
                if message.body != data[40:size]:
                    mismatches.append((data[40:size], message))
                data = data[size:]
        while True:
            peer.answer(peer.next(), NACK)

    server = scripted(script)
    robot = regista.Robot("127.0.0.1", server.port, mode="pull")
    assert robot.server == "Player v.3.1.1-dev"
    reads = replay(robot, session["messages"])
    robot.close()
    assert mismatches == []
    assert reads >= 15


def replay(robot, messages):
    reads = 0
    for i, message in enumerate(messages):
        if message["dir"] != "c2s":
            continue
        came = []
        for other in messages[i + 1 :]:
            if other["dir"] != "s2c":
                break
            came.append(other)
        states = [m for m in came if m["name"] == "position2d.STATE"]
        fields, what = message["fields"], message["name"]
        if what == "player.DEV" and fields["access"] == 1:
            robot.position2d() if fields["addr"]["interf"] == 4 else robot.power()
        elif what == "player.DEV":
            break
        elif what == "player.DATA":
            sample = robot.position2d().latest("STATE")
            while sample.stamp < states[-1]["timestamp"]:
                assert robot.read(timeout=2)
                sample = robot.position2d().latest("STATE")
            state, expected = sample.value, states[-1]["fields"]
            assert [state.pose.x, state.pose.y, state.pose.heading] == list(expected["pos"].values())
            assert [state.velocity.x, state.velocity.y, state.velocity.w] == list(expected["vel"].values())
            assert state.stalled == expected["stall"]
            reads += 1
        else:
            assert what == "player.DATAMODE"
    return reads


def test_the_listening_socket_is_no_player(scripted):
    server = scripted(obliging, b"SSH-2.0-OpenSSH_9.2p1 Debian-2+d")
    with pytest.raises(regista.ConnectionError, match=r"it greets with 'SSH-2.0.*another service answers"):
        regista.Robot("127.0.0.1", server.port)
