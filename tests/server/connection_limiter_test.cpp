// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <connection_limiter.hpp>

namespace regista {
namespace {

using namespace std::chrono_literals;
using asio::ip::make_address;

constexpr Time start{100s};

TEST(ConnectionLimiter, admits_each_address_so_often_a_second) {
  ConnectionLimiter limiter{20};
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(limiter.admit(make_address("10.0.0.1"), start), i < 20) << i;
    EXPECT_EQ(limiter.admit(make_address("10.0.0.2"), start), i < 20) << i;
  }
  EXPECT_TRUE(limiter.admit(make_address("10.0.0.1"), start + 50ms));
  EXPECT_FALSE(limiter.admit(make_address("10.0.0.1"), start + 50ms));
}

TEST(ConnectionLimiter, does_not_count_loopback) {
  ConnectionLimiter limiter{1};
  for (int i = 0; i < 100; ++i) {
    EXPECT_TRUE(limiter.admit(make_address("127.0.0.1"), start));
    EXPECT_TRUE(limiter.admit(make_address("127.3.2.1"), start));
    EXPECT_TRUE(limiter.admit(make_address("::1"), start));
  }
}

TEST(ConnectionLimiter, counts_a_subnet_of_ipv6_as_one) {
  ConnectionLimiter limiter{1};
  EXPECT_TRUE(limiter.admit(make_address("fd00:1:2:3::1"), start));
  EXPECT_FALSE(limiter.admit(make_address("fd00:1:2:3:ffff::2"), start));
  EXPECT_TRUE(limiter.admit(make_address("fd00:1:2:4::1"), start));
}

TEST(ConnectionLimiter, is_bounded) {
  ConnectionLimiter limiter{20};
  const auto address = [](std::uint32_t number) { return asio::ip::address_v4{0x0a000000 + number}; };
  for (std::uint32_t i = 0; i < ConnectionLimiter::most; ++i) EXPECT_TRUE(limiter.admit(address(i), start));
  EXPECT_FALSE(limiter.admit(address(ConnectionLimiter::most), start)) << "no more fit";
  EXPECT_TRUE(limiter.admit(address(0), start)) << "those who are known go on";
  EXPECT_TRUE(limiter.admit(address(ConnectionLimiter::most), start + 51ms)) << "the others were forgotten";
}

}  // namespace
}  // namespace regista
