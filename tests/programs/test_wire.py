# SPDX-License-Identifier: Apache-2.0
"""regista-wire, as a person or a script uses it. The golden vectors were made with Player's own encoder."""

import json
import math
import os
import struct
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WIRE = Path(os.environ.get("REGISTA_BIN", ROOT / "build/dev/bin")) / "regista-wire"
OURS = {1, 2, 4, 13, 20, 21, 25, 31, 44, 49, 51, 52, 53, 60, 67}


def load(name):
    return json.loads((ROOT / "tests/data" / name).read_text())


GOLDEN = [v for v in load("player-golden.json") if v.get("kind") != "header"]
KNOWN = [v for v in GOLDEN if v["interface"] in OURS]
FOREIGN = [v for v in GOLDEN if v["interface"] not in OURS]
SESSIONS = [load("player-session-libplayercpp.json"), load("player-session-playerprint.json")]


def wire(command, lines=(), arguments=()):
    """Exit code, lines of stdout, lines of stderr."""
    text = "".join(f"{line}\n" for line in lines)
    done = subprocess.run([WIRE, command, *arguments], input=text, capture_output=True, text=True, timeout=20)
    return done.returncode, done.stdout.splitlines(), done.stderr.splitlines()


def decode(*messages):
    code, out, err = wire("decode", messages)
    assert (code, err) == (0, [])
    return [json.loads(line) for line in out]


def encode(*objects):
    code, out, err = wire("encode", [json.dumps(o) for o in objects])
    assert (code, err) == (0, [])
    return out


def refused(command, line):
    """The one error of the one line."""
    code, out, err = wire(command, [line if isinstance(line, str) else json.dumps(line)])
    assert (code, out, len(err)) == (1, [], 1), (code, out, err)
    assert err[0].startswith("line 1: ")
    return err[0].removeprefix("line 1: ")


def header(interf, kind, subtype, **more):
    address = {"host": 0, "robot": 0, "interf": interf, "index": 0}
    return {"addr": address, "type": kind, "subtype": subtype, "timestamp": 0.0, "seq": 0, **more}


def velocity(**more):
    return {"header": header(4, 2, 1), "fields": {"vel": {"px": 0.3, "py": 0, "pa": 0}, "state": 1, **more}}


def raw(interf, kind, subtype, body):
    return (struct.pack(">6Ld2L", 0, 0, interf, 0, kind, subtype, 0.0, 0, len(body)) + body).hex()


def same(a, b):
    """Equal, with the order of keys, the signs of zeros, and the types of numbers."""
    return json.dumps(a) == json.dumps(b)


def test_golden_vectors_decode_to_their_fields():
    for vector, message in zip(KNOWN, decode(*(v["message_hex"] for v in KNOWN)), strict=True):
        assert same(message, {"header": vector["header"], "fields": vector["fields"]}), vector["name"]


def test_golden_vectors_encode_to_their_bytes():
    objects = [{"header": v["header"], "fields": v["fields"]} for v in KNOWN]
    for vector, message in zip(KNOWN, encode(*objects), strict=True):
        assert message == vector["message_hex"], vector["name"]


@pytest.mark.parametrize("vector", FOREIGN, ids=lambda v: v["name"])
def test_other_interfaces_are_unknown_in_words(vector):
    words = f"interface {vector['interface']}: unknown interface"
    assert refused("decode", vector["message_hex"]) == words
    assert refused("encode", {"header": vector["header"], "fields": vector["fields"]}) == words


@pytest.mark.parametrize("session", SESSIONS, ids=["libplayerc++", "playerprint"])
def test_recorded_sessions_decode_and_encode_to_the_same_bytes(session):
    messages = [m for m in session["messages"] if "banner" not in m]
    decoded = decode(*(m["hex"] for m in messages))
    assert encode(*decoded) == [m["hex"] for m in messages]
    for recorded, ours in zip(messages, decoded, strict=True):
        assert same(ours["fields"], recorded["fields"])


def test_takes_messages_as_arguments_too():
    hexes = [KNOWN[0]["message_hex"], "zz", KNOWN[1]["message_hex"]]
    code, out, err = wire("decode", arguments=hexes)
    assert (code, len(out), err) == (1, 2, ["argument 2: character 1 is not a hex digit"])


