// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// An inertial measurement unit, in the body frame.
namespace regista::imu {

inline constexpr std::uint16_t code = 60;

struct State {
  Pose3d pose{};

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields = Fields{Field<&State::pose>{"pose"}};
  friend bool operator==(const State&, const State&) = default;
};

/// Calibrated samples of the three sensors.
struct Calibrated {
  float acceleration_x = 0;
  float acceleration_y = 0;
  float acceleration_z = 0;
  float rate_x = 0;
  float rate_y = 0;
  float rate_z = 0;
  float field_x = 0;
  float field_y = 0;
  float field_z = 0;

  static constexpr Message message{code, Kind::data, 2, "CALIB"};
  static constexpr auto fields = Fields{
      Field<&Calibrated::acceleration_x>{"accel_x", "m/s^2"}, Field<&Calibrated::acceleration_y>{"accel_y", "m/s^2"},
      Field<&Calibrated::acceleration_z>{"accel_z", "m/s^2"}, Field<&Calibrated::rate_x>{"gyro_x", "rad/s"},
      Field<&Calibrated::rate_y>{"gyro_y", "rad/s"},          Field<&Calibrated::rate_z>{"gyro_z", "rad/s"},
      Field<&Calibrated::field_x>{"magn_x", "gauss"},         Field<&Calibrated::field_y>{"magn_y", "gauss"},
      Field<&Calibrated::field_z>{"magn_z", "gauss"}};
  friend bool operator==(const Calibrated&, const Calibrated&) = default;
};

struct Quaternion {
  Calibrated samples{};
  float q0 = 0;
  float q1 = 0;
  float q2 = 0;
  float q3 = 0;

  static constexpr Message message{code, Kind::data, 3, "QUAT"};
  static constexpr auto fields =
      Fields{Field<&Quaternion::samples>{"calib_data"}, Field<&Quaternion::q0>{"q0", "", "scalar part"},
             Field<&Quaternion::q1>{"q1"}, Field<&Quaternion::q2>{"q2"}, Field<&Quaternion::q3>{"q3"}};
  friend bool operator==(const Quaternion&, const Quaternion&) = default;
};

struct Euler {
  Calibrated samples{};
  Orientation3d orientation{};

  static constexpr Message message{code, Kind::data, 4, "EULER"};
  static constexpr auto fields =
      Fields{Field<&Euler::samples>{"calib_data"}, Field<&Euler::orientation>{"orientation"}};
  friend bool operator==(const Euler&, const Euler&) = default;
};

struct FullState {
  Pose3d pose{};
  Rates3d velocity{};
  Rates3d acceleration{};

  static constexpr Message message{code, Kind::data, 5, "FULLSTATE"};
  static constexpr auto fields =
      Fields{Field<&FullState::pose>{"pose"}, Field<&FullState::velocity>{"vel", "", "m/s, rad/s"},
             Field<&FullState::acceleration>{"acc", "", "m/s^2, rad/s^2"}};
  friend bool operator==(const FullState&, const FullState&) = default;
};

/// Which of the data messages to publish.
struct SetDataType {
  std::uint8_t subtype = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 1, "SET_DATATYPE"};
  static constexpr auto fields = Fields{Field<&SetDataType::subtype>{"value", "", "of the data message"}};
  friend bool operator==(const SetDataType&, const SetDataType&) = default;
};

struct ResetOrientation {
  std::uint32_t value = 0;

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 2, "RESET_ORIENTATION"};
  static constexpr auto fields = Fields{Field<&ResetOrientation::value>{"value", "", "driver specific"}};
  friend bool operator==(const ResetOrientation&, const ResetOrientation&) = default;
};

struct ResetEuler {
  Pose3d orientation{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 3, "RESET_EULER"};
  static constexpr auto fields = Fields{Field<&ResetEuler::orientation>{"orientation"}};
  friend bool operator==(const ResetEuler&, const ResetEuler&) = default;
};

}  // namespace regista::imu

namespace regista {

struct Imu {
  static constexpr std::uint16_t code = imu::code;
  static constexpr std::string_view name = "imu";
  using Messages = TypeList<imu::State, imu::Calibrated, imu::Quaternion, imu::Euler, imu::FullState, imu::SetDataType,
                            imu::ResetOrientation, imu::ResetEuler>;
};

}  // namespace regista
