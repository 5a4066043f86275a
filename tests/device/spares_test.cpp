// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/device/spares.hpp>

namespace regista {
namespace {

using Message = std::variant<int, std::vector<int>, std::vector<double>>;
using Kinds = TypeList<int, std::vector<int>, std::vector<double>>;

TEST(Spares, gives_back_the_memory_of_a_place_that_changed_its_kind) {
  Spares<Message, Kinds> spares;
  Message place;
  spares.assign(place, std::vector<int>{1, 2, 3});
  const int* memory = std::get<std::vector<int>>(place).data();
  spares.assign(place, 7);
  EXPECT_EQ(std::get<int>(place), 7);
  spares.assign(place, std::vector<double>{0.5});
  spares.assign(place, std::vector<int>{4, 5});
  EXPECT_EQ(std::get<std::vector<int>>(place), (std::vector{4, 5}));
  EXPECT_EQ(std::get<std::vector<int>>(place).data(), memory);
}

TEST(Spares, writes_over_a_message_of_the_same_kind) {
  Spares<Message, Kinds> spares;
  Message place = std::vector<int>{1, 2, 3};
  const int* memory = std::get<std::vector<int>>(place).data();
  spares.assign(place, std::vector<int>{9});
  EXPECT_EQ(std::get<std::vector<int>>(place), std::vector{9});
  EXPECT_EQ(std::get<std::vector<int>>(place).data(), memory);
}

TEST(Spares, are_shared_by_the_places_of_a_queue) {
  Spares<Message, Kinds> spares;
  std::array<Message, 3> places;
  for (int round = 0; round < 100; ++round) {
    for (std::size_t i = 0; i < places.size(); ++i) {
      if ((static_cast<std::size_t>(round) + i) % 3 == 0) {
        spares.assign(places[i], std::vector<int>{round});
      } else {
        spares.assign(places[i], std::vector<double>{1.0 * round, 2});
      }
    }
    EXPECT_EQ(std::get<std::vector<int>>(places[static_cast<std::size_t>(3 - round % 3) % 3]), std::vector{round});
  }
}

}  // namespace
}  // namespace regista
