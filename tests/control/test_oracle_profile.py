# SPDX-License-Identifier: Apache-2.0
"""Durations of quickest moves on one axis, against Ruckig without a limit on jerk (Berscheid and Kroeger 2021)."""

import os
import random
import subprocess
from pathlib import Path

import pytest

ruckig = pytest.importorskip("ruckig")

CASES = 20_000


def random_case(rng):
    speed = rng.uniform(0.1, 4)
    beyond = rng.choice((1, 1, 1, 3))  # every fourth start is faster than the limit
    return (
        rng.uniform(-6, 6),
        rng.choice((0, rng.uniform(-beyond * speed, beyond * speed))),
        rng.uniform(-6, 6),
        rng.choice((0, rng.uniform(-speed, speed))),
        speed,
        rng.uniform(0.1, 5),
    )


def ruckig_duration(x0, v0, x1, v1, speed, acceleration):
    move = ruckig.InputParameter(1)
    move.current_position, move.current_velocity = [x0], [v0]
    move.target_position, move.target_velocity = [x1], [v1]
    move.max_velocity, move.max_acceleration = [speed], [acceleration]
    trajectory = ruckig.Trajectory(1)
    result = ruckig.Ruckig(1).calculate(move, trajectory)
    assert result == ruckig.Result.Working, result
    return trajectory.duration


def test_durations_equal_those_of_ruckig():
    rng = random.Random(1)
    cases = [random_case(rng) for _ in range(CASES)]
    lines = "".join(" ".join(map(repr, case)) + "\n" for case in cases)
    program = Path(os.environ.get("REGISTA_BIN", "build/dev/bin")) / "profile_durations"
    ours = subprocess.run([program], input=lines, capture_output=True, text=True, check=True, timeout=60).stdout.split()
    assert len(ours) == CASES
    for case, duration in zip(cases, map(float, ours), strict=True):
        assert duration == pytest.approx(ruckig_duration(*case), abs=1e-9, rel=0), case
