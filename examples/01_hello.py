# SPDX-License-Identifier: Apache-2.0
import regista

with regista.Robot("localhost") as robot:  # raises when nobody answers
    base = robot.position2d()
    base.reset_odometry()
    while base.state.pose.x < 1.0:  # one metre ahead
        base.set_velocity(x=0.5)  # repeated: silence stops the robot
        robot.read(timeout=0.1)  # values change here, and only here
    base.stop()
    print(f"drove {base.state.pose.x:.1f} m")
