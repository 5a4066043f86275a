// SPDX-License-Identifier: Apache-2.0
// Where on the field is the ball that the robot sees half a metre ahead, and how must it drive to move towards +x?
#include <regista/core/geometry.hpp>

#include <cstdio>

int main() {
  const regista::Pose2d field_from_robot{.x = 1.0, .y = 2.0, .heading = std::numbers::pi / 2};
  const regista::Pose2d robot_from_ball{.x = 0.5};
  const regista::Pose2d field_from_ball = field_from_robot * robot_from_ball;
  std::printf("ball: x %.2f m, y %.2f m\n", field_from_ball.x, field_from_ball.y);

  const regista::FieldVelocity east{.x = 0.3};
  const regista::BodyVelocity command = to_body(east, field_from_robot.heading);
  std::printf("drive: x %.2f m/s, y %.2f m/s\n", command.x, command.y);
}
