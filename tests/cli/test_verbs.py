# SPDX-License-Identifier: Apache-2.0
"""Every verb against a real server: what it says, and how it ends."""

import itertools
import json
import os
import signal
import socket
import struct
import subprocess
import time

import pytest
import regista
from command_line import REGISTA, ROOT, Server, Terminal, environment, run, wait_for
from scripted import ACK, REQUEST, ScriptedServer, state

NOBODY = "127.0.0.1:1"  # nobody listens there


def owner(server, device=0, name="nav@laptop", priority=30):
    """A client that drives, as long as it is used."""
    robot = regista.Robot("127.0.0.1", server.port, name=name, priority=priority)
    robot.position2d(device).take()
    return robot


def test_list(sim):
    done = sim.run("list")
    assert done.returncode == 0
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0] == ["DEVICE", "DRIVER"]
    assert ["position2d:0", "simulated_base"] in lines
    assert {"device": "kicker:0", "driver": "simulated_kicker"} in sim.json("list")


def test_robot_from_the_environment(sim):
    assert run("list", env={"REGISTA_ROBOT": sim.robot}).returncode == 0


def test_info(sim):
    told = sim.json("info", "position2d")
    assert told["driver"] == "simulated_base"
    assert told["GET_GEOM"]["size"]["length"] > 0
    assert 50 < told["rates_hz"]["STATE"] < 150
    assert "simulated_base" in sim.run("info", "position2d:0").stdout


def test_print_counts_and_json(sim):
    done = sim.run("print", "position2d", "--count", 3, "--json")
    assert done.returncode == 0
    messages = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(messages) == 3
    assert messages[0]["device"] == "position2d:0" and messages[0]["message"] == "STATE"
    assert set(messages[0]["pose"]) == {"x", "y", "heading"}
    assert messages[0]["stamp"] < messages[1]["stamp"] < messages[2]["stamp"]


def test_print_text(sim):
    done = sim.run("print", "power:0", "-n", 1)
    assert done.returncode == 0
    assert "STATE" in done.stdout and "voltage_v" in done.stdout


def test_print_rate(sim):
    done = sim.run("print", "position2d", "--rate", 10, "--count", 5, "--json")
    stamps = [json.loads(line)["stamp"] for line in done.stdout.splitlines()]
    steps = [b - a for a, b in itertools.pairwise(stamps)]
    assert len(stamps) == 5 and min(steps) > 0.05


def test_print_of_a_device_that_is_not_there(sim):
    done = sim.run("print", "imu:3", "-n", 1)
    assert done.returncode == 4
    assert "imu:3" in done.stderr and done.stdout == ""


def test_print_of_a_device_that_says_nothing(tmp_path):
    config = tmp_path / "mute.cfg"
    os.mkfifo(tmp_path / "frames")
    config.write_text('driver ( name "playback" provides ["power:0"] input "frames" )\n')
    with Server(config) as server:
        done = server.run("print", "power", "--timeout", 0.5)
    assert done.returncode == 5
    assert "power:0" in done.stderr and "500 ms" in done.stderr


def test_status_clients_and_doctor(fresh):
    with owner(fresh) as robot:
        told = fresh.json("status")
        assert {driver["name"] for driver in told["drivers"]} >= {"simulated_base", "simulated_battery"}
        assert any(client["name"] == "nav@laptop" for client in fresh.json("clients"))
        assert "nav@laptop" in fresh.run("clients").stdout
        shown = fresh.run("status").stdout
        assert "simulated_base" in shown
        robot.read(timeout=0)
    findings = fresh.json("doctor")
    assert {finding["health"] for finding in findings} <= {"OK", "WARN", "ERROR", "STALE"}
    assert any(finding["thing"] == "driver simulated_base" for finding in findings)


def test_doctor_finds_a_fault(tmp_path):
    (tmp_path / "empty").write_bytes(b"")
    config = tmp_path / "faulty.cfg"
    config.write_text('driver ( name "playback" provides ["position2d:0"] input "empty" alwayson yes )\n')
    with Server(config) as server:
        done = server.run("doctor")
        assert done.returncode == 1
        assert "ERROR driver playback: " in done.stdout


