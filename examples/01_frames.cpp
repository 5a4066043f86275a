// SPDX-License-Identifier: Apache-2.0
#include <regista/core/geometry.hpp>

#include <cstdio>

// A robot on the field faces left (+y) and sees a ball half a metre ahead. Where on the field is the ball?
int main() {
  const regista::Pose2d field_from_robot{.x = 1.0, .y = 2.0, .heading = std::numbers::pi / 2};
  const regista::Pose2d robot_from_ball{.x = 0.5};

  const regista::Pose2d field_from_ball = field_from_robot * robot_from_ball;
  std::printf("x %.2f m, y %.2f m\n", field_from_ball.x, field_from_ball.y);
}
