// SPDX-License-Identifier: Apache-2.0
#include "local_frame.hpp"

#include <GeographicLib/UTMUPS.hpp>
#include <cmath>
#include <numbers>

namespace regista {

std::optional<Geodetic> read_datum(const Section& config) {
  if (!config.has("datum")) return {};
  const auto datum = config.numbers("datum");
  if (datum.size() < 2 || datum.size() > 3 || std::abs(datum[0]) > 90 || std::abs(datum[1]) > 180) {
    throw config.error("datum",
                       "must be [latitude longitude] or [latitude longitude altitude]: degrees north within "
                       "[-90, 90], degrees east within [-180, 180], metres above the ellipsoid");
  }
  return Geodetic{.latitude_deg = datum[0], .longitude_deg = datum[1], .altitude_m = datum.size() > 2 ? datum[2] : 0};
}

gps::State to_state(const Fix& fix) {
  gps::State state{.quality = fix.quality, .satellites = fix.satellites_in_view};
  state.time_s = static_cast<std::uint32_t>(fix.time_s);
  state.time_us = static_cast<std::uint32_t>(1e6 * (fix.time_s - state.time_s));
  if (fix.quality == 0) return state;

  state.latitude = static_cast<std::int32_t>(std::lround(1e7 * fix.place.latitude_deg));
  state.longitude = static_cast<std::int32_t>(std::lround(1e7 * fix.place.longitude_deg));
  state.altitude_mm = static_cast<std::int32_t>(std::lround(1e3 * fix.place.altitude_m));
  state.speed_mps = fix.speed_mps;
  state.course_rad = wrap_angle(fix.course_rad);
  int zone = 0;
  bool north = true;
  GeographicLib::UTMUPS::Forward(fix.place.latitude_deg, fix.place.longitude_deg, zone, north, state.utm_e_m,
                                 state.utm_n_m);
  state.hdop_tenths = static_cast<std::uint32_t>(std::lround(10 * fix.hdop));
  state.vdop_tenths = static_cast<std::uint32_t>(std::lround(10 * fix.vdop));
  state.horizontal_error_m = fix.horizontal_error_m;
  state.vertical_error_m = fix.vertical_error_m;
  return state;
}

LocalFrame::LocalFrame(const Geodetic& datum) : plane_{datum.latitude_deg, datum.longitude_deg, datum.altitude_m} {}

Point3d LocalFrame::local(const Geodetic& place) const {
  Point3d local;
  plane_.Forward(place.latitude_deg, place.longitude_deg, place.altitude_m, local.x, local.y, local.z);
  return local;
}

Geodetic LocalFrame::geodetic(const Point3d& local) const {
  Geodetic place;
  plane_.Reverse(local.x, local.y, local.z, place.latitude_deg, place.longitude_deg, place.altitude_m);
  return place;
}

localize::State LocalFrame::to_local(const Fix& fix) const {
  constexpr double any_heading_rad2 = std::numbers::pi * std::numbers::pi / 3;
  const Point3d here = local(fix.place);
  return {.pending_time_s = fix.time_s,
          .hypotheses = {{.mean = {.x = here.x, .y = here.y},
                          .covariance = {fix.east_sd_m * fix.east_sd_m, fix.north_sd_m * fix.north_sd_m,
                                         any_heading_rad2, 0, 0, 0},
                          .weight = 1}}};
}

}  // namespace regista
