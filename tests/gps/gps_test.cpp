// SPDX-License-Identifier: Apache-2.0
#include "gps.hpp"

#include <cmath>
#include <deque>
#include <limits>

#include "../drivers/bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

gps_data_t data_of_gpsd() {
  gps_data_t data{};
  data.fix.time = {.tv_sec = 1'767'225'600, .tv_nsec = 500'000'000};
  data.fix.mode = MODE_3D;
  data.fix.status = 1;
  data.fix.latitude = 63.41;
  data.fix.longitude = 10.42;
  data.fix.altHAE = 55.5;
  data.fix.epx = 3.92;
  data.fix.epy = 5.88;
  data.fix.eph = 7.1;
  data.fix.epv = 9;
  data.fix.speed = 1.5;
  data.fix.track = 90;
  data.dop.hdop = 0.9;
  data.dop.vdop = 1.4;
  data.satellites_used = 8;
  data.satellites_visible = 11;
  return data;
}

TEST(ToFix, turns_the_units_and_signs_of_gpsd_into_ours) {
  const Fix fix = to_fix(data_of_gpsd());
  EXPECT_EQ(fix.time_s, 1'767'225'600.5);
  EXPECT_EQ(fix.quality, 1U);
  EXPECT_EQ(fix.place.latitude_deg, 63.41);
  EXPECT_EQ(fix.place.longitude_deg, 10.42);
  EXPECT_EQ(fix.place.altitude_m, 55.5);
  EXPECT_TRUE(fix.three_d);
  EXPECT_NEAR(fix.east_sd_m, 2, 1e-9);
  EXPECT_NEAR(fix.north_sd_m, 3, 1e-9);
  EXPECT_EQ(fix.horizontal_error_m, 7.1);
  EXPECT_EQ(fix.vertical_error_m, 9);
  EXPECT_EQ(fix.speed_mps, 1.5);
  EXPECT_NEAR(fix.course_rad, -M_PI / 2, 1e-12);  // east
  EXPECT_EQ(fix.hdop, 0.9);
  EXPECT_EQ(fix.vdop, 1.4);
  EXPECT_EQ(fix.satellites_used, 8U);
  EXPECT_EQ(fix.satellites_in_view, 11U);
}

TEST(ToFix, height_above_the_sea_becomes_height_above_the_ellipsoid) {
  gps_data_t data = data_of_gpsd();
  data.fix.altHAE = nan;
  data.fix.altMSL = 15;
  data.fix.geoid_sep = 39.5;
  EXPECT_EQ(to_fix(data).place.altitude_m, 54.5);
}

TEST(ToFix, what_is_not_a_number_is_unknown_and_never_goes_on) {
  gps_data_t data = data_of_gpsd();
  data.fix.altHAE = data.fix.altMSL = data.fix.epx = data.fix.epy = data.fix.eph = data.fix.epv = nan;
  data.fix.speed = data.fix.track = data.dop.hdop = data.dop.vdop = nan;
  const Fix fix = to_fix(data);
  EXPECT_EQ(fix.quality, 1U);
  EXPECT_FALSE(fix.three_d);
  EXPECT_EQ(fix.place.altitude_m, 0);
  EXPECT_EQ(fix.speed_mps, 0);
  EXPECT_EQ(fix.course_rad, 0);
  EXPECT_GE(fix.east_sd_m, 5) << "nothing known is no accuracy";
  const gps::State state = to_state(fix);
  EXPECT_TRUE(std::isfinite(state.horizontal_error_m + state.vertical_error_m + state.utm_e_m));
}

TEST(ToFix, a_place_that_is_none_is_no_fix) {
  for (const auto& [latitude, longitude] :
       {std::pair{nan, 10.0}, {63.0, nan}, {91.0, 10.0}, {63.0, 181.0}, {0.0, 0.0}}) {
    gps_data_t data = data_of_gpsd();
    data.fix.latitude = latitude;
    data.fix.longitude = longitude;
    EXPECT_EQ(to_fix(data).quality, 0U) << latitude << ' ' << longitude;
  }
  gps_data_t data = data_of_gpsd();
  data.fix.mode = MODE_NO_FIX;
  EXPECT_EQ(to_fix(data).quality, 0U);
}

TEST(ToFix, corrected_ones_are_differential) {
  for (const auto& [status, quality] : {std::pair{1, 1U}, {2, 2U}, {3, 2U}, {4, 2U}, {5, 1U}}) {
    gps_data_t data = data_of_gpsd();
    data.fix.status = status;
    EXPECT_EQ(to_fix(data).quality, quality) << status;
  }
}

Fix fix_at(double latitude_deg, double longitude_deg, double time_s = 1) {
  return {.time_s = time_s,
          .quality = 1,
          .place = {latitude_deg, longitude_deg, 40},
          .three_d = true,
          .east_sd_m = 1,
          .north_sd_m = 1,
          .satellites_in_view = 10,
          .satellites_used = 8};
}

class Finder : public testing::Test {
 protected:
  /// A fix a second, until there is a datum; the seconds that it took, or 100.
  int find(const std::function<Fix(int)>& fix) {
    for (int second = 0; second < 100; ++second) {
      now_ += 1s;
      if ((datum_ = finder_.step(fix(second), now_))) return second;
    }
    return 100;
  }
  DatumFinder finder_{{.satellites = 6, .rest = 10s, .within_m = 3, .speed_mps = 0.5}};
  Time now_{1000s};
  std::optional<Geodetic> datum_;
};

TEST_F(Finder, takes_the_mean_of_what_it_saw_at_rest) {
  // 1e-5° north are 1.1 m.
  EXPECT_EQ(find([](int i) { return fix_at(63.4 + (i % 2 == 0 ? 1e-5 : -1e-5), 10.4); }), 10);
  EXPECT_NEAR(datum_->latitude_deg, 63.4, 2e-6);
  EXPECT_NEAR(datum_->longitude_deg, 10.4, 1e-9);
  EXPECT_NEAR(datum_->altitude_m, 40, 1e-3);
}

TEST_F(Finder, a_wild_first_fix_is_not_the_origin) {
  EXPECT_EQ(find([](int i) { return i == 0 ? fix_at(63.8, 10.4) : fix_at(63.4, 10.4); }), 11);
  EXPECT_NEAR(datum_->latitude_deg, 63.4, 1e-9);
}

TEST_F(Finder, begins_anew_with_every_step_loss_and_wild_fix) {
  EXPECT_EQ(find([](int i) { return i < 20 ? fix_at(63.4 + 1e-4 * i, 10.4) : fix_at(63.4, 10.4); }), 30);
  finder_ = DatumFinder{{.satellites = 6, .rest = 10s, .within_m = 3, .speed_mps = 0.5}};
  const auto spoilt = [](auto spoil) {
    return [spoil](int i) {
      Fix fix = fix_at(63.4, 10.4);
      if (i == 5) spoil(fix);
      return fix;
    };
  };
  EXPECT_EQ(find(spoilt([](Fix& f) { f.satellites_used = 5; })), 16);
  finder_ = DatumFinder{{.satellites = 6, .rest = 10s, .within_m = 3, .speed_mps = 0.5}};
  EXPECT_EQ(find(spoilt([](Fix& f) { f.speed_mps = 0.6; })), 16);
  finder_ = DatumFinder{{.satellites = 6, .rest = 10s, .within_m = 3, .speed_mps = 0.5}};
  EXPECT_EQ(find(spoilt([](Fix& f) { f.quality = 0; })), 16);
  finder_ = DatumFinder{{.satellites = 6, .rest = 10s, .within_m = 3, .speed_mps = 0.5}};
  EXPECT_EQ(find(spoilt([](Fix& f) { f.three_d = false; })), 16);
}

TEST_F(Finder, works_over_the_date_line) {
  EXPECT_EQ(find([](int i) { return fix_at(-18, i % 2 == 0 ? 179.999995 : -179.999995); }), 10);
  EXPECT_NEAR(std::abs(datum_->longitude_deg), 180, 1e-5);
}

/// gpsd as a test says it.
class FakeGpsd final : public GpsdLink {
 public:
  struct Script {
    std::deque<GpsdReport> reports;
    bool ended = false;
  };
  explicit FakeGpsd(std::shared_ptr<Script> script) : script_{std::move(script)} {}
  Result<> open() override { return {}; }
  void close() noexcept override {}
  [[nodiscard]] int descriptor() const override { return -1; }
  Result<std::optional<GpsdReport>> receive() override {
    if (script_->ended) return Error{std::errc::connection_aborted, name_ + " ended"};
    if (script_->reports.empty()) return std::optional<GpsdReport>{};
    const GpsdReport report = script_->reports.front();
    script_->reports.pop_front();
    return std::optional{report};
  }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  std::shared_ptr<Script> script_;
  std::string name_ = "gpsd at fake:1";
};

class GpsDriverTest : public testing::Test {
 protected:
  void start(const std::string& keys) {
    bench_.emplace("provides [\"gps:0\" \"localize:0\"] " + keys,
                   [this](regista::Setup& setup) -> std::unique_ptr<Driver> {
                     return std::make_unique<GpsDriver>(setup, std::make_unique<FakeGpsd>(gpsd_));
                   });
  }
  void hear(const GpsdReport& report) {
    gpsd_->reports.push_back(report);
    bench_->run(1s);
  }
  template <typename D>
  int count() {
    int count = 0;
    for (const Sample& sample : bench_->samples()) count += std::holds_alternative<D>(sample.data) ? 1 : 0;
    return count;
  }
  std::string property(const char* key) {
    return std::string{bench_->ask(property::GetText{.key = Text{key}})->value.view()};
  }

  std::shared_ptr<FakeGpsd::Script> gpsd_ = std::make_shared<FakeGpsd::Script>();
  std::optional<Bench> bench_;
};

TEST_F(GpsDriverTest, publishes_each_fix_in_the_field) {
  start("datum [63.4 10.4 40]");
  hear(fix_at(63.41, 10.42));
  EXPECT_EQ(bench_->latest<gps::State>().latitude, 634'100'000);
  EXPECT_NEAR(bench_->latest<localize::State>().hypotheses.at(0).mean.x, 999.2255, 0.01);
  EXPECT_EQ(count<gps::State>(), 1);
  EXPECT_EQ(count<localize::State>(), 1);
  EXPECT_EQ(property("fix"), "3D, 8 of 10 satellites, sd 1.00 m");
}

TEST_F(GpsDriverTest, believes_the_configuration_more_than_the_receiver) {
  start("datum [63.4 10.4 40] sd 0.02");
  hear(fix_at(63.41, 10.42));
  EXPECT_NEAR(bench_->latest<localize::State>().hypotheses.at(0).covariance[0], 0.0004, 1e-12);
}

TEST_F(GpsDriverTest, finds_a_datum_and_says_how_to_keep_it) {
  start("datum_rest 3");
  for (int i = 1; i < 3; ++i) hear(fix_at(63.41, 10.42, i));
  EXPECT_EQ(count<localize::State>(), 0) << "no origin, no place in the field";
  EXPECT_EQ(count<gps::State>(), 2);
  for (int i = 3; i < 6; ++i) hear(fix_at(63.41, 10.42, i));
  EXPECT_EQ(bench_->events(),
            "gps:0: the field's origin is here: write `datum [63.4100000 10.4200000 40.0]` into the .cfg to keep it\n");
  EXPECT_EQ(property("datum"), "63.4100000 10.4200000 40.0");
  EXPECT_NEAR(bench_->latest<localize::State>().hypotheses.at(0).mean.x, 0, 1e-6);
}

TEST_F(GpsDriverTest, refuses_another_place_in_words_once) {
  start("datum [63.4 10.4 40]");
  hear(fix_at(52.1, 11.6, 1));
  hear(fix_at(52.1, 11.6, 2));
  EXPECT_EQ(
      bench_->events(),
      "gps:0: refused a fix at 52.1000000 11.6000000 40.0, 1258 km from the datum (63.4000000 10.4000000 40.0): is "
      "`datum` that of another place?\n");
  EXPECT_EQ(count<gps::State>() + count<localize::State>(), 0);
  EXPECT_EQ(bench_->ask(property::GetInt{.key = Text{"refused"}})->value, 2);
  bench_->run(2s);
  EXPECT_NE(bench_->events().find("no fix for 3.0 s: "), std::string::npos);
}

TEST_F(GpsDriverTest, no_fix_is_told_with_the_reason_and_so_is_the_next_fix) {
  start("datum [63.4 10.4 40]");
  hear(fix_at(63.41, 10.42));
  for (int i = 0; i < 4; ++i) hear(Fix{.satellites_in_view = 2});
  EXPECT_EQ(bench_->events(), "gps:0: no fix for 3.0 s: 2 satellites in view: is the sky free?\n");
  EXPECT_EQ(bench_->latest<gps::State>().quality, 0U);
  EXPECT_EQ(count<localize::State>(), 1);
  hear(fix_at(63.41, 10.42, 6));
  EXPECT_EQ(bench_->events(), "gps:0: a fix again after 5.0 s\n");
  EXPECT_EQ(bench_->latest<gps::State>().quality, 1U);
}

TEST_F(GpsDriverTest, a_fix_that_gpsd_repeats_is_stale) {
  start("datum [63.4 10.4 40]");
  for (int i = 0; i < 5; ++i) hear(fix_at(63.41, 10.42, 7));
  EXPECT_EQ(bench_->events(), "gps:0: no fix for 3.0 s: the receiver is silent: is it plugged in, and switched on?\n");
  EXPECT_EQ(count<localize::State>(), 1);
  EXPECT_EQ(bench_->latest<gps::State>().quality, 0U);
}

TEST_F(GpsDriverTest, a_gpsd_without_receiver_is_told) {
  start("");
  gpsd_->reports.push_back(Receivers{0});
  bench_->run(4s);
  EXPECT_EQ(bench_->events(), "gps:0: no fix for 3.0 s: gpsd at fake:1 has no receiver: is it plugged in?\n");
}

TEST_F(GpsDriverTest, keeps_its_datum_while_gpsd_restarts) {
  start("datum_rest 0");
  hear(fix_at(63.4, 10.4, 1));
  gpsd_->ended = true;
  bench_->run(100ms);
  EXPECT_NE(bench_->events().find("gpsd at fake:1 ended"), std::string::npos);
  gpsd_->ended = false;
  bench_->run(2s);
  hear(fix_at(63.41, 10.42, 9));
  EXPECT_NEAR(bench_->latest<localize::State>().hypotheses.at(0).mean.x, 999.2255, 0.01);
}

}  // namespace
}  // namespace regista
