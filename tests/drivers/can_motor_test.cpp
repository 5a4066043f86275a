// SPDX-License-Identifier: Apache-2.0
#include "can_motor.hpp"

#include <malloc.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using canopen::Cia402State;
using canopen::NodeId;

constexpr std::array<NodeId, 2> nodes{5, 6};
constexpr const char* keys =
    "provides [\"actarray:0\" \"power:0\" \"dio:0\"] bus \"simulated\" nodes [5 6] gear 20 wheel_speed 1200 "
    "wheel_accel 2000 ";
constexpr const char* ramps = "increments 4096 wheel_decel 2000 quick_stop 4000";

struct SimulatedDrives {
  sim::CanDrives* drives = nullptr;
};

/// The driver with two simulated drives, which a test can look into.
struct Drives : SimulatedDrives, Bench {
  explicit Drives(const std::string& more = ramps, const sim::CanDriveParameters& parameters = {})
      : Bench{keys + more, [&](Setup& setup) -> std::unique_ptr<Driver> {
                auto link = std::make_unique<can_motor::SimulatedBusLink>(nodes, parameters, 500'000);
                drives = &link->drives();
                return std::make_unique<CanMotor>(setup, std::move(link));
              }} {}

  /// POWER 1, and its answer, which takes its time.
  Result<> power_up() {
    const auto asked = ask(actarray::SetPower{.on = 1});
    if (asked) return {};
    if (asked.error().code != std::errc::timed_out) return asked.error();
    run(3500ms);
    if (!last_reply()) return Error{std::errc::timed_out, "never answered"};
    if (!*last_reply()) return last_reply()->error();
    return {};
  }
  Result<> up() {
    run(1s);
    return power_up();
  }
  void turn(float left, float right, Duration duration) {
    drive(actarray::MultiSpeedCommand{.speeds = {left, right}}, duration);
  }
  [[nodiscard]] Cia402State state(std::size_t i) const { return drives->drive(i).drive().state(); }
  [[nodiscard]] double rpm(std::size_t i) const { return drives->drive(i).drive().speed_rpm(); }
  std::string text(const std::string& key) {
    const auto reply = ask(property::GetText{.key = Text{key}});
    return reply ? std::string{reply->value.view()} : reply.error().message();
  }
};

TEST(CanMotor, brings_drives_up_but_enables_them_only_on_request) {
  Drives bench;
  bench.run(1s);
  EXPECT_EQ(bench.events(), "actarray:0: node 5: up, switch on disabled\nactarray:0: node 6: up, switch on disabled\n");
  EXPECT_EQ(bench.state(0), Cia402State::switch_on_disabled);
  bench.turn(3, 3, 300ms);
  EXPECT_EQ(bench.rpm(0), 0);
  EXPECT_EQ(bench.events(), "actarray:0 refused: the drives are off: ask for POWER 1\n");
  ASSERT_TRUE(bench.power_up());
  EXPECT_EQ(bench.state(0), Cia402State::operation_enabled);
  EXPECT_EQ(bench.state(1), Cia402State::operation_enabled);
  EXPECT_EQ(bench.rpm(0), 0) << "what was commanded before is forgotten";
  EXPECT_EQ(bench.latest<actarray::State>().motors_on, 1);
}

TEST(CanMotor, power_that_is_asked_for_while_drives_come_up_is_answered_when_they_are_enabled) {
  Drives bench;
  bench.run(20ms);
  EXPECT_EQ(bench.events(), "");
  ASSERT_TRUE(bench.power_up());
  EXPECT_EQ(bench.state(0), Cia402State::operation_enabled);
  EXPECT_EQ(bench.state(1), Cia402State::operation_enabled);
  EXPECT_EQ(bench.rpm(0), 0);
}

TEST(CanMotor, power_that_was_refused_for_a_missing_drive_is_not_switched_on_when_it_comes) {
  Drives bench;
  bench.drives->port_of(1).connect(false);
  bench.run(20ms);
  const auto refused = bench.power_up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what.substr(0, 7), "node 6:");
  bench.events();
  bench.turn(1, 1, 100ms);
  EXPECT_EQ(bench.events().substr(0, 27), "actarray:0 refused: node 6:");
  bench.drives->port_of(1).connect(true);
  bench.run(3s);
  EXPECT_EQ(bench.state(0), Cia402State::switch_on_disabled);
  EXPECT_EQ(bench.state(1), Cia402State::switch_on_disabled);
}

