// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <regista/device/ring.hpp>
#include <string>
#include <thread>

namespace regista {
namespace {

using Box = Mailbox<int, 8>;

std::vector<int> drained(Box& box) {
  std::vector<int> items;
  box.drain([&](int item) { items.push_back(item); });
  return items;
}

bool put(Box& box, std::size_t lane, int value) {
  return box.put(lane, [&](int& item) { item = value; });
}

TEST(Ring, gives_back_in_order) {
  Ring<int, 4> ring;
  for (int round = 0; round < 10; ++round) {
    for (int i = 0; i < 3; ++i) {
      *ring.claim() = 3 * round + i;
      ring.push();
    }
    for (int i = 0; i < 3; ++i) {
      ASSERT_NE(ring.front(), nullptr);
      EXPECT_EQ(*ring.front(), 3 * round + i);
      ring.pop();
    }
    EXPECT_EQ(ring.front(), nullptr);
  }
}

TEST(Ring, refuses_when_full) {
  Ring<int, 4> ring;
  for (int i = 0; i < 4; ++i) {
    ASSERT_NE(ring.claim(), nullptr);
    ring.push();
  }
  EXPECT_EQ(ring.claim(), nullptr);
  EXPECT_EQ(ring.size(), 4);
  (void)ring.front();
  ring.pop();
  EXPECT_NE(ring.claim(), nullptr);
  EXPECT_EQ(ring.claim(1), nullptr) << "the last place is reserved";
}

TEST(Ring, keeps_the_memory_of_its_elements) {
  Ring<std::string, 2> ring;
  const std::string large(1000, 'x');
  for (int i = 0; i < 2; ++i) {
    ring.claim()->assign(large);
    ring.push();
    (void)ring.front();
    ring.pop();
  }
  EXPECT_GE(ring.claim()->capacity(), large.size());
}

TEST(Latest, gives_the_newest_once) {
  Latest<int> latest;
  EXPECT_EQ(latest.take(), nullptr);
  latest.back() = 1;
  EXPECT_FALSE(latest.publish());
  latest.back() = 2;
  EXPECT_TRUE(latest.publish()) << "1 was replaced";
  const int* taken = latest.take();
  ASSERT_NE(taken, nullptr);
  EXPECT_EQ(*taken, 2);
  EXPECT_EQ(latest.take(), nullptr);
  latest.back() = 3;
  EXPECT_FALSE(latest.publish());
  EXPECT_EQ(*taken, 2) << "what was taken stays until the next take";
}

TEST(Mailbox, keeps_order_across_lanes_and_ring) {
  Box box;
  const std::size_t a = box.add_lane();
  const std::size_t b = box.add_lane();
  put(box, a, 1);
  put(box, Box::no_lane, 2);
  put(box, b, 3);
  put(box, a, 4);
  EXPECT_EQ(drained(box), (std::vector{1, 2, 3, 4}));
  EXPECT_EQ(drained(box), std::vector<int>{});
}

TEST(Mailbox, refuses_what_has_no_lane_when_full) {
  Box box;
  for (int i = 0; i < 8; ++i) EXPECT_TRUE(put(box, Box::no_lane, i));
  EXPECT_FALSE(put(box, Box::no_lane, 8));
  EXPECT_EQ(box.refused(), 1);
  EXPECT_EQ(drained(box), (std::vector{0, 1, 2, 3, 4, 5, 6, 7}));
}

TEST(Mailbox, keeps_three_quarters_for_what_has_no_lane) {
  Box box;
  const std::size_t lane = box.add_lane();
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(put(box, lane, i));
  for (int i = 0; i < 6; ++i) EXPECT_TRUE(put(box, Box::no_lane, 100 + i));
  EXPECT_FALSE(put(box, Box::no_lane, 106));
}

TEST(Mailbox, lets_the_newest_of_a_lane_win_when_full) {
  Box box;
  const std::size_t lane = box.add_lane();
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(put(box, lane, i));
  EXPECT_EQ(drained(box), (std::vector{0, 1, 99}));
  EXPECT_EQ(box.replaced(), 97);
}

TEST(Mailbox, gives_an_overflown_item_before_a_later_one_of_the_ring) {
  Box box;
  const std::size_t lane = box.add_lane();
  for (int i = 0; i < 3; ++i) put(box, lane, i);  // the last goes beside the ring
  put(box, Box::no_lane, 3);
  EXPECT_EQ(drained(box), (std::vector{0, 1, 2, 3}));
}

// One thread fills, the other takes: order is kept over all lanes, the last item of a lane arrives, and every item is
// taken, replaced or refused.
TEST(Mailbox, keeps_order_and_count_between_two_threads) {
  constexpr int count = 30000;
  Mailbox<std::pair<std::size_t, int>, 64> box;
  const std::array lanes{box.add_lane(), box.add_lane(), box.no_lane};
  std::atomic<bool> finished{false};
  std::thread producer{[&] {
    for (int i = 1; i <= count; ++i) {
      const std::size_t which = static_cast<std::size_t>(i * 7 / 3) % 3;
      box.put(lanes[which], [&](auto& item) { item = {which, i}; });
    }
    finished.store(true, std::memory_order_release);
  }};
  int last = 0;
  bool ordered = true;
  std::array<int, 3> last_of{};
  std::size_t taken = 0;
  for (bool done = false; !done;) {
    done = finished.load(std::memory_order_acquire);
    taken += box.drain([&](const auto& item) {
      ordered = ordered && item.second > last;
      last = item.second;
      last_of[item.first] = item.second;
    });
  }
  taken += box.drain([&](const auto& item) { last_of[item.first] = item.second; });
  producer.join();
  EXPECT_TRUE(ordered);
  EXPECT_EQ(taken + box.replaced() + box.refused(), count);
  for (std::size_t which = 0; which < 2; ++which) {
    int newest = count;
    while (static_cast<std::size_t>(newest * 7 / 3) % 3 != which) --newest;
    EXPECT_EQ(last_of[which], newest);
  }
}

}  // namespace
}  // namespace regista
