// SPDX-License-Identifier: Apache-2.0
#include "gpsd_link.hpp"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>

namespace regista {

namespace {

constexpr double normal_95 = 1.96;   // standard deviations, of one coordinate
constexpr double unknown_sd_m = 10;  // a receiver of the metre class on a bad day
constexpr double smallest_sd_m = 0.005;

double finite_or(double value, double fallback) { return std::isfinite(value) ? value : fallback; }

double sd(double error_95_m, double horizontal_error_95_m) {
  double sd_m = unknown_sd_m;
  if (std::isfinite(error_95_m) && error_95_m > 0) {
    sd_m = error_95_m / normal_95;
  } else if (std::isfinite(horizontal_error_95_m) && horizontal_error_95_m > 0) {
    sd_m = horizontal_error_95_m / rayleigh_95;
  }
  return std::max(sd_m, smallest_sd_m);
}

/// gps.h renames its STATUS_… with every version; the numbers stay.
bool is_differential(int status) { return status >= 2 && status <= 4; }

class LibgpsLink final : public GpsdLink {
 public:
  LibgpsLink(std::string host, std::uint16_t port, std::string receiver)
      : host_{std::move(host)},
        port_{std::to_string(port)},
        receiver_{std::move(receiver)},
        name_{"gpsd at " + host_ + ":" + port_} {}
  ~LibgpsLink() override { shut(); }
  LibgpsLink(const LibgpsLink&) = delete;
  LibgpsLink& operator=(const LibgpsLink&) = delete;

  Result<> open() override {
    shut();
    data_ = std::make_unique<gps_data_t>();
    if (::gps_open(host_.c_str(), port_.c_str(), data_.get()) != 0) {
      // libgps says by a negative errno which of its own steps failed.
      const std::string why = ::gps_errstr(errno);
      data_.reset();
      return Error{std::errc::not_connected, name_ + " (" + why + "; is it running?)"};
    }
    open_ = true;
    // A gpsd whose machine lost power says no goodbye: ask after 5 s of silence, give up after 5 s more.
    for (const auto& [option, value] : {std::pair{TCP_KEEPIDLE, 5}, {TCP_KEEPINTVL, 1}, {TCP_KEEPCNT, 5}}) {
      (void)::setsockopt(data_->gps_fd, IPPROTO_TCP, option, &value, sizeof value);
    }
    const int on = 1;
    (void)::setsockopt(data_->gps_fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    const unsigned flags = WATCH_ENABLE | WATCH_JSON | (receiver_.empty() ? 0 : WATCH_DEVICE);
    if (::gps_stream(data_.get(), flags, receiver_.empty() ? nullptr : receiver_.data()) != 0) return gone("tell");
    return {};
  }

  void close() noexcept override { shut(); }
  [[nodiscard]] int descriptor() const override { return open_ ? data_->gps_fd : -1; }

  Result<std::optional<GpsdReport>> receive() override {
    // libgps takes all that the socket has, and hands it out line by line.
    while (::gps_waiting(data_.get(), 0)) {
      errno = 0;
      if (::gps_read(data_.get(), nullptr, 0) < 0) return gone("read from");
      if ((data_->set & DEVICELIST_SET) != 0) return std::optional<GpsdReport>{Receivers{data_->devices.ndevices}};
      if ((data_->set & MODE_SET) != 0) return std::optional<GpsdReport>{to_fix(*data_)};
    }
    return std::optional<GpsdReport>{};
  }

  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  [[nodiscard]] Error gone(const char* what) const {
    if (errno == 0) return {std::errc::connection_aborted, name_ + " ended"};
    return {std::error_code{errno, std::generic_category()}, std::string{what} + " " + name_};
  }

  void shut() noexcept {
    if (std::exchange(open_, false)) (void)::gps_close(data_.get());
    data_.reset();
  }

  std::string host_;
  std::string port_;
  std::string receiver_;
  std::string name_;
  std::unique_ptr<gps_data_t> data_;  // large
  bool open_ = false;
};

}  // namespace

Fix to_fix(const gps_data_t& data) {
  const gps_fix_t& from = data.fix;
  Fix fix{.time_s = static_cast<double>(from.time.tv_sec) + 1e-9 * static_cast<double>(from.time.tv_nsec),
          .satellites_in_view = static_cast<std::uint32_t>(std::max(data.satellites_visible, 0)),
          .satellites_used = static_cast<std::uint32_t>(std::max(data.satellites_used, 0))};
  const bool on_earth = std::abs(from.latitude) <= 90 && std::abs(from.longitude) <= 180 &&
                        !(from.latitude == 0 && from.longitude == 0);  // false for NaN
  if (from.mode < MODE_2D || !on_earth) return fix;

  fix.quality = is_differential(from.status) ? 2 : 1;
  fix.place = {.latitude_deg = from.latitude, .longitude_deg = from.longitude};
  const double altitude_m = std::isfinite(from.altHAE) ? from.altHAE : from.altMSL + from.geoid_sep;
  if (from.mode >= MODE_3D && std::isfinite(altitude_m)) {
    fix.three_d = true;
    fix.place.altitude_m = altitude_m;
  }
  fix.speed_mps = finite_or(from.speed, 0);
  fix.course_rad = -finite_or(from.track, 0) * std::numbers::pi / 180;  // gpsd counts clockwise
  fix.east_sd_m = sd(from.epx, from.eph);
  fix.north_sd_m = sd(from.epy, from.eph);
  fix.horizontal_error_m = finite_or(from.eph, 0);
  fix.vertical_error_m = finite_or(from.epv, 0);
  fix.hdop = finite_or(data.dop.hdop, 0);
  fix.vdop = finite_or(data.dop.vdop, 0);
  return fix;
}

std::unique_ptr<GpsdLink> libgps_link(std::string host, std::uint16_t port, std::string receiver) {
  return std::make_unique<LibgpsLink>(std::move(host), port, std::move(receiver));
}

}  // namespace regista
