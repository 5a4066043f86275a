// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

// The code between the lines below is that of docs/adding-an-interface.md; Documentation compares the two.
// --8<--
#include <regista/interfaces/message.hpp>

/// A gripper with two fingers.
namespace regista::gripper {

inline constexpr std::uint16_t code = 3;

struct State {
  std::uint32_t state = 0;
  std::uint32_t beams = 0;
  std::uint8_t stored = 0;

  static constexpr Message message{code, Kind::data, 1, "STATE"};
  static constexpr auto fields = Fields{Field<&State::state>{"state", "", "1 open, 2 closed, 3 moving, 4 error"},
                                        Field<&State::beams>{"beams", "", "bit 0 is the outer beam; 1: broken"},
                                        Field<&State::stored>{"stored", "", "objects held"}};
  friend bool operator==(const State&, const State&) = default;
};

struct OpenCommand {
  static constexpr Message message{code, Kind::command, 1, "OPEN", Flow::edge, "gripper"};
  static constexpr auto fields = Fields{};
  friend bool operator==(const OpenCommand&, const OpenCommand&) = default;
};

}  // namespace regista::gripper

namespace regista {

struct Gripper {
  static constexpr std::uint16_t code = gripper::code;
  static constexpr std::string_view name = "gripper";
  using Messages = TypeList<gripper::State, gripper::OpenCommand>;
};

}  // namespace regista
// --8<--

#include <fstream>
#include <iterator>

namespace regista {
namespace {

static_assert(InterfaceType<Gripper>);
static_assert(DataType<gripper::State>);
static_assert(CommandType<gripper::OpenCommand>);

std::string text_of(const char* file) { return {std::istreambuf_iterator{std::ifstream{file}.rdbuf()}, {}}; }

TEST(Documentation, of_adding_an_interface_shows_code_that_compiles) {
  const std::string mark = "// --8<--\n";
  const std::string test = text_of(TEST_DATA "/../interfaces/adding_an_interface_test.cpp");
  const std::size_t begin = test.find('\n' + mark) + 1 + mark.size();
  const std::string code = test.substr(begin, test.find('\n' + mark, begin) + 1 - begin);
  ASSERT_GT(code.size(), 500U);
  EXPECT_NE(text_of(TEST_DATA "/../../docs/adding-an-interface.md").find(code), std::string::npos) << code;
}

}  // namespace
}  // namespace regista
