# SPDX-License-Identifier: Apache-2.0
"""record, replay and plot against real servers."""

import contextlib
import json
import math
import os
import re
import signal
import socket
import subprocess
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest
import regista
from command_line import REGISTA, ROOT, Server, by_pypi, environment, owned, run, wait_for
from mcap.reader import make_reader
from regista import position2d
from regista.recording import Channel, Recorder, Recording, schema, write


def driven(server, seconds):
    """Drive round for a while."""
    with regista.Robot("127.0.0.1", server.port) as robot:
        base = robot.position2d()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            base.set_velocity(x=0.4, w=0.8)
            robot.read(timeout=0.02)


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    """A recording of the simulated robot."""
    path = tmp_path_factory.mktemp("lap") / "lap.mcap"
    with Server(ROOT / "examples/sim.cfg") as server:
        recorder = server.start("record", path, "--for", 6, stderr=subprocess.PIPE)
        wait_for(lambda: path.exists() and path.stat().st_size > 1000)
        driven(server, 2.0)
        _, errors = recorder.communicate(timeout=60)
        assert recorder.returncode == 0, errors
        assert re.search(r"lap.mcap: \d+ messages, \d+ bytes, 0 dropped", errors)
    return path


def test_record_holds_every_device_and_opens_by_pypi_mcap(lap):
    with lap.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        topics = {channel.topic for channel in summary.channels.values()}
        assert {"/position2d/0/state", "/position2d/0/pose", "/power/0/state", "/kicker/0/state"} <= topics
        assert "/position2d/0/get_geom" in topics  # what it is, beside what it says
        assert {s.name for s in summary.schemas.values()} >= {"regista.position2d.State", "foxglove.PoseInFrame"}
        times = [message.log_time for _, _, message in reader.iter_messages()]
    assert times == sorted(times)
    assert abs(times[-1] * 1e-9 - time.time()) < 600  # since the epoch


def test_record_says_what_the_robot_said(lap):
    states = [r for r in Recording(lap) if r.topic == "/position2d/0/state"]
    stamps = [r.publish_time_ns for r in states]
    assert len(states) > 300 and stamps == sorted(stamps)
    assert any(abs(r.message["velocity"]["x"] - 0.4) < 0.1 for r in states)
    poses = [r for r in Recording(lap) if r.topic == "/position2d/0/pose"]
    assert len(poses) == len(states)
    heading = states[-1].message["pose"]["heading"]
    assert poses[-1].message["pose"]["orientation"]["w"] == pytest.approx(math.cos(heading / 2))


def test_record_refuses_to_overwrite(sim, lap):
    before = lap.read_bytes()
    done = sim.run("record", lap)
    assert done.returncode == 1 and "--force" in done.stderr and lap.read_bytes() == before


def test_record_on_a_full_disk_tells_and_ends_with_1(sim):
    done = sim.run("record", "/dev/full", "--for", 2)
    assert done.returncode == 1
    assert "log stopped: No space left on device" in done.stderr
    assert re.search(r"0 bytes, [1-9]\d* dropped; the end is missing: No space left on device", done.stderr)


def test_record_of_a_device_that_is_not_there_leaves_no_file(sim, tmp_path):
    done = sim.run("record", tmp_path / "x.mcap", "imu:7")
    assert done.returncode == 4 and "imu:7" in done.stderr and not list(tmp_path.iterdir())


def test_record_ends_well_with_ctrl_c(sim, tmp_path):
    path = tmp_path / "short.mcap"
    process = sim.start("record", path, "power", "position2d", stderr=subprocess.PIPE)
    wait_for(lambda: path.exists() and path.stat().st_size > 1000)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    recording = Recording(path)
    assert {r.metadata["device"] for r in recording if "device" in r.metadata} == {"power:0", "position2d:0"}
    assert recording.complete


