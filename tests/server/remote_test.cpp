// SPDX-License-Identifier: Apache-2.0
// A client drives a repeater in one server, and the repeater a base in another one, over TCP.
#include <gtest/gtest.h>
#include <fake_base.hpp>
#include <regista/client/connection.hpp>
#include <regista/server/server.hpp>

#include <thread>

namespace regista {
namespace {

using namespace std::chrono_literals;

constexpr client::Address base{Position2d::code, 0};

/// Offers what it requires.
class Repeater final : public Driver {
 public:
  explicit Repeater(Setup& setup) : port_{setup.provide<Position2d>()}, base_{setup.require<Position2d>()} {
    base_.on_data<position2d::State>(
        [this](const position2d::State& state, Time measured) { port_.send(state, measured); });
    port_.on<position2d::VelocityCommand>([this](const position2d::VelocityCommand& command) { base_.send(command); });
    port_.on<position2d::GetGeometry>(
        [this](const position2d::GetGeometry& request, Responder<position2d::Geometry> responder) {
          const auto shared = std::make_shared<Responder<position2d::Geometry>>(std::move(responder));
          base_.request(request, [shared](const Result<position2d::Geometry>& answer) { shared->answer(answer); });
        });
  }
  Result<> read(const Tick&) override { return {}; }
  void publish() override {}
  void halt() noexcept override {}

 private:
  Port<Position2d> port_;
  Required<Position2d> base_;
};

template <typename D>
constexpr Plugin plugin(const char* name) {
  return {.name = name, .summary = "", .stops_by_itself = true, .create = [](Setup& setup) -> std::unique_ptr<Driver> {
            return std::make_unique<D>(setup);
          }};
}
constexpr Plugin fake_base = plugin<FakeBase>("fake_base");
constexpr Plugin repeater = plugin<Repeater>("repeater");

class Serving {
 public:
  explicit Serving(const std::string& config, std::uint16_t port = 0)
      : server_{parse_config(config, "test.cfg"), {.port = port, .plugins = {&fake_base, &repeater}}},
        thread_{[this] { at_rest_ = server_.run(); }} {}
  ~Serving() {
    server_.stop();
    thread_.join();
    EXPECT_TRUE(at_rest_);
  }
  Serving(const Serving&) = delete;
  Serving& operator=(const Serving&) = delete;
  [[nodiscard]] std::uint16_t port() const { return server_.port(); }

 private:
  Server server_;
  bool at_rest_ = false;
  std::thread thread_;
};

std::string base_config(const std::string& keys = "") {
  return "driver ( name \"fake_base\" provides [\"position2d:0\"] echo yes rate 100 " + keys + " )";
}
std::string repeater_config(std::uint16_t port) {
  return "driver ( name \"repeater\" priority 15 provides [\"position2d:0\"] requires [\"127.0.0.1:" +
         std::to_string(port) + ":position2d:0\"] )";
}

class Driving {
 public:
  explicit Driving(std::uint16_t port) : connection_{"127.0.0.1", port, {.timeout = 10s}} {
    (void)connection_.subscribe(base, [this](const xdr::Header&, const AnyData& data, Time) {
      if (const auto* state = std::get_if<position2d::State>(&data)) speed_ = state->velocity.x;
    });
    const Result<> connected = connection_.connect();
    EXPECT_TRUE(connected) << connected.error().message();
  }

  /// Command a speed until the base says that it has it.
  bool drive(double speed) {
    for (const Time end = Clock::now() + 20s; Clock::now() < end;) {
      if (!connection_.send(base, position2d::VelocityCommand{.velocity = {.x = speed}})) return false;
      if (!connection_.read(50ms)) return false;
      if (speed_ == speed) return true;
    }
    return false;
  }
  bool sees(double speed) {
    for (const Time end = Clock::now() + 20s; Clock::now() < end && speed_ != speed;) {
      if (!connection_.read(50ms)) return false;
    }
    return speed_ == speed;
  }
  client::Connection& connection() { return connection_; }

