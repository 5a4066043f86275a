// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <regista/device/host.hpp>

#include "counting_new.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using player::Access;
using position2d::VelocityCommand;

constexpr SessionId alice = 1;
constexpr SessionId bob = 2;

/// Writes down what it is told, and fails as it is told.
class Robot final : public Driver {
 public:
  explicit Robot(Setup& setup)
      : base{setup.provide<Position2d>()},
        kicker{setup.provide<Kicker>()},
        arm{setup.provide<Actarray>()},
        gain{setup.property("gain", 1.0, {.min = 0, .max = 2})},
        count{setup.property("count", std::int32_t{3})},
        on{setup.property("on", true)},
        label{setup.property("label", std::string{"red"}, {.read_only = true})} {
    base.on<VelocityCommand>([this](const VelocityCommand& c) -> Result<> {
      may_throw("command");
      if (busy) return Error{std::errc::device_or_resource_busy, "busy"};
      velocity = c.velocity;
      if (write_down) log.push_back("velocity " + std::to_string(c.velocity.x).substr(0, 4));
      return {};
    });
    base.on<position2d::PositionCommand>([](const position2d::PositionCommand&) -> Result<> {
      return Error{std::errc::resource_unavailable_try_again, "no camera has seen the robot yet"};
    });
    base.on<position2d::ResetOdometry>([this](const position2d::ResetOdometry&) -> Result<Empty> {
      may_throw("request");
      log.push_back("reset");
      return Empty{};
    });
    base.on<position2d::GetGeometry>([this](const position2d::GetGeometry&, Responder<position2d::Geometry> responder) {
      deferred.push_back(std::move(responder));
    });
    base.on<position2d::SetMotorPower>([](const position2d::SetMotorPower&, Responder<Empty>) {});  // dropped
    kicker.on<kicker::KickCommand>([this](const kicker::KickCommand& c) -> Result<> {
      log.push_back("kick");
      if (c.speed_mps > 8) return Error{std::errc::argument_out_of_domain, "too hard"};
      return {};
    });
    arm.on<actarray::MultiSpeedCommand>([this](const actarray::MultiSpeedCommand& c) { joints = c.speeds.size(); });
    arm.on<actarray::MultiPositionCommand>([](const actarray::MultiPositionCommand&) {});
    arm.on<actarray::SpeedCommand>([this](const actarray::SpeedCommand& c) {
      log.push_back("joint " + std::to_string(c.joint) + ' ' + std::to_string(c.speed).substr(0, 4));
    });
    gain.on_change([this] { may_throw("property"); });
  }

  Result<> open() override {
    log.push_back("open");
    may_throw("open");
    if (!openable) return Error{std::errc::no_such_device, "open /dev/robot"};
    return {};
  }
  Result<> read(const Tick& tick) override {
    may_throw("read");
    ticks.push_back(tick);
    if (!readable) return Error{std::errc::io_error, "read /dev/robot"};
    return {};
  }
  void publish() override {
    may_throw("publish");
    base.send(position2d::State{.velocity = velocity});
    arm.send(joint_states);
    kicker.send(kicker::State{});
  }
  void halt() noexcept override {
    if (write_down) log.push_back("halt");
    velocity = {};
  }
  void close() noexcept override { log.push_back("close"); }

  void may_throw(std::string_view where) const {
    if (where == thrower) throw std::runtime_error{"ouch"};
  }
  std::vector<std::string> take_log() { return std::exchange(log, {}); }

  Port<Position2d> base;
  Port<Kicker> kicker;
  Port<Actarray> arm;
  Property<double> gain;
  Property<std::int32_t> count;
  Property<bool> on;
  Property<std::string> label;
  std::vector<Responder<position2d::Geometry>> deferred;
  std::vector<std::string> log;
  std::vector<Tick> ticks;
  BodyVelocity velocity{};
  std::size_t joints = 0;
  actarray::State joint_states{.actuators = std::vector<actarray::Actuator>(6)};
  std::string thrower;
  bool busy = false;
  bool openable = true;
  bool readable = true;
  bool write_down = true;
};

constexpr std::size_t base = 0;
constexpr std::size_t kick = 1;
constexpr std::size_t arm = 2;

/// A host with its network side, and a clock that stands until told.
struct Bench {
  explicit Bench(HostOptions options = {}) {
    auto setup = std::make_unique<Setup>(Section{});
    auto made = std::make_unique<Robot>(*setup);
    driver = made.get();
    host = std::make_unique<DriverHost>("robot", std::move(setup), std::move(made), std::move(options));
    link = &host->add_link(&woken);
  }

