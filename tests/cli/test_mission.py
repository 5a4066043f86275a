# SPDX-License-Identifier: Apache-2.0
"""The verb mission against a server with a simulated robot that knows where it is."""

import json

import pytest
from command_line import Server, wait_for

FIELD = """
driver ( name "simulated_base" provides ["position2d:0"] rate 100 holonomic no motor_speed 2 motor_accel 4 )
driver ( name "waypoint" provides ["planner:0"] requires ["position2d:0"] rate 50 speed 1.5 park 0.2 beta 0.05 )
"""
MISSION = {
    "id": "there",
    "points": [{"x": 1, "y": 0}, {"x": 2, "y": 0.5, "heading": 0.5, "do": [{"wait": 0.2}, {"ask": True}]}],
}


@pytest.fixture
def field(tmp_path):
    (tmp_path / "field.cfg").write_text(FIELD)
    with Server(tmp_path / "field.cfg") as server:
        server.file = tmp_path / "mission.json"
        server.file.write_text(json.dumps(MISSION))
        yield server


def state(server):
    return server.json("mission", "show")["state"]


def test_a_mission_is_uploaded_driven_answered_and_finished(field):
    assert field.run("mission", "show").stdout == "no mission\n"
    assert field.run("mission", "start").returncode == 4
    uploaded = field.run("mission", "upload", field.file)
    assert uploaded.returncode == 0 and 'mission "there": 2 points, 2 actions' in uploaded.stderr
    assert state(field) == "ready"
    driving = field.start("mission", "start", stdout=-1, stderr=-1)
    wait_for(lambda: state(field) == "asking")
    assert field.run("mission", "go-on").returncode == 0
    out, err = driving.communicate(timeout=60)
    assert (driving.returncode, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].startswith('mission "there" driving: point 0 of 2, ')
    assert 'mission "there" asking: point 1 of 2, action 1' in lines
    assert lines[-1] == 'mission "there" finished'
    assert field.run("mission", "go-on").returncode == 4


def test_a_mission_is_paused_resumed_and_cancelled(field):
    assert field.run("mission", "upload", field.file).returncode == 0
    assert field.run("mission", "pause").returncode == 4  # nobody drives it
    driving = field.start("mission", "start", stdout=-1, stderr=-1)
    wait_for(lambda: state(field) == "driving")
    assert field.run("mission", "pause").returncode == 0
    assert field.json("mission", "show") | {"state": "paused", "reason": "paused by ENABLE"} == field.json(
        "mission", "show"
    )
    assert field.run("mission", "resume").returncode == 0
    wait_for(lambda: state(field) == "asking")
    assert field.run("mission", "cancel").returncode == 0
    wait_for(lambda: state(field) == "paused")
    driving.terminate()
    driving.communicate(timeout=60)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "no JSON"),
        ("{}", 'no list "points"'),
        ('{"points": [{"x": 1}]}', "point 0 has no number 'y'"),
        ('{"points": [{"x": 1, "y": 2, "z": 3}]}', "point 0 has 'z'"),
        ('{"points": [{"x": 1, "y": 2, "do": [{"dig": 1}]}]}', "point 0, work 0 is none of"),
        ('{"points": [{"x": 1, "y": 2, "do": [{"relay": 0}]}]}', "point 0, work 0 is none of"),
    ],
)
def test_a_file_that_is_no_mission_is_refused_with_the_place(field, text, why):
    field.file.write_text(text)
    done = field.run("mission", "upload", field.file)
    assert done.returncode == 2 and why in done.stderr, done.stderr


def test_what_the_driver_refuses_is_told_in_its_words(field):
    field.file.write_text('{"id": "r", "points": [{"x": 1, "y": 2, "do": [{"relay": 0, "on": true}]}]}')
    done = field.run("mission", "upload", field.file)
    assert done.returncode == 4 and "the driver requires no dio" in done.stderr