TEST(CanMotor, an_emergency_while_drives_are_awaited_refuses_power_and_blocks_nobody) {
  Drives bench;
  bench.drives->port_of(1).connect(false);
  bench.run(900ms);
  ASSERT_EQ(bench.ask(actarray::SetPower{.on = 1}).error().code, std::errc::timed_out);
  bench.drives->drive(0).fail(0x3210, bench.now());
  bench.run(20ms);
  ASSERT_TRUE(bench.last_reply());
  ASSERT_FALSE(*bench.last_reply());
  EXPECT_NE(bench.last_reply()->error().what.find("EMCY 0x3210"), std::string::npos);
  EXPECT_EQ(bench.events().find("stopped"), std::string::npos);
}

TEST(CanMotor, turns_each_wheel_at_its_own_speed_and_tells_how_far) {
  Drives bench{"increments 4096 reversed [6]"};
  ASSERT_TRUE(bench.up());
  bench.turn(4, -2, 3s);
  const auto wheels = bench.latest<actarray::State>().actuators;
  ASSERT_EQ(wheels.size(), 2U);
  EXPECT_NEAR(wheels[0].speed, 4, 0.01);
  EXPECT_NEAR(wheels[1].speed, -2, 0.01);
  EXPECT_NEAR(bench.rpm(0), 4 * 20 * 60 / (2 * std::numbers::pi), 1);
  EXPECT_NEAR(bench.rpm(1), 2 * 20 * 60 / (2 * std::numbers::pi), 1) << "mounted the other way round";
  // One increment of 4096 x 20 in a turn, and what a message is old.
  EXPECT_NEAR(wheels[0].position, bench.drives->drive(0).drive().turns() / 20 * 2 * std::numbers::pi, 0.1);
  EXPECT_NEAR(wheels[1].position, -bench.drives->drive(1).drive().turns() / 20 * 2 * std::numbers::pi, 0.1);
  EXPECT_EQ(wheels[0].state, actarray::ActuatorState::moving);
}

TEST(CanMotor, stops_when_its_client_falls_silent) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  EXPECT_GT(bench.rpm(0), 900);
  bench.run(2s);
  EXPECT_EQ(bench.rpm(0), 0);
  EXPECT_EQ(bench.state(0), Cia402State::operation_enabled);
}

TEST(CanMotor, without_power_makes_a_quick_stop_and_takes_the_voltage_away) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  ASSERT_TRUE(bench.ask(actarray::SetPower{.on = 0}));
  bench.run(20ms);
  EXPECT_EQ(bench.state(0), Cia402State::quick_stop_active);
  bench.run(1s);
  EXPECT_EQ(bench.state(0), Cia402State::switch_on_disabled);
  EXPECT_EQ(bench.rpm(1), 0);
}

// ros_canopen#413: the set-points of before a halt went on.
TEST(CanMotor, a_set_point_is_0_until_a_drive_is_enabled) {
  Drives bench;
  bool enabled = false;
  int enabling = 0;
  bench.drives->bus().lose = [&](const canopen::CanFrame& frame) {
    if (frame.id != 0x205) return false;
    const bool enables = (frame.data[0] & 0xFU) == 0xF;
    const bool first = !std::exchange(enabled, enables) && enables;
    if (first) ++enabling;
    EXPECT_TRUE((enabled && !first) || canopen::get_le(frame.bytes().subspan(2, 4)) == 0);
    return false;
  };
  ASSERT_TRUE(bench.up());
  for (int round = 0; round < 3; ++round) {
    bench.turn(5, 5, 500ms);
    ASSERT_TRUE(bench.ask(actarray::SetPower{.on = 0}));
    bench.turn(5, 5, 500ms);  // refused, and forgotten
    ASSERT_TRUE(bench.power_up());
    EXPECT_EQ(bench.rpm(0), 0);
  }
  EXPECT_EQ(enabling, 4);
}

// CANopenNode: with an error in 1001, as without its storage files, a node does not become operational.
TEST(CanMotor, tells_that_a_drive_does_not_start) {
  Drives bench;
  bench.drives->bus().lose = [](const canopen::CanFrame& frame) {
    return frame == canopen::nmt_frame(canopen::NmtCommand::start, 5);
  };
  bench.run(7s);
  EXPECT_NE(bench.events().find("node 5: was started and stays pre-operational: its error register 1001"),
            std::string::npos);
  bench.drives->bus().lose = [](const canopen::CanFrame& frame) { return frame.id == 0x185; };
  bench.run(12s);
  EXPECT_NE(bench.events().find("node 5: was started and tells nothing: its PDO 0x185"), std::string::npos);
}

