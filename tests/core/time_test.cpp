// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/core/time.hpp>

namespace regista {
namespace {

using namespace std::chrono_literals;

TEST(Time, seconds_there_and_back_keep_the_nanosecond) {
  EXPECT_EQ(from_seconds(0.1), 100ms);
  EXPECT_EQ(from_seconds(-2.5), -2500ms);
  EXPECT_EQ(from_seconds(seconds(86'400s + 1ns)), 86'400s + 1ns);
  EXPECT_DOUBLE_EQ(seconds(1500us), 0.0015);
}

}  // namespace
}  // namespace regista