  bool command(std::size_t port, const AnyCommand& message, SessionId session = alice) {
    return link->down.put(host->lane(*link, port, message), [&](Inbound& in) {
      in = {.session = session, .port = port, .arrived = now, .message = message};
    });
  }
  bool drive(double x, SessionId session = alice) {
    return command(base, VelocityCommand{.velocity = {.x = x}}, session);
  }
  bool post(std::size_t port, decltype(Inbound::message) message, SessionId session = alice) {
    return link->down.put(link->down.no_lane, [&](Inbound& in) {
      in = {.session = session,
            .port = port,
            .arrived = now,
            .reply_to = {.session = session, .sequence = ++sequence},
            .message = std::move(message)};
    });
  }
  bool ask(std::size_t port, const AnyRequest& request, SessionId session = alice) {
    return post(port, request, session);
  }
  /// Ask, run one cycle, and give the one answer.
  Result<AnyReply> answer(std::size_t port, const AnyRequest& request, SessionId session = alice) {
    replies.clear();
    ask(port, request, session);
    cycle();
    if (replies.size() != 1) return Error{std::errc::protocol_error, std::to_string(replies.size()) + " answers"};
    return replies.front().answer;
  }
  Result<AnyReply> subscribe(std::size_t port = base, Access access = Access::open, SessionId session = alice) {
    return answer(port, player::Subscribe{.access = access}, session);
  }
  void gone(SessionId session) { post(base, Gone{}, session); }

  Time cycle(Duration later = {}, bool descriptor_ready = false) {
    now += later;
    due = host->cycle(now, descriptor_ready);
    drain();
    return due;
  }
  void drain() {
    link->up.drain([&](Outbound& out) {
      if (auto* reply = std::get_if<Reply>(&out)) replies.push_back(*reply);
      if (auto* sample = std::get_if<Sample>(&out)) {
        ++samples;
        if (const auto* state = std::get_if<position2d::State>(&sample->data)) velocity = state->velocity;
      }
      if (auto* notice = std::get_if<Notice>(&out)) {
        if (const auto* event = std::get_if<player::Event>(&notice->message)) events.emplace_back(event->text.view());
        if (const auto* motion = std::get_if<player::Motion>(&notice->message)) motions.push_back(*motion);
      }
    });
  }
  /// As a thread would: when due.
  void run(Duration length) {
    const Time end = now + length;
    while (true) {
      now = std::max(now, std::min(due, end));
      cycle();
      if (due > end) break;
    }
    now = end;
  }
  std::string last_event() const { return events.empty() ? "" : events.back(); }

  Time now{100s};
  Time due{100s};
  Wakeup woken;
  Robot* driver = nullptr;
  std::unique_ptr<DriverHost> host;
  Link* link = nullptr;
  std::uint32_t sequence = 0;
  std::vector<Reply> replies;
  std::vector<std::string> events;
  std::vector<player::Motion> motions;
  std::size_t samples = 0;
  BodyVelocity velocity{};
};

using Log = std::vector<std::string>;

TEST(DriverHost, opens_for_the_first_subscriber_and_closes_after_the_last) {
  Bench bench;
  EXPECT_EQ(bench.cycle(), Time::max());
  EXPECT_EQ(bench.driver->take_log(), Log{});
  const auto opened = bench.subscribe();
  ASSERT_TRUE(opened);
  EXPECT_EQ(std::get<player::Subscribe>(*opened).driver.view(), "robot");
  EXPECT_EQ(bench.driver->take_log(), Log{"open"});
  ASSERT_TRUE(bench.subscribe(kick, Access::open, bob));
  bench.run(100ms);
  ASSERT_TRUE(bench.subscribe(base, Access::close));
  EXPECT_EQ(bench.driver->take_log(), Log{});
  bench.gone(bob);
  bench.cycle();
  EXPECT_EQ(bench.driver->take_log(), (Log{"halt", "close"}));
  EXPECT_EQ(bench.due, Time::max());
}

TEST(DriverHost, answers_a_close_without_an_open_as_player_does) {
  Bench bench;
  const auto closed = bench.subscribe(base, Access::close);
  ASSERT_TRUE(closed);
  EXPECT_EQ(std::get<player::Subscribe>(*closed).access, Access::error);
}

TEST(DriverHost, opens_at_start_when_always_on) {
  Bench bench{{.always_on = true}};
  bench.cycle();
  EXPECT_EQ(bench.driver->take_log(), Log{"open"});
  bench.run(1s);
  EXPECT_EQ(bench.driver->ticks.size(), 51);
  EXPECT_EQ(bench.samples, 0) << "nobody listens";
}

TEST(DriverHost, refuses_a_subscription_when_the_driver_does_not_open) {
  Bench bench;
  bench.driver->openable = false;
  const auto refused = bench.subscribe();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().what, "driver \"robot\" failed: open /dev/robot: No such device");
  EXPECT_EQ(refused.error().code, std::errc::no_such_device);
  EXPECT_EQ(bench.due, Time::max()) << "nobody wants it";
}

