# SPDX-License-Identifier: Apache-2.0
"""Recordings, made and played on the page."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import wait_for
from regista import gps, localize, position2d, power
from regista.geometry import BodyVelocity, Pose2d, Size3d
from regista.message import Received
from regista.recording import Log, Recorder, Recording

NONE = math.nan
SPEED = 0.1  # m/s, of the robot in the recording


def record(path, kinds, seconds=60, geometry=None):
    """A recording in which a robot drives along x, ten times a second; `kinds` says what at that second."""
    recorder = Recorder(path)
    log = Log(recorder)
    if geometry is not None:
        log.answer("position2d:0", position2d.GetGeometry(), geometry)
    for i in range(seconds * 10):
        for device, said in kinds(i / 10).items():
            log.data(Received(device=device, message=said, stamp=i / 10, arrival=i / 10))
    assert recorder.close() is None


def drives(second):
    return {"position2d:0": position2d.State(pose=Pose2d(SPEED * second, 0, 0), velocity=BodyVelocity(SPEED, 0, 0))}


@pytest.fixture
def gateway(robot, start):
    return start(robot)


def play(page, name):
    page.locator("#recording").select_option(name)
    page.locator("#play").click()


def place(page):
    """x [m] of the chosen robot, as the page shows it."""
    found = re.search(r"x (-?[0-9.]+)", page.locator("#moving").inner_text())
    return float(found[1]) if found else None


def test_a_recording_is_paused_and_sought_and_played_faster(gateway, visit, accessible, tmp_path):
    record(tmp_path / "lap.mcap", drives)
    page = visit(gateway)
    play(page, "lap.mcap")
    page.locator(".chip", has_text="lap.mcap").click()
    page.locator("#player-text", has_text="of 59.9 s").wait_for()
    page.locator("#player-pause").click()
    page.locator("#player-pause", has_text="Go on").wait_for()
    page.locator("#player-at").fill("30")
    page.locator("#player-text", has_text="30.0 of").wait_for()
    wait_for(lambda: place(page) == pytest.approx(30 * SPEED, abs=0.1))
    page.locator("#player-at").fill("10")  # back again
    page.locator("#player-text", has_text=re.compile(r"^10\.0 of 59\.9 s$")).wait_for()
    wait_for(lambda: place(page) == pytest.approx(10 * SPEED, abs=0.1))
    page.wait_for_timeout(500)  # half a second in the text, unless it pauses
    assert page.locator("#player-text").inner_text() == "10.0 of 59.9 s"
    accessible(page)
    page.locator("#player-rate").select_option("20")
    page.locator("#player-pause").click()
    wait_for(lambda: place(page) > 20 * SPEED)
    page.locator("#player-text", has_text="59.9 of 59.9 s").wait_for()
    wait_for(lambda: place(page) == pytest.approx(59.9 * SPEED, abs=0.05))
    page.locator("#player-pause").click()
    page.locator("#player-pause", has_text="Go on").wait_for()
    page.locator("#player-at").focus()
    page.keyboard.press("Home")
    page.locator("#player-text", has_text=re.compile(r"^0\.0 of 59\.9 s$")).wait_for()
    wait_for(lambda: place(page) == pytest.approx(0, abs=0.05))
    page.locator("#end-play").click()
    page.locator("#player").wait_for(state="hidden")
    page.locator(".chip", has_text=".mcap").wait_for(state="detached")
    assert page.troubles == []


def test_of_plays_at_once_the_last_wins(gateway, visit, tmp_path):
    names = ["one.mcap", "two.mcap", "three.mcap"]
    for name in names:
        record(tmp_path / name, drives, seconds=20)
    page = visit(gateway)
    for name in names:
        play(page, name)
    page.locator(".chip", has_text="three.mcap").click()
    page.locator("#player-text", has_text="of 19.9 s").wait_for()
    assert page.locator(".chip", has_text=".mcap").count() == 1
    children = Path(f"/proc/{gateway.process.pid}/task/{gateway.process.pid}/children").read_text().split()
    assert len(children) == 1
    assert page.troubles == []


def test_recordings_of_one_second_have_names_of_their_own_the_newest_first(gateway, visit, tmp_path):
    page = visit(gateway)
    for made in (1, 2, 3):
        page.locator("#record").click()
        page.locator("#record", has_text="End recording").wait_for()
        page.locator("#record").click()
        page.locator("#record", has_text="● Record").wait_for()
        wait_for(lambda made=made: len(list(tmp_path.glob("*.mcap"))) == made)
    files = sorted(tmp_path.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns, reverse=True)
    wait_for(lambda: page.locator("#recording option").all_inner_texts() == [path.name for path in files])
    assert all(Recording(path).span() for path in files)


def test_numbers_that_are_none_break_nothing(gateway, visit, tmp_path):
    bad = localize.Hypothesis(mean=Pose2d(1, NONE, 0), covariance=np.array([NONE, math.inf, 0, 0, 0, 0]), weight=1)

    def broken(second):
        return {
            "position2d:0": position2d.State(
                pose=Pose2d(SPEED * second, 0, 0), velocity=BodyVelocity(NONE, math.inf, 0)
            ),
            "power:0": power.State(valid=9, voltage_v=NONE, charge_percent=math.inf),
            "gps:0": gps.State(
                latitude=634178000,
                longitude=104018000,
                quality=1,
                satellites=7,
                horizontal_error_m=NONE,
                speed_mps=NONE,
            ),
            "localize:0": localize.State(hypotheses=[bad]),
        }

    record(tmp_path / "broken.mcap", broken, geometry=position2d.Geometry(size=Size3d(NONE, math.inf, 0)))
    page = visit(gateway)
    play(page, "broken.mcap")
    page.locator(".chip", has_text="broken.mcap").click()
    page.locator("#facts", has_text="GPS, 7 satellites").wait_for()
    wait_for(lambda: (place(page) or 0) > 3 * SPEED)
    shown = page.locator("body").inner_text()
    assert "NaN" not in shown and "undefined" not in shown and "Infinity" not in shown
    assert page.troubles == []