TEST(CanMotor, an_emergency_of_one_drive_stops_both_until_power_is_asked_for) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  bench.events();
  bench.drives->drive(0).fail(0x3210, bench.now());
  bench.run(10ms);
  EXPECT_EQ(bench.state(1), Cia402State::quick_stop_active) << "after a frame each way";
  EXPECT_NE(bench.events().find("actarray:0: node 5: EMCY 0x3210 DC link over-voltage"), std::string::npos);
  bench.turn(5, 5, 1s);
  EXPECT_EQ(bench.rpm(0), 0);
  EXPECT_EQ(bench.rpm(1), 0);
  bench.events();
  bench.run(5s);
  bench.turn(5, 5, 100ms);
  const std::string refused = bench.events();
  EXPECT_NE(refused.find("refused: node 5: EMCY 0x3210"), std::string::npos) << refused;
  EXPECT_NE(bench.text("node5.emcy").find("EMCY 0x3210"), std::string::npos);
  EXPECT_EQ(bench.text("node5").substr(0, 5), "fault");
  ASSERT_TRUE(bench.power_up()) << "which resets the fault";
  bench.turn(5, 5, 1s);
  EXPECT_GT(bench.rpm(0), 900);
}

TEST(CanMotor, a_drive_that_is_pulled_stops_the_other_one) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  bench.events();
  bench.drives->port_of(1).connect(false);
  bench.turn(5, 5, 270ms);  // 250 ms and a beat
  EXPECT_NE(bench.state(0), Cia402State::operation_enabled);
  EXPECT_NE(bench.state(1), Cia402State::operation_enabled) << "it misses us";
  EXPECT_NE(bench.events().find("actarray:0: node 6: heartbeat lost for 250 ms"), std::string::npos);
  bench.run(2s);
  EXPECT_NE(bench.text("node6").find("does not answer"), std::string::npos) << bench.text("node6");
  const auto refused = bench.power_up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what.substr(0, 7), "node 6:");
  bench.drives->port_of(1).connect(true);
  bench.run(3s);
  EXPECT_EQ(bench.state(0), Cia402State::switch_on_disabled);
  ASSERT_TRUE(bench.power_up());
  bench.turn(5, 5, 1s);
  EXPECT_GT(bench.rpm(1), 900);
}

TEST(CanMotor, a_power_cycle_stops_both_and_the_drive_comes_back_configured_but_not_enabled) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  bench.events();
  bench.drives->drive(0).power_cycle(bench.now());
  bench.run(10ms);
  EXPECT_EQ(bench.state(1), Cia402State::quick_stop_active);
  bench.turn(5, 5, 2s);
  const std::string events = bench.events();
  EXPECT_NE(events.find("node 5: boot-up message, its power was gone"), std::string::npos) << events;
  EXPECT_NE(events.find("node 5: up, switch on disabled"), std::string::npos) << events;
  EXPECT_EQ(bench.rpm(0), 0);
  EXPECT_EQ(bench.rpm(1), 0);
  EXPECT_EQ(bench.drives->drive(0).slave().get({0x6007, 0}), 3U) << "set up again";
  ASSERT_TRUE(bench.power_up());
}

TEST(CanMotor, drives_stop_by_themselves_when_the_server_is_gone) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  bench.drives->port().connect(false);
  bench.turn(5, 5, 250ms);
  bench.run(10ms);  // simulated drives see the time of the beats
  EXPECT_EQ(bench.state(0), Cia402State::quick_stop_active);
  EXPECT_EQ(bench.state(1), Cia402State::quick_stop_active);
}

