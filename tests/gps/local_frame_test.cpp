// SPDX-License-Identifier: Apache-2.0
#include "local_frame.hpp"

#include <gtest/gtest.h>

namespace regista {
namespace {

struct Known {
  Geodetic datum;
  Geodetic place;
  Point3d local;
};

// From PROJ 9.5.1: +proj=cart, then +proj=topocentric, both +ellps=WGS84.
const Known known[] = {
    {{63.4, 10.4, 40}, {63.4, 10.4, 40}, {0, 0, 0}},
    {{63.4, 10.4, 40}, {63.41, 10.42, 55.5}, {999.22554, 1114.84622, 15.32464}},
    {{63.4, 10.4, 40}, {63.395, 10.385, 0}, {-749.80407, -557.25195, -40.06827}},
    {{-33.9, 151.2, 5}, {-33.91, 151.19, 5}, {-924.82176, -1109.25259, -0.16378}},
    {{0, 179.999, 0}, {0.001, -179.999, 0}, {222.63898, 110.57428, -0.00485}},  // over the date line
};

TEST(LocalFrame, agrees_with_proj_both_ways) {
  for (const Known& k : known) {
    const LocalFrame frame{k.datum};
    const Point3d local = frame.local(k.place);
    EXPECT_NEAR(local.x, k.local.x, 1e-5);
    EXPECT_NEAR(local.y, k.local.y, 1e-5);
    EXPECT_NEAR(local.z, k.local.z, 1e-5);
    const Geodetic back = frame.geodetic(k.local);
    EXPECT_NEAR(back.latitude_deg, k.place.latitude_deg, 1e-10);
    EXPECT_NEAR(back.longitude_deg, k.place.longitude_deg, 1e-10);
    EXPECT_NEAR(back.altitude_m, k.place.altitude_m, 1e-5);
  }
}

TEST(LocalFrame, covariance_is_that_of_the_fix_and_no_heading_is_made_up) {
  const localize::State state = LocalFrame{{63.4, 10.4, 40}}.to_local(
      {.quality = 1, .place = {63.41, 10.42, 55.5}, .east_sd_m = 2, .north_sd_m = 3});
  const localize::Hypothesis& here = state.hypotheses.at(0);
  EXPECT_NEAR(here.mean.x, 999.22554, 1e-5);
  EXPECT_EQ(here.covariance[0], 4);
  EXPECT_EQ(here.covariance[1], 9);
  EXPECT_NEAR(here.covariance[2], 3.2899, 1e-4);  // π²/3
  EXPECT_EQ(here.weight, 1);
}

TEST(Fix, has_the_units_of_the_message) {
  const gps::State state = to_state({.time_s = 1'767'225'600.25,
                                     .quality = 2,
                                     .place = {63.41, 10.42, 55.5},
                                     .speed_mps = 1.5,
                                     .course_rad = 4,
                                     .hdop = 0.94,
                                     .vdop = 1.26,
                                     .satellites_in_view = 12,
                                     .satellites_used = 9});
  EXPECT_EQ(state.time_s, 1'767'225'600U);
  EXPECT_EQ(state.time_us, 250'000U);
  EXPECT_EQ(state.latitude, 634'100'000);
  EXPECT_EQ(state.longitude, 104'200'000);
  EXPECT_EQ(state.altitude_mm, 55'500);
  EXPECT_EQ(state.speed_mps, 1.5);
  EXPECT_NEAR(state.course_rad, 4 - 2 * 3.14159265, 1e-7);
  EXPECT_EQ(state.quality, 2U);
  EXPECT_EQ(state.satellites, 12U);
  EXPECT_EQ(state.hdop_tenths, 9U);
  EXPECT_EQ(state.vdop_tenths, 13U);
}

TEST(Fix, utm_agrees_with_proj) {
  const auto expect = [](const Geodetic& place, double east_m, double north_m) {
    const gps::State state = to_state({.quality = 1, .place = place});
    EXPECT_NEAR(state.utm_e_m, east_m, 1e-3);
    EXPECT_NEAR(state.utm_n_m, north_m, 1e-3);
  };
  expect({63.41, 10.42, 0}, 570911.6719, 7032057.3872);    // EPSG:32632
  expect({60.5, 5.3, 0}, 296817.4247, 6712810.0719);       // likewise: zone 32 begins farther west in Norway
  expect({-33.91, 151.19, 0}, 332663.7558, 6246348.1095);  // EPSG:32756
}

TEST(Fix, none_is_all_zero_but_for_time_and_satellites) {
  const gps::State state = to_state({.time_s = 5, .place = {1, 2, 3}, .satellites_in_view = 3});
  EXPECT_EQ(state, (gps::State{.time_s = 5, .satellites = 3}));
}

}  // namespace
}  // namespace regista
