# SPDX-License-Identifier: Apache-2.0
import regista

# Two robots, one loop: they turn until both have turned by a right angle.
with regista.Team(regista.Robot("localhost", port) for port in (6665, 6666)) as team:
    for robot in team:
        robot.position2d().reset_odometry()
    turned = False
    while not turned:
        team.read(timeout=0.1)
        turned = True
        for robot in team:
            base = robot.position2d()
            there = base.state.pose.heading > 1.57
            base.set_velocity(w=0.0 if there else 1.0)
            turned = turned and there
    for robot in team:
        robot.stop()
        print(f"robot at port {robot.port} has turned")
