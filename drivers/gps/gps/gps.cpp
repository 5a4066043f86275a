// SPDX-License-Identifier: Apache-2.0
#include "gps.hpp"

#include <cmath>
#include <cstdio>
#include <utility>

namespace regista {

namespace {

constexpr int most_reports = 64;  // in one beat; the rest comes with the next

template <typename... Numbers>
std::string text(const char* format, Numbers... numbers) {
  char line[160];
  (void)std::snprintf(line, sizeof line, format, numbers...);
  return line;
}

std::string to_text(const Geodetic& place) {
  return text("%.7f %.7f %.1f", place.latitude_deg, place.longitude_deg, place.altitude_m);
}

DatumRules read_rules(const Section& config) {
  DatumRules rules;
  rules.satellites =
      static_cast<std::uint32_t>(config.integer("datum_satellites", rules.satellites, {.min = 1, .max = 100}));
  rules.rest = config.duration("datum_rest", rules.rest, {.min = 0, .max = 3600});
  rules.within_m = config.length("datum_within", rules.within_m, {.min = 0.01});
  return rules;
}

std::unique_ptr<GpsdLink> link_to_gpsd(const Section& config) {
  return libgps_link(config.text("host", "127.0.0.1"),
                     static_cast<std::uint16_t>(config.integer("port", 2947, {.min = 1, .max = 65535})),
                     config.text("receiver", ""));
}

}  // namespace

GpsDriver::GpsDriver(Setup& setup) : GpsDriver{setup, link_to_gpsd(setup.config)} {}

GpsDriver::GpsDriver(Setup& setup, std::unique_ptr<GpsdLink> link)
    : receiver_{setup.provide<Gps>()},
      local_{setup.provide<Localize>()},
      fix_text_{setup.property<std::string>("fix", "none", {.read_only = true})},
      datum_text_{setup.property<std::string>("datum", "none", {.read_only = true})},
      refused_{setup.property<std::int32_t>("refused", 0, {.read_only = true})},
      range_m_{setup.config.length("range", 20'000, {.min = 1})},
      timeout_{setup.config.duration("timeout", std::chrono::seconds{3}, {.min = 0.1, .max = 3600})},
      link_{std::move(link)},
      finder_{read_rules(setup.config)} {
  if (setup.config.has("sd")) sd_m_ = setup.config.length("sd", {.min = 1e-3});
  if (const auto datum = read_datum(setup.config)) {
    frame_.emplace(*datum);
    datum_text_.set(to_text(*datum));
  }
}

Result<> GpsDriver::open() {
  receivers_.reset();
  in_view_ = 0;
  seen_.reset();
  spoke_.reset();
  told_lost_ = false;
  return link_->open();
}

std::span<const int> GpsDriver::descriptors() const {
  descriptor_[0] = link_->descriptor();
  return descriptor_;
}

Result<> GpsDriver::read(const Tick& tick) {
  if (!seen_) seen_ = tick.now;
  heard_.reset();
  for (int i = 0; i < most_reports; ++i) {
    const Result<std::optional<GpsdReport>> report = link_->receive();
    if (!report) {
      fix_text_.set("none: " + report.error().message());
      return report.error();
    }
    if (!*report) break;
    if (const auto* receivers = std::get_if<Receivers>(&**report)) {
      receivers_ = *receivers;
    } else {
      take(std::get<Fix>(**report), tick.now);
    }
  }
  watch(tick.now);
  return {};
}

void GpsDriver::take(Fix fix, Time now) {
  in_view_ = fix.satellites_in_view;
  receivers_.reset();  // one reports
  if (fix.quality == 0) {
    spoke_ = now;
    heard_ = fix;
    (void)finder_.step(fix, now);
    return;
  }
  // gpsd repeats the last fix of a receiver that fell silent.
  if (fix.time_s != 0 && fix.time_s == last_time_s_) return;
  last_time_s_ = fix.time_s;
  spoke_ = now;
  if (sd_m_) fix.east_sd_m = fix.north_sd_m = *sd_m_;
  if (!frame_) find_datum(fix, now);
  if (frame_) {
    const Point3d here = frame_->local(fix.place);
    const double away_m = std::hypot(here.x, here.y, here.z);
    if (!(away_m <= range_m_)) {
      refused_.set(*refused_ + 1);
      if (!std::exchange(far_, true)) {
        receiver_.tell(1, "refused a fix at " + to_text(fix.place) + text(", %.0f km from the datum (", 1e-3 * away_m) +
                              *datum_text_ + "): is `datum` that of another place?");
      }
      return;
    }
    far_ = false;
  }
  heard_ = fix;
  if (!std::exchange(fixed_, true)) {
    if (told_lost_) receiver_.tell(0, text("a fix again after %.1f s", seconds(now - *seen_)));
    told_lost_ = false;
  }
  seen_ = now;
  fix_text_.set(std::string{fix.quality == 2 ? "differential"
                            : fix.three_d    ? "3D"
                                             : "2D"} +
                text(", %u of %u satellites, sd %.2f m", fix.satellites_used, fix.satellites_in_view,
                     std::hypot(fix.east_sd_m, fix.north_sd_m) / std::sqrt(2.0)));
}

void GpsDriver::find_datum(const Fix& fix, Time now) {
  const auto datum = finder_.step(fix, now);
  if (!datum) return;
  frame_.emplace(*datum);
  datum_text_.set(to_text(*datum));
  receiver_.tell(0, "the field's origin is here: write `datum [" + *datum_text_ + "]` into the .cfg to keep it");
}

void GpsDriver::watch(Time now) {
  const Duration without = now - *seen_;
  if (without < timeout_ || told_lost_) return;
  told_lost_ = true;
  fixed_ = false;
  fix_text_.set("none: " + why_not(now));
  receiver_.tell(1, text("no fix for %.1f s: ", seconds(without)) + why_not(now));
  if (!heard_) heard_ = Fix{.satellites_in_view = in_view_};
}

std::string GpsDriver::why_not(Time now) const {
  if (receivers_ && receivers_->count == 0) return link_->name() + " has no receiver: is it plugged in?";
  if (!spoke_ || now - *spoke_ >= timeout_) return "the receiver is silent: is it plugged in, and switched on?";
  if (far_) return "all are too far from the datum";
  return text("%u satellites in view: is the sky free?", in_view_);
}

void GpsDriver::publish() {
  if (!heard_) return;
  receiver_.send(to_state(*heard_));
  if (heard_->quality != 0 && frame_) local_.send(frame_->to_local(*heard_));
}

}  // namespace regista
