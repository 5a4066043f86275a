# SPDX-License-Identifier: Apache-2.0
"""A field robot drives through three points and waits at the second: examples/field.cfg."""

import regista
from regista import Pose2d, planner

POINTS = [Pose2d(3, 0, 0), Pose2d(5, 2, 1.57), Pose2d(3, 4, 3.14)]
WAIT = planner.Action(point=1, act=planner.Act.wait, duration_s=1)

with regista.Robot("localhost") as robot:
    driver = robot.device("planner:0")
    truth, localizer = robot.position2d(1), robot.position2d(2)
    robot.position2d(0).set_motor_power(True)  # its drives have no voltage before
    while localizer.count == 0:  # it is silent until it knows where it is
        robot.read(timeout=1)
    driver.request(planner.SetMission(id="three points", points=POINTS, actions=[WAIT]))
    driver.send(planner.RunCommand(id="three points"))
    driver.keep_alive(True)  # the mission stops when this program does

    done, mission = 0, driver.request(planner.GetMission())
    while mission.state != planner.MissionState.finished:
        robot.read(timeout=0.1)
        mission = driver.request(planner.GetMission())
        if mission.point > done:
            print(f"point {mission.point} of {mission.count}", flush=True)
        if mission.state == planner.MissionState.failed:
            raise SystemExit(mission.reason)
        done = mission.point
    off_m = abs(complex(truth.state.pose.x, truth.state.pose.y) - complex(POINTS[-1].x, POINTS[-1].y))
    print("arrived:", "yes" if off_m < 1 else "no")