def test_an_error_names_its_line_and_spares_the_others():
    good = KNOWN[0]["message_hex"]
    code, out, err = wire("decode", [good, "", "12", "123", good.upper()])
    assert (code, len(out)) == (1, 2)
    assert out[0] == out[1]
    assert err == [
        "line 3: a header takes 40 bytes, here are 1: message too short",
        "line 4: odd number of hex digits (3)",
    ]


def test_answers_line_by_line_in_a_pipe():
    with subprocess.Popen([WIRE, "decode"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        for vector in KNOWN[:3]:
            process.stdin.write(vector["message_hex"] + "\n")
            process.stdin.flush()
            assert json.loads(process.stdout.readline())["fields"] == vector["fields"]
        process.stdin.close()
        assert process.wait(timeout=10) == 0


def test_bytes_after_the_last_field_are_a_note():
    code, out, err = wire("decode", [raw(20, 1, 1, struct.pack(">3L", 8, 5, 99))])
    assert (code, json.loads(out[0])["fields"]) == (0, {"count": 8, "bits": 5})
    assert err == ["line 1: 4 bytes after the last field disregarded"]


def test_the_age_of_a_pose_is_there_only_when_sent():
    stock, ours = velocity(), velocity(age=0.04)
    messages = encode(stock, ours)
    assert [len(m) // 2 - 40 for m in messages] == [28, 36]
    decoded = decode(*messages)
    assert "age" not in decoded[0]["fields"]
    assert decoded[1]["fields"]["age"] == 0.04


def test_short_bodies_name_field_and_bytes():
    body = struct.pack(">3dL", 1, 2, 3, 1)
    assert refused("decode", raw(4, 2, 1, body[:20])).startswith(
        "body of 20 bytes ends in `vel.pa`, which takes bytes 16 to 24"
    )
    assert refused("decode", raw(4, 2, 1, body)[:-8]).startswith("the header promises a body of 28 bytes, here are 24")
    assert refused("decode", raw(4, 2, 1, body) + "00").startswith(
        "the header promises a body of 28 bytes, here are 29"
    )


def test_absurd_counts_are_refused():
    text = refused("decode", raw(51, 1, 1, struct.pack(">4L", 0x7FFFFFF0, 0x7FFFFFF0, 0, 0)))
    assert "array of 2147483632 elements at byte 4 in `data`" in text


def test_unknown_messages_are_named():
    assert refused("decode", raw(4, 2, 99, b"")) == "position2d has no command of subtype 99: unknown message"
    assert refused("decode", raw(4, 9, 1, b"")) == "position2d has no message of type 9 of subtype 1: unknown message"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"state": 300}, "`fields.state`: 300 is not a whole number from 0 to 255"),
        ({"state": -1}, "`fields.state`: -1 is not a whole number from 0 to 255"),
        ({"state": 1.5}, "`fields.state`: 1.5 is not a whole number from 0 to 255"),
        ({"state": True}, "`fields.state`: true is not a whole number from 0 to 255"),
        ({"vel": {"px": 1, "py": 2}}, "`fields.vel.pa`: missing"),
        ({"vel": 7}, "`fields.vel`: 7 is not an object"),
        ({"vel": {"px": "1", "py": 2, "pa": 0}}, '`fields.vel.px`: "1" is not a number, "inf", "-inf" or "nan"'),
        ({"speed": 1}, "`fields.speed`: no such field; there are: vel, state, age"),
    ],
)
def test_wrong_values_are_refused_by_name(change, words):
    assert refused("encode", velocity(**change)) == words


def subscribe(**fields):
    address = {"host": 0, "robot": 0, "interf": 4, "index": 0}
    return {"header": header(1, 3, 3), "fields": {"addr": address, "access": 1, **fields}}


def test_counts_may_be_left_out_but_not_be_wrong():
    assert encode(subscribe(driver_name="ab\0")) == encode(subscribe(driver_name_count=3, driver_name="ab\0"))
    assert refused("encode", subscribe(driver_name_count=2, driver_name="ab\0")) == (
        "`fields.driver_name_count`: 2, but there are 3 elements; correct it or leave it out"
    )


def test_no_more_is_encoded_than_players_buffers_hold():
    assert len(encode(subscribe(driver_name=64 * "x"))) == 1
    assert refused("encode", subscribe(driver_name=65 * "x")) == "`fields.driver_name`: 65 bytes, at most 64 fit"
    key = {"header": header(1, 3, 7), "fields": {"auth_key": 33 * [0]}}
    assert refused("encode", key) == "`fields.auth_key`: 33 elements, at most 32 fit"