TEST(DriverHost, tries_again_with_back_off_while_wanted) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.run(20ms);
  bench.driver->readable = false;
  bench.driver->openable = false;
  bench.driver->take_log();
  bench.cycle(20ms);
  EXPECT_EQ(bench.last_event(), "driver \"robot\" failed: read /dev/robot: Input/output error; next try in 1 s");
  EXPECT_EQ(bench.driver->take_log(), (Log{"halt", "close"}));
  for (const Duration wait : {1s, 2s, 4s, 8s, 16s, 30s, 30s}) {
    EXPECT_EQ(bench.due - bench.now, wait);
    bench.cycle(wait - 1ns);
    EXPECT_EQ(bench.driver->take_log(), Log{});
    bench.cycle(1ns);
    EXPECT_EQ(bench.driver->take_log(), (Log{"open", "halt"}));
  }
  bench.gone(alice);
  bench.cycle();
  EXPECT_EQ(bench.due, Time::max());
}

TEST(DriverHost, comes_back_at_rest_after_a_fault) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  ASSERT_TRUE(bench.drive(1));
  bench.run(100ms);
  EXPECT_EQ(bench.velocity.x, 1);
  bench.driver->readable = false;
  bench.run(20ms);
  EXPECT_EQ(bench.driver->velocity.x, 0);
  EXPECT_EQ(bench.motions.back().state, player::MotionState::fault);
  bench.drive(1);
  bench.cycle();
  EXPECT_EQ(bench.last_event(), "position2d:0 refused: driver \"robot\" failed: read /dev/robot: Input/output error");
  bench.driver->readable = true;
  bench.driver->take_log();
  bench.run(2s);
  EXPECT_EQ(bench.driver->take_log(), Log{"open"});
  EXPECT_EQ(bench.velocity.x, 0);
  bench.drive(1);
  bench.run(20ms);
  EXPECT_EQ(bench.velocity.x, 1) << "with its subscription still there";
}

TEST(DriverHost, survives_whatever_throws) {
  for (const std::string where : {"open", "read", "publish", "command", "request", "property"}) {
    SCOPED_TRACE(where);
    Bench bench;
    if (where != "open") {
      ASSERT_TRUE(bench.subscribe());
      bench.run(100ms);
    }
    bench.driver->thrower = where;
    bench.driver->take_log();
    bench.replies.clear();
    if (where == "open") bench.ask(base, player::Subscribe{});
    if (where == "command") bench.drive(1);
    if (where == "request") bench.ask(base, position2d::ResetOdometry{});
    if (where == "property") bench.ask(base, property::SetDouble{.key = "gain", .value = 0.5});
    bench.run(25ms);
    EXPECT_EQ(bench.last_event().substr(0, bench.last_event().find(';')),
              "driver \"robot\" failed: " + where + " threw \"ouch\"");
    EXPECT_EQ(bench.host->metrics().faults, 1);
    EXPECT_FALSE(bench.host->metrics().open);
    if (where != "read" && where != "publish" && where != "command") {
      ASSERT_EQ(bench.replies.size(), 1);
      EXPECT_FALSE(bench.replies.front().answer);
    }
  }
}

TEST(DriverHost, tells_set_points_once_a_cycle_and_every_edge) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  ASSERT_TRUE(bench.subscribe(kick));
  bench.driver->take_log();
  for (int i = 0; i < 10; ++i) bench.drive(0.1 * i);
  for (int i = 0; i < 3; ++i) bench.command(kick, kicker::KickCommand{.speed_mps = 1});
  bench.cycle();
  EXPECT_EQ(bench.driver->take_log(), (Log{"kick", "kick", "kick", "velocity 0.90"}));
  EXPECT_EQ(bench.host->metrics().commands, 13);
}

TEST(DriverHost, tells_each_joint_its_newest_set_point) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe(arm));
  bench.driver->take_log();
  for (const auto& [joint, speed] : {std::pair{0, 1.F}, {0, 2.F}, {1, 3.F}, {1, 4.F}}) {
    bench.command(arm, actarray::SpeedCommand{.joint = joint, .speed = speed});
  }
  bench.cycle();
  EXPECT_EQ(bench.driver->take_log(), (Log{"joint 0 2.00", "joint 1 4.00"}));
}

TEST(DriverHost, ramps_an_array_down_joint_by_joint_when_the_driver_takes_nothing_else) {
  Bench bench{{.motion = {{}, {}, {.ramp = 10}}}};
  bench.host->ports()[arm].commands[AnyCommand{actarray::MultiSpeedCommand{}}.index()] = nullptr;
  bench.driver->joint_states.actuators = {{.speed = 1}, {.speed = 2}};
  ASSERT_TRUE(bench.subscribe(arm));
  bench.command(arm, actarray::SpeedCommand{.joint = 1, .speed = 2});
  bench.run(20ms);
  bench.driver->take_log();
  ASSERT_TRUE(bench.answer(arm, player::Stop{}));
  bench.run(100ms);
  const Log log = bench.driver->take_log();
  ASSERT_GE(log.size(), 4);
  EXPECT_EQ((Log{log.begin(), log.begin() + 4}), (Log{"joint 0 1.00", "joint 1 2.00", "joint 0 0.80", "joint 1 1.80"}));
  bench.run(200ms);
  EXPECT_EQ(bench.driver->take_log().back(), "joint 1 0.00");
}

