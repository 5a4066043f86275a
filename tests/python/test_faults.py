# SPDX-License-Identifier: Apache-2.0
"""Servers that are not there, die, stop and flood; signals, forks and threads. Never a hang."""

import builtins
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
import regista
from scripted import BANNER, obliging, pack, state

TIMEOUT = 0.5
NOISE = 1.5  # s that a loaded machine may add


class Watch:
    """The block raises within `limit` seconds."""

    def __init__(self, limit):
        self.limit = limit

    def __enter__(self):
        self.begin = time.monotonic()

    def __exit__(self, *_):
        assert time.monotonic() - self.begin < self.limit + NOISE


def test_nobody_listens():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with Watch(TIMEOUT), pytest.raises(regista.ConnectionError, match="is the server running") as raised:
        regista.Robot("127.0.0.1", port, timeout=TIMEOUT)
    assert isinstance(raised.value, builtins.ConnectionError) and isinstance(raised.value, regista.Error)
    assert (raised.value.host, raised.value.port, raised.value.asked) == ("127.0.0.1", port, "connect")
    copied = pickle.loads(pickle.dumps(raised.value))
    assert (str(copied), copied.port) == (str(raised.value), port)


def test_a_name_without_an_address():
    with pytest.raises(regista.ConnectionError, match=r"no-such-host\.invalid"):
        regista.Robot("no-such-host.invalid", timeout=TIMEOUT)


def test_a_listener_that_never_accepts():
    refused = pytest.raises(regista.ConnectionError, match="no greeting")
    with socket.create_server(("127.0.0.1", 0)) as listener, Watch(TIMEOUT), refused:
        regista.Robot("127.0.0.1", listener.getsockname()[1], timeout=TIMEOUT)


def test_a_killed_server(start):
    server = start()
    robot = regista.Robot("127.0.0.1", server.port, timeout=TIMEOUT)
    base = robot.position2d()
    server.process.kill()
    with Watch(TIMEOUT), pytest.raises(regista.ConnectionError, match=r"read: .*robot.reconnect\(\)"):
        while True:
            robot.read(timeout=5)
    with pytest.raises(regista.ConnectionError):
        base.set_velocity(x=0.1)
    with pytest.raises(regista.ConnectionError):
        base.geometry()
    assert not robot.connected
    with pytest.raises(regista.ConnectionError):
        robot.reconnect()
    robot.close()


def test_a_stopped_server(start):
    server = start()
    with regista.Robot("127.0.0.1", server.port, timeout=TIMEOUT) as robot:
        base = robot.position2d()
        os.kill(server.process.pid, signal.SIGSTOP)
        with Watch(TIMEOUT), pytest.raises(regista.TimeoutError, match="GET_GEOM: 500 ms: no answer") as raised:
            base.geometry()
        assert isinstance(raised.value, builtins.TimeoutError)
        with Watch(2 * TIMEOUT), pytest.raises(regista.TimeoutError, match="the server has been silent for"):
            while True:
                robot.read(timeout=5)


def test_a_cable_that_swallows_all(scripted):
    """Half open: it shook hands, and then says nothing more and reads nothing."""
    silent = threading.Event()

    def script(peer):
        while True:
            message = peer.next()
            peer.serve(message)
            if (message.interface, message.subtype) == (1, 3):
                silent.wait()
                return

    server = scripted(script)
    robot = regista.Robot("127.0.0.1", server.port, timeout=TIMEOUT)
    robot.position2d()
    with Watch(TIMEOUT), pytest.raises(regista.TimeoutError):
        robot.read(timeout=10)
    with Watch(TIMEOUT):
        robot.close()
    silent.set()


