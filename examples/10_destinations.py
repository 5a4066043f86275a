# SPDX-License-Identifier: Apache-2.0
from regista.soccer import Team

# Distributed: each robot is told where to go, fuses camera, wheels and IMU, plans, and corrects by itself.
with Team("team.cfg", "yellow") as team:
    goals = {robot: (-0.5, 0.5 * robot.id, 1.57) for robot in team}
    # A robot that has not heard of vision yet takes no destination; read() tells it again.
    for robot, goal in goals.items():
        robot.go_to(*goal)
    while not all(robot.is_at(*goal) for robot, goal in goals.items()):
        team.read(timeout=0.05)
    print(f"{len(team)} robots in line")