TEST(DriverHost, tells_a_set_point_before_a_later_request_of_its_port) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.driver->take_log();
  bench.drive(0.1);
  bench.drive(0.2);
  bench.ask(base, position2d::ResetOdometry{});
  bench.drive(0.3);
  bench.cycle();
  EXPECT_EQ(bench.driver->take_log(), (Log{"velocity 0.20", "reset", "velocity 0.30"}));
}

TEST(DriverHost, answers_requests_exactly_once) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  EXPECT_TRUE(bench.answer(base, position2d::ResetOdometry{}));
  EXPECT_EQ(bench.answer(base, position2d::SetMotorPower{}).error().what, "the driver dropped the request");
  EXPECT_EQ(bench.answer(base, position2d::SetOdometry{}).error().what,
            "driver \"robot\" does not answer this request");
  EXPECT_EQ(bench.answer(base, position2d::SetSpeedProfile{.speed_mps = NAN}).error().code, std::errc::not_supported);
  EXPECT_EQ(bench.answer(kick, kicker::GetLimits{}).error().what, "subscribe to kicker:0 first");

  bench.replies.clear();
  bench.ask(base, position2d::GetGeometry{});
  bench.ask(base, position2d::GetGeometry{});
  bench.cycle();
  EXPECT_EQ(bench.replies.size(), 0);
  auto first = std::move(bench.driver->deferred.front());
  bench.driver->deferred.erase(bench.driver->deferred.begin());
  first.answer(position2d::Geometry{.size = {.width = 2}});
  first.answer(position2d::Geometry{});
  bench.driver->deferred.clear();
  bench.cycle();
  ASSERT_EQ(bench.replies.size(), 2);
  EXPECT_EQ(std::get<position2d::Geometry>(*bench.replies[0].answer).size.width, 2);
  EXPECT_FALSE(bench.replies[1].answer);
}

TEST(DriverHost, may_be_destroyed_with_requests_unanswered) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.ask(base, position2d::GetGeometry{});
  bench.cycle();
  ASSERT_EQ(bench.driver->deferred.size(), 1);
  bench.host.reset();
}

TEST(DriverHost, gets_and_sets_properties_of_every_type) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  EXPECT_TRUE(bench.answer(base, property::SetDouble{.key = "gain", .value = 1.5}));
  EXPECT_EQ(std::get<property::GetDouble>(*bench.answer(base, property::GetDouble{.key = "gain"})).value, 1.5);
  EXPECT_TRUE(bench.answer(base, property::SetInt{.key = "count", .value = -7}));
  EXPECT_EQ(std::get<property::GetInt>(*bench.answer(base, property::GetInt{.key = "count"})).value, -7);
  EXPECT_TRUE(bench.answer(base, property::SetBool{.key = "on", .value = 0}));
  EXPECT_EQ(std::get<property::GetBool>(*bench.answer(base, property::GetBool{.key = "on"})).value, 0);
  EXPECT_EQ(std::get<property::GetText>(*bench.answer(base, property::GetText{.key = "label"})).value.view(), "red");
  EXPECT_EQ(*bench.driver->gain, 1.5);
  EXPECT_EQ(*bench.driver->count, -7);
  EXPECT_FALSE(*bench.driver->on);

  EXPECT_EQ(bench.answer(base, property::SetText{.key = "label", .value = "blue"}).error().what,
            "property 'label' is read-only");
  EXPECT_EQ(bench.answer(base, property::SetDouble{.key = "gain", .value = 3}).error().code,
            std::errc::result_out_of_range);
  EXPECT_FALSE(bench.answer(base, property::SetDouble{.key = "gain", .value = NAN}));
  EXPECT_EQ(bench.answer(base, property::SetInt{.key = "gain", .value = 1}).error().what,
            "property 'gain' is of another type");
  EXPECT_EQ(bench.answer(base, property::GetInt{.key = "gian"}).error().what,
            "driver \"robot\" has no property 'gian' of this type");
  EXPECT_EQ(*bench.driver->gain, 1.5);
}

TEST(DriverHost, knows_what_its_driver_can) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  const auto can = [&](Kind kind, std::uint32_t subtype) {
    return bool{bench.answer(base, property::HasCapability{static_cast<std::uint32_t>(kind), subtype})};
  };
  EXPECT_TRUE(can(Kind::command, VelocityCommand::message.subtype));
  EXPECT_FALSE(can(Kind::command, position2d::CarCommand::message.subtype));
  EXPECT_TRUE(can(Kind::request, position2d::ResetOdometry::message.subtype));
  EXPECT_FALSE(can(Kind::request, position2d::SetOdometry::message.subtype));
  EXPECT_TRUE(can(Kind::data, position2d::State::message.subtype));
}

