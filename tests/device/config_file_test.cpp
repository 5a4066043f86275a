// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <regista/device/config_file.hpp>

#include <map>

namespace regista {
namespace {

using Files = std::map<std::string, std::string>;

/// robot.cfg and what it includes, in memory.
ConfigFile parse(std::string_view text, const Files& files = {}) {
  return parse_config(text, "robot.cfg", [&](const std::filesystem::path& file) -> Result<std::string> {
    const auto found = files.find(file.string());
    if (found == files.end()) return Error{std::errc::no_such_file_or_directory, "read " + file.string()};
    return found->second;
  });
}

std::string complaint(std::string_view text, const Files& files = {}) {
  try {
    (void)parse(text, files);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "(none)";
}

Section only_driver(std::string_view text, const Files& files = {}) {
  ConfigFile config = parse(text, files);
  EXPECT_EQ(config.drivers.size(), 1);
  return config.drivers.at(0);
}

TEST(ConfigFile, reads_what_player_reads) {
  const ConfigFile config = parse(
      "# Desc: a differential base\n"
      "driver\n"
      "(\n"
      "  name \"p2os\"\n"
      "  provides [\"odometry:::position2d:0\"\n"
      "            \"dio:0\"\n"
      "            \"power:0\"\n"
      "           ]\n"
      "  port \"/dev/ttyS0\"   # the cable\n"
      "  alwayson 1\n"
      ")\n"
      "driver( name \"vfh\" provides [\"position2d:1\"] requires [\"position2d:0\"] safety_dist 0.1 debug false )\n");
  ASSERT_EQ(config.drivers.size(), 2);
  const Section& base = config.drivers[0];
  EXPECT_EQ(base.text("name"), "p2os");
  EXPECT_EQ(base.device_names("provides").size(), 3);
  EXPECT_EQ(base.text("port"), "/dev/ttyS0");
  EXPECT_TRUE(base.boolean("alwayson"));
  EXPECT_NO_THROW(base.check_unused());
  EXPECT_EQ(to_string(base.place()), "robot.cfg:2:1");
  const Section& skill = config.drivers[1];
  EXPECT_EQ(skill.number("safety_dist"), 0.1);
  EXPECT_FALSE(skill.boolean("debug"));
  EXPECT_STREQ(skill.error("safety_dist", "is small").what(), "robot.cfg:12:84: 'safety_dist' is small");
}

TEST(ConfigFile, reads_what_player_stumbles_over) {
  const Section driver = only_driver(
      "driver\r\n(\r\n"
      "  provides[\"position2d:0\"]  # " +
      std::string(5000, '-') +
      "\r\n"
      "  gain 1.5e-3\r\n"
      "  gains [1  # of x\r\n"
      "         # of y is the same\r\n"
      "         +2E1 -.5]\r\n"
      "  text \"" +
      std::string(5000, 'x') +
      "\"\r\n"
      "  alwayson true\r\n"
      ")");
  EXPECT_EQ(driver.device_names("provides").size(), 1);
  EXPECT_EQ(driver.number("gain"), 0.0015);
  EXPECT_EQ(driver.numbers("gains"), (std::vector<double>{1, 20, -0.5}));
  EXPECT_EQ(driver.text("text").size(), 5000);
  EXPECT_TRUE(driver.boolean("alwayson"));
}

TEST(ConfigFile, knows_an_index_of_a_key_from_a_tuple) {
  const Section driver = only_driver("driver(\n color[0] [255 0 0]\n mode[12] yes\n limits[5]\n rate 3 more[1]# x\n)");
  EXPECT_EQ(driver.numbers("color[0]"), (std::vector<double>{255, 0, 0}));
  EXPECT_TRUE(driver.boolean("mode[12]"));
  EXPECT_EQ(driver.numbers("limits"), (std::vector<double>{5}));
  EXPECT_EQ(driver.numbers("more"), (std::vector<double>{1}));
}

TEST(ConfigFile, takes_every_line_end_and_a_byte_order_mark) {
  EXPECT_EQ(complaint("\xEF\xBB\xBF; "), complaint("; "));
  for (const char* text : {"\n\n  ;", "\r\n\r\n  ;", "\r\r  ;"})
    EXPECT_EQ(complaint(text), "robot.cfg:3:3: ';' has no meaning here: a statement ends with its value");
}

TEST(ConfigFile, lets_utf8_pass_and_counts_its_characters) {
  const Section driver = only_driver("driver( # größer\n name \"Käfer\" rate \"x\" )");
  EXPECT_EQ(driver.text("name"), "Käfer");
  EXPECT_STREQ(driver.error("rate", "!").what(), "robot.cfg:2:20: 'rate' !");
}

TEST(ConfigFile, writes_templates_out) {
  const ConfigFile config = parse(
      "define base driver( name \"fake\" rate 50 limits [1 2 3] )\n"
      "define fast base( rate 1000 )\n"
      "base( provides [\"position2d:0\"] )\n"
      "fast( provides [\"position2d:1\"] limits [9] )\n");
  ASSERT_EQ(config.drivers.size(), 2);
  EXPECT_EQ(config.drivers[0].type(), "driver");
  EXPECT_EQ(config.drivers[0].number("rate"), 50);
  EXPECT_EQ(to_string(config.drivers[0].place()), "robot.cfg:3:1");
  EXPECT_EQ(config.drivers[1].text("name"), "fake");
  EXPECT_EQ(config.drivers[1].number("rate"), 1000);
  EXPECT_EQ(config.drivers[1].numbers("limits"), std::vector<double>{9}) << "no tail of the template's tuple";
  EXPECT_STREQ(config.drivers[0].error("rate", "?").what(), "robot.cfg:1:38: 'rate' ?");
}

TEST(ConfigFile, includes_files_relative_to_the_one_that_includes) {
  const Files files{{"parts/base.cfg", "include \"more/unit.cfg\"\ndefine base driver( map \"hall.png\" )\n"},
                    {"parts/more/unit.cfg", "unit_length \"cm\""}};
  const Section driver = only_driver("include \"parts/base.cfg\"\nbase( radius 8 )", files);
  EXPECT_DOUBLE_EQ(driver.length("radius"), 0.08);
  EXPECT_EQ(driver.file("map"), "parts/hall.png");
}

TEST(ConfigFile, applies_units_to_all_sections_wherever_they_are_set) {
  const ConfigFile config = parse("driver( turn 90 )\nserver( turn 1 )\nunit_angle \"radians\"\nunit_length \"mm\"");
  EXPECT_DOUBLE_EQ(config.drivers[0].angle("turn"), 90);
  EXPECT_DOUBLE_EQ(config.server.angle("turn"), 1);
  EXPECT_DOUBLE_EQ(only_driver("driver( turn 90 )").angle("turn"), std::numbers::pi / 2);
}

TEST(ConfigFile, keeps_server_and_plugins) {
  const ConfigFile config = parse("plugin \"libmine\"\nserver( listen \"::1\" )\ndriver( plugin \"ours\" name \"x\" )");
  ASSERT_EQ(config.plugins.size(), 1);
  EXPECT_EQ(config.plugins[0].text, "libmine");
  EXPECT_EQ(to_string(config.plugins[0].place), "robot.cfg:1:8");
  EXPECT_EQ(config.server.text("listen"), "::1");
  EXPECT_EQ(config.drivers[0].text("plugin"), "ours");
}

TEST(ConfigFile, has_an_empty_server_section_when_the_file_has_none) {
  const ConfigFile config = parse("");
  EXPECT_EQ(config.server.text("listen", "127.0.0.1"), "127.0.0.1");
  EXPECT_NO_THROW(config.server.check_unused());
}

struct Wrong {
  const char* text;
  const char* error;
};

TEST(ConfigFile, says_what_is_wrong_where_and_how_to_mend_it) {
  for (const auto& [text, error] : std::initializer_list<Wrong>{
           // Sections
           {"\ndrivr(\n)", "2:1: unknown section 'drivr'; did you mean 'driver'?"},
           {"define camera driver()\ncamra()", "2:1: unknown section 'camra'; did you mean 'camera'?"},
           {"window( size [1 2] )",
            "1:1: unknown section 'window'; known are 'driver', 'server' and what define has named before"},
           {"interface( name \"x\" )",
            "1:1: interface plugins are not loaded; a driver sends data of its own through 'opaque:0'"},
           {"server()\nserver()", "2:1: a second section 'server'; the first is at robot.cfg:1:1"},
           {"\n driver(\n rate 5\n", "2:2: section 'driver' is not closed: add ')'"},
           {"driver(\n rate 5\ndriver(\n)",
            "3:1: 'driver' begins inside of section 'driver', opened at robot.cfg:1:1: is a ')' missing?"},
           {"driver( ) )", "1:11: ')' closes nothing: delete it"},
           {"( name \"x\" )", "1:1: '(' needs the section's type before it: driver("},
           {"driver\nname \"x\"", "1:1: 'driver' needs '('"},
           // Keys and values
           {"driver( rate )", "1:9: 'rate' has no value on its line"},
           {"driver( rate\n 5 )", "1:9: 'rate' has no value on its line"},
           {"driver( name fast )", "1:14: text needs quotes: \"fast\""},
           {"driver( names [a b] )", "1:16: text needs quotes: \"a\""},
           {"driver( rate 5\n rate 6 )", "2:2: 'rate' is already set at robot.cfg:1:9"},
           {"driver( size 5 6 )", "1:16: several values of 'size' need brackets: [ ]"},
           {"driver( \"name\" )", "1:9: expected a key, found \"name\""},
           {"driver( 5 )", "1:9: expected a key, found '5'"},
           {"driver( ] )", "1:9: expected a key, found ']'"},
           {"driver( size [ ] )", "1:14: the tuple of 'size' is empty"},
           {"driver( size [1\n)", "1:14: the tuple of 'size' is not closed: add ']'"},
           {"driver( size [1 [2]] )", "1:17: a tuple cannot hold a tuple"},
           // Words and characters
           {"driver( rate 1-2 )", "1:14: '1-2' is not a number"},
           {"driver( rate 0x1F )", "1:14: '0x1F' is not a number"},
           {"driver( rate 1e999 )", "1:14: '1e999' is not a number"},
           {"driver( name \"x )\n", "1:14: the string is not closed on its line: add '\"'"},
           {"driver( name \"x", "1:14: the string is not closed on its line: add '\"'"},
           {"driver( rate 5; )", "1:15: ';' has no meaning here: a statement ends with its value"},
           {"driver( size [1, 2] )", "1:16: ',' has no meaning here: values are separated by spaces"},
           {"driver( rate = 5 )", "1:14: '=' has no meaning here: write the key, a space, the value"},
           {"driver { rate 5 }", "1:8: '{' has no meaning here: a section is in ( )"},
           {"driver( name 'x' )", "1:14: ' has no meaning here: text is in \"double quotes\""},
           {"driver( ) // end", "1:11: '/' has no meaning here: a comment starts with #, and a path is in \"quotes\""},
           {"driver( rate 5 ! )", "1:16: '!' has no meaning here"},
           {"driver( größe 5 )", "1:11: byte 0xC3: outside of strings and comments only ASCII"},
           {"driver( name \"a\x01\" )", "1:16: control character 0x01: is this a text file?"},
           {"# \x7f", "1:3: control character 0x7F: is this a text file?"},
           // Statements
           {"include base.cfg", "1:1: include needs a file in quotes on its line: include \"base.cfg\""},
           {"\ninclude \"base.cfg\"", "2:9: read base.cfg: No such file or directory"},
           {"driver( include \"a\" )", "1:9: 'include' must stand outside of sections"},
           {"driver( define a driver() )", "1:9: 'define' must stand outside of sections"},
           {"plugin mine", "1:1: plugin needs a name in quotes on its line: plugin \"my_driver\""},
           {"define driver(", "1:1: define needs a name, a type and a section: define base driver( ... )"},
           {"define driver driver()", "1:8: 'driver' is a word of the language: choose another name"},
           {"define a driver()\ndefine a driver()", "2:8: 'a' is already defined at robot.cfg:1:10"},
           {"define a drver()", "1:10: unknown section 'drver'; did you mean 'driver'?"},
           {"unit_length \"inch\"", R"(1:13: 'unit_length' must be "m", "cm" or "mm", not "inch")"},
           {"unit_angle \"grad\"", R"(1:12: 'unit_angle' must be "degrees" or "radians", not "grad")"},
           {"unit_lenght \"cm\"", "1:1: unknown key 'unit_lenght'; did you mean 'unit_length'?"},
       })
    EXPECT_EQ(complaint(text), std::string{"robot.cfg:"} + error) << text;
}

TEST(ConfigFile, refuses_a_nul) {
  EXPECT_EQ(complaint(std::string_view{"driver\0()", 9}),
            "robot.cfg:1:7: control character 0x00: is this a text file?");
}

TEST(ConfigFile, names_the_included_file_in_errors) {
  EXPECT_EQ(complaint("include \"parts/base.cfg\"", {{"parts/base.cfg", "\n  drivr()"}}),
            "parts/base.cfg:2:3: unknown section 'drivr'; did you mean 'driver'?");
  EXPECT_EQ(complaint("include \"a.cfg\"\n)", {{"a.cfg", "driver(\n"}}),
            "a.cfg:1:1: section 'driver' is not closed: add ')'");
}

TEST(ConfigFile, refuses_includes_in_a_circle) {
  EXPECT_EQ(complaint("include \"./robot.cfg\""), "robot.cfg:1:9: 'robot.cfg' includes itself: robot.cfg > robot.cfg");
  const Files files{{"a/b.cfg", "include \"c.cfg\""}, {"a/c.cfg", "include \"../a/b.cfg\""}};
  EXPECT_EQ(complaint("include \"a/b.cfg\"", files),
            "a/c.cfg:1:9: 'a/b.cfg' includes itself: robot.cfg > a/b.cfg > a/c.cfg > a/b.cfg");
}

TEST(ConfigFile, lets_a_file_be_included_twice_one_after_the_other) {
  EXPECT_EQ(parse("include \"a.cfg\"\ninclude \"a.cfg\"", {{"a.cfg", "driver()"}}).drivers.size(), 2);
}

TEST(ConfigFile, ends_at_its_limits) {
  Files deep;
  for (int i = 0; i < 20; ++i) deep[std::to_string(i)] = "include \"" + std::to_string(i + 1) + "\"";
  EXPECT_EQ(
      complaint("include \"0\"", deep),
      "14:1:9: more than 16 files deep: robot.cfg > 0 > 1 > 2 > 3 > 4 > 5 > 6 > 7 > 8 > 9 > 10 > 11 > 12 > 13 > 14");

  EXPECT_EQ(complaint(std::string((1 << 20) + 1, ' ')), "robot.cfg: longer than 1 MiB");

  std::string keys = "(";
  for (int i = 0; i < 256; ++i) keys += "\nkey" + std::to_string(i) + " 1";
  EXPECT_EQ(complaint("define full driver" + keys + ")\nfull( key7 2 )"), "(none)");
  EXPECT_EQ(complaint("driver" + keys + "\nkey256 1)"), "robot.cfg:258:1: more than 256 keys in one section");

  // Each file includes the next one twice: without a limit, 2^15 files.
  Files wide;
  for (int i = 0; i < 14; ++i) {
    const std::string next = "include \"" + std::to_string(i + 1) + "\"\n";
    wide[std::to_string(i)] = next + next;
  }
  wide["14"] = "";
  EXPECT_TRUE(complaint("include \"0\"", wide)
                  .ends_with(": the configuration is larger than 8 MiB with its includes and templates"));

  std::string copies = "define big driver( text \"" + std::string(100'000, 'x') + "\" )\n";
  for (int i = 0; i < 1000; ++i) copies += "big()\n";
  EXPECT_TRUE(complaint(copies).ends_with(": the configuration is larger than 8 MiB with its includes and templates"));
}

TEST(ReadConfig, reads_files) {
  const std::filesystem::path directory = std::filesystem::path{TEST_DATA} / "config";
  const ConfigFile config = read_config(directory / "robot.cfg");
  ASSERT_EQ(config.drivers.size(), 2);
  EXPECT_EQ(config.drivers[0].file("calibration"), directory / "parts" / "wheels.txt");
  EXPECT_EQ(config.drivers[1].device_names("requires").size(), 1);
}

TEST(ReadConfig, names_a_file_that_it_cannot_read) {
  const auto error = [](const std::filesystem::path& file) {
    try {
      (void)read_config(file);
    } catch (const ConfigError& problem) {
      return std::string{problem.what()};
    }
    return std::string{"(none)"};
  };
  EXPECT_EQ(error("nowhere/robot.cfg"), "nowhere/robot.cfg: No such file or directory");
  EXPECT_EQ(error(TEST_DATA), TEST_DATA ": Is a directory");
}

TEST(ParseConfig, reads_the_example_of_the_documentation) {
  const std::string page = *load_file(std::filesystem::path{TEST_DATA} / ".." / ".." / "docs" / "configuration.md");
  const std::size_t begin = page.find("# robot.cfg:");
  ASSERT_NE(begin, std::string::npos);
  const ConfigFile config = parse(page.substr(begin, page.find("```", begin) - begin), {{"parts/wheels.cfg", ""}});
  ASSERT_EQ(config.drivers.size(), 2);
  const Section& base = config.drivers[0];
  EXPECT_EQ(base.number("rate"), 250);
  EXPECT_DOUBLE_EQ(base.length("radius"), 0.09);
  EXPECT_DOUBLE_EQ(base.angles("wheels").at(2), 210 * std::numbers::pi / 180);
  EXPECT_EQ(base.device_names("provides").at(0).name.key, "output");
  EXPECT_EQ(config.drivers[1].text("plugin"), "libregista_waypoint");
  EXPECT_EQ(config.server.text("listen"), "127.0.0.1");
}

/// tests/data/config/bad: the first line of each file is a comment that says what the complaint must be.
TEST(ParseConfig, refuses_every_bad_file_in_the_words_that_it_names) {
  const std::filesystem::path directory = std::filesystem::path{TEST_DATA} / "config" / "bad";
  const auto load = [&](const std::filesystem::path& file) { return load_file(directory / file); };
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator{directory}) {
    const std::string name = entry.path().filename().string();
    const std::string text = *load(name);
    ASSERT_TRUE(text.starts_with("# ")) << name;
    try {
      const ConfigFile config = parse_config(text, name, load);
      for (const Section& driver : config.drivers) {
        (void)driver.text("name");
        (void)driver.number("rate", 50, {.min = 1, .max = 2000});
        (void)driver.boolean("alwayson", false);
        (void)driver.device_names("provides");
        (void)driver.device_names("requires");
        driver.check_unused();
      }
      ADD_FAILURE() << name << " was not refused";
    } catch (const ConfigError& error) {
      EXPECT_EQ(error.what(), text.substr(2, text.find('\n') - 2));
    }
    ++count;
  }
  EXPECT_GE(count, 10);
}

TEST(ConfigFile, of_another_program_has_sections_of_its_own) {
  constexpr std::array<std::string_view, 2> types{"vision", "robot"};
  const auto sections = parse_sections("robot( id 3 )\nvision( delay 0.03 )\nrobot( id 4 )", "a.cfg", types);
  ASSERT_EQ(sections.size(), 3U);
  EXPECT_EQ(sections[0].integer("id"), 3);
  EXPECT_EQ(sections[1].type(), "vision");
  EXPECT_EQ(sections[2].integer("id"), 4);
  EXPECT_THROW((void)parse_sections("driver()", "a.cfg", types), ConfigError);
  EXPECT_THROW((void)parse_sections("plugin \"x\"", "a.cfg", types), ConfigError);
}

}  // namespace
}  // namespace regista
