# SPDX-License-Identifier: Apache-2.0
from math import hypot

import regista

# Go to a pose and do something else on the way: here, watch it.
with regista.Robot("localhost") as robot:
    base = robot.position2d()
    base.reset_odometry()
    base.go_to(0.8, 0.4, 0.5)  # stays valid while this program calls read()
    fastest = 0.0
    while not base.is_at(0.8, 0.4, 0.5):
        robot.read(timeout=0.1)
        fastest = max(fastest, hypot(base.state.velocity.x, base.state.velocity.y))
    pose = base.state.pose
    print(f"at ({pose.x:.1f}, {pose.y:.1f}), never faster than 2 m/s: {'yes' if fastest < 2 else 'no'}")