def test_doctor_finds_who_is_silent(tmp_path):
    os.mkfifo(tmp_path / "frames")
    feeder = os.open(tmp_path / "frames", os.O_RDWR)  # who says nothing
    config = tmp_path / "mute.cfg"
    config.write_text('driver ( name "playback" provides ["power:0"] input "frames" rate 50 )\n')
    with Server(config) as server, regista.Robot("127.0.0.1", server.port) as robot:
        robot.power()
        done = server.run("doctor")
    os.close(feeder)
    assert done.returncode == 1
    assert "STALE power:0: said nothing for 1 s" in done.stdout


def test_get_and_set(fresh):
    assert fresh.json("get", "position2d", "noise")["value"] == 0.01
    assert fresh.run("set", "position2d", "noise", 0.25).returncode == 0
    assert fresh.run("get", "position2d", "noise").stdout == "0.25\n"
    assert fresh.run("set", "position2d", "noise", 1).returncode == 0  # a whole number is a number
    assert fresh.json("get", "position2d", "noise")["value"] == 1.0
    negative = fresh.run("set", "position2d", "noise", -0.5)
    assert negative.returncode == 4 and "noise" in negative.stderr, "the driver's word, not the shell's"
    wrong = fresh.run("set", "position2d", "noise", "loud")
    assert wrong.returncode == 2 and "noise of position2d:0 is a number, not 'loud'" in wrong.stderr
    unknown = fresh.run("get", "position2d", "colour")
    assert unknown.returncode == 4 and "position2d:0" in unknown.stderr


def test_odom(fresh):
    assert fresh.run("odom", "--set", 1, 2, 0.5).returncode == 0
    told = fresh.json("odom")
    assert told["x"] == pytest.approx(1, abs=0.05) and told["y"] == pytest.approx(2, abs=0.05)
    assert "x 1.0" in fresh.run("odom").stdout
    assert abs(fresh.json("odom", "--reset")["x"]) < 0.05
    assert fresh.run("odom", "power:0").returncode == 2


def test_kick(fresh):
    def kicks():
        return json.loads(fresh.run("print", "kicker", "-n", 1, "--json").stdout)["kick_count"]

    with regista.Robot("127.0.0.1", fresh.port) as robot:  # keeps the driver open, and so its count
        kicker = robot.kicker()
        wait_for(lambda: robot.read(timeout=0.1) and kicker.count)
        for _ in range(3):  # each of them is told, however soon after the last one
            empty = fresh.run("kick", 3)
            assert empty.returncode == 4 and "the capacitor has" in empty.stderr
        assert fresh.run("kick", 3, "--charge").returncode == 0
        assert kicks() == 1
        assert fresh.run("kick", 3, "--chip", 0.8, "--charge").returncode == 0
        assert kicks() == 2
    assert fresh.run("kick", -1).returncode == 2


def test_kick_while_somebody_else_owns_the_kicker(fresh):
    with regista.Robot("127.0.0.1", fresh.port, name="striker@field", priority=30) as other:
        kicker = other.kicker()
        kicker.take("kick")
        process = fresh.start("kick", 3, stderr=subprocess.PIPE)
        while process.poll() is None:  # an owner that is idle for the lease owns no more
            kicker.charge(True)
            other.read(timeout=0.05)
        errors = process.stderr.read()
        process.stderr.close()
        assert process.returncode == 4
        assert "kicker:0" in errors and 'owned by "striker@field"' in errors


def test_stop_is_for_everybody(fresh):
    with owner(fresh) as robot:
        base = robot.position2d()
        base.set_velocity(x=0.3)
        wait_for(lambda: robot.read(timeout=0.1) and base.motion().state.name == "driving")
        assert fresh.run("stop").returncode == 0
        wait_for(lambda: robot.read(timeout=0.1) and not base.motion().owner)


def test_bench(sim):
    told = sim.json("bench", "--count", 50)
    assert set(told) == {"regista client", "raw socket, same server", "TCP echo on this machine"}
    for durations in told.values():
        assert 0 < durations["p50_us"] <= durations["p99_us"] <= durations["max_us"]
    assert "ROUND TRIP" in sim.run("bench", "-n", 50).stdout


