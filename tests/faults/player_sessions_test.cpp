// SPDX-License-Identifier: Apache-2.0
// What stock clients said to a stock server, said to ours: the same kinds of answers come, in the same order.
#include <fstream>
#include <nlohmann/json.hpp>

#include "player.hpp"

namespace regista::testing {
namespace {

/// Has what the recorded server's devices had.
class FakeDriver final : public Driver {
 public:
  explicit FakeDriver(Setup& setup) : base_{setup.provide<Position2d>()}, power_{setup.provide<Power>()} {
    base_.on<position2d::VelocityCommand>([](const auto&) -> Result<> { return {}; });
    base_.on<position2d::PositionCommand>([](const auto&) -> Result<> { return {}; });
    base_.on<position2d::GetGeometry>(
        [](const auto&) -> Result<position2d::Geometry> { return position2d::Geometry{}; });
    base_.on<position2d::SetMotorPower>([](const auto&) -> Result<Empty> { return Empty{}; });
    base_.on<position2d::SetOdometry>([](const auto&) -> Result<Empty> { return Empty{}; });
    base_.on<position2d::ResetOdometry>([](const auto&) -> Result<Empty> { return Empty{}; });
  }
  Result<> read(const Tick&) override { return {}; }
  void publish() override {
    base_.send(position2d::State{});
    power_.send(power::State{});
  }
  void halt() noexcept override {}

 private:
  Port<Position2d> base_;
  Port<Power> power_;
};

const Plugin fake_driver{
    .name = "fakedriver",
    .summary = "as in the recordings",
    .stops_by_itself = true,
    .create = [](Setup& setup) -> std::unique_ptr<Driver> { return std::make_unique<FakeDriver>(setup); }};

class PlayerSession : public ::testing::TestWithParam<const char*> {};

TEST_P(PlayerSession, gets_the_same_kinds_of_answers_in_the_same_order) {
  std::ifstream file{std::string{TEST_DATA} + "/player-session-" + GetParam() + ".json"};
  const nlohmann::json session = nlohmann::json::parse(file);
  const TestServer server{R"(driver ( name "fakedriver" provides ["position2d:0" "power:0"] )
                             driver ( name "fakedriver" provides ["position2d:1"] ))",
                          {&fake_driver}};
  Player client{server.port()};
  std::size_t answers = 0;
  for (const auto& recorded : session["messages"]) {
    if (recorded.contains("banner")) continue;
    if (recorded["dir"] == "c2s") {
      client.send(from_hex(recorded["hex"].get<std::string>()));
      continue;
    }
    if (recorded["type"] == "DATA") continue;  // how many there are is a matter of time
    std::size_t data_before = 0;
    RawMessage got = client.receive_message();
    for (; got.type == data; ++data_before) got = client.receive_message();
    const std::string name = recorded["name"];
    SCOPED_TRACE(name + " at " + recorded["t"].dump());
    const std::uint32_t type = recorded["type"] == "SYNCH" ? synch : recorded["type"] == "RESP_ACK" ? ack : nack;
    ASSERT_EQ(got.type, type);
    ASSERT_EQ(got.interface, recorded["interface"].get<std::uint32_t>());
    ASSERT_EQ(got.index, recorded["index"].get<std::uint32_t>());
    ASSERT_EQ(got.subtype, recorded["subtype"].get<std::uint32_t>());
    EXPECT_EQ(got.body.size(), recorded["size"].get<std::size_t>());
    if (type == synch) {
      EXPECT_GE(data_before, 1U);
    }
    ++answers;
  }
  EXPECT_GT(answers, 20U);
  EXPECT_TRUE(
      std::ranges::none_of(server.log(), [](const std::string& line) { return line.find("error") != line.npos; }));
}

INSTANTIATE_TEST_SUITE_P(Recorded, PlayerSession, ::testing::Values("playerprint", "libplayercpp"),
                         [](const auto& session) { return std::string{session.param}; });

}  // namespace
}  // namespace regista::testing
