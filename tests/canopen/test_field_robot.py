# SPDX-License-Identifier: Apache-2.0
"""The field robot from end to end, in real processes: see field_robot.py."""

import math
import re
import statistics

import pytest

pytest.importorskip("can")
pytest.importorskip("canopen")
from field_robot import FIELD_GPS, KERNEL, LEAVE, PARK, SQUARE, STARTS, drive_lien, park_oslo
from receiver import GPSD
from regista_process import BIN

LIMIT = 120 if KERNEL else 60  # [s]: an emulated kernel has one slow processor for all
SPEED = 2  # [m/s]: faster than Lien's robot, so that it is over in half a minute


@pytest.mark.skipif(GPSD is None, reason="gpsd is not installed (apt install gpsd)")
@pytest.mark.skipif(not (BIN.parent / "lib/regista/gps.so").exists(), reason="built without libgps and GeographicLib")
def test_liens_square_on_wheels_compass_and_gps():
    drive = drive_lien(SQUARE, FIELD_GPS, f"speed {SPEED} turn_speed 115 k3 1.5 beta 0.05", limit_s=LIMIT)
    assert len(drive.stops) == len(SQUARE), f"{drive.failures}\n{drive.server_log}"
    assert drive.outputs[-1] == 0
    # What a busy machine let the truth, or the server, come late by: the robot went on meanwhile. Of the server no more
    # is excused than such a machine does to it; a driver that blocks is late by more.
    missed = max((int(text) / 1000 for text in re.findall(r"deadline missed: (\d+) ms", drive.server_log)), default=0)
    late = max(SPEED * max(stop.lag_s for stop in drive.stops), min(SPEED * missed, 0.1))
    sd = FIELD_GPS.sd()
    print(drive.stops, drive.failures, f"{drive.time_s:.1f} s; filter sd {sd:.3f} m; late {late:.3f} m")
    for stop in drive.stops:
        assert stop.estimate_m < LEAVE
        assert stop.beyond_gps_m < LEAVE + 4 * sd + late, drive.server_log
    # Beside where it parked there is the error of the filter, whose length is Rayleigh's.
    mean = statistics.mean(stop.beyond_gps_m for stop in drive.stops)
    assert mean < PARK + 2 * sd * math.sqrt(math.pi / 2) + late, drive.server_log


@pytest.mark.skipif(bool(KERNEL), reason="four drives are too much for an emulated processor")
def test_oslos_four_poses_on_four_wheels():
    parked = park_oslo("ours")
    print(parked)
    assert len(parked) == len(STARTS)
    for each in parked:
        assert each.time_s < 6  # 2.5 s in the mean of the reproduction
        assert each.truth_m < 0.05 * math.sqrt(2) + 4 * 0.03  # the tolerance on each axis, and slip on some 3 m