TEST(DriverHost, beats_on_an_absolute_grid) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.cycle();
  const Time start = bench.driver->ticks.front().now;
  for (int i = 1; i < 200; ++i) bench.cycle(bench.due + std::chrono::microseconds{i % 7 * 100} - bench.now);
  EXPECT_EQ((bench.due - start) % 20ms, 0ns);
  EXPECT_EQ(bench.due - start, 200 * 20ms);
  EXPECT_EQ(bench.host->metrics().beats_missed, 0);
  bench.cycle(bench.due + 45ms - bench.now);
  EXPECT_EQ(bench.host->metrics().beats_missed, 2);
  EXPECT_EQ(bench.due - start, 203 * 20ms);
  EXPECT_GE(bench.host->metrics().jitter.quantile(1), 45ms);
}

TEST(DriverHost, starts_its_beats_when_open_has_returned) {
  Bench bench;
  bench.ask(base, player::Subscribe{});
  bench.cycle();
  EXPECT_EQ(bench.due, bench.now);
  bench.cycle(3s);  // so long open() took
  EXPECT_EQ(bench.host->metrics().beats_missed, 0);
  EXPECT_EQ(bench.driver->ticks.front().dt, 0ns);
  EXPECT_EQ(bench.due, bench.now + 20ms);
}

TEST(DriverHost, beats_for_descriptors_and_messages_only_without_a_rate) {
  Bench bench{{.rate_hz = 0}};
  ASSERT_TRUE(bench.subscribe());
  bench.cycle();
  EXPECT_EQ(bench.due, Time::max());
  bench.cycle(7ms, true);
  bench.cycle(5ms, true);
  ASSERT_EQ(bench.driver->ticks.size(), 2);
  EXPECT_EQ(bench.driver->ticks[0].dt, 7ms);
  EXPECT_EQ(bench.driver->ticks[1].dt, 5ms);
  bench.drive(1);
  bench.run(2s);
  EXPECT_EQ(bench.driver->velocity.x, 0) << "its lease is kept nevertheless";
  EXPECT_EQ(bench.driver->ticks.size(), 2);
}

TEST(DriverHost, stops_a_silent_client_at_its_lease) {
  Bench bench{{.rate_hz = 1}};
  ASSERT_TRUE(bench.subscribe());
  bench.drive(1);
  bench.run(500ms);
  EXPECT_EQ(bench.driver->velocity.x, 1);
  bench.run(1ms);
  EXPECT_EQ(bench.driver->velocity.x, 0) << "not at the next beat";
}

TEST(DriverHost, tells_refusals_once_in_five_seconds_with_a_count) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  ASSERT_TRUE(bench.subscribe(base, Access::open, bob));
  bench.events.clear();
  for (int i = 0; i < 120; ++i) {
    bench.drive(1, alice);
    bench.drive(-1, bob);
    bench.run(50ms);
  }
  EXPECT_EQ(bench.host->metrics().commands_refused, 120);
  ASSERT_EQ(bench.events.size(), 2);
  EXPECT_EQ(bench.events[0], "position2d:0 refused: owned by \"unknown\" (prio 10) until released or 500 ms idle");
  EXPECT_EQ(bench.events[1], bench.events[0] + " (99 more before)");
}

TEST(DriverHost, tells_a_newcomer_its_refusal_whatever_others_were_told) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.drive(std::nan(""), alice);
  bench.events.clear();
  bench.post(base, Identity{.name = "teleop@host", .priority = 20}, bob);
  ASSERT_TRUE(bench.subscribe(base, Access::open, bob));
  bench.drive(std::nan(""), bob);
  EXPECT_EQ(bench.events, Log{"position2d:0 refused: cmd_vel.vx = nan"});
  bench.post(base, Identity{.name = "still@host", .priority = 20}, bob);
  bench.drive(std::nan(""), bob);
  EXPECT_EQ(bench.events.size(), 1) << "a new name makes no newcomer";
}

TEST(DriverHost, warns_of_a_flood_once_in_five_seconds_with_a_count) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.driver->write_down = false;
  bench.events.clear();
  const auto flood = [&](int each_beat, Duration length) {
    for (const Time end = bench.now + length; bench.now < end;) {
      for (int i = 0; i < each_beat; ++i) bench.drive(1);
      bench.run(20ms);
    }
  };
  flood(2, 60s);
  EXPECT_EQ(bench.events, Log{}) << "a hiccup";
  flood(1001, 1s);
  ASSERT_EQ(bench.events.size(), 1);
  flood(1001, 8s);
  ASSERT_EQ(bench.events.size(), 2);
  EXPECT_EQ(bench.events[1],
            "driver \"robot\": 250000 commands in 5000 ms were replaced by newer ones before it took them");
  EXPECT_EQ(bench.host->metrics().commands_replaced + bench.link->down.replaced(), 3000 + 450 * 1000);
}

TEST(DriverHost, tells_missed_deadlines_once_in_five_seconds_with_a_count) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.run(100ms);
  bench.events.clear();
  bench.cycle(bench.due + 19ms - bench.now);
  EXPECT_EQ(bench.events, Log{}) << "late, but not missed";
  bench.cycle(bench.due + 37ms - bench.now);
  EXPECT_EQ(bench.events, Log{"driver \"robot\": deadline missed: 37 ms"});
  for (int i = 0; i < 12; ++i) bench.cycle(bench.due + 21ms - bench.now);
  EXPECT_EQ(bench.events.size(), 1);
  bench.run(5s);
  bench.cycle(bench.due + 99ms - bench.now);
  EXPECT_EQ(bench.last_event(), "driver \"robot\": deadline missed: 99 ms (12 more before)");
}