def test_record_killed_keeps_all_but_the_last_second(sim, tmp_path):
    path = tmp_path / "killed.mcap"
    process = sim.start("record", path)
    wait_for(lambda: path.exists() and path.stat().st_size > 20_000)
    wait_for(lambda: time.time() - path.stat().st_mtime > 0.3)  # not just after it wrote
    killed = time.time_ns()
    process.kill()
    process.wait()
    messages = by_pypi(path.read_bytes())
    age = (killed - messages[-1].log_time) * 1e-9
    print(f"the newest message in the file of a killed recorder is {age:.2f} s old")
    assert age < 1.5  # 1 s, and what a loaded machine adds
    recording = Recording(path)
    assert len(list(recording)) == len(messages) and not recording.complete


def test_record_goes_on_when_the_server_comes_back(tmp_path):
    path = tmp_path / "twice.mcap"
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    config = tmp_path / "sim.cfg"
    config.write_text((ROOT / "examples/sim.cfg").read_text())

    def start():
        process = subprocess.Popen(
            [environment()["REGISTA_SERVER"], "--port", str(port), "--log-level", "off", config],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout.readline().startswith("regista-server: ready")
        return process

    first = start()
    recorder = subprocess.Popen(
        [*REGISTA, "record", path, "--robot", f"127.0.0.1:{port}"], env=environment(), stderr=subprocess.PIPE, text=True
    )
    wait_for(lambda: path.exists() and path.stat().st_size > 10_000)
    first.kill()
    first.wait()
    first.stdout.close()
    died = time.time_ns()
    second = start()
    try:
        wait_for(lambda: any(m.log_time > died + 100_000_000 for m in by_pypi(path.read_bytes())))
    finally:
        recorder.send_signal(signal.SIGINT)
        recorder.communicate(timeout=60)
        second.kill()
        second.wait()
        second.stdout.close()
    assert recorder.returncode == 0


# --- replay


@contextlib.contextmanager
def replaying(path, *arguments):
    """`regista replay` on a free port: the process and the port."""
    process = subprocess.Popen(
        [*REGISTA, "replay", str(path), "--port", "0", "--sim", *map(str, arguments)],
        env=environment(),
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        serving = process.stderr.readline()
        assert serving.startswith("serving "), serving + process.stderr.read()
        yield process, int(serving.rsplit(":", 1)[1])
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


def watch(process, port, names):
    """What a client sees until the replay ends: {device: [(arrival, message)]}"""
    seen = {name: [] for name in names}
    with regista.Robot("127.0.0.1", port) as robot:
        robot.record()
        for name in names:
            robot.device(name)
        with contextlib.suppress(regista.ConnectionError):
            while True:
                robot.read(timeout=1.0)
                for received in robot.messages():
                    seen[received.device].append((received.arrival, received.message))
    assert process.wait(timeout=60) == 0
    return seen


def steady(path, count=400, step_ns=10_000_000):
    """A recording with known values and times."""
    recorder = Recorder(path)
    channel = Channel(
        "/position2d/3/state",
        "regista.position2d.State",
        schema(position2d.State),
        {"device": "position2d:3", "kind": "data", "subtype": "1"},
    )
    begin = 1_700_000_000_000_000_000
    for i in range(count):
        state = position2d.State()
        state.pose.x, state.velocity.w = i / 7, -i / 3
        # uneven: a step that is taken for granted would be found out
        time_ns = begin + i * step_ns + (i % 3) * 2_000_000
        assert recorder.put(channel, write(state), time_ns, time_ns)
    assert recorder.close() is None
    return [(i * step_ns + (i % 3) * 2_000_000) * 1e-9 for i in range(count)]


def test_replay_reproduces_values_and_times(tmp_path):
    path = tmp_path / "steady.mcap"
    times = steady(path)
    with replaying(path, "--wait") as (process, port):
        seen = watch(process, port, ["position2d:3"])["position2d:3"]
    assert [(m.pose.x, m.velocity.w) for _, m in seen] == [(i / 7, -i / 3) for i in range(400)]
    offsets = [arrival - time for (arrival, _), time in zip(seen, times, strict=True)]
    middle = sorted(offsets)[len(offsets) // 2]
    errors = sorted(abs(offset - middle) for offset in offsets)
    p50, p99 = errors[len(errors) // 2], errors[int(0.99 * len(errors))]
    print(f"replay: off by p50 {1e3 * p50:.3f} ms, p99 {1e3 * p99:.3f} ms, at most {1e3 * errors[-1]:.3f} ms")
    assert p99 < 0.050  # the goal is 2 ms; a loaded machine is no reason to fail


def test_replay_of_a_real_recording_is_what_was_recorded(lap):
    recorded = [r.message for r in Recording(lap) if r.topic == "/position2d/0/state"]
    with replaying(lap, "--wait", "--rate", 4, "--end", 3) as (process, port):
        seen = [write(m) for _, m in watch(process, port, ["position2d:0", "power:0"])["position2d:0"]]
    assert len(seen) > 0.9 * len(recorded) * 3 / 6 * 0.9
    positions = [recorded.index(message) for message in seen]  # in order, each once
    assert positions == sorted(set(positions))


def test_replay_answers_and_refuses_like_the_robot(lap):
    with replaying(lap, "--loop") as (_, port), regista.Robot("127.0.0.1", port) as robot:
        base = robot.position2d()
        assert base.geometry().size.length > 0
        base.set_velocity(x=1)
        wait_for(lambda: robot.read(timeout=0.1) and any("refused" in event.text for event in robot.events()))


def test_replay_faster_between_start_and_end(tmp_path):
    path = tmp_path / "steady.mcap"
    steady(path)
    with replaying(path, "--wait", "--rate", 2, "--start", 1, "--end", 2) as (process, port):
        seen = watch(process, port, ["position2d:3"])["position2d:3"]
    numbers = [round(m.pose.x * 7) for _, m in seen]
    assert numbers[0] == 100 and 198 <= numbers[-1] <= 200
    assert 0.3 < seen[-1][0] - seen[0][0] < 0.9


def test_replay_loops(tmp_path):
    path = tmp_path / "steady.mcap"
    steady(path, count=20)
    with replaying(path, "--loop") as (process, port), regista.Robot("127.0.0.1", port) as robot:
        base = robot.position2d(3)
        seen = []
        while seen.count(0.0) < 3:
            robot.read(timeout=5.0)
            seen.append(base.state.pose.x)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130


def seconds_of_cpu(process):
    """In user and kernel mode: fields 14 and 15 of proc(5), /proc/PID/stat."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def steered(path, *arguments):
    process = subprocess.Popen(
        [*REGISTA, "replay", str(path), "--port", "0", "--sim", "--steer", *arguments],
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr.readline().startswith("serving ")
        yield process
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            stream.close()


def test_a_steered_replay_rests_at_its_end_and_ends_with_its_input(tmp_path):
    path = tmp_path / "steady.mcap"
    steady(path, count=100)
    with steered(path, "--end", "0.5") as process:
        while json.loads(process.stdout.readline())["at"] < 0.5:
            pass
        began, before = time.monotonic(), seconds_of_cpu(process)
        for _ in range(10):
            assert json.loads(process.stdout.readline())["at"] == 0.5
        assert seconds_of_cpu(process) - before < 0.5 * (time.monotonic() - began)
        process.stdin.close()
        assert process.wait(timeout=60) == 0


def test_a_steered_replay_that_nobody_ever_saw_ends_with_its_input(tmp_path):
    path = tmp_path / "steady.mcap"
    steady(path, count=10)
    with steered(path, "--wait") as process:
        process.stdin.close()
        assert process.wait(timeout=60) == 0


def test_replay_of_a_cut_file_plays_what_is_there(tmp_path):
    path = tmp_path / "steady.mcap"
    steady(path, count=2000, step_ns=100_000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    with replaying(path) as (process, _):
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0 and "ends in the middle" in errors


def test_replay_beside_live_devices_is_refused(lap, sim):
    done = run("replay", lap, "--port", sim.port)
    assert done.returncode == 4
    assert f"localhost:{sim.port}" in done.stderr and "simulated_base" in done.stderr and "--sim" in done.stderr
    still = run("replay", lap, "--port", sim.port, "--sim")
    assert still.returncode == 4 and "another port" in still.stderr


def test_replay_on_a_port_of_somebody_else(lap):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        done = run("replay", lap, "--port", taken.getsockname()[1], "--sim")
    assert done.returncode == 1 and "in use" in done.stderr


def test_replay_tells_when_its_server_ends(tmp_path):
    path = tmp_path / "steady.mcap"
    steady(path)
    with replaying(path) as (process, _):
        (server,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        os.kill(int(server), signal.SIGKILL)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 1 and "regista-server has ended" in errors


def test_replay_needs_a_recording(tmp_path):
    missing = run("replay", tmp_path / "none.mcap")
    assert missing.returncode == 1
    assert missing.stderr == f"regista: {tmp_path}/none.mcap: No such file or directory\n"
    empty = tmp_path / "empty.mcap"
    Recorder(empty).close()
    done = run("replay", empty)
    assert done.returncode == 1 and "regista record" in done.stderr


def test_replay_moves_a_robot_only_when_told(fresh, tmp_path):
    path = tmp_path / "ahead.mcap"
    recorder = Recorder(path)
    channel = Channel("/x", "S", {}, {"device": "position2d:0", "kind": "data", "subtype": "1"})
    state = position2d.State()
    state.velocity.x = 0.5
    for i in range(100):
        recorder.put(channel, write(state), i * 10_000_000, i * 10_000_000)
    recorder.close()
    assert run("replay", path, "--to", "127.0.0.1:1", "--move").returncode == 3
    refused = run("replay", path, "--to", fresh.robot)
    assert refused.returncode == 4 and "--move" in refused.stderr
    with regista.Robot("127.0.0.1", fresh.port) as robot:
        base = robot.position2d()
        wait_for(lambda: robot.read(timeout=0.1) and base.count > 1)
        assert abs(base.state.pose.x) < 0.01
        moved = run("replay", path, "--to", fresh.robot, "--move")
        assert moved.returncode == 0, moved.stderr
        wait_for(lambda: robot.read(timeout=0.1) and not base.motion().owner)
        assert 0.2 < base.state.pose.x < 0.8
    with owned(fresh, "nav@laptop", 10):
        refused = run("replay", path, "--to", fresh.robot, "--move")
    assert refused.returncode == 4 and 'owned by "nav@laptop"' in refused.stderr


# --- plot


def test_plot_draws_svg_and_png(lap, tmp_path):
    svg = tmp_path / "lap.svg"
    done = run("plot", lap, "-o", svg)
    assert done.returncode == 0, done.stderr
    assert ElementTree.parse(svg).getroot().tag.endswith("svg")
    png = tmp_path / "speed.png"
    assert run("plot", lap, "position2d:0.velocity.x", "power:0.voltage_v", "-o", png).returncode == 0
    assert png.read_bytes().startswith(b"\x89PNG")


def test_plot_names_what_it_could_draw(lap):
    done = run("plot", lap, "position2d:0.speed")
    assert done.returncode == 1 and "position2d:0.velocity.x" in done.stderr
    done = run("plot", lap, "-o", "picture.xyz")
    assert done.returncode == 2 and "png" in done.stderr


def test_plot_without_matplotlib_says_how_to_install_it(lap, tmp_path):
    (tmp_path / "matplotlib.py").write_text("raise ImportError('not here')\n")
    done = run("plot", lap, env={"PYTHONPATH": f"{tmp_path}:{environment().get('PYTHONPATH', '')}"})
    assert done.returncode == 1 and "pip install 'regista[plot]'" in done.stderr
