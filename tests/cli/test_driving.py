# SPDX-License-Identifier: Apache-2.0
"""drive on a pseudo-terminal and joy on a FIFO, against a real server."""

import os
import signal
import subprocess

import pytest
import regista
from command_line import Terminal, owned, run, wait_for
from regista.cli.hand import AXES, BUTTONS, EV_ABS, EV_KEY, EVENT


@pytest.fixture
def watcher(fresh):
    """A client that looks at the base, and at who drives it."""
    with regista.Robot("127.0.0.1", fresh.port, name="watcher") as robot:
        base = robot.position2d()
        base.motion()

        def until(look):
            return wait_for(lambda: robot.read(timeout=0.1) is not None and look(base))

        until(lambda base: base.count > 0)
        yield base, until


def drives(base):
    return base.motion().owner.startswith("drive ") and base.state.velocity.x > 0.1


def rests(base):
    return not base.motion().owner and abs(base.state.velocity.x) < 0.05


def test_drive_moves_while_a_key_is_held_and_stops_when_not(fresh, watcher):
    base, until = watcher
    with Terminal("drive", "--robot", fresh.robot, "--speed", 0.4) as terminal:
        terminal.wait_for("nobody")
        assert rests(base)
        terminal.keys("w")
        until(drives)
        terminal.wait_for("DRIVING")
        until(rests)  # nobody repeats the key
        assert base.state.pose.x > 0.02
        terminal.keys("x")
        assert terminal.end() == 0


def test_drive_ends_at_rest_with_ctrl_c_and_leaves_the_terminal_as_it_was(fresh, watcher):
    import termios

    _, until = watcher
    with Terminal("drive", "--robot", fresh.robot) as terminal:
        before = termios.tcgetattr(terminal.master)
        terminal.wait_for("nobody")
        assert termios.tcgetattr(terminal.master)[3] & termios.ICANON == 0
        terminal.keys("w")
        until(drives)
        os.killpg(terminal.process.pid, signal.SIGINT)
        assert terminal.end() == 130
        until(rests)
        assert termios.tcgetattr(terminal.master) == before


def test_drive_killed_hard_leaves_a_robot_at_rest(fresh, watcher):
    base, until = watcher
    with Terminal("drive", "--robot", fresh.robot) as terminal:
        terminal.wait_for("nobody")
        terminal.keys("w")
        until(drives)
        terminal.process.kill()
        until(rests)
        assert "disconnected" in base.motion().reason


def test_drive_shows_who_drives_and_takes_over_only_when_asked(fresh, watcher):
    _, until = watcher
    with owned(fresh, "nav@laptop", 10), Terminal("drive", "--robot", fresh.robot) as terminal:
        terminal.wait_for("nav@laptop")
        terminal.keys("w")
        terminal.wait_for("refused")
        until(lambda base: base.motion().owner == "nav@laptop")
        terminal.keys("t")
        until(lambda base: base.motion().owner.startswith("drive "))
        terminal.keys("w")
        until(drives)
        terminal.keys(" ")
        until(rests)
        terminal.keys("x")
        assert terminal.end() == 0


def test_drive_cannot_take_from_somebody_more_important(fresh):
    with owned(fresh, "safety@field", 90), Terminal("drive", "--robot", fresh.robot) as terminal:
        terminal.wait_for("safety@field")
        terminal.keys("t")
        terminal.wait_for("TAKE refused")
        terminal.keys("x")
        assert terminal.end() == 0


def test_drive_wants_a_terminal(fresh):
    done = fresh.run("drive", stdin=subprocess.DEVNULL)
    assert done.returncode == 2 and "terminal" in done.stderr


def test_drive_tells_when_the_server_is_gone(fresh):
    with Terminal("drive", "--robot", fresh.robot) as terminal:
        terminal.wait_for("nobody")
        fresh.process.kill()
        assert terminal.end() == 3
        assert "Traceback" not in terminal.shown


def event(kind, code, value):
    return EVENT.pack(0, 0, kind, code, value)


HOLD = event(EV_KEY, BUTTONS["BTN_TL"], 1)
AHEAD = event(EV_ABS, AXES["ABS_Y"], -32768)


@pytest.fixture
def gamepad(tmp_path, fresh):
    """A FIFO in the place of an event device, and the verb that reads it."""
    fifo = tmp_path / "event7"
    os.mkfifo(fifo)
    process = fresh.start("joy", "--pad", fifo, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    pad = os.open(fifo, os.O_WRONLY)
    yield process, pad
    process.kill()
    process.wait()
    process.stderr.close()


def test_joy_drives_only_while_the_dead_mans_button_is_held(watcher, gamepad):
    _, until = watcher
    process, pad = gamepad
    os.write(pad, AHEAD)
    os.write(pad, HOLD)
    until(lambda base: base.motion().owner.startswith("joy ") and base.state.velocity.x > 0.2)
    os.write(pad, event(EV_KEY, BUTTONS["BTN_TL"], 0))
    until(rests)
    os.write(pad, HOLD)
    until(lambda base: base.state.velocity.x > 0.2)
    os.close(pad)  # unplugged
    until(rests)
    assert process.wait(timeout=60) == 1
    assert "is gone; position2d:0 was let go" in process.stderr.read()


def test_joy_stops_with_its_stop_button_and_ends_with_ctrl_c(watcher, gamepad):
    _, until = watcher
    process, pad = gamepad
    os.write(pad, AHEAD + HOLD)
    until(lambda base: base.state.velocity.x > 0.2)
    os.write(pad, event(EV_KEY, BUTTONS["BTN_EAST"], 1))
    until(lambda base: abs(base.state.velocity.x) < 0.05)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == 130
    os.close(pad)


def test_joy_without_a_gamepad():
    done = run("joy", "--pad", "/dev/input/event-none")
    assert done.returncode == 1 and "plugged in" in done.stderr
    done = run("joy", "--hold", "BTN_NONSENSE", "--pad", "/dev/null")
    assert done.returncode == 2 and "BTN_TL" in done.stderr
