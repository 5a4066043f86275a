// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/device/ring.hpp>

#include <vector>

namespace regista {
namespace {

TEST(Mailbox, drained_in_part_gives_everything_in_order_in_the_end) {
  Mailbox<int, 8> mailbox;
  const std::size_t lane = mailbox.add_lane();
  const auto put = [&](int value) { return mailbox.put(lane, [&](int& item) { item = value; }); };
  for (int i = 1; i <= 10; ++i) EXPECT_TRUE(put(i));  // six in the queue, then the newest of the lane

  std::vector<int> taken;
  const auto take = [&](int& item) { taken.push_back(item); };
  EXPECT_EQ(mailbox.drain(take, 4), 4U);
  EXPECT_EQ(taken, (std::vector{1, 2, 3, 4}));
  EXPECT_EQ(mailbox.drain(take, 4), 3U);
  EXPECT_EQ(taken, (std::vector{1, 2, 3, 4, 5, 6, 10}));
  EXPECT_EQ(mailbox.replaced(), 3U);
}

TEST(Mailbox, drained_in_part_drops_what_a_lane_kept_when_something_newer_follows_in_the_queue) {
  Mailbox<int, 8> mailbox;
  const std::size_t lane = mailbox.add_lane();
  const auto put = [&](int value) { return mailbox.put(lane, [&](int& item) { item = value; }); };
  for (int i = 1; i <= 7; ++i) EXPECT_TRUE(put(i));
  std::vector<int> taken;
  const auto take = [&](int& item) { taken.push_back(item); };
  mailbox.drain(take, 1);
  EXPECT_TRUE(put(8));  // into the queue, although 7 waits in the lane
  while (mailbox.drain(take, 2) == 2) {
  }
  EXPECT_EQ(taken, (std::vector{1, 2, 3, 4, 5, 6, 8}));
}

}  // namespace
}  // namespace regista
