// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/device/ring.hpp>

#include <vector>

namespace regista {
namespace {

TEST(Mailbox, drained_in_part_gives_everything_in_order_in_the_end) {
  Mailbox<int, 32> mailbox;
  const std::size_t lane = mailbox.add_lane();
  const auto put = [&](int value) { return mailbox.put(lane, [&](int& item) { item = value; }); };
  for (int i = 1; i <= 12; ++i) EXPECT_TRUE(put(i));  // eight in the queue, then the newest of the lane

  std::vector<int> taken;
  const auto take = [&](int& item) { taken.push_back(item); };
  EXPECT_TRUE(mailbox.drain_some(4, take));
  EXPECT_EQ(taken, (std::vector{1, 2, 3, 4}));
  while (mailbox.drain_some(4, take)) {
  }
  EXPECT_EQ(taken, (std::vector{1, 2, 3, 4, 5, 6, 7, 8, 12}));
  EXPECT_EQ(mailbox.replaced(), 3U);
}

TEST(Mailbox, drained_in_part_keeps_the_order_of_what_a_lane_held_and_what_follows_in_the_queue) {
  Mailbox<int, 32> mailbox;
  const std::size_t lane = mailbox.add_lane();
  const auto put = [&](int value) { return mailbox.put(lane, [&](int& item) { item = value; }); };
  for (int i = 1; i <= 9; ++i) EXPECT_TRUE(put(i));
  std::vector<int> taken;
  const auto take = [&](int& item) { taken.push_back(item); };
  EXPECT_TRUE(mailbox.drain_some(1, take));
  EXPECT_TRUE(put(10));  // into the queue, although 9 waits in the lane
  while (mailbox.drain_some(2, take)) {
  }
  EXPECT_EQ(taken, (std::vector{1, 2, 3, 4, 5, 6, 7, 8, 9, 10}));
}

}  // namespace
}  // namespace regista
