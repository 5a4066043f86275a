# SPDX-License-Identifier: Apache-2.0
"""The recorder alone: MCAP files as PyPI's mcap reads them, also when they are cut or the disk is full."""

import json
import os
import random
import subprocess
import sys
import threading
import time

import jsonschema
import pytest
from command_line import by_pypi, wait_for
from mcap.reader import make_reader
from regista import gps, opaque, position2d, power, recording
from regista.recording import Channel, Recorder, Recording, foxglove

STATE = Channel("/position2d/0/state", "test.State", {"type": "object", "properties": {"x": {"type": "number"}}})


def fill(recorder, count, begin=0, step_ns=10_000_000):
    for i in range(begin, begin + count):
        time_ns = 1_000_000_000_000 + i * step_ns
        assert recorder.put(STATE, {"x": i * 0.1, "noise": random.Random(i).random()}, time_ns, time_ns + 1)


def test_a_whole_file_is_valid_and_indexed(tmp_path):
    path = tmp_path / "whole.mcap"
    recorder = Recorder(path)
    fill(recorder, 5000)
    assert recorder.close() is None
    assert (recorder.written, recorder.dropped, recorder.size) == (5000, 0, path.stat().st_size)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "regista"
        summary = reader.get_summary()
        assert summary.statistics.message_count == 5000
        assert len(summary.chunk_indexes) > 1
        assert max(index.uncompressed_size for index in summary.chunk_indexes) < 2 * 64 * 1024
        values = [json.loads(message.data)["x"] for _, _, message in reader.iter_messages()]
    assert values == [i * 0.1 for i in range(5000)]
    assert Recording(path).span() == (5000, 1_000_000_000_000, 1_000_000_000_000 + 4999 * 10_000_000)


def test_a_file_cut_anywhere_keeps_what_came_before(tmp_path):
    path = tmp_path / "whole.mcap"
    recorder = Recorder(path)
    fill(recorder, 5000)
    recorder.close()
    data = path.read_bytes()
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    cut_path = tmp_path / "cut.mcap"
    random.seed(23)
    kept = []
    for cut in sorted(random.randrange(8, len(data)) for _ in range(60)):
        whole_chunks = [c for c in chunks if c.chunk_start_offset + c.chunk_length <= cut]
        cut_path.write_bytes(data[:cut])
        ours = Recording(cut_path)
        messages = list(ours)
        assert [m.message["x"] for m in messages] == [i * 0.1 for i in range(len(messages))]
        assert not ours.complete
        assert len(messages) == len(by_pypi(data[:cut]))
        last = max((c.message_end_time for c in whole_chunks), default=0)
        assert (messages[-1].log_time_ns if messages else 0) == last  # all whole chunks, and nothing else
        assert ours.span()[0] == len(messages)
        kept.append(len(messages))
    assert kept[0] < kept[-1]


def test_what_is_older_than_a_second_is_in_the_file(tmp_path):
    path = tmp_path / "growing.mcap"
    recorder = Recorder(path)
    stop = threading.Event()

    def feed():
        while not stop.wait(0.01):
            recorder.put(STATE, {"x": 0.0}, time.time_ns(), time.time_ns())

    feeder = threading.Thread(target=feed)
    feeder.start()
    try:
        wait_for(lambda: recorder.written > 150)
        now = time.time_ns()
        messages = by_pypi(path.read_bytes())
        assert now - messages[-1].log_time < 1_000_000_000 + 500_000_000  # a loaded machine records late
    finally:
        stop.set()
        feeder.join()
        recorder.close()


def test_a_file_that_is_there_is_not_overwritten(tmp_path):
    path = tmp_path / "there.mcap"
    path.write_text("mine")
    with pytest.raises(FileExistsError):
        Recorder(path)
    assert path.read_text() == "mine"
    Recorder(path, overwrite=True).close()
    assert Recording(path).span()[0] == 0


def test_a_full_disk_drops_and_says_so():
    notices = []
    recorder = Recorder("/dev/full", on_notice=notices.append)
    wait_for(lambda: recorder.trouble)
    begin = time.monotonic()
    for i in range(12_345):
        assert not recorder.put(STATE, {"x": 1.0}, i, i)
    assert time.monotonic() - begin < 2  # it does not wait for the disk
    assert recorder.dropped == 12_345
    assert recorder.close().strerror == "No space left on device"
    assert notices == ["log stopped: No space left on device"]


FULL_THEN_FREE = """
import resource, sys, time
from regista.recording import Channel, Recorder
notices = []
recorder = Recorder(sys.argv[1], on_notice=lambda text: print(text, flush=True))
channel = Channel("/x", "X", {"type": "object"})
soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, hard))
number = 0
def feed(until):
    global number
    while not until():
        recorder.put(channel, {"i": number, "filling": str(hash(number) * 7919)}, number, number)
        number += 1
        time.sleep(0.0002)
feed(lambda: recorder.trouble)
dropped = recorder.dropped
feed(lambda: recorder.dropped - dropped > 200)
resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
feed(lambda: recorder.trouble is None)
first_after = number
feed(lambda: number > first_after + 500)
print(recorder.close(), number, recorder.dropped)
"""