TEST(DriverHost, stops_what_was_to_go_where_its_driver_refuses_to_in_the_same_cycle) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.drive(1);
  bench.cycle();
  bench.command(base, position2d::PositionCommand{.pose = {.x = 5}});
  bench.cycle();
  EXPECT_EQ(bench.last_event(), "position2d:0 refused: no camera has seen the robot yet");
  EXPECT_EQ(bench.driver->velocity.x, 0);
  const auto motion = bench.answer(base, player::GetMotion{});
  ASSERT_TRUE(motion);
  const auto& status = *std::get_if<player::Motion>(&*motion);
  EXPECT_EQ(status.state, player::MotionState::stopped);
  EXPECT_EQ(status.reason, "refused: no camera has seen the robot yet");
}

TEST(DriverHost, halts_a_driver_that_refuses_to_come_to_rest) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.drive(1);
  bench.cycle();
  bench.driver->busy = true;
  (void)bench.driver->take_log();
  bench.run(600ms);
  EXPECT_EQ(bench.driver->velocity.x, 0);
  const Log log = bench.driver->take_log();
  EXPECT_EQ(std::ranges::count(log, "halt"), 1);
}

TEST(DriverHost, knows_that_a_halt_for_one_device_has_stopped_the_others_of_its_driver) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  ASSERT_TRUE(bench.subscribe(arm, Access::open, bob));
  bench.drive(1);
  bench.command(arm, actarray::MultiPositionCommand{.positions = {1, 2}}, bob);
  bench.cycle();
  const auto state_of = [&](std::size_t port) {
    const auto motion = bench.answer(port, player::GetMotion{}, port == arm ? bob : alice);
    return motion ? *std::get_if<player::Motion>(&*motion) : player::Motion{};
  };
  EXPECT_EQ(state_of(arm).state, player::MotionState::driving);
  bench.driver->busy = true;
  bench.run(600ms);
  EXPECT_EQ(state_of(arm).state, player::MotionState::stopped);
  EXPECT_EQ(state_of(arm).reason, "halted to bring position2d:0 to rest");
}

TEST(DriverHost, asks_nothing_of_a_driver_that_failed_just_before) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  (void)bench.driver->take_log();
  bench.driver->thrower = "command";
  bench.drive(1);
  bench.ask(base, position2d::ResetOdometry{});  // is told the velocity first
  bench.cycle();
  const Log log = bench.driver->take_log();
  EXPECT_EQ(std::ranges::count(log, "close"), 1);
  EXPECT_EQ(std::ranges::count(log, "reset"), 0);
}

TEST(DriverHost, refuses_commands_of_who_is_not_subscribed) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.drive(1, bob);
  bench.cycle();
  EXPECT_EQ(bench.driver->velocity.x, 0);
  EXPECT_EQ(bench.last_event(), "position2d:0 refused: subscribe to position2d:0 first");
}

TEST(DriverHost, stops_when_the_owner_closes_or_is_gone) {
  Bench bench;
  for (const bool close : {true, false}) {
    ASSERT_TRUE(bench.subscribe());
    ASSERT_TRUE(bench.subscribe(base, Access::open, bob));
    bench.post(base, Identity{.name = "teleop@host", .priority = 20});
    bench.drive(1);
    bench.run(20ms);
    ASSERT_EQ(bench.driver->velocity.x, 1);
    close ? (void)bench.ask(base, player::Subscribe{.access = Access::close}) : bench.gone(alice);
    bench.cycle();
    EXPECT_EQ(bench.driver->velocity.x, 0);
    EXPECT_EQ(bench.last_event(), "position2d:0 stopped: owner \"teleop@host\" disconnected");
  }
}

TEST(DriverHost, stops_for_anybody_and_shows_why) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.drive(1);
  bench.run(20ms);
  ASSERT_TRUE(bench.answer(base, player::Stop{}, bob));
  EXPECT_EQ(bench.driver->velocity.x, 0);
  const auto motion = bench.answer(base, player::GetMotion{}, bob);
  ASSERT_TRUE(motion);
  EXPECT_EQ(std::get<player::Motion>(*motion).reason.view(), "\"unknown\" asked for a stop");
  EXPECT_EQ(bench.motions.back().state, player::MotionState::stopped);
  EXPECT_FALSE(bench.answer(base, player::GetMotion{.group = "kick"}));
}

