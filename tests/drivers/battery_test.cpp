// SPDX-License-Identifier: Apache-2.0
#include "battery.hpp"

#include <filesystem>
#include <fstream>
#include <map>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

/// A sysfs that a test fills.
class Battery : public testing::Test {
 protected:
  Battery() : root_{fs::path{testing::TempDir()} / ("sysfs-" + std::to_string(::getpid()))} {
    fs::create_directories(root_);
  }
  ~Battery() override { fs::remove_all(root_); }

  void write(const std::string& folder, const std::map<std::string, std::string>& files) {
    fs::create_directories(root_ / "class" / folder);
    for (const auto& [name, text] : files) std::ofstream{root_ / "class" / folder / name} << text << '\n';
  }
  Bench bench(const std::string& keys = "") {
    return Bench::of<BatteryDriver>("provides [\"power:0\"] root \"" + root_.string() + "\" " + keys);
  }

  fs::path root_;
};

// As a notebook's ACPI says it (cat /sys/class/power_supply/BAT0/*).
const std::map<std::string, std::string> notebook{
    {"type", "Battery"},         {"status", "Discharging"}, {"present", "1"},           {"capacity", "87"},
    {"voltage_now", "12243000"}, {"power_now", "9840000"},  {"energy_now", "43190000"}, {"energy_full", "49600000"}};

TEST_F(Battery, is_found_and_read_in_si) {
  write("power_supply/AC", {{"type", "Mains"}, {"online", "0"}});
  write("power_supply/BAT0", notebook);
  write("power_supply/A_mouse", {{"type", "Battery"}, {"scope", "Device"}, {"capacity", "3"}});
  Bench bench = this->bench();
  bench.run(20ms);
  const auto state = bench.latest<power::State>();
  EXPECT_EQ(state.valid, 31U);
  EXPECT_NEAR(state.voltage_v, 12.243, 1e-5);
  EXPECT_NEAR(state.charge_percent, 87, 1e-4);
  EXPECT_NEAR(state.power_w, 9.84, 1e-5);
  EXPECT_NEAR(state.energy_j, 43.19 * 3600, 0.1);
  EXPECT_EQ(state.charging, 0);
  EXPECT_EQ(bench.events(), "");
}

TEST_F(Battery, tells_charge_and_current_of_a_smart_battery) {
  write("power_supply/sbs", {{"type", "Battery"},
                             {"status", "Charging"},
                             {"voltage_now", "25000000"},
                             {"current_now", "-1500000"},  // of some drivers, whichever way it flows
                             {"charge_now", "4000000"},
                             {"charge_full", "8000000"}});
  Bench bench = this->bench("supply \"sbs\"");
  bench.run(20ms);
  const auto state = bench.latest<power::State>();
  EXPECT_NEAR(state.charge_percent, 50, 1e-4);
  EXPECT_NEAR(state.power_w, -37.5, 1e-4) << "drawn from the battery";
  EXPECT_NEAR(state.energy_j, 4 * 25 * 3600, 1);
  EXPECT_EQ(state.charging, 1);
}

TEST_F(Battery, says_only_what_it_knows) {
  write("power_supply/BAT0",
        {{"type", "Battery"}, {"status", "Unknown"}, {"voltage_now", "12000000"}, {"capacity", ""}});
  Bench bench = this->bench();
  bench.run(20ms);
  EXPECT_EQ(bench.latest<power::State>().valid, std::uint32_t{power::volts});
}

TEST_F(Battery, a_voltage_sensor_tells_the_charge_by_a_line) {
  write("hwmon/hwmon0", {{"name", "coretemp"}});
  write("hwmon/hwmon1", {{"name", "ina226"}, {"in1_input", "24000"}, {"curr1_input", "2500"}});
  Bench bench = this->bench("sensor \"ina226\" current \"curr1\" empty_voltage 22 full_voltage 26");
  bench.run(20ms);
  const auto state = bench.latest<power::State>();
  EXPECT_EQ(state.valid, std::uint32_t{power::volts | power::percent | power::watts});
  EXPECT_NEAR(state.voltage_v, 24, 1e-5);
  EXPECT_NEAR(state.power_w, 60, 1e-4);
  EXPECT_NEAR(state.charge_percent, 50, 1e-4);
  write("hwmon/hwmon1", {{"in1_input", "27000"}});
  bench.run(20ms);
  EXPECT_EQ(bench.latest<power::State>().charge_percent, 100);
}

