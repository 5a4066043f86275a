// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <regista/core/geometry.hpp>
#include <regista/core/time.hpp>
#include <regista/sim/battery.hpp>
#include <regista/sim/motor.hpp>
#include <regista/sim/random.hpp>
#include <span>
#include <vector>

namespace regista::sim {

/// One driven wheel. Forward turning pushes the robot along `drive_rad`.
struct Wheel {
  double x_m = 0;  ///< contact point, in the body frame
  double y_m = 0;
  double drive_rad = 0;  ///< direction of drive in the body frame; 0: ahead
  double radius_m = 0.035;
  double gear = 9;              ///< turns of the motor for one of the wheel
  double inertia_kg_m2 = 2e-5;  ///< of the wheel and its gear, at the wheel
  double coulomb_nm = 0;        ///< friction of the gear at the wheel, beside the motor's own
  double viscous_nm_s = 0;      ///< likewise, by speed
  double sideways = 1;          ///< friction across the drive, as a share of `grip`; omni wheels roll: 0.05
};

struct WheeledRobotParameters {
  std::vector<Wheel> wheels = {};  ///< one to eight
  double mass_kg = 3;
  double inertia_kg_m2 = 0.01;  ///< about the vertical axis through the centre of mass, the body's origin
  MotorParameters motor = faulhaber_2342_012_cr;
  SpeedLoopParameters loop = {};
  double hop_s = 0.002;  ///< the boards form a chain, which passes a command on once in this time
  BatteryParameters battery = {};
  double grip = 0.6;        ///< μ between wheel and floor
  double creep_mps = 0.02;  ///< slip at which a wheel uses 71 % of its grip
  double rough_nm = 0;      ///< sd of a friction that varies on its own way at each wheel
  double rough_s = 0.3;     ///< correlation time of it
  std::uint64_t seed = 1;
};

/// A wheel with its axle through the robot's centre: at `angle_rad` on a circle, driving counter-clockwise.
Wheel omni_wheel(double angle_rad, double distance_m);
/// The soccer robot of Holtzhausen 2013: four omni wheels at 45° + k·90°, 80 mm out, 3 kg, gear 9, wheels of 35 mm.
WheeledRobotParameters ssl_robot();
/// The same as Holtzhausen blames it: wheels off their centre and gears of unequal friction. The figures are guesses,
/// within what a workshop leaves, that make the wheels alone err as much as his did.
WheeledRobotParameters used_ssl_robot(std::uint64_t seed);
/// Four fixed wheels: front left, front right, rear left, rear right. They skid when the robot turns.
WheeledRobotParameters skid_steer_robot(double track_m, double wheelbase_m, double mass_kg);
/// Two fixed wheels, left and right, and a castor without friction.
WheeledRobotParameters differential_robot(double track_m, double mass_kg);

/// A rigid body on driven wheels, in the plane: motors, their boards, battery, friction and slip. Each wheel bears the
/// same load. A contact pushes with μN · slip / √(slip² + creep²): creep under small forces, μN at most. Deterministic
/// from its parameters. One second takes some 0.5 ms.
class WheeledRobot {
 public:
  static constexpr std::size_t max_wheels = 8;

  struct WheelState {
    double speed_radps = 0;     ///< truth
    double angle_rad = 0;       ///< truth
    double measured_radps = 0;  ///< as the board reads its encoder
    std::int64_t count = 0;     ///< edges of the encoder, gear × triggers_per_revolution a turn of the wheel
    double motor_a = 0;
    double slip_mps = 0;  ///< surface of the wheel against the floor, along its drive
    double force_n = 0;   ///< on the robot, along its drive
  };
  struct State {
    Pose2d pose;              ///< truth, in the field
    BodyVelocity velocity;    ///< truth
    double accel_x_mps2 = 0;  ///< truth, mean over the step, in the body frame: what an accelerometer feels
    double accel_y_mps2 = 0;
    std::array<WheelState, max_wheels> wheels;
  };

  /// Throws std::invalid_argument that names field, value and remedy.
  explicit WheeledRobot(const WheeledRobotParameters& parameters);

  /// Set-points of the wheels, rad/s at the wheel, which go down the chain of boards. As many as wheels. Not finite: 0.
  void command(std::span<const double> wheel_radps);
  const State& step(Duration dt);

  [[nodiscard]] const State& state() const { return state_; }
  [[nodiscard]] const Battery& battery() const { return battery_; }
  [[nodiscard]] std::size_t wheel_count() const { return wheels_.size(); }
  /// Put the robot somewhere, its wheels rolling along without slip. The boards keep what they know.
  void place(const Pose2d& pose, const BodyVelocity& velocity = {});
  /// Force and torque from outside, in the body frame, until changed [N, N, N m].
  void push(double x_n, double y_n, double torque_nm) { push_ = {x_n, y_n, torque_nm}; }

 private:
  using Targets = std::array<double, max_wheels>;

  struct Drive {
    Wheel wheel;
    double cos_drive, sin_drive, lever_m;  // lever: v_drive = cos vx + sin vy + lever w
    double cross_lever_m;                  // likewise across, to the left of the drive
    double inertia_kg_m2;                  // wheel, gear and rotor, at the wheel
    SpeedLoop loop;
    double duty = 0;
    double rough_nm = 0;
  };

  std::array<double, 2> sub_step(double h);  // the acceleration in it, x and y of the body [m/s²]
  void run_boards(double h);

  WheeledRobotParameters parameters_;
  Random random_;
  std::vector<Drive> wheels_;
  Battery battery_;
  State state_;
  std::array<double, 3> push_{};
  Targets input_{};
  std::array<Targets, max_wheels> chain_{};  // [k]: what board k passes on
  double until_hop_s_ = 0;
  double until_loop_s_ = 0;
};

}  // namespace regista::sim
