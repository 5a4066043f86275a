// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/core/rate_limit.hpp>

namespace regista {
namespace {

using namespace std::chrono_literals;

TEST(RateLimit, admits_a_burst_and_then_one_each_interval) {
  RateLimit limit{50ms, 20};
  const Time start{100s};
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(limit.admit(start));
  for (int i = 0; i < 1000; ++i) EXPECT_FALSE(limit.admit(start)) << "what is refused does not count";
  EXPECT_FALSE(limit.admit(start + 49ms));
  EXPECT_TRUE(limit.admit(start + 50ms));
  EXPECT_FALSE(limit.admit(start + 51ms));
}

TEST(RateLimit, admits_no_more_in_any_second_than_burst_and_rate_allow) {
  RateLimit limit{50ms, 20};
  int admitted = 0;
  for (Time now{100s}; now < Time{110s}; now += 1ms) admitted += limit.admit(now) ? 1 : 0;
  EXPECT_EQ(admitted, 20 + 10 * 20 - 1);
}

TEST(RateLimit, forgets) {
  RateLimit limit{50ms, 20};
  EXPECT_TRUE(limit.idle(Time{}));
  const Time start{100s};
  for (int i = 0; i < 20; ++i) (void)limit.admit(start);
  EXPECT_FALSE(limit.idle(start + 999ms));
  EXPECT_TRUE(limit.idle(start + 1s));
}

TEST(Throttle, tells_how_many_were_kept_quiet) {
  Throttle throttle{5s};
  const Time start{100s};
  EXPECT_EQ(throttle.admit(start), 0);
  for (int i = 0; i < 7; ++i) EXPECT_EQ(throttle.admit(start + 1s), std::nullopt);
  EXPECT_EQ(throttle.admit(start + 5s), 7);
  EXPECT_EQ(throttle.admit(start + 10s), 0);
}

}  // namespace
}  // namespace regista