def test_strings_hold_one_character_a_byte():
    every = bytes(range(256)).decode("latin-1")
    message = {"header": header(4, 3, 250), "fields": {"key": every, "value": ""}}
    [hexed] = encode(message)
    assert bytes(range(256)).hex() in hexed
    assert decode(hexed)[0]["fields"]["key"] == every
    message["fields"]["key"] = "\u4e2d"
    assert refused("encode", message) == (
        '`fields.key`: "\\u4e2d" has a character above U+00FF; write one character a byte'
    )


def test_the_size_of_a_header_may_be_left_out_but_not_be_wrong():
    message = velocity()
    message["header"]["size"] = 28
    assert encode(message) == encode(velocity())
    message["header"]["size"] = 29
    assert refused("encode", message) == "`header.size`: 29, but the body takes 28 bytes; correct it or leave it out"


def test_what_is_no_message_is_refused():
    assert refused("encode", "{").startswith("not JSON at byte 2: syntax error")
    assert refused("encode", json.dumps(velocity()).replace("0.3", "1e999")) == "number overflow parsing '1e999'"
    assert refused("encode", "[]") == "`message`: [] is not an object"
    assert refused("encode", '{"header": {}}') == "`fields`: missing"
    assert refused("encode", '{"header": 1, "fields": null}') == "`header`: 1 is not an object"
    assert refused("encode", '{"header": {}, "fields": null}') == "`header.addr`: missing"
    assert refused("encode", {**velocity(), "more": 1}).startswith("`message.more`: no such field")


FLOATS = [0.0, -0.0, 5e-324, -2.2250738585072014e-308, 0.1, 1 / 3, 1e22, 1e23, 1.7976931348623157e308, 2**53 + 2.0]


def test_doubles_are_exact():
    objects = [velocity(vel={"px": x, "py": -x, "pa": math.inf}) for x in FLOATS]
    for o in objects:
        o["fields"]["vel"]["pa"] = "inf"
    messages = encode(*objects)
    for x, message in zip(FLOATS, messages, strict=True):
        assert message[80:128] == struct.pack(">3d", x, -x, math.inf).hex()
    for o, ours in zip(objects, decode(*messages), strict=True):
        assert same(ours["fields"], o["fields"])


def test_all_kinds_of_float32_are_exact():
    patterns = [*range(0, 2**32, 9973 * 101), 1, 0x80000000, 0x80000001, 0x007FFFFF, 0x00800000, 0x7F7FFFFF]
    patterns = [p for p in patterns if not (p & 0x7F800000 == 0x7F800000 and p & 0x7FFFFF)]  # NaN has one name
    messages = [raw(21, 2, 1, struct.pack(">2L", 0, p)) for p in patterns]
    decoded = decode(*messages)
    assert encode(*decoded) == messages
    for p, message in zip(patterns, decoded, strict=True):
        (x,) = struct.unpack(">f", struct.pack(">L", p))
        assert same(message["fields"]["voltage"], x if math.isfinite(x) else str(x))


def test_nan_and_infinities_are_strings():
    numbers = {"nan": "7fc00000", "inf": "7f800000", "-inf": "ff800000"}
    for name, pattern in numbers.items():
        message = {"header": header(21, 2, 1), "fields": {"id": 1, "voltage": name}}
        assert encode(message)[0].endswith(pattern)
        assert decode(*encode(message))[0]["fields"]["voltage"] == name


def test_a_float32_that_overflows_is_refused():
    message = {"header": header(21, 2, 1), "fields": {"id": 1, "voltage": 1e39}}
    assert refused("encode", message) == (
        "`fields.voltage`: 1e+39 is beyond the largest float of 32 bits, 3.4028234663852886e+38"
    )


def test_wrong_usage_ends_with_64():
    assert wire("decode", arguments=["--bogus"])[0] == 64
    assert wire("guess")[0] == 64


def test_help_shows_examples_that_work():
    code, out, _ = wire("--help")
    assert code == 0
    [example] = [line.split() for line in out if line.strip().startswith("regista-wire decode 0")]
    assert decode(example[2])[0]["header"]["addr"]["interf"] == 4
    assert wire("decode", arguments=["--help"])[0] == 0