TEST(DriverHost, loses_no_answer_when_its_user_is_slow) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.replies.clear();
  int asked = 0;
  for (int round = 0; round < 3; ++round) {
    while (bench.ask(base, position2d::ResetOdometry{})) ++asked;
    bench.host->cycle(bench.now);
  }
  EXPECT_EQ(asked, 3 * 256);
  while (bench.ask(base, position2d::ResetOdometry{})) FAIL() << "who takes no answers may not ask";
  EXPECT_EQ(bench.link->down.size(), 256);
  for (int i = 0; i < 10; ++i) {
    bench.drain();
    bench.cycle();
  }
  ASSERT_EQ(bench.replies.size(), static_cast<std::size_t>(asked));
  for (std::size_t i = 1; i < bench.replies.size(); ++i) {
    EXPECT_LT(bench.replies[i - 1].to.sequence, bench.replies[i].to.sequence);
  }
}

TEST(DriverHost, comes_to_rest_at_shut_down) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.drive(1);
  bench.run(20ms);
  bench.driver->take_log();
  bench.host->shut_down(bench.now);
  bench.drain();
  EXPECT_EQ(bench.driver->velocity.x, 0);
  EXPECT_EQ(bench.driver->take_log(), (Log{"velocity 0.00", "halt", "close"}));
  EXPECT_EQ(bench.last_event(), "position2d:0 stopped: server shutting down");
}

TEST(DriverHost, treats_a_driver_that_hung_as_failed_when_it_returns) {
  Bench bench;
  ASSERT_TRUE(bench.subscribe());
  bench.run(20ms);
  EXPECT_FALSE(bench.host->busy_since());
  EXPECT_FALSE(bench.host->give_up()) << "it has no way around";
  bench.cycle();
  EXPECT_EQ(bench.last_event(), "driver \"robot\" failed: hung and came back; next try in 1 s");
}

TEST(DriverHost, sums_what_its_groups_limited) {
  Bench bench{{.motion = {{.max_speed = 0.5}}}};
  ASSERT_TRUE(bench.subscribe());
  for (int i = 0; i < 3; ++i) {
    bench.drive(1);
    bench.run(20ms);
  }
  EXPECT_EQ(bench.host->metrics().commands_clamped, 3);
  EXPECT_EQ(bench.velocity.x, 0.5);
}

TEST(DriverHost, does_not_allocate_in_steady_state) {
  Bench bench;
  bench.driver->write_down = false;
  bench.driver->ticks.reserve(2000);
  ASSERT_TRUE(bench.subscribe(base));
  ASSERT_TRUE(bench.subscribe(arm));
  ASSERT_TRUE(bench.subscribe(kick));  // three kinds of data: each place of the queue gets each in turn
  const actarray::MultiSpeedCommand speeds{.speeds = {1, 2, 3, 4, 5, 6}};
  const auto beat = [&] {
    bench.now = bench.due;
    bench.drive(1);
    bench.command(arm, speeds);
    const std::size_t before = allocations().count;
    bench.due = bench.host->cycle(bench.now);
    const std::size_t made = allocations().count - before;
    std::size_t states = 0;
    bench.link->up.drain([&](Outbound& out) { states += out.index() == 0; });
    EXPECT_EQ(states, 3);
    return made;
  };
  bench.due = bench.host->cycle(bench.now);
  for (int i = 0; i < 300; ++i) (void)beat();  // every place of the queues was used, by everything
  std::size_t made = 0;
  for (int i = 0; i < 300; ++i) made += beat();
  EXPECT_EQ(made, 0);
  EXPECT_GT(allocations().count, 0) << "they are counted";
  EXPECT_EQ(bench.driver->joints, 6);
}

/// A skill: drives the base that it requires.
class Skill final : public Driver {
 public:
  explicit Skill(Setup& setup) : port{setup.provide<Planner>()}, base_{setup.require<Position2d>()} {
    base_.on_data<position2d::State>([this](const position2d::State& state, Time) {
      seen = state.velocity;
      ++states;
    });
  }
  Result<> open() override {
    base_.request<position2d::ResetOdometry>({}, [this](const Result<Empty>& answer) {
      ++answers;
      answered = bool{answer};
    });
    return {};
  }
  Result<> read(const Tick&) override {
    for (int i = 0; i < sends; ++i) base_.send(VelocityCommand{.velocity = {.x = 0.1 * (i + 1)}});
    if (goes) base_.send(position2d::PositionCommand{.pose = {.x = 9}});
    goes = false;
    return {};
  }
  void publish() override {}
  void halt() noexcept override {}
  bool connected() const { return base_.connected(); }

  Port<Planner> port;
  Required<Position2d> base_;
  BodyVelocity seen{};
  int states = 0;
  int answers = 0;
  bool answered = false;
  int sends = 0;
  bool goes = false;
};

/// A skill that commands an array of joints.
class ArmSkill final : public Driver {
 public:
  explicit ArmSkill(Setup& setup) : port{setup.provide<Planner>()}, arm_{setup.require<Actarray>()} {
    arm_.on_data<actarray::State>([this](const actarray::State& state, Time) { seen = state.actuators.size(); });
  }
  Result<> read(const Tick&) override {
    arm_.send(speeds);
    return {};
  }
  void publish() override {}
  void halt() noexcept override {}

