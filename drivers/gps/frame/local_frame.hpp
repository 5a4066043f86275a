// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <GeographicLib/LocalCartesian.hpp>
#include <optional>
#include <regista/core/geometry.hpp>
#include <regista/device/config.hpp>
#include <regista/interfaces/gps.hpp>
#include <regista/interfaces/localize.hpp>

namespace regista {

/// A place on the ellipsoid WGS 84.
struct Geodetic {
  double latitude_deg = 0;   ///< north, in [-90, 90]
  double longitude_deg = 0;  ///< east, in [-180, 180]
  double altitude_m = 0;     ///< above the ellipsoid
};

/// The key `datum`, [latitude longitude] or [latitude longitude altitude] in degrees and metres whatever the file's
/// units are; nothing when it is not there.
[[nodiscard]] std::optional<Geodetic> read_datum(const Section& config);

/// Of an error in the plane with the same sd along both axes, 95 % are within this many of them: √(-2 ln 0.05).
inline constexpr double rayleigh_95 = 2.4477;

/// What a receiver found out at one time.
struct Fix {
  double time_s = 0;          ///< UTC since 1970; 0: unknown
  std::uint32_t quality = 0;  ///< 0 none: of the rest only time and satellites count; 1 GPS, 2 differential
  Geodetic place{};
  bool three_d = false;  ///< the altitude is measured; if not, it is 0
  double speed_mps = 0;
  double course_rad = 0;  ///< counter-clockwise from north
  double east_sd_m = 0;
  double north_sd_m = 0;
  double horizontal_error_m = 0;  ///< 95 %; 0: unknown
  double vertical_error_m = 0;    ///< 95 %; 0: unknown
  double hdop = 0;
  double vdop = 0;
  std::uint32_t satellites_in_view = 0;
  std::uint32_t satellites_used = 0;
};

/// The receiver's message: UTM in the standard zone (near the poles UPS).
[[nodiscard]] gps::State to_state(const Fix& fix);

/// The plane that touches the earth at the datum: x east, y north, z up.
class LocalFrame {
 public:
  explicit LocalFrame(const Geodetic& datum);

  [[nodiscard]] Point3d local(const Geodetic& place) const;
  [[nodiscard]] Geodetic geodetic(const Point3d& local) const;
  /// A fix as one hypothesis with its covariance. A receiver knows no heading: it is 0, with the variance of an angle
  /// that may be any, π²/3.
  [[nodiscard]] localize::State to_local(const Fix& fix) const;

 private:
  GeographicLib::LocalCartesian plane_;
};

}  // namespace regista