def test_a_server_that_takes_no_bytes(scripted):
    silent = threading.Event()

    def script(peer):
        for _ in range(4):
            peer.serve(peer.next())
        silent.wait()

    server = scripted(script)
    robot = regista.Robot("127.0.0.1", server.port, timeout=TIMEOUT)
    opaque = robot.opaque()
    with Watch(5), pytest.raises(regista.TimeoutError, match="the server takes no bytes"):
        for _ in range(10_000):
            opaque.send_bytes(bytes(10_000))
    silent.set()
    with Watch(2 * TIMEOUT):
        robot.close()


def test_a_flood_neither_hangs_nor_grows(scripted):
    """A hundred thousand states as fast as loopback takes them: each read() returns, and the newest is there."""
    total = 100_000

    def script(peer):
        while True:
            message = peer.next()
            peer.serve(message)
            if (message.interface, message.subtype) == (1, 3):
                break
        for i in range(0, total, 1000):
            peer.socket.sendall(b"".join(state(j + 1) for j in range(i, i + 1000)))
        obliging(peer)

    server = scripted(script)
    with regista.Robot("127.0.0.1", server.port) as robot:
        robot.record(limit=1000)
        base = robot.position2d()
        while base.state.pose.x < total:
            with Watch(0.5):
                assert robot.read(timeout=2)
        messages = robot.messages()
        assert len(messages) == 1000
        assert messages[-1].message.pose.x == total
        assert base.count + robot.counters()["superseded"] == total


def test_nonsense_ends_the_connection_with_words(scripted):
    def script(peer):
        while True:
            message = peer.next()
            peer.serve(message)
            if (message.interface, message.subtype) == (1, 3):
                peer.socket.sendall(pack(4, 0, 99, 1))

    server = scripted(script)
    robot = regista.Robot("127.0.0.1", server.port)
    robot.position2d()
    with pytest.raises(regista.ConnectionError, match="message of type 99"):
        robot.read(timeout=2)


def test_reconnect_restores_what_was_subscribed(port):
    with regista.Robot("127.0.0.1", port) as robot:
        base = robot.position2d()
        robot.reconnect()
        assert robot.generation == 2
        count = base.count
        while base.count == count:
            assert robot.read(timeout=2)


def test_reconnecting_by_itself_outlives_the_server(scripted):
    """The connection breaks after each subscription; read() goes on with the next one."""

    def script(peer):
        while True:
            message = peer.next()
            peer.serve(message)
            if (message.interface, message.subtype) == (1, 3):
                peer.socket.sendall(state(1.0))
                return

    server = scripted(script)
    robot = regista.Robot("127.0.0.1", server.port, reconnect=True)
    base = robot.position2d()
    end = time.monotonic() + 20
    while robot.generation < 3 or base.count < 3:
        robot.read(timeout=0.5)
        assert time.monotonic() < end