MESSAGE = "0100007f00001a090000000400000000000000040000000200000000000000000000000000000000"


def test_wire_there_and_back():
    decoded = run("wire", "decode", MESSAGE)
    assert decoded.returncode == 0
    assert json.loads(decoded.stdout)["header"]["addr"]["interf"] == 4
    assert run("wire", "encode", input=decoded.stdout).stdout == MESSAGE + "\n"
    assert run("wire", "decode", input=MESSAGE + "\n").stdout == decoded.stdout


def test_wire_tells_the_line_that_is_wrong_and_goes_on():
    done = run("wire", "decode", input=f"nonsense\n{MESSAGE}\n{MESSAGE[:-2]}\n")
    assert done.returncode == 1
    assert len(done.stdout.splitlines()) == 1
    assert done.stderr.splitlines()[0].startswith("line 1: ") and "line 3: " in done.stderr


def test_wire_encodes_no_nonsense():
    right = json.loads(run("wire", "decode", MESSAGE).stdout)
    wrong = ["{", "[1]", "NaN", "1e999", '"\\ud800"', "9" * 400, "[" * 100_000]
    inside = [json.dumps({**right, "fields": {"vel": 0}}).replace('{"vel": 0}', text) for text in wrong]
    done = run("wire", "encode", input="\n".join([*wrong, *inside, json.dumps(right)]) + "\n")
    assert (done.returncode, done.stdout) == (1, MESSAGE + "\n")
    told = [line.split(":")[0] for line in done.stderr.splitlines()]
    assert told == [f"line {number + 1}" for number in range(len(wrong + inside))]


VERBS = [
    ["list"],
    ["info", "position2d"],
    ["print", "position2d"],
    ["status"],
    ["clients"],
    ["doctor"],
    ["get", "position2d", "noise"],
    ["set", "position2d", "noise", "0.01"],
    ["odom"],
    ["kick", "1"],
    ["stop"],
    ["bench"],
    ["record", "never.mcap"],
]


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
def test_nobody_answers(verb, tmp_path):
    done = run(*verb, "--robot", NOBODY, cwd=tmp_path)
    assert done.returncode == 3
    assert "127.0.0.1:1" in done.stderr and "regista-server" in done.stderr and "Traceback" not in done.stderr
    assert done.stdout == "" and not list(tmp_path.iterdir())


def test_nobody_answers_who_could_be_driven():
    with Terminal("drive", "--robot", NOBODY) as terminal:
        assert terminal.end() == 3
        assert NOBODY in terminal.shown
    done = run("joy", "--pad", "/dev/null", "--robot", NOBODY)
    assert done.returncode == 3 and NOBODY in done.stderr


def test_a_host_that_does_not_exist():
    done = run("list", "--robot", "no-such-robot.invalid")
    assert done.returncode == 3 and "no-such-robot.invalid" in done.stderr


def test_a_server_that_says_nothing():
    with socket.create_server(("127.0.0.1", 0)) as mute:
        done = run("list", "--robot", f"127.0.0.1:{mute.getsockname()[1]}", "--timeout", 0.5)
    assert done.returncode == 3
    assert "127.0.0.1" in done.stderr and "no answer in time" in done.stderr


@pytest.mark.parametrize(
    ("robot", "text"),
    [
        ("host:port", "port"),
        ("host:70000", "65535"),
        (":6665", "no host"),
        ("[::1", "[::1]:6665"),
    ],
)
def test_addresses_that_are_none(robot, text):
    done = run("list", "--robot", robot)
    assert done.returncode == 2 and text in done.stderr


def test_ipv6(sim):
    assert (
        run("list", "--robot", f"[::1]:{sim.port}").returncode == 3
    )  # it listens on IPv4 only, and the text says where


@pytest.mark.parametrize(
    "arguments",
    [
        ["lst"],
        ["list", "--nonsense"],
        ["print"],
        ["kick", "fast"],
        ["print", "a:b"],
        ["get", "teapot:0", "noise"],
        ["info", "position2d:65536"],
    ],
)
def test_wrong_usage(arguments):
    done = run(*arguments)
    assert done.returncode == 2 and done.stderr and done.stdout == ""


