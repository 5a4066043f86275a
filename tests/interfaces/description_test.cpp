// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regista/interfaces/messages.hpp>
#include <set>

namespace regista {
namespace {

using nlohmann::json;

/// Read from Player's own interface definitions, not from ours: those of our interfaces, and the universal requests.
const json& layouts() {
  static const json file = json::parse(std::ifstream{TEST_DATA "/player-layouts.json"});
  return file;
}

/// How the wire lays out a number: Player's name of the type.
template <typename T>
std::string number_type() {
  if constexpr (std::is_enum_v<T>) return number_type<std::underlying_type_t<T>>();
  if constexpr (std::same_as<T, double>) return "double";
  if constexpr (std::same_as<T, float>) return "float";
  if constexpr (std::same_as<T, std::int8_t>) return "char";
  if constexpr (std::same_as<T, std::uint8_t>) return "uint8_t";
  if constexpr (std::same_as<T, std::uint16_t>) return "uint16_t";
  if constexpr (std::same_as<T, std::int32_t>) return "int32_t";
  if constexpr (std::same_as<T, std::uint32_t>) return "uint32_t";
  return "?";
}

/// Compares one struct of ours with one of Player's: names, order, types, dimensions, all the way down.
template <typename T>
void compare(const std::string& theirs, const std::string& place) {
  const json& members = layouts()["structs"][theirs];
  ASSERT_FALSE(members.is_null()) << place << ": Player has no " << theirs;
  std::size_t next = 0;
  const auto compare_field = [&]<typename F>(const F& field) {
    using Value = typename F::Value;
    const std::string here = place + '.' + std::string{field.wire_name};
    if constexpr (is_optional<Value>) {
      EXPECT_EQ(next, members.size()) << here << ": ours alone, so it must come after Player's own";
      return;
    }
    if constexpr (is_vector<Value> || std::same_as<Value, Text>) {
      ASSERT_LT(next, members.size()) << here;
      EXPECT_EQ(members[next++], (json{std::string{field.wire_name} + "_count", "uint32_t", "", false})) << here;
    }
    ASSERT_LT(next, members.size()) << here;
    const json& member = members[next++];
    EXPECT_EQ(member[0], field.wire_name) << here;
    const std::string type = member[1];
    if constexpr (std::same_as<Value, Text>) {
      EXPECT_EQ(type, "char") << here;
    } else if constexpr (is_vector<Value> || is_array<Value>) {
      using Element = typename Value::value_type;
      if constexpr (Described<Element>) compare<Element>(type, here);
      if constexpr (!Described<Element>) {
        EXPECT_EQ(type, number_type<Element>()) << here;
      }
    } else if constexpr (Described<Value>) {
      compare<Value>(type, here);
    } else if constexpr (!is_optional<Value>) {
      EXPECT_EQ(type == "player_bool_t" ? "uint8_t" : type, number_type<Value>()) << here;
    }
    constexpr bool counted = is_vector<Value> || std::same_as<Value, Text>;
    EXPECT_EQ(member[3], counted) << here;
    if constexpr (counted) {
      EXPECT_EQ(member[2], field.max_count == unlimited ? json{"*"}[0] : json(field.max_count)) << here;
    } else if constexpr (is_array<Value>) {
      EXPECT_EQ(member[2], std::tuple_size_v<Value>) << here;
    } else {
      EXPECT_EQ(member[2], "") << here;
    }
  };
  fields<T>.apply([&](const auto&... field) { (compare_field(field), ...); });
  EXPECT_EQ(next, members.size()) << place << ": fields are missing";
}

template <typename M>
const json* layout_of() {
  constexpr Message m = M::message;
  for (const json& layout : layouts()["messages"]) {
    if (layout["interface"] == m.interface && layout["type"] == static_cast<int>(m.kind) &&
        layout["subtype"] == m.subtype) {
      return &layout;
    }
  }
  return nullptr;
}

/// A request's own struct where it has fields, else its answer's: Player has one for both.
template <typename M>
void compare_message(const std::string& place) {
  const json* layout = layout_of<M>();
  ASSERT_NE(layout, nullptr) << place << ": Player has no such message";
  if constexpr (M::message.interface != any_interface) {
    EXPECT_EQ((*layout)["name"], M::message.name) << place;
    EXPECT_EQ((*layout)["iname"], interface_name(M::message.interface)) << place;
  }
  const json& theirs = (*layout)["struct"];
  if constexpr (field_count<M> > 0) {
    ASSERT_TRUE(theirs.is_string()) << place << ": empty in Player";
    compare<M>(theirs, place);
  }
  if constexpr (RequestType<M>) {
    if constexpr (field_count<typename M::Reply> > 0) {
      ASSERT_TRUE(theirs.is_string()) << place << ": empty in Player";
      compare<typename M::Reply>(theirs, place + " (reply)");
    } else if constexpr (field_count<M> == 0) {
      EXPECT_TRUE(theirs.is_null()) << place << ": Player has fields";
    }
  } else if constexpr (field_count<M> == 0) {
    EXPECT_TRUE(theirs.is_null()) << place << ": Player has fields";
  }
}

template <typename Visit>
void for_each_message(Visit&& visit) {
  any_message(AllMessages{}, [&]<typename M>() { return (visit.template operator()<M>(), false); });
}

/// The kicker, and the extension of the player interface from subtype 100 on.
constexpr bool is_our_addition(const Message& m) {
  return m.interface == kicker::code ||
         ((m.interface == player::code || m.interface == planner::code) && m.subtype >= 100);
}

TEST(Description, agrees_with_players_own_definitions) {
  std::size_t count = 0;
  for_each_message([&]<typename M>() {
    if constexpr (!is_our_addition(M::message)) {
      compare_message<M>(std::string{interface_name(M::message.interface)} + ' ' + std::string{M::message.name});
      ++count;
    }
  });
  EXPECT_EQ(count, layouts()["messages"].size());
}

TEST(Description, leaves_out_no_message_of_its_interfaces) {
  std::set<std::tuple<int, int, int>> ours;
  for_each_message([&]<typename M>() {
    ours.insert({M::message.interface, static_cast<int>(M::message.kind), M::message.subtype});
  });
  for (const json& layout : layouts()["messages"]) {
    EXPECT_TRUE(ours.contains({layout["interface"], layout["type"], layout["subtype"]})) << layout;
  }
}

TEST(Description, has_each_interface_and_each_message_once) {
  std::map<std::uint16_t, std::set<std::pair<Kind, std::uint8_t>>> seen;
  for_each_message([&]<typename M>() {
    EXPECT_TRUE(seen[M::message.interface].insert({M::message.kind, M::message.subtype}).second) << M::message.name;
  });
  std::set<std::string_view> names;
  any_message(Interfaces{}, [&]<typename I>() {
    EXPECT_TRUE(names.insert(I::name).second) << I::name;
    EXPECT_EQ(interface_code(I::name), I::code);
    EXPECT_EQ(interface_name(I::code), I::name);
    return false;
  });
  EXPECT_EQ(names.size(), Interfaces::size);
  EXPECT_EQ(interface_code("laser"), 0);
  EXPECT_EQ(interface_name(6), "");
}

TEST(Description, names_each_field_of_a_message_once) {
  for_each_message([&]<typename M>() {
    std::set<std::string_view> ours;
    std::set<std::string_view> players;
    const auto insert = [&](const auto& field) {
      EXPECT_TRUE(ours.insert(field.name).second) << M::message.name << ' ' << field.name;
      EXPECT_TRUE(players.insert(field.wire_name).second) << M::message.name << ' ' << field.wire_name;
    };
    fields<M>.apply([&](const auto&... field) { (insert(field), ...); });
  });
}

TEST(Field, is_named_as_its_member) {
  using Names = std::vector<std::string_view>;
  const auto names = [](const auto&... field) { return Names{field.name...}; };
  EXPECT_EQ(fields<position2d::State>.apply(names), (Names{"pose", "velocity", "stalled"}));
  EXPECT_EQ(fields<property::GetInt>.apply(names), (Names{"key", "value"}));  // of a template
}

TEST(Flow, never_repeats_what_happens_once) {
  EXPECT_EQ(kicker::KickCommand::message.flow, Flow::edge);
  EXPECT_EQ(kicker::ChipCommand::message.flow, Flow::edge);
  EXPECT_EQ(dio::OutputCommand::message.flow, Flow::edge);
  EXPECT_EQ(opaque::Command::message.flow, Flow::edge);
  EXPECT_EQ(position2d::VelocityCommand::message.flow, Flow::set_point);
  EXPECT_EQ(kicker::DribblerCommand::message.flow, Flow::set_point);
}

TEST(Text, carries_the_terminating_zero_that_stock_receivers_expect) {
  EXPECT_EQ(Text{"stage"}.bytes(), std::string("stage\0", 6));
  EXPECT_EQ(Text{"stage"}.view(), "stage");
  EXPECT_EQ(Text{}.view(), "");
}

TEST(Text, keeps_the_bytes_of_a_peer) {
  EXPECT_EQ(Text::from_bytes("no zero").bytes(), "no zero");
  EXPECT_EQ(Text::from_bytes("no zero").view(), "no zero");
  EXPECT_EQ(Text::from_bytes(std::string("a\0b\0", 4)).view(), "a");
}

}  // namespace
}  // namespace regista