 private:
  client::Connection connection_;
  double speed_ = 0;
};

TEST(Remote, forwards_commands_and_data_of_another_server) {
  const Serving there{base_config()};
  const Serving here{repeater_config(there.port())};
  Driving client{here.port()};
  EXPECT_TRUE(client.drive(0.25));
  EXPECT_TRUE(client.drive(-0.5));
}

TEST(Remote, forwards_requests_and_their_answers) {
  const Serving there{base_config()};
  const Serving here{repeater_config(there.port())};
  Driving client{here.port()};
  ASSERT_TRUE(client.drive(0.25));  // by now it is connected
  const auto geometry = client.connection().request(base, position2d::GetGeometry{});
  ASSERT_TRUE(geometry) << geometry.error().message();
  EXPECT_EQ(geometry->size.length, 0.4);
}

TEST(Remote, forwards_a_refusal_with_its_words_and_its_errno) {
  const Serving there{base_config("fault \"error\" at \"request\"")};
  const Serving here{repeater_config(there.port())};
  Driving client{here.port()};
  ASSERT_TRUE(client.drive(0.25));
  const auto geometry = client.connection().request(base, position2d::GetGeometry{});
  ASSERT_FALSE(geometry);
  EXPECT_EQ(geometry.error().code, std::errc::io_error);
  EXPECT_EQ(geometry.error().what, "made-up fault");
}

TEST(Remote, says_which_server_did_not_answer) {
  const Serving there{base_config("fault \"hang\" at \"request\" seconds 1.7")};
  const Serving here{repeater_config(there.port())};
  Driving client{here.port()};
  ASSERT_TRUE(client.drive(0.25));
  const auto geometry = client.connection().request(base, position2d::GetGeometry{});
  ASSERT_FALSE(geometry);
  EXPECT_EQ(geometry.error().code, std::errc::timed_out);
  EXPECT_EQ(geometry.error().what, "127.0.0.1:" + std::to_string(there.port()) + ": 1500 ms: no answer in time");
}

TEST(Remote, drives_under_the_name_and_priority_of_the_driver_that_requires_it) {
  const Serving there{base_config()};
  const Serving here{repeater_config(there.port())};
  Driving client{here.port()};
  client::Connection observer{"127.0.0.1", there.port()};
  ASSERT_TRUE(observer.connect());
  ASSERT_TRUE(client.drive(0.25));
  const auto motion =
      observer.request(client::server_address, player::GetMotion{.address = {.interface = base.interface}});
  ASSERT_TRUE(motion) << motion.error().message();
  EXPECT_EQ(motion->owner.view(), "repeater");
  EXPECT_EQ(motion->priority, 15);
}

TEST(Remote, stops_when_the_client_of_the_requiring_driver_falls_silent) {
  const Serving there{base_config()};
  const Serving here{repeater_config(there.port())};
  Driving client{here.port()};
  ASSERT_TRUE(client.drive(0.25));
  EXPECT_TRUE(client.sees(0));
}

TEST(Remote, is_not_offered_by_the_server_that_requires_it) {
  const Serving there{base_config()};
  const Serving here{repeater_config(there.port())};
  Driving client{here.port()};
  const auto list = client.connection().request(client::server_address, player::GetDeviceList{});
  ASSERT_TRUE(list);
  EXPECT_EQ(list->devices.size(), 1U);
}

TEST(Remote, is_connected_again_after_its_server_was_away) {
  auto there = std::make_unique<Serving>(base_config());
  const std::uint16_t port = there->port();
  const Serving here{repeater_config(port)};
  Driving client{here.port()};
  ASSERT_TRUE(client.drive(0.25));
  there.reset();
  there = std::make_unique<Serving>(base_config(), port);
  EXPECT_TRUE(client.drive(0.5));
}

}  // namespace
}  // namespace regista