TEST(CanMotor, after_bus_off_nothing_moves_until_power_is_asked_for) {
  Drives bench;
  ASSERT_TRUE(bench.up());
  bench.turn(5, 5, 1s);
  bench.events();
  bench.drives->port().bus_off();
  bench.turn(5, 5, 300ms);
  EXPECT_NE(bench.events().find("driver \"driver\" failed: CAN bus bus-off"), std::string::npos);
  EXPECT_EQ(bench.drives->port().send({}).error().code, std::errc::network_down);
  bench.drives->port().restart();
  bench.turn(5, 5, 5s);
  EXPECT_EQ(bench.rpm(0), 0);
  EXPECT_EQ(bench.rpm(1), 0);
  EXPECT_NE(bench.state(0), Cia402State::operation_enabled);
  ASSERT_TRUE(bench.power_up());
  bench.turn(5, 5, 1s);
  EXPECT_GT(bench.rpm(0), 900);
}

TEST(CanMotor, refuses_to_enable_a_drive_that_would_go_on_without_us) {
  Drives bench{"", {.watches_master = false}};
  const auto refused = bench.up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what,
            "node 5 would go on driving when this server dies: 6007 says that it does nothing then, and cannot be set "
            "(write 6007:00: SDO abort 0x06020000: no such object in the dictionary)");
  EXPECT_EQ(bench.state(0), Cia402State::switch_on_disabled);
}

TEST(CanMotor, refuses_another_makers_drive) {
  Drives bench{"vendor \"0x1E\""};
  ASSERT_FALSE(bench.up());
  EXPECT_NE(bench.events().find("node 5: is another drive: vendor 0x52454741, expected 0x0000001E"), std::string::npos);
}

TEST(CanMotor, refuses_another_product_of_the_maker) {
  Drives bench{"vendor \"0x52454741\" product \"0x403\""};
  const auto refused = bench.up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "node 5: is another drive: product 0x00000402, expected 0x00000403");
  EXPECT_NE(bench.events().find("node 6: is another drive: product 0x00000402, expected 0x00000403"),
            std::string::npos);
}

using canopen::ObjectDictionary;
using canopen::ObjectIndex;

sim::CanDriveParameters changed(std::function<void(ObjectDictionary&)> change) {
  sim::CanDriveParameters parameters;
  parameters.change = std::move(change);
  return parameters;
}

/// A drive without some objects, all of their sub-indices.
sim::CanDriveParameters lacking(std::initializer_list<std::uint16_t> indices) {
  return changed([indices = std::vector(indices)](ObjectDictionary& dictionary) {
    std::erase_if(dictionary.objects,
                  [&](const auto& object) { return std::ranges::find(indices, object.first.index) != indices.end(); });
  });
}

// What is optional in CiA 301 and 402, and missing in one drive or another.
TEST(CanMotor, brings_up_drives_that_lack_what_they_need_not_have) {
  for (const auto& parameters :
       {lacking({0x1017}), lacking({0x6502}), lacking({0x6061}), lacking({0x6072, 0x6080, 0x605A}),
        lacking({0x6075, 0x6077, 0x6078, 0x6079}), lacking({0x1016}), lacking({0x1001, 0x1014}),
        changed([](ObjectDictionary& dictionary) {
          for (std::uint16_t index = 0x1800; index < 0x1804; ++index) dictionary.objects.erase({index, 3});
          for (std::uint8_t sub = 2; sub <= 4; ++sub) dictionary.objects.erase({0x1018, sub});
        })}) {
    Drives bench{"", parameters};
    const auto up = bench.up();
    ASSERT_TRUE(up) << up.error().message();
    bench.turn(5, 5, 1s);
    EXPECT_GT(bench.rpm(0), 900);
    bench.drives->port().connect(false);
    bench.run(300ms);
    EXPECT_NE(bench.state(0), Cia402State::operation_enabled);
  }
}

TEST(CanMotor, insists_on_the_limit_of_torque_that_was_asked_for) {
  Drives bench{"torque 30", lacking({0x6072})};
  const auto refused = bench.up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "node 5: read 6072:00: SDO abort 0x06020000: no such object in the dictionary");
}

TEST(CanMotor, refuses_drives_that_nothing_stops_without_us) {
  const auto refusal = [](const sim::CanDriveParameters& parameters) -> std::string {
    const auto up = Drives{"", parameters}.up();
    return up ? "none" : up.error().what;
  };
  EXPECT_NE(refusal(lacking({0x6007})).find("6007 says that it does nothing then, and cannot be set"),
            std::string::npos);
  const std::string neither = refusal(changed([](ObjectDictionary& dictionary) {
    std::erase_if(dictionary.objects, [](const auto& object) { return object.first.index == 0x1016; });
    dictionary.objects.erase({0x1400, 5});
  }));
  EXPECT_EQ(neither,
            "node 5 would go on driving when this server dies: it takes neither 1016 (read 1016:01: SDO abort "
            "0x06020000: no such object in the dictionary) nor 1400:05 (write 1400:05: SDO abort 0x06090011: no "
            "such sub-index)");
}

