# SPDX-License-Identifier: Apache-2.0
from math import pi

import regista

# Once round a square of one metre, by destinations: the robot finds the way by itself.
with regista.Robot("localhost") as robot:
    base = robot.position2d()
    base.reset_odometry()
    for x, y, heading in [(1.0, 0.0, pi / 2), (1.0, 1.0, -pi), (0.0, 1.0, -pi / 2), (0.0, 0.0, 0.0)]:
        base.drive_to(x, y, heading, timeout=10, distance_m=0.02)
        pose = base.state.pose
        print(f"at ({abs(pose.x):.1f}, {abs(pose.y):.1f}), asked for ({x:.1f}, {y:.1f})")