TEST_F(Battery, low_and_critical_are_told_once_and_left_with_a_margin) {
  write("power_supply/BAT0", notebook);
  Bench bench = this->bench();
  const auto at = [&](const char* percent) {
    write("power_supply/BAT0", {{"capacity", percent}});
    bench.run(50ms);
    return bench.events();
  };
  EXPECT_EQ(at("21"), "");
  EXPECT_EQ(at("20"), "power:0: battery low: 20 %, 12.24 V\n");
  EXPECT_EQ(at("21"), "");
  EXPECT_EQ(at("20"), "");
  EXPECT_EQ(at("10"), "power:0: battery critical: 10 %, 12.24 V: stop and charge it, or the computer will be off\n");
  EXPECT_EQ(bench.ask(property::GetText{.key = Text{"level"}})->value.view(), "critical");
  EXPECT_EQ(at("12"), "");
  EXPECT_EQ(at("13"), "power:0: battery low: 13 %, 12.24 V\n");
  EXPECT_EQ(at("22"), "");
  EXPECT_EQ(at("23"), "power:0: battery good again: 23 %, 12.24 V\n");
  EXPECT_EQ(bench.ask(property::GetText{.key = Text{"level"}})->value.view(), "good");
}

TEST_F(Battery, thresholds_may_be_voltages) {
  write("hwmon/hwmon1", {{"name", "ina226"}, {"in1_input", "24000"}});
  Bench bench = this->bench("sensor \"ina226\" warning_voltage 23 critical_voltage 22");
  bench.run(20ms);
  EXPECT_EQ(bench.events(), "");
  write("hwmon/hwmon1", {{"in1_input", "21900"}});
  bench.run(20ms);
  EXPECT_EQ(bench.events(), "power:0: battery critical: 21.90 V: stop and charge it, or the computer will be off\n");
}

TEST_F(Battery, a_missing_one_is_refused_with_those_there_are) {
  write("power_supply/AC", {{"type", "Mains"}});
  const std::string folder = (root_ / "class/power_supply").string();
  const auto refusal = [this](const char* keys) { return bench(keys).subscribed().error().what; };
  EXPECT_NE(refusal("").find("no battery in " + folder + ", only AC"), std::string::npos) << refusal("");
  EXPECT_NE(refusal("supply \"BAT1\"").find("no supply 'BAT1' in " + folder + ", only AC"), std::string::npos);
  EXPECT_NE(refusal("sensor \"ina226\"")
                .find("no sensor 'ina226' in " + (root_ / "class/hwmon").string() + ", which is empty"),
            std::string::npos);
}

TEST_F(Battery, taken_out_is_a_fault_and_put_in_again_it_goes_on) {
  write("power_supply/BAT0", notebook);
  Bench bench = this->bench();
  bench.run(20ms);
  fs::rename(root_ / "class/power_supply/BAT0", root_ / "class/BAT0");
  bench.run(20ms);
  EXPECT_NE(bench.events().find("was the battery taken out?"), std::string::npos);
  fs::rename(root_ / "class/BAT0", root_ / "class/power_supply/BAT0");
  bench.samples().clear();
  bench.run(2s);
  EXPECT_NEAR(bench.latest<power::State>().charge_percent, 87, 1e-4);
  write("power_supply/BAT0", {{"present", "0"}});
  bench.run(20ms);
  EXPECT_NE(bench.events().find("the battery is not present"), std::string::npos);
}

TEST_F(Battery, complains_about_its_keys) {
  write("power_supply/BAT0", notebook);
  for (const char* keys :
       {"full_voltage 12", "empty_voltage 10", "empty_voltage 12 full_voltage 11", "warning 10 critical 20",
        "warning_voltage 10 critical_voltage 11", "supply \"BAT0\" sensor \"ina226\"", "critical 101"}) {
    EXPECT_THROW((void)bench(keys), ConfigError) << keys;
  }
}

}  // namespace
}  // namespace regista