TEST(CanMotor, refuses_a_drive_without_profile_velocity) {
  Drives bench{"", changed([](ObjectDictionary& dictionary) {
                 dictionary.objects.at({0x6502, 0}).value = {0x01, 0, 0, 0};  // profile position
               })};
  const auto refused = bench.up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "node 5: has no profile velocity mode: 6502:00 is 0x00000001");
}

TEST(CanMotor, takes_the_first_bytes_of_an_object_that_is_longer_than_it_should_be) {
  Drives bench{"", changed([](ObjectDictionary& dictionary) {
                 dictionary.objects.at({0x6502, 0}).value = canopen::Bytes(12, 0xFF);
                 dictionary.objects.at({0x6075, 0}).value = canopen::Bytes(12, 0xFF);
               })};
  const auto up = bench.up();
  EXPECT_TRUE(up) << up.error().message();
}

void fix_pdo(ObjectDictionary& dictionary, std::uint16_t communication, std::uint32_t cob_id,
             std::initializer_list<std::uint32_t> mapping) {
  const auto fix = [&](ObjectIndex object, std::uint64_t value) {
    canopen::ObjectEntry& entry = dictionary.objects.at(object);
    entry.value = canopen::le_bytes(value, entry.value.size());
    entry.access = canopen::Access::constant;
  };
  dictionary.objects.at({communication, 1}).value = canopen::le_bytes(cob_id, 4);
  const auto index = static_cast<std::uint16_t>(communication + 0x200);
  fix({index, 0}, mapping.size());
  std::uint8_t sub = 0;
  for (const std::uint32_t code : mapping) fix({index, ++sub}, code);
}

TEST(CanMotor, uses_fixed_pdos_that_are_as_they_should_be) {
  Drives bench{"", changed([](ObjectDictionary& dictionary) {
                 fix_pdo(dictionary, 0x1400, 0x205, {0x60400010, 0x60FF0020});
                 fix_pdo(dictionary, 0x1800, 0x185, {0x60410010, 0x606C0020});
               })};
  bench.run(1s);
  EXPECT_NE(bench.events().find("node 5: up, switch on disabled"), std::string::npos);
}

TEST(CanMotor, takes_measurements_from_a_fixed_pdo_that_has_them_and_from_no_other) {
  const auto voltage = [](std::initializer_list<std::uint32_t> mapping) -> std::optional<float> {
    Drives bench{"", changed([&](ObjectDictionary& dictionary) { fix_pdo(dictionary, 0x1802, 0x385, mapping); })};
    EXPECT_TRUE(bench.up());
    bench.run(500ms);
    const std::string text = bench.text("node5");
    if (text.find(" V") == std::string::npos) return {};
    return std::stof(text.substr(text.rfind(", ", text.find(" V")) + 2));
  };
  EXPECT_EQ(voltage({0x60790020, 0x60780010, 0x60770010}), 48);
  EXPECT_EQ(voltage({0x60640020, 0x606C0020}), std::nullopt) << "position and speed";
}

TEST(CanMotor, says_which_fixed_pdo_is_not_as_it_should_be) {
  Drives bench{
      "", changed([](ObjectDictionary& dictionary) { fix_pdo(dictionary, 0x1400, 0x205, {0x60400010, 0x60710010}); })};
  const auto refused = bench.up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "node 5: write 1600:00: SDO abort 0x06010002: the object is read-only");
}

// ros_canopen#111: a target that was left behind in the drive made it jump when it was enabled.
// ros2_canopen#204, #225: a drive that is up already sends no boot-up message.
TEST(CanMotor, takes_a_drive_over_that_is_up_and_has_a_target) {
  Drives bench{"", changed([](ObjectDictionary& dictionary) {
                 dictionary.objects.at({0x60FF, 0}).value = canopen::le_bytes(500, 4);
               })};
  bool boots = false;
  bench.drives->bus().lose = [&](const canopen::CanFrame& frame) {
    const bool is_boot_up = (frame.id & 0x780U) == 0x700 && frame.bytes()[0] == 0;
    boots = boots || is_boot_up;
    return is_boot_up;
  };
  const auto up = bench.up();
  ASSERT_TRUE(up) << up.error().message();
  EXPECT_TRUE(boots);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(bench.rpm(i), 0);
    EXPECT_EQ(bench.drives->drive(i).slave().get({0x60FF, 0}), 0U);
  }
}

