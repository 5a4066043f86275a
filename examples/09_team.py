# SPDX-License-Identifier: Apache-2.0
from math import cos, sin

from regista.soccer import Team

# Centralised: cameras say where robots are, velocities go out. All cross a circle, and none touches another.
with Team("team.cfg", "yellow") as team:
    for side in (1, -1):
        angles = {robot: 6.283 * robot.id / len(team) for robot in team}
        places = {robot: (side * cos(angle) - 1.5, side * sin(angle)) for robot, angle in angles.items()}
        for robot, place in places.items():
            robot.drive_to(*place)
        while not all(robot.is_at(*place) for robot, place in places.items()):
            team.read(timeout=0.05)  # values change here, and velocities go out from here
        print(f"{len(team)} robots stand on the circle")
