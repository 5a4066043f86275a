// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>

#include <fstream>
#include <numbers>
#include <regista/device/plugin.hpp>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

/// As a server loads it, but at once: what is missing is found here. Stays loaded.
const Plugin* load(const std::string& file) {
  void* library = ::dlopen((PLUGINS "/" + file + ".so").c_str(), RTLD_NOW | RTLD_LOCAL);
  return library == nullptr ? nullptr : static_cast<const Plugin*>(::dlsym(library, "regista_plugin"));
}

TEST(Plugins, all_load_by_themselves_and_are_of_this_server) {
  for (const std::string name : {"regista/simulated_base", "regista/simulated_battery", "regista/simulated_kicker",
                                 "regista/localizer", "regista/posture", "regista/waypoint",
                                 "regista-examples/turntable", "regista-examples/lamps", "regista-faults/fake_base"}) {
    const Plugin* plugin = load(name);
    ASSERT_NE(plugin, nullptr) << ::dlerror();
    EXPECT_EQ(plugin->name, name.substr(name.find('/') + 1));
    EXPECT_STRNE(plugin->summary, "");
    EXPECT_EQ(plugin->api, plugin_api);
    EXPECT_EQ(plugin->layout, plugin_layout);
    EXPECT_NE(plugin->create, nullptr);
  }
}

TEST(Plugins, broken_ones_are_broken_as_their_names_say) {
  EXPECT_EQ(load("regista-faults/wrong_api")->api, plugin_api + 1);
  EXPECT_EQ(load("regista-faults/wrong_layout")->layout, plugin_layout + 1);
  EXPECT_EQ(load("regista-faults/no_symbol"), nullptr);
  EXPECT_NE(std::string{::dlerror()}.find("regista_plugin"), std::string::npos);
  EXPECT_EQ(load("regista-faults/undefined_symbol"), nullptr);
  EXPECT_NE(std::string{::dlerror()}.find("undefined symbol: foo"), std::string::npos);
}

TEST(Plugins, what_a_constructor_throws_crosses_over) {
  const Plugin* plugin = load("regista/simulated_base");
  ASSERT_NE(plugin, nullptr);
  EXPECT_THROW(Bench("size [1 2]", plugin->create), ConfigError);
}

void expect_all_keys_known(const std::string& file, const std::string& folder) {
  for (const Section& section : read_config(EXAMPLES "/" + file).drivers) {
    const Plugin* plugin = load(folder + "/" + section.text("name"));
    ASSERT_NE(plugin, nullptr) << ::dlerror();
    Setup setup{section};
    const auto driver = plugin->create(setup);
    for (const char* key : {"name", "plugin", "provides", "requires", "rate", "lease"}) (void)setup.config.has(key);
    EXPECT_NO_THROW(setup.config.check_unused());
  }
}

TEST(Plugins, know_every_key_of_the_examples) {
  expect_all_keys_known("sim.cfg", "regista");
#ifdef REGISTA_GPS
  expect_all_keys_known("sim_field.cfg", "regista");
  expect_all_keys_known("field_sensors.cfg", "regista");
#endif
  expect_all_keys_known("driver/turntable.cfg", "regista-examples");
}

class Turntable : public testing::Test {
 public:
  static Bench make(const std::string& keys = "") {
    return Bench{"provides [\"position1d:0\"] " + keys, load("regista-examples/turntable")->create};
  }
  static position1d::State state(Bench& bench) { return bench.latest<position1d::State>(); }
};

TEST_F(Turntable, turns_as_fast_as_told_and_stops_when_nobody_tells) {
  Bench bench = make();
  bench.drive(position1d::VelocityCommand{.velocity = 0.5F}, 2s);
  EXPECT_NEAR(state(bench).position, 1, 0.01);
  bench.run(1s);
  EXPECT_EQ(state(bench).velocity, 0);
}

TEST_F(Turntable, goes_to_a_position_no_faster_than_it_can_or_may) {
  Bench bench = make("fastest 45");
  bench.send(position1d::PositionCommand{.position = 2});
  bench.run(1s);
  EXPECT_NEAR(state(bench).velocity, std::numbers::pi / 4, 1e-6);
  bench.send(position1d::PositionCommand{.position = 2, .velocity = 0.1F});
  bench.run(20ms);
  EXPECT_NEAR(state(bench).velocity, 0.1, 1e-6);
  bench.send(position1d::PositionCommand{.position = 2});
  bench.run(10s);
  EXPECT_NEAR(state(bench).position, 2, 1e-6);
}

TEST_F(Turntable, a_client_changes_its_gain) {
  Bench bench = make("gain 2");
  ASSERT_TRUE(bench.ask(property::SetDouble{.key = Text{"gain"}, .value = 1}));
  bench.send(position1d::PositionCommand{.position = 0.5F});
  bench.run(10ms);
  const double to_go = 0.5 - state(bench).position;
  bench.run(10ms);
  EXPECT_NEAR(state(bench).velocity, to_go, 1e-6);
}

TEST_F(Turntable, is_told_where_it_is_only_at_rest) {
  Bench bench = make();
  ASSERT_TRUE(bench.ask(position1d::SetOdometry{.position = 3}));
  bench.drive(position1d::VelocityCommand{.velocity = 1}, 100ms);
  EXPECT_NEAR(state(bench).position, 3.1, 0.02);
  const auto refused = bench.ask(position1d::SetOdometry{});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "the table turns: stop it first");
}

TEST_F(Turntable, tells_its_size) {
  Bench bench = make("radius 0.2");
  EXPECT_EQ(bench.ask(position1d::GetGeometry{})->size.width, 0.4);
}

TEST_F(Turntable, fits_on_a_page) {
  std::ifstream source{EXAMPLES "/driver/turntable.cpp"};
  int lines = 0;
  for (std::string line; std::getline(source, line);) ++lines;
  EXPECT_LE(lines, 60);
  EXPECT_GT(lines, 10);
}

}  // namespace
}  // namespace regista