def run(program, port, **options):
    """A Python of its own; what it wrote."""
    command = [sys.executable, "-c", program, str(port)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


INTERRUPTED = """
import sys, regista
robot = regista.Robot("127.0.0.1", int(sys.argv[1]), timeout=30)
{prepare}
print("waiting", flush=True)
try:
    {wait}
except KeyboardInterrupt:
    print("interrupted, connected:", robot.connected, flush=True)
    {after}
"""


def interrupt(program, port):
    process = run(program, port)
    try:
        assert process.stdout.readline() == "waiting\n"
        time.sleep(0.3)  # into the wait: a signal before it would prove nothing
        with Watch(0):
            process.send_signal(signal.SIGINT)
            return process.communicate(timeout=20)
    finally:
        process.kill()


def test_ctrl_c_ends_a_read_and_leaves_the_connection(scripted):
    program = INTERRUPTED.format(prepare="", wait="robot.read(timeout=30)", after="robot.read(0); robot.position2d()")
    out, err = interrupt(program, scripted(obliging).port)
    assert (out, err) == ("interrupted, connected: True\n", "")


def test_ctrl_c_ends_a_drive_and_the_base_can_be_stopped(port):
    program = INTERRUPTED.format(
        prepare="base = robot.position2d(); base.reset_odometry()",
        wait="base.drive_to(1000, 0, timeout=30)",
        after="base.stop(); print(len(robot.devices()))",
    )
    out, err = interrupt(program, port)
    assert (out, err) == ("interrupted, connected: True\n5\n", "")


def test_ctrl_c_ends_a_request_that_gets_no_answer(scripted):
    def script(peer):
        while True:
            message = peer.next()
            if message.interface == 1:
                peer.serve(message)

    server = scripted(script)
    program = INTERRUPTED.format(
        prepare="base = robot.position2d()", wait="base.geometry()", after="import os; os._exit(0)"
    )
    out, err = interrupt(program, server.port)
    assert (out, err) == ("interrupted, connected: True\n", "")


def test_a_signal_handler_that_returns_interrupts_nothing(scripted):
    program = """
import signal, sys, threading, time, os, regista
signal.signal(signal.SIGUSR1, lambda *_: print("signal", flush=True))
robot = regista.Robot("127.0.0.1", int(sys.argv[1]))
threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGUSR1)).start()
begin = time.monotonic()
assert not robot.read(timeout=0.6)
assert time.monotonic() - begin >= 0.6
"""
    out, err = run(program, scripted(obliging).port).communicate(timeout=30)
    assert (out, err) == ("signal\n", "")


def test_other_threads_run_while_a_robot_waits(scripted):
    with regista.Robot("127.0.0.1", scripted(obliging).port) as robot:
        ticks = []
        stop = threading.Event()

        def tick():
            while not stop.is_set():
                ticks.append(time.monotonic())
                stop.wait(0.01)

        thread = threading.Thread(target=tick)
        thread.start()
        begin = time.monotonic()
        assert not robot.read(timeout=0.5)
        end = time.monotonic()
        stop.set()
        thread.join()
        assert sum(begin < t < end for t in ticks) > 5


def test_a_second_thread_is_refused_with_words(scripted):
    with regista.Robot("127.0.0.1", scripted(obliging).port) as robot:
        waiting = threading.Thread(target=lambda: robot.read(timeout=1))
        waiting.start()
        refused = None
        while waiting.is_alive() and refused is None:
            try:
                robot.position2d()
            except RuntimeError as error:
                refused = error
        waiting.join()
        assert "in use, by another thread" in str(refused)
        robot.position2d()


def test_a_forked_child_is_refused_and_leaves_the_parents_connection(port):
    program = """
import os, sys, regista
robot = regista.Robot("127.0.0.1", int(sys.argv[1]))
base = robot.position2d()
if (child := os.fork()) == 0:
    try:
        base.set_velocity(x=1.0)
    except RuntimeError as error:
        print(error, flush=True)
    del base, robot
    with regista.Robot("127.0.0.1", int(sys.argv[1])) as own:
        print("own", own.position2d().driver, flush=True)
    sys.exit(0)
os.waitpid(child, 0)
count = base.count
while base.count < count + 3:
    assert robot.read(timeout=2)
print("parent reads on")
"""
    out, err = run(program, port).communicate(timeout=30)
    assert out.splitlines() == [
        "this robot was connected by the parent process: connect one of your own",
        "own simulated_base",
        "parent reads on",
    ], err


def test_subinterpreters_are_refused(port):
    try:
        import _xxsubinterpreters as interpreters
    except ImportError:
        pytest.skip("this Python has them under another name")
    interpreter = interpreters.create()
    try:
        with pytest.raises(interpreters.RunFailedError, match="ImportError"):
            interpreters.run_string(interpreter, "import regista._core")
    finally:
        interpreters.destroy(interpreter)


def test_a_robot_that_is_dropped_closes_itself(port):
    for _ in range(20):
        regista.Robot("127.0.0.1", port).position2d()
    with regista.Robot("127.0.0.1", port) as robot:
        names = [client["name"] for client in robot.status()["clients"]]
    assert len(names) < 5


def test_the_greeting_of_a_stock_server_is_known():
    assert len(BANNER) == 32