TEST(CanMotor, takes_the_voltage_away_from_a_drive_that_does_not_take_another_target) {
  Drives bench;
  bool without_voltage = false;
  bench.drives->bus().lose = [&](const canopen::CanFrame& frame) {
    const auto is = [&](std::uint8_t command, std::uint16_t index) {
      return frame.id == 0x605 && frame.data[0] == command && canopen::get_le(frame.bytes().subspan(1, 2)) == index;
    };
    if (is(0x40, 0x60FF)) bench.drives->drive(0).slave().set({0x60FF, 0}, 500);
    without_voltage = without_voltage || (is(0x2B, 0x6040) && frame.data[4] == 0);
    return false;
  };
  bench.run(500ms);
  EXPECT_TRUE(without_voltage);
  EXPECT_NE(bench.events().find("node 5: 60FF:00 was written and reads back differently"), std::string::npos)
      << "and it is not enabled";
}

/// The whole driver with a DCF beside its .cfg, or what was wrong with it.
struct WithDcf {
  explicit WithDcf(const std::string& objects, const std::string& name = "drive.dcf") {
    std::ofstream{folder / "drive.dcf"} << "[FileInfo]\nFileName=drive.dcf\n[DeviceInfo]\nVendorName=regista\n"
                                        << "[MandatoryObjects]\nSupportedObjects=0\n"
                                        << objects;
    keys = "dcf [\"" + (folder / name).string() + "\"]";
  }
  ~WithDcf() { std::filesystem::remove_all(folder); }
  WithDcf(const WithDcf&) = delete;
  WithDcf& operator=(const WithDcf&) = delete;

  std::filesystem::path folder = [] {
    std::string name = (std::filesystem::temp_directory_path() / "dcf.XXXXXX").string();
    return std::filesystem::path{::mkdtemp(name.data())};
  }();
  std::string keys;
};

constexpr const char* two_objects =
    "[OptionalObjects]\nSupportedObjects=2\n1=0x6083\n2=0x6084\n"
    "[6083]\nParameterName=acceleration\nDataType=0x0007\nAccessType=rw\nParameterValue=4321\n"
    "[6084]\nParameterName=deceleration\nDataType=0x0007\nAccessType=rw\nParameterValue=8000\n";

TEST(CanMotor, writes_of_a_dcf_what_differs_and_reads_it_back) {
  const WithDcf dcf{two_objects};
  // 'wheel_accel' of the other keys would win over the DCF: settings come after it.
  std::string without_ramps = "provides [\"actarray:0\"] bus \"simulated\" nodes [5] gear 20 wheel_speed 1200 ";
  sim::CanDrives* drives = nullptr;
  std::vector<std::uint16_t> written;
  int read_back = 0;
  Bench bench{without_ramps + dcf.keys, [&](regista::Setup& setup) -> std::unique_ptr<Driver> {
                auto link = std::make_unique<can_motor::SimulatedBusLink>(
                    std::span{nodes}.first(1), changed([](ObjectDictionary& dictionary) {
                      dictionary.objects.at({0x6084, 0}).value = canopen::le_bytes(8000, 4);
                    }),
                    500'000);
                drives = &link->drives();
                return std::make_unique<CanMotor>(setup, std::move(link));
              }};
  drives->bus().lose = [&](const canopen::CanFrame& frame) {
    if (frame.id != 0x605) return false;
    const auto index = static_cast<std::uint16_t>(frame.data[1] | frame.data[2] << 8);
    if (frame.data[0] >> 5 == 1) written.push_back(index);
    if (frame.data[0] >> 5 == 2 && index == 0x6083) ++read_back;
    return false;
  };
  bench.run(1s);
  EXPECT_NE(bench.events().find("node 5: up"), std::string::npos);
  EXPECT_EQ(drives->drive(0).slave().get({0x6083, 0}), 4321U);
  EXPECT_EQ(std::ranges::count(written, 0x6083), 1);
  EXPECT_EQ(std::ranges::count(written, 0x6084), 0) << "it had 8000 already";
  EXPECT_EQ(read_back, 2) << "compared, and verified";
}

TEST(CanMotor, says_which_object_of_a_dcf_a_drive_refuses) {
  const WithDcf dcf{two_objects};
  Drives bench{dcf.keys, changed([](ObjectDictionary& dictionary) { dictionary.objects.at({0x6084, 0}).high = 5000; })};
  const auto refused = bench.up();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "node 5: write 6084:00: SDO abort 0x06090031: value too high");
  EXPECT_NE(bench.events().find("actarray:0: node 6: write 6084:00: SDO abort 0x06090031: value too high"),
            std::string::npos);
  EXPECT_EQ(bench.state(0), Cia402State::switch_on_disabled);
}

