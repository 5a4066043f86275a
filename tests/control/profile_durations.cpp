// SPDX-License-Identifier: Apache-2.0
// For oracle_profile_test.py: a line "x0 v0 x1 v1 speed acceleration" in, the duration of the quickest move out [s].
#include <cstdio>
#include <regista/control/velocity_profile.hpp>

int main() {
  using namespace regista::control;
  AxisState start;
  AxisState goal;
  AxisLimits limits;
  while (std::scanf("%lf %lf %lf %lf %lf %lf", &start.position, &start.velocity, &goal.position, &goal.velocity,
                    &limits.speed, &limits.acceleration) == 6) {
    std::printf("%.17g\n", AxisProfile::quickest(start, goal, limits).duration_s());
  }
}
