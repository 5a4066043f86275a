// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/core/result.hpp>

#include <memory>

namespace regista {
namespace {

TEST(Result, holds_a_value_that_can_be_moved_out) {
  Result<std::unique_ptr<int>> result{std::make_unique<int>(7)};
  ASSERT_TRUE(result);
  EXPECT_EQ(*std::move(*result), 7);
}

TEST(Result, says_what_was_tried_and_why_it_failed) {
  const Result<int> result = Error{std::errc::no_such_file_or_directory, "open /dev/ttyACM0"};
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, std::errc::no_such_file_or_directory);
  EXPECT_EQ(result.error().message(), "open /dev/ttyACM0: No such file or directory");
}

TEST(Result, of_nothing_is_a_success_unless_told) {
  EXPECT_TRUE(Result<>{});
  EXPECT_FALSE(Result<>{Error(std::errc::timed_out, "read")});
}

}  // namespace
}  // namespace regista
