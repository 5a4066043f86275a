// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <regista/device/driver.hpp>

#include "datum_finder.hpp"
#include "gpsd_link.hpp"

namespace regista {

/// A satellite receiver, through gpsd.
///
/// `gps:0` has what the receiver says, and quality 0 while it has no fix. `localize:0` has each fix in the field, x
/// east and y north of the datum, with its covariance; nothing while there is no fix or no datum.
///
/// | Key                | Value                                                                    | Default      |
/// |--------------------|--------------------------------------------------------------------------|--------------|
/// | `host`             | of gpsd                                                                  | "127.0.0.1"  |
/// | `port`             | of gpsd                                                                  | 2947         |
/// | `receiver`         | "/dev/ttyACM0", if gpsd has several; "": whichever reports               | ""           |
/// | `datum`            | [latitude longitude altitude], degrees and [m]: the field's origin       | is found     |
/// | `datum_satellites` | used at least, for a datum that is found                                 | 6            |
/// | `datum_rest`       | [s] that the robot stands still for it                                   | 10           |
/// | `datum_within`     | [length] around the mean of the fixes: what counts as still              | 3 m          |
/// | `range`            | [length] from the datum: a fix beyond is refused                         | 20000 m      |
/// | `sd`               | [length] of a fix along each axis                                        | gpsd's guess |
/// | `timeout`          | [s] without a fix, then it is lost                                       | 3            |
///
/// Properties, read-only: `fix` (text), `datum` (text, as the key), `refused` (fixes).
class GpsDriver final : public Driver {
 public:
  explicit GpsDriver(Setup& setup);
  /// With this way to gpsd.
  GpsDriver(Setup& setup, std::unique_ptr<GpsdLink> link);

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override {}
  void close() noexcept override { link_->close(); }
  [[nodiscard]] std::span<const int> descriptors() const override;

 private:
  void take(Fix fix, Time now);
  void find_datum(const Fix& fix, Time now);
  void watch(Time now);
  [[nodiscard]] std::string why_not(Time now) const;

  Port<Gps> receiver_;
  Port<Localize> local_;
  Property<std::string> fix_text_;
  Property<std::string> datum_text_;
  Property<std::int32_t> refused_;
  std::optional<double> sd_m_;
  double range_m_;
  Duration timeout_;
  std::unique_ptr<GpsdLink> link_;
  mutable std::array<int, 1> descriptor_{-1};
  DatumFinder finder_;
  std::optional<LocalFrame> frame_;

  std::optional<Fix> heard_;  ///< in this beat, with or without a fix
  std::optional<Receivers> receivers_;
  double last_time_s_ = 0;
  std::uint32_t in_view_ = 0;
  bool fixed_ = false;         ///< as far as the clients were told
  bool told_lost_ = false;     ///< likewise
  bool far_ = false;           ///< likewise
  std::optional<Time> seen_;   ///< the last good fix, or the opening
  std::optional<Time> spoke_;  ///< the last report of the receiver that was no repetition
};

}  // namespace regista
