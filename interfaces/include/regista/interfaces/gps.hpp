// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// A satellite receiver.
namespace regista::gps {

inline constexpr std::uint16_t code = 13;

struct State {
  std::uint32_t time_s = 0;
  std::uint32_t time_us = 0;
  std::int32_t latitude = 0;
  std::int32_t longitude = 0;
  std::int32_t altitude_mm = 0;
  double speed_mps = 0;
  double course_rad = 0;
  double utm_e_m = 0;
  double utm_n_m = 0;
  std::uint32_t quality = 0;
  std::uint32_t satellites = 0;
  std::uint32_t hdop_tenths = 0;
  std::uint32_t vdop_tenths = 0;
  double horizontal_error_m = 0;
  double vertical_error_m = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields =
      Fields{Field<&State::time_s>{"time_sec", "s", "UTC since 1970"},
             Field<&State::time_us>{"time_usec", "us", "the fraction"},
             Field<&State::latitude>{"latitude", "1e-7 deg", "north"},
             Field<&State::longitude>{"longitude", "1e-7 deg", "east"},
             Field<&State::altitude_mm>{"altitude", "mm", "above the ellipsoid"},
             Field<&State::speed_mps>{"speed", "m/s", "over ground"},
             Field<&State::course_rad>{"course", "rad", "over ground, counter-clockwise from north"},
             Field<&State::utm_e_m>{"utm_e", "m", "UTM easting"},
             Field<&State::utm_n_m>{"utm_n", "m", "UTM northing"},
             Field<&State::quality>{"quality", "", "0 no fix, 1 GPS, 2 differential"},
             Field<&State::satellites>{"num_sats", "", "in view"},
             Field<&State::hdop_tenths>{"hdop", "0.1", "horizontal dilution of precision"},
             Field<&State::vdop_tenths>{"vdop", "0.1", "vertical dilution of precision"},
             Field<&State::horizontal_error_m>{"err_horz", "m"},
             Field<&State::vertical_error_m>{"err_vert", "m"}};
  friend bool operator==(const State&, const State&) = default;
};

}  // namespace regista::gps

namespace regista {

struct Gps {
  static constexpr std::uint16_t code = gps::code;
  static constexpr std::string_view name = "gps";
  using Messages = TypeList<gps::State>;
};

}  // namespace regista