TEST(CanMotor, says_what_is_wrong_with_a_dcf_before_anything_starts) {
  const auto complaint = [](const std::string& objects, const std::string& name) -> std::string {
    const WithDcf dcf{objects, name};
    try {
      Drives bench{dcf.keys};
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_NE(complaint("", "other.dcf").find("'dcf' cannot be used: "), std::string::npos);
  EXPECT_NE(
      complaint("[OptionalObjects]\nSupportedObjects=1\n1=0x6083\n[6083]\nParameterName=a\nDataType=foo\n", "drive.dcf")
          .find("drive.dcf:12: 'foo' is no number"),
      std::string::npos);
}

TEST(CanMotor, a_gen4_that_charges_its_battery_tells_a_negative_current) {
  Drives bench{"profile \"sevcon\"", {.sevcon = true}};
  const auto up = bench.up();
  ASSERT_TRUE(up) << up.error().message();
  bench.turn(5, -5, 1s);
  EXPECT_NEAR(bench.rpm(0), 955, 1);
  for (std::size_t i = 0; i < 2; ++i) {
    canopen::Slave& slave = bench.drives->drive(i).slave();
    slave.set({0x5100, 2}, static_cast<std::uint64_t>(-16 * 10));  // 10 A into the battery
    EXPECT_EQ(slave.get({0x1005, 0}), 0x80U) << "its own SYNC is off";
    EXPECT_EQ(slave.get({0x1014, 0}), 0x80U + nodes[i]) << "its EMCYs are on";
    EXPECT_EQ(slave.get({0x5902, 0}), 2U) << "it stops without set-points";
  }
  bench.run(100ms);
  const auto power = bench.latest<power::State>();
  EXPECT_EQ(power.valid, power::volts | power::watts);
  EXPECT_FLOAT_EQ(power.voltage_v, 48);
  EXPECT_FLOAT_EQ(power.power_w, -2 * 48 * 10);
}

TEST(CanMotor, tells_the_voltage_of_its_drives) {
  Drives bench;
  bench.run(1s);
  EXPECT_EQ(bench.latest<power::State>().valid, power::volts);
  EXPECT_FLOAT_EQ(bench.latest<power::State>().voltage_v, 48);
}

TEST(CanMotor, switches_outputs_of_drives_and_leaves_their_other_bits) {
  Drives bench{R"(relays ["5 60FE:01 16" "6 60FE:01 17" "5 60FE:01 18"])"};
  bench.run(1s);
  bench.drives->drive(0).slave().set({0x60FE, 1}, 0x80000001);
  bench.send(dio::OutputCommand{.count = 3, .bits = 0b111}, 2);
  bench.run(100ms);
  EXPECT_EQ(bench.drives->drive(0).slave().get({0x60FE, 1}), 0x80050001U);
  EXPECT_EQ(bench.drives->drive(0).slave().get({0x60FE, 2}), 0x00050000U) << "the mask";
  EXPECT_EQ(bench.drives->drive(1).slave().get({0x60FE, 1}), 0x00020000U);
  EXPECT_EQ(bench.latest<dio::State>(), (dio::State{.count = 3, .bits = 0b111}));
  bench.send(dio::OutputCommand{.count = 1, .bits = 0}, 2);
  bench.run(100ms);
  EXPECT_EQ(bench.drives->drive(0).slave().get({0x60FE, 1}), 0x80040001U);
  EXPECT_EQ(bench.latest<dio::State>(), (dio::State{.count = 3, .bits = 0b110}));
  EXPECT_EQ(bench.events().find("refused"), std::string::npos);
  bench.send(dio::OutputCommand{.count = 4, .bits = 0}, 2);
  EXPECT_EQ(bench.events(), "dio:0 refused: there are 3 relays, and 4 bits\n");
}

TEST(CanMotor, tells_that_a_drive_did_not_switch_an_output) {
  Drives lacks{R"(relays ["5 2000:00 1"])"};
  lacks.run(1s);
  lacks.events();
  lacks.send(dio::OutputCommand{.count = 1, .bits = 1}, 2);
  lacks.run(100ms);
  EXPECT_EQ(lacks.events().substr(0, 32), "dio:0: relays: node 5: read 2000");
  EXPECT_EQ(lacks.latest<dio::State>(), (dio::State{.count = 1, .bits = 0}));
  Drives too_long{R"(relays ["5 6502:00 1"])", changed([](ObjectDictionary& dictionary) {
                    dictionary.objects.at({0x6502, 0}).value = canopen::Bytes(12, 0xFF);
                  })};
  too_long.run(1s);
  too_long.events();
  too_long.send(dio::OutputCommand{.count = 1, .bits = 1}, 2);
  too_long.run(100ms);
  EXPECT_EQ(too_long.events(), "dio:0: relays: node 5: 6502:00 has 12 bytes, not 1 to 8: Bad message\n");
}

/// Ten minutes; REGISTA_SOAK_HOURS=24 makes it a day, in some minutes.
TEST(CanMotor, drives_on_without_growth_or_drift) {
  const char* hours = std::getenv("REGISTA_SOAK_HOURS");
  const Duration limit = hours != nullptr ? std::chrono::hours{std::stoi(hours)} : Duration{10min};
  sim::CanDrives drives{nodes, {}};
  can_motor::DriveSettings settings{.position = true, .max_speed = 4000};
  std::string told;
  can_motor::DriveGroup group{drives.port(),
                              nodes,
                              settings,
                              {{}, {}},
                              {},
                              {.stopped = [&](const std::string& why) { told += why; },
                               .tell =
                                   [&](std::uint8_t severity, const std::string& text) {
                                     if (severity > 0) told += text;
                                   }}};
  Time now{1000s};
  const auto run = [&](Duration duration) {
    for (const Time end = now + duration; now < end; now += 100ms) ASSERT_TRUE(drives.run(group, now));
  };
  run(1s);
  group.enable([](const Result<>& done) { ASSERT_TRUE(done); }, now);
  run(1s);
  std::size_t after_a_minute = 0;
  const Time begin = now;
  for (int second = 0; now - begin < limit; ++second) {
    const std::array targets{1000 + second % 700, -500 - second % 900};
    ASSERT_TRUE(group.set_targets(targets, now));
    run(1s);
    if (second == 60) after_a_minute = mallinfo2().uordblks;
  }
  EXPECT_EQ(told, "");
  EXPECT_LT(mallinfo2().uordblks, after_a_minute + 4096);
  EXPECT_EQ(group.master().statistics().saturated, 0U);
  ASSERT_TRUE(group.set_targets(std::array{0, 0}, now));
  run(2s);
  for (std::size_t i = 0; i < 2; ++i) {
    const double truth = drives.drive(i).drive().turns();
    EXPECT_NEAR(static_cast<double>(group.drives()[i].increments()) / 4096, truth, 1.0 / 4096) << "exactly";
    // Rounded to whole rpm, and a trapezoid every 20 ms: no way gets lost on average.
    EXPECT_NEAR(group.drives()[i].way() / 60, truth, 1e-4 * std::abs(truth));
  }
}

TEST(CanMotor, names_what_is_wrong_with_its_keys) {
  const auto complaint = [](const std::string& more) -> std::string {
    try {
      Drives bench{more};
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_NE(complaint("profile \"dunker\"").find("'profile' must be \"cia402\" or \"sevcon\""), std::string::npos);
  EXPECT_NE(complaint("relays [\"7 60FE:01 1\"]").find("node 7, which is not in 'nodes'"), std::string::npos);
  EXPECT_NE(complaint("relays [\"5 1\"]").find("must be like \"5 60FE:01 16\""), std::string::npos);
  EXPECT_NE(complaint("vendor \"sevcon\"").find("must be a hexadecimal number"), std::string::npos);
  EXPECT_NE(complaint("reversed [9]").find("must be some of 'nodes'"), std::string::npos);
}

}  // namespace
}  // namespace regista
