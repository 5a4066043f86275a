# SPDX-License-Identifier: Apache-2.0
"""The whole way: client, TCP, regista-server, driver, serial line (a pty), reference firmware, simulated robot."""

import json
import math
import struct
import subprocess
import threading
import time

import pytest
from regista_process import BIN, COMMAND, NOISE, POSITION2D, Client, ServerProcess, wait_for

SIMULATOR = BIN / "regista-motor-board-sim"
DRIVERS = BIN.parent / "lib/regista"


class Board:
    """regista-motor-board-sim, and what it says of the robot, line by line."""

    def __init__(self, folder, *arguments):
        self.port = folder / "board"
        command = [SIMULATOR, "--link", self.port, "--report", "200", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline().startswith("/dev/pts/")
        self.lines = []
        self.thread = threading.Thread(target=self.listen)
        self.thread.start()

    def listen(self):
        for line in self.process.stdout:
            self.lines.append(json.loads(line))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()

    def stop(self):
        self.process.kill()
        self.process.wait()
        self.thread.join()
        self.process.stdout.close()

    def now(self):
        return self.lines[-1]

    def when(self, true, since):
        """The first report after `since` for which it is true."""
        return wait_for(lambda: [r for r in list(self.lines) if r["t"] > since and true(r)])[0]


class RobotServer(ServerProcess):
    def __init__(self, folder, driver, keys=""):
        super().__init__(folder, f'driver ( {driver} port "{folder / "board"}" {keys} )\n', DRIVERS)


SOCCER = 'name "ssl_robot" provides ["position2d:0" "position2d:1"]'
ROVER = 'name "motor_board" provides ["actarray:0"]'


class Streaming:
    """Repeats a command, so that its lease does not run out."""

    def __init__(self, send):
        self.send = send
        self.done = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def run(self):
        while not self.done.wait(0.05):
            try:
                self.send()
            except OSError:
                return

    def __enter__(self):
        self.thread.start()

    def __exit__(self, *_):
        self.done.set()
        self.thread.join()


def moves(report):
    return any(report["set"])


def rests(report):
    return not any(report["set"])


def test_f21_board_stops_the_wheels_when_the_server_is_killed(tmp_path):
    stops = []
    for _ in range(4):
        with Board(tmp_path) as board, RobotServer(tmp_path, SOCCER) as server:
            client = Client(server.port)
            client.open()
            with Streaming(lambda c=client: c.velocity(0.4)):
                board.when(lambda r: any(abs(w) > 1 for w in r["turns"]), 0)
                killed = time.monotonic()
                server.process.kill()
                server.process.wait()
                stopped = board.when(rests, killed)
            assert stopped["timed_out"]
            stops.append(stopped["t"] - killed)
            client.close()
            # Nothing moves it again.
            at_rest = board.when(lambda r: max(map(abs, r["turns"])) < 0.05, stopped["t"])
            assert at_rest["t"] - killed < 1 + NOISE
    print("stops after ms:", [round(1e3 * s) for s in stops])
    assert min(stops) < 0.1
    assert max(stops) < 0.1 + NOISE


def test_f31_cable_is_unplugged_and_plugged_in_again(tmp_path):
    board = Board(tmp_path)
    try:
        with RobotServer(tmp_path, SOCCER) as server:
            client = Client(server.port)
            client.open()
            with Streaming(lambda: client.velocity(0.4)):
                board.when(moves, 0)
                board.stop()
                unplugged = time.monotonic()
                wait_for(lambda: 'driver "ssl_robot" failed: ' in server.log())
                assert time.monotonic() - unplugged < 0.1 + NOISE
            assert f"{tmp_path / 'board'}" in server.log()
            board = Board(tmp_path)
            plugged = time.monotonic()
            with Streaming(lambda: client.velocity(0.4)):
                board.when(moves, plugged)
            assert time.monotonic() - plugged < 5
            client.close()
    finally:
        board.stop()


def test_a_second_server_may_not_have_the_same_board(tmp_path):
    with Board(tmp_path), RobotServer(tmp_path, SOCCER) as first:
        client = Client(first.port)
        client.open()
        other = tmp_path / "other"
        other.mkdir()
        (other / "board").symlink_to((tmp_path / "board").resolve())
        with RobotServer(other, SOCCER) as second:
            late = Client(second.port)
            with pytest.raises(AssertionError):
                late.open()
            wait_for(lambda: "another program has it" in second.log())
            late.close()
        client.close()


def test_drives_a_square_under_a_camera(tmp_path):
    with Board(tmp_path, "--used") as board, RobotServer(tmp_path, SOCCER) as server:
        client = Client(server.port)
        client.open(0)
        client.open(1)

        goal = (0, 0)

        def at_goal(r):
            return math.hypot(r["x"] - goal[0], r["y"] - goal[1]) < 0.01

        def camera_and_team():
            truth = board.now()
            age = max(0.0, time.monotonic() - truth["t"])
            pose = struct.pack(">3dId", truth["x"], truth["y"], truth["heading"], 1, age)
            client.send(POSITION2D, 1, COMMAND, 1, pose)
            client.send(POSITION2D, 0, COMMAND, 2, struct.pack(">6dI", *goal, 0, 0, 0, 0, 1))

        with Streaming(camera_and_team):
            for corner in [(0.5, 0), (0.5, 0.5), (0, 0.5), (0, 0)]:
                goal = corner
                board.when(at_goal, time.monotonic())
        client.close()


def test_wheels_of_a_rover_turn_one_by_one(tmp_path):
    with Board(tmp_path) as board, RobotServer(tmp_path, ROVER) as server:
        client = Client(server.port)
        actarray = 53
        assert client.ask(1, 0, 3, struct.pack(">7I", 0, 0, actarray, 0, 1, 0, 0))[2] == 4
        speeds = [-1.0, -5.0, 3.0, 7.0]
        body = struct.pack(">II4f", 4, 4, *speeds)
        with Streaming(lambda: client.send(actarray, 0, COMMAND, 4, body)):
            set_points = board.when(moves, 0)["set"]
        assert set_points == speeds
        assert board.when(rests, time.monotonic() - 0.01)
        client.close()
