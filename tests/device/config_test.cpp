// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include <regista/device/config.hpp>

namespace regista {
namespace {

using namespace std::chrono_literals;
using enum Value::Type;

/// driver at robot.cfg:1:1 with each key on a line of its own, from line 2 in column 3, and its values from column 10.
class Driver {
 public:
  Driver& set(const std::string& key, std::vector<Value> values) {
    ++line_;
    int column = 10;
    for (Value& value : values) {
      value.place = {"conf/robot.cfg", line_, column};
      column += static_cast<int>(value.text.size()) + 1;
    }
    section_.add({.key = key, .place = {"conf/robot.cfg", line_, 3}, .values = std::move(values)});
    return *this;
  }
  Section* operator->() { return &section_; }

 private:
  int line_ = 1;
  Section section_{"driver", {"conf/robot.cfg", 1, 1}};
};

Value num(std::string text) { return {number, std::move(text), {}}; }
Value str(std::string value) { return {text, std::move(value), {}}; }
Value flag(std::string text) { return {boolean, std::move(text), {}}; }

template <typename Action>
std::string complaint(Action&& action) {
  try {
    action();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "(none)";
}

TEST(Section, reads_what_is_there_and_falls_back_where_nothing_is) {
  Driver driver;
  driver.set("rate", {num("1e2")})
      .set("port", {str("/dev/ttyS0")})
      .set("count", {num("-7")})
      .set("fast", {flag("yes")});
  EXPECT_EQ(driver->number("rate"), 100);
  EXPECT_EQ(driver->number("mass", 2.5), 2.5);
  EXPECT_EQ(driver->text("port"), "/dev/ttyS0");
  EXPECT_EQ(driver->text("host", "localhost"), "localhost");
  EXPECT_EQ(driver->integer("count"), -7);
  EXPECT_EQ(driver->integer("retries", 3), 3);
  EXPECT_TRUE(driver->boolean("fast"));
  EXPECT_TRUE(driver->boolean("safe", true));
  EXPECT_EQ(driver->duration("lease", 500ms), Duration{500ms});
  EXPECT_EQ(driver->numbers("gains", {1, 2}), (std::vector<double>{1, 2}));
  EXPECT_TRUE(driver->has("rate"));
  EXPECT_FALSE(driver->has("nothing"));
}

TEST(Section, demands_a_key_that_has_no_fallback) {
  Driver driver;
  driver.set("prot", {str("/dev/ttyS0")});
  EXPECT_EQ(complaint([&] { (void)driver->text("port"); }),
            "conf/robot.cfg:1:1: section 'driver' lacks the key 'port'; is 'prot' at conf/robot.cfg:2:3 meant?");
  EXPECT_EQ(complaint([&] { (void)driver->angle("heading"); }),
            "conf/robot.cfg:1:1: section 'driver' lacks the key 'heading'");
}

TEST(Section, refuses_a_value_of_the_wrong_type_at_its_place) {
  Driver driver;
  driver.set("rate", {str("fast")}).set("mass", {str("5")}).set("port", {num("6665")}).set("steps", {num("1.5")});
  driver.set("on", {num("2")}).set("up", {str("true")}).set("gains", {num("1"), flag("true")});
  EXPECT_EQ(complaint([&] { (void)driver->number("rate"); }),
            "conf/robot.cfg:2:10: 'rate' must be a number, not \"fast\"");
  EXPECT_EQ(complaint([&] { (void)driver->number("mass"); }),
            "conf/robot.cfg:3:10: 'mass' must be a number: write 5 without quotes");
  EXPECT_EQ(complaint([&] { (void)driver->text("port"); }), "conf/robot.cfg:4:10: 'port' must be text: write \"6665\"");
  EXPECT_EQ(complaint([&] { (void)driver->integer("steps"); }),
            "conf/robot.cfg:5:10: 'steps' must be a whole number, not 1.5");
  EXPECT_EQ(complaint([&] { (void)driver->boolean("on"); }), "conf/robot.cfg:6:10: 'on' must be true or false, not 2");
  EXPECT_EQ(complaint([&] { (void)driver->boolean("up"); }),
            "conf/robot.cfg:7:10: 'up' must be true or false, not \"true\"");
  EXPECT_EQ(complaint([&] { (void)driver->numbers("gains"); }),
            "conf/robot.cfg:8:12: 'gains' must be a number, not true");
}

TEST(Section, refuses_a_number_out_of_range_in_the_units_it_is_written_in) {
  Driver driver;
  driver.set("rate", {num("0")}).set("turn", {num("270")}).set("radius", {num("-1")}).set("lease", {num("-0.5")});
  driver.set("size", {num("1"), num("9")}).set("count", {num("11")});
  driver->set_units({.metres = 0.01, .length_name = "cm"});
  EXPECT_EQ(complaint([&] { (void)driver->number("rate", {.min = 1, .max = 2000}); }),
            "conf/robot.cfg:2:10: 'rate' is 0, must be within [1, 2000]");
  EXPECT_EQ(complaint([&] { (void)driver->angle("turn", {.min = -std::numbers::pi, .max = std::numbers::pi}); }),
            "conf/robot.cfg:3:10: 'turn' is 270, must be within [-180, 180] degrees");
  EXPECT_EQ(complaint([&] { (void)driver->length("radius", 1, {.min = 0.02}); }),
            "conf/robot.cfg:4:10: 'radius' is -1, must be at least 2 cm");
  EXPECT_EQ(complaint([&] { (void)driver->duration("lease", {.max = 2}); }),
            "conf/robot.cfg:5:10: 'lease' is -0.5, must be within [0, 2] s");
  EXPECT_EQ(complaint([&] { (void)driver->numbers("size", {.max = 5}); }),
            "conf/robot.cfg:6:12: 'size' is 9, must be at most 5");
  EXPECT_EQ(complaint([&] { (void)driver->integer("count", 1, {.min = 1, .max = 10}); }),
            "conf/robot.cfg:7:10: 'count' is 11, must be within [1, 10]");
}

TEST(Section, refuses_a_duration_that_would_overflow_whatever_the_range) {
  Driver driver;
  driver.set("pause", {num("1e300")});
  EXPECT_EQ(complaint([&] { (void)driver->duration("pause", {.min = 1}); }),
            "conf/robot.cfg:2:10: 'pause' is 1e300, must be within [1, 1000000000] s");
}

TEST(Section, honours_units) {
  Driver driver;
  driver.set("radius", {num("8")})
      .set("turn", {num("90")})
      .set("size", {num("40"), num("25")})
      .set("wheels", {num("180")});
  EXPECT_DOUBLE_EQ(driver->length("radius"), 8);
  EXPECT_DOUBLE_EQ(driver->angle("turn"), std::numbers::pi / 2);
  driver->set_units({.metres = 0.001, .length_name = "mm", .radians = 1, .angle_name = "radians"});
  EXPECT_DOUBLE_EQ(driver->length("radius"), 0.008);
  EXPECT_DOUBLE_EQ(driver->angle("turn"), 90);
  EXPECT_EQ(driver->lengths("size"), (std::vector<double>{0.04, 0.025}));
  EXPECT_EQ(driver->angles("wheels"), (std::vector<double>{180}));
  EXPECT_DOUBLE_EQ(driver->length("height", 0.15), 0.15) << "a fallback is in metres already";
}

TEST(Section, reads_one_value_as_a_list_and_a_list_of_one_as_a_value) {
  Driver driver;
  driver.set("gain", {num("2")}).set("names", {str("a")}).set("pair", {num("1"), num("2")});
  EXPECT_EQ(driver->numbers("gain"), std::vector<double>{2});
  EXPECT_EQ(driver->texts("names"), std::vector<std::string>{"a"});
  EXPECT_EQ(driver->text("names"), "a");
  EXPECT_EQ(complaint([&] { (void)driver->number("pair"); }), "conf/robot.cfg:4:12: 'pair' must be one value, not 2");
}

TEST(Section, keeps_whole_numbers_exact) {
  Driver driver;
  driver.set("serial", {num("9007199254740993")}).set("least", {num("-9223372036854775808")}).set("plus", {num("+12")});
  driver.set("thousand", {num("1e3")}).set("five", {num("5.0")}).set("beyond", {num("9223372036854775808")});
  EXPECT_EQ(driver->integer("serial"), 9007199254740993);
  EXPECT_EQ(driver->integer("least"), std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(driver->integer("plus"), 12);
  EXPECT_EQ(driver->integer("thousand"), 1000);
  EXPECT_EQ(driver->integer("five"), 5);
  EXPECT_EQ(complaint([&] { (void)driver->integer("beyond"); }),
            "conf/robot.cfg:7:10: 'beyond' must be a whole number, not 9223372036854775808");
}

TEST(Section, starts_a_relative_path_from_the_file_that_names_it) {
  Driver driver;
  driver.set("map", {str("maps/hall.png")}).set("device", {str("/dev/ttyS0")});
  EXPECT_EQ(driver->file("map"), "conf/maps/hall.png");
  EXPECT_EQ(driver->file("device"), "/dev/ttyS0");
}

TEST(Section, finds_the_key_that_nobody_asked_for) {
  Driver driver;
  driver.set("port", {str("x")}).set("rtae", {num("50")}).set("colour", {num("1")});
  (void)driver->text("port");
  (void)driver->number("rate", 10);
  EXPECT_EQ(complaint([&] { driver->check_unused(); }), "conf/robot.cfg:3:3: unknown key 'rtae'; did you mean 'rate'?");
  (void)driver->has("rtae");
  EXPECT_EQ(complaint([&] { driver->check_unused(); }), "conf/robot.cfg:4:3: unknown key 'colour'");
  (void)driver->has("colour");
  EXPECT_NO_THROW(driver->check_unused());
}

TEST(Section, lets_a_driver_complain_at_the_value_or_at_the_section) {
  Driver driver;
  driver.set("wheels", {num("1")});
  EXPECT_STREQ(driver->error("wheels", "must be three or four angles").what(),
               "conf/robot.cfg:2:10: 'wheels' must be three or four angles");
  EXPECT_STREQ(driver->error("mode", "is needed with a gyro").what(),
               "conf/robot.cfg:1:1: 'mode' is needed with a gyro");
}

TEST(Section, refuses_a_key_twice_unless_the_first_came_from_a_template) {
  Section section{"driver", {"a.cfg", 1, 1}};
  section.add({.key = "rate", .place = {"a.cfg", 2, 3}, .values = {num("5")}, .inherited = true});
  section.add({.key = "rate", .place = {"a.cfg", 5, 3}, .values = {num("6")}});
  EXPECT_EQ(section.number("rate"), 6);
  EXPECT_EQ(complaint([&] { section.add({.key = "rate", .place = {"b.cfg", 6, 3}, .values = {num("7")}}); }),
            "b.cfg:6:3: 'rate' is already set at a.cfg:5:3");
}

TEST(Section, gives_device_names_their_places) {
  Driver driver;
  driver.set("provides", {str("position2d:0"), str("odometry:::position2d:1")}).set("requires", {str("positon2d:0")});
  const auto provided = driver->device_names("provides");
  ASSERT_EQ(provided.size(), 2);
  EXPECT_EQ(provided[1].name, (DeviceName{.key = "odometry", .host = {}, .interface = Position2d::code, .index = 1}));
  EXPECT_EQ(to_string(provided[1].place), "conf/robot.cfg:2:23");
  EXPECT_EQ(complaint([&] { (void)driver->device_names("requires"); }),
            "conf/robot.cfg:3:10: device 'positon2d:0': unknown interface 'positon2d'; did you mean 'position2d'?");
  EXPECT_TRUE(driver->device_names("none").empty());
}

TEST(ParseNumber, takes_finite_decimals_and_nothing_else) {
  for (const auto& [text, value] : {std::pair{"1e2", 100.0}, {"+5", 5.0}, {"-.5", -0.5}, {"1.", 1.0}, {"1E-3", 0.001}})
    EXPECT_EQ(parse_number(text), value) << text;
  for (const char* text :
       {"", "-", "+", ".", "1-2", "+-1", "--1", "0x10", "1e", "inf", "-inf", "nan", "1e999", "1,5", " 1"})
    EXPECT_FALSE(parse_number(text)) << text;
}

TEST(ParseDeviceName, reads_from_the_right) {
  const auto parsed = [](std::string_view text) { return parse_device_name(text); };
  EXPECT_EQ(*parsed("position2d:0"), (DeviceName{.key = {}, .host = {}, .interface = 4, .index = 0}));
  EXPECT_EQ(*parsed("6666:power:3"), (DeviceName{.key = {}, .host = {}, .port = 6666, .interface = 2, .index = 3}));
  EXPECT_EQ(*parsed("robot7.local:6665:position2d:0"),
            (DeviceName{.key = {}, .host = "robot7.local", .port = 6665, .interface = 4, .index = 0}));
  EXPECT_EQ(*parsed("odometry:::position2d:65535"),
            (DeviceName{.key = "odometry", .host = {}, .interface = 4, .index = 65535}));
  EXPECT_EQ(*parsed("::position2d:0"), *parsed("position2d:0"));
}

TEST(ParseDeviceName, says_which_part_is_wrong) {
  const auto wrong = [](std::string_view text) {
    const auto name = parse_device_name(text);
    return name ? "(none)" : name.error().what;
  };
  EXPECT_EQ(wrong("position2d"), "device 'position2d': needs an interface and an index, such as 'position2d:0'");
  EXPECT_EQ(wrong(""), "device '': needs an interface and an index, such as 'position2d:0'");
  EXPECT_EQ(wrong("position2d:x"), "device 'position2d:x': index 'x' must be a number within [0, 65535]");
  EXPECT_EQ(wrong("position2d:"), "device 'position2d:': index '' must be a number within [0, 65535]");
  EXPECT_EQ(wrong("position2d:-1"), "device 'position2d:-1': index '-1' must be a number within [0, 65535]");
  EXPECT_EQ(wrong("position2d:65536"), "device 'position2d:65536': index '65536' must be a number within [0, 65535]");
  EXPECT_EQ(wrong("0:position2d:0"), "device '0:position2d:0': port '0' must be a number within [1, 65535]");
  EXPECT_EQ(wrong("robot7:position2d:0"),
            "device 'robot7:position2d:0': port 'robot7' must be a number within [1, 65535]");
  EXPECT_EQ(wrong("a:b:c:1:position2d:0"),
            "device 'a:b:c:1:position2d:0': at most five parts, key:host:port:interface:index");
  EXPECT_EQ(wrong("laser:0"),
            "device 'laser:0': unknown interface 'laser'; known are power, position2d, gps, dio, aio, localize, "
            "simulation, planner, joystick, opaque, position1d, actarray, imu, kicker");
  EXPECT_EQ(wrong("position:0"), "device 'position:0': unknown interface 'position'; did you mean 'position2d'?");
}

RC_GTEST_PROP(DeviceNameText, there_and_back_is_the_same, ()) {
  const auto word = rc::gen::container<std::string>(rc::gen::elementOf(std::string{"ab.-_7"}));
  const DeviceName name{.key = *word,
                        .host = *word,
                        .port = *rc::gen::arbitrary<std::uint16_t>(),
                        .interface = *rc::gen::element(Position2d::code, Kicker::code, Opaque::code),
                        .index = *rc::gen::arbitrary<std::uint16_t>()};
  RC_ASSERT(*parse_device_name(to_string(name)) == name);
}

TEST(DeviceNameText, leaves_out_what_is_not_set) {
  for (const char* text : {"position2d:0", "6666:power:3", "robot7::imu:0", "robot7:6665:position2d:0",
                           "odometry:::position2d:0", "motor::6666:dio:1"})
    EXPECT_EQ(to_string(*parse_device_name(text)), text);
}

// The distances are those of the literature: Damerau 1964, and Boytsov 2011 for "ca" and "abc", which tells the
// restricted distance (3) from the unrestricted one (2).
TEST(EditDistance, counts_edits_and_swaps) {
  EXPECT_EQ(edit_distance("rate", "rate"), 0);
  EXPECT_EQ(edit_distance("rtae", "rate"), 1);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3);
  EXPECT_EQ(edit_distance("ca", "abc"), 3);
  EXPECT_EQ(edit_distance("", "abc"), 3);
  EXPECT_EQ(edit_distance("abc", ""), 3);
}

TEST(Closest, suggests_only_what_is_mostly_right) {
  const std::vector<std::string> known{"rate", "alwayson", "aio"};
  EXPECT_EQ(closest("raet", known), "rate");
  EXPECT_EQ(closest("always_on", known), "alwayson");
  EXPECT_EQ(closest("ir", known), "") << "half of it would be wrong";
  EXPECT_EQ(closest("x", known), "");
  EXPECT_EQ(closest(std::string(1000, 'r'), known), "");
  EXPECT_EQ(closest("rats", std::vector<std::string>{"bats", "rate"}), "bats") << "the first of equals";
}

}  // namespace
}  // namespace regista