def test_it_goes_on_when_there_is_space_and_the_file_is_whole(tmp_path):
    path = tmp_path / "limited.mcap"  # a limit of the file's size is the full disk that needs no root
    done = subprocess.run(
        [sys.executable, "-c", FULL_THEN_FREE, path], capture_output=True, text=True, timeout=60, check=True
    )
    stopped, resumed, counts = done.stdout.splitlines()
    assert stopped == "log stopped: File too large"
    assert resumed.startswith("log stopped: File too large, ") and resumed.endswith(" messages dropped; going on")
    trouble, put, dropped = counts.split()
    assert trouble == "None" and int(dropped) >= 200
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        numbers, logs = [], []
        for _, channel, message in reader.iter_messages():
            content = json.loads(message.data)
            if channel.topic == "/log":
                logs.append(content["message"])
            else:
                numbers.append(content["i"])
    assert len(numbers) == int(put) - int(dropped) == summary.statistics.message_count - 1
    assert numbers == sorted(set(numbers)) and numbers[-1] == int(put) - 1
    assert logs == [resumed.removesuffix("; going on")]


def test_a_slow_disk_bounds_the_queue_and_never_the_reader(tmp_path):
    fifo = tmp_path / "slow"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)  # a disk that takes 64 KiB and then nothing
    recorder = Recorder(fifo, overwrite=True)
    filling = [random.Random(i).randbytes(500).hex() for i in range(100)]
    begin = time.monotonic()
    refused = sum(not recorder.put(STATE, {"filling": filling[i % 100]}, i, i) for i in range(20_000))
    assert time.monotonic() - begin < 10
    taken = 20_000 - refused
    assert refused == recorder.dropped > 0
    assert 8 * 1024 * 1024 - 2000 < taken * 1000 < 9 * 1024 * 1024  # what the queue, a chunk and the FIFO hold
    stop = threading.Event()

    def drain():
        while not stop.wait(0.001):
            try:
                os.read(reader, 1 << 20)
            except BlockingIOError:
                continue

    drainer = threading.Thread(target=drain)
    drainer.start()
    recorder.close()
    stop.set()
    drainer.join()
    os.close(reader)


@pytest.mark.parametrize(
    "message",
    [
        position2d.State(),
        power.State(valid=3, voltage_v=12.5),
        gps.State(latitude=473_977_419),
        opaque.State(bytes=b"\x00\xff regista"),
    ],
    ids=lambda message: type(message).__module__,
)
def test_messages_fit_their_schemas_and_come_back(message):
    schema = recording.schema(type(message))
    jsonschema.Draft202012Validator.check_schema(schema)
    written = json.loads(json.dumps(recording.write(message), allow_nan=False))
    jsonschema.validate(written, schema)
    assert set(written) == set(schema["properties"])
    assert recording.read(type(message), written) == message


def test_schemas_tell_units_and_meanings():
    schema = recording.schema(position2d.State)
    assert schema["title"] == "position2d.State"
    assert schema["properties"]["pose"]["properties"]["x"] == {"type": "number", "description": "[m]"}
    assert schema["properties"]["velocity"]["properties"]["w"]["description"] == "[rad/s]"
    assert "motors run" in schema["properties"]["stalled"]["description"]


def test_numbers_that_json_cannot_say_come_back():
    state = position2d.State()
    state.pose.x, state.velocity.w = float("-inf"), float("nan")
    written = json.loads(json.dumps(recording.write(state), allow_nan=False))
    back = recording.read(position2d.State, written)
    assert back.pose.x == float("-inf") and back.velocity.w != back.velocity.w


def test_foxglove_shapes_are_their_schemas():
    pose = foxglove.pose(1_500_000_001, "odom", 1, 2, 3.14159265)
    jsonschema.validate(pose, foxglove.POSE_IN_FRAME)
    assert pose["timestamp"] == {"sec": 1, "nsec": 500_000_001}
    assert pose["pose"]["orientation"]["z"] == pytest.approx(1)
    jsonschema.validate(foxglove.location(0, "gps", 1, 2, 3), foxglove.LOCATION_FIX)
    jsonschema.validate(foxglove.log(0, foxglove.ERROR, "text"), foxglove.LOG)


def test_what_is_no_mcap_file_is_refused(tmp_path):
    (tmp_path / "text").write_text("hello")
    with pytest.raises(ValueError, match="is no MCAP file"):
        Recording(tmp_path / "text")