  Port<Planner> port;
  Required<Actarray> arm_;
  actarray::MultiSpeedCommand speeds{.speeds = {1, 2, 3, 4, 5, 6}};
  std::size_t seen = 0;
};

TEST(Required, does_not_allocate_in_steady_state) {
  Bench robot;
  robot.driver->write_down = false;
  robot.driver->ticks.reserve(10000);
  auto setup = std::make_unique<regista::Setup>(Section{});
  auto made = std::make_unique<ArmSkill>(*setup);
  const ArmSkill& skill = *made;
  DriverHost host{"skill", std::move(setup), std::move(made), HostOptions{.always_on = true}};
  Wakeup woken;
  host.add_link(&woken);
  join(host, host.required()[0], *robot.host, arm, first_driver_session);
  const auto beats = [&](int count) {
    const std::size_t before = allocations().count;
    for (int i = 0; i < count; ++i) {
      robot.now += 20ms;
      host.cycle(robot.now);
      robot.host->cycle(robot.now);
    }
    return allocations().count - before;
  };
  (void)beats(400);
  EXPECT_EQ(skill.seen, 6);
  EXPECT_EQ(robot.driver->joints, 6);
  EXPECT_EQ(beats(400), 0);
}

/// A skill's host, joined to that of a robot.
struct Pair {
  explicit Pair(bool joined = true) {
    auto setup = std::make_unique<Setup>(Section{});
    auto made = std::make_unique<Skill>(*setup);
    skill = made.get();
    host = std::make_unique<DriverHost>("waypoint", std::move(setup), std::move(made),
                                        HostOptions{.always_on = true, .priority = 12});
    host->add_link(&woken);
    if (joined) join(*host, host->required()[0], *robot.host, base, first_driver_session);
  }
  /// Both, at each millisecond.
  void run(Duration length) {
    for (const Time end = robot.now + length; robot.now < end;) {
      host->cycle(robot.now);
      robot.cycle(1ms);
    }
  }

  Bench robot;
  Wakeup woken;
  Skill* skill = nullptr;
  std::unique_ptr<DriverHost> host;
};

TEST(Required, is_subscribed_while_its_consumer_is_open) {
  Pair pair;
  pair.run(100ms);
  EXPECT_TRUE(pair.skill->connected());
  EXPECT_EQ(pair.robot.driver->take_log(), (Log{"open", "reset"}));
  EXPECT_EQ(pair.skill->answers, 1);
  EXPECT_TRUE(pair.skill->answered);
  EXPECT_GE(pair.skill->states, 4);
  pair.host->shut_down(pair.robot.now);
  pair.robot.cycle(1ms);
  EXPECT_FALSE(pair.skill->connected());
  EXPECT_EQ(pair.robot.driver->take_log(), (Log{"halt", "close"}));
}

TEST(Required, is_asked_again_with_back_off_while_it_refuses) {
  Pair pair;
  pair.robot.driver->openable = false;
  pair.run(2500ms);
  EXPECT_FALSE(pair.skill->connected());
  EXPECT_EQ(pair.robot.driver->take_log(), (Log{"open", "halt", "open", "halt"})) << "after 1 s, and after 2 s more";
  pair.robot.driver->openable = true;
  pair.run(2s);
  EXPECT_TRUE(pair.skill->connected());
}

TEST(Required, is_commanded_under_the_consumers_name_and_priority) {
  Pair pair;
  pair.skill->sends = 3;
  pair.run(100ms);
  EXPECT_EQ(pair.robot.driver->velocity.x, 0.1 * 3);
  EXPECT_EQ(pair.robot.motions.back().owner.view(), "waypoint");
  EXPECT_EQ(pair.robot.motions.back().priority, 12);
  const Log log = pair.robot.driver->take_log();
  EXPECT_EQ(std::ranges::count(log, "velocity 0.10"), 0) << "set-points coalesce over the edge";
  pair.skill->sends = 0;
  pair.run(520ms);
  EXPECT_EQ(pair.robot.driver->velocity.x, 0);
}

TEST(Required, keeps_a_destination_alive_from_its_consumers_cycle) {
  Pair pair;
  pair.robot.driver->base.on<position2d::PositionCommand>([](const position2d::PositionCommand&) {});
  pair.run(100ms);
  pair.skill->goes = true;
  pair.run(3s);
  EXPECT_EQ(pair.robot.motions.back().state, player::MotionState::driving);
  pair.robot.run(600ms);  // the consumer's thread hangs
  EXPECT_EQ(pair.robot.motions.back().state, player::MotionState::stopped);
  EXPECT_EQ(pair.robot.motions.back().reason.view(), "no sign of life for 500 ms (lease 500 ms)");
}

TEST(Required, that_was_never_joined_does_nothing) {
  Pair pair{false};
  pair.skill->sends = 1;
  pair.run(100ms);
  EXPECT_FALSE(pair.skill->connected());
  EXPECT_EQ(pair.skill->answers, 0);
}

}  // namespace
}  // namespace regista