def test_help_has_examples_and_exit_codes():
    done = run("--help")
    assert done.returncode == 0
    for text in ("Examples:", "regista drive", "Exit codes:", "130", "list", "doctor"):
        assert text in done.stdout
    for verb in (*(verb[0] for verb in VERBS), "drive", "joy", "replay", "plot"):
        told = run(verb, "--help").stdout
        assert f"Examples:\n    regista {verb}" in told
    assert run("--version").stdout.startswith("regista ")


def test_a_reader_that_has_enough_is_no_failure(sim):
    command = f"set -o pipefail; {' '.join(REGISTA)} print position2d --robot {sim.robot} | head -n 2"
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False, env=environment()
    )
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) == 2 and done.stderr == ""


READING = ["list", "info position2d", "print power", "status", "clients", "doctor", "get position2d noise", "odom"]


@pytest.mark.parametrize("verb", [*READING, "status --json", "bench -n 10", f"wire decode {MESSAGE}"])
def test_a_reader_that_has_gone_is_no_failure(sim, verb):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        robot = {} if verb.startswith("wire") else {"REGISTA_ROBOT": sim.robot}
        done = run(*verb.split(), env=robot, capture_output=False, stdout=writer, stderr=subprocess.PIPE)
    finally:
        os.close(writer)
    assert done.returncode == 0 and done.stderr == ""


def test_ctrl_c_ends_with_130(sim):
    process = sim.start("print", "position2d", "--json", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert json.loads(process.stdout.readline())
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130 and "Traceback" not in errors


def test_watching_ends_with_ctrl_c(sim):
    with Terminal("status", "--watch", "--robot", sim.robot) as terminal:
        terminal.wait_for("simulated_base")
        os.killpg(terminal.process.pid, signal.SIGINT)
        assert terminal.end() == 130


@pytest.fixture
def stock():
    """A Player server without our extension, as far as these verbs need it."""

    def serve(peer):
        while True:
            message = peer.next()
            if message.interface == 1 and message.subtype == 1:  # DEVLIST: position2d:0
                peer.answer(message, ACK, struct.pack(">2I4I", 1, 1, 0, 0, 4, 0))
            elif message.interface == 1 and message.subtype == 2:  # DRIVERINFO
                peer.answer(message, ACK, message.body[:16] + struct.pack(">II4s", 3, 3, b"p2\0"))
            else:
                peer.serve(message)
            if message.interface == 1 and message.subtype == 3 and message.kind == REQUEST:
                for x in range(3):
                    peer.socket.sendall(state(x, stamp=1000 + x))

    server = ScriptedServer(serve)
    yield f"127.0.0.1:{server.port}"
    server.close()


def test_a_stock_player_server(stock):
    done = run("list", "--robot", stock)
    assert done.returncode == 0 and done.stdout.split() == ["DEVICE", "DRIVER", "position2d:0", "p2"]
    done = run("print", "position2d", "-n", 1, "--json", "--robot", stock)
    assert json.loads(done.stdout)["pose"]["x"] in (0, 1, 2)
    done = run("doctor", "--robot", stock)
    assert done.returncode == 0 and "WARN  server: a stock Player server" in done.stdout
    done = run("status", "--robot", stock)
    assert done.returncode == 4 and stock in done.stderr


def test_no_color_and_pipes_have_no_escapes(sim):
    for env in ({}, {"NO_COLOR": "1"}):
        assert "\x1b[" not in sim.run("doctor", env=env).stdout


def test_completion_scripts():
    done = run("--show-completion", "bash")
    assert done.returncode == 0 and "_REGISTA_COMPLETE" in done.stdout


def test_a_server_that_goes_away_while_printing(tmp_path):
    with Server(ROOT / "examples/sim.cfg") as server:
        process = server.start("print", "position2d", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        process.stdout.readline()
        server.process.kill()
        began = time.monotonic()
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 3, errors
        assert time.monotonic() - began < 20 and "Traceback" not in errors
