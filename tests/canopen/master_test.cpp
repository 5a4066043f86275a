// SPDX-License-Identifier: Apache-2.0
#include <counting_new.hpp>
#include <regista/canopen/eds.hpp>
#include <regista/canopen/master.hpp>
#include <regista/canopen/slave.hpp>

#include "bench.hpp"

namespace regista::canopen {
namespace {

ObjectDictionary drive_dictionary(NodeId node) { return load_eds(TEST_DATA "/canopen/drive.eds", node); }

/// A slave with what its callbacks told.
struct Drive {
  Drive(Bench& bench, NodeId node)
      : port{bench.bus.attach()},
        slave{port,
              node,
              drive_dictionary(node),
              {.written = [this](ObjectIndex object, ByteView data) -> std::optional<SdoAbort> {
                 written.emplace_back(object, get_le(data.first(std::min<std::size_t>(data.size(), 8))));
                 return {};
               },
               .reading = {},
               .state = {},
               .silent = [this](std::uint16_t code) { silent.push_back(code); }},
              {}} {
    bench.join(port, slave);
  }
  VirtualBus::Port& port;
  std::vector<std::pair<ObjectIndex, std::uint64_t>> written;
  std::vector<std::uint16_t> silent;
  Slave slave;
};

struct OneMaster : testing::Test {
  explicit OneMaster(const Master::Options& options = {})
      : master{port,
               options,
               {.node = [this](NodeId node, NodeMonitor::Event event) { events.emplace_back(node, event); },
                .emcy = [this](NodeId node, const Emcy& emcy) { emcies.emplace_back(node, emcy); },
                .bus = [this](BusState state) { bus_states.push_back(state); }}} {
    bench.join(port, master);
  }
  Result<Bytes> read(NodeId node, ObjectIndex object, SdoTransfer transfer = SdoTransfer::standard) {
    std::optional<Result<Bytes>> result;
    const auto begun =
        master.upload(node, object, [&](Result<Bytes> r) { result = std::move(r); }, bench.now, transfer);
    if (!begun) return begun.error();
    (void)bench.run_until([&] { return result.has_value(); });
    return *result;
  }
  Result<> configure(NodeId node, std::vector<SdoWrite> writes) {
    std::optional<Result<>> result;
    const auto begun = master.configure(node, std::move(writes), [&](Result<> r) { result = std::move(r); }, bench.now);
    if (!begun) return begun.error();
    (void)bench.run_until([&] { return result.has_value(); });
    return *result;
  }
  bool has(NodeId node, NodeMonitor::Event event) const {
    return std::ranges::find(events, std::pair{node, event}) != events.end();
  }

  Bench bench;
  VirtualBus::Port& port = bench.bus.attach();
  std::vector<std::pair<NodeId, NodeMonitor::Event>> events;
  std::vector<std::pair<NodeId, Emcy>> emcies;
  std::vector<BusState> bus_states;
  Master master;
};

struct MasterAndDrives : OneMaster {
  using OneMaster::OneMaster;
  Drive left{bench, 5};
  Drive right{bench, 6};
};

TEST_F(MasterAndDrives, hear_each_other_boot_and_change_state) {
  bench.run(10ms);
  EXPECT_TRUE(has(5, NodeMonitor::Event::boot_up));
  EXPECT_TRUE(has(6, NodeMonitor::Event::boot_up));
  ASSERT_TRUE(configure(5, heartbeat_writes(127, 50ms, 300ms)));
  ASSERT_TRUE(master.command(NmtCommand::start, 0, bench.now));
  bench.run(60ms);
  EXPECT_EQ(left.slave.state(), NmtState::operational);
  EXPECT_EQ(right.slave.state(), NmtState::operational);
  EXPECT_EQ(master.monitor(5).state(), NmtState::operational);
}

TEST_F(MasterAndDrives, read_of_both_at_once) {
  int done = 0;
  for (const NodeId node : {NodeId{5}, NodeId{6}}) {
    for (int i = 0; i < 10; ++i) {
      ASSERT_TRUE(master.upload(
          node, {0x1000, 0},
          [&](const Result<Bytes>& result) {
            EXPECT_TRUE(result);
            ++done;
          },
          bench.now));
    }
  }
  const Time begin = bench.now;
  ASSERT_TRUE(bench.run_until([&] { return done == 20; }));
  EXPECT_LT(bench.now - begin, 20 * bus_time(2 * worst_frame_bits(8), 1'000'000));
  std::optional<Identity> identity;
  ASSERT_TRUE(master.identify(6, [&](Result<Identity> r) { identity = *r; }, bench.now));
  ASSERT_TRUE(bench.run_until([&] { return identity.has_value(); }));
  EXPECT_EQ(*identity, (Identity{0xF4, 0x402, 0x10001, 0x12345678}));
}

TEST_F(MasterAndDrives, refuse_the_sixty_sixth_transfer) {
  for (int i = 0; i < 65; ++i) ASSERT_TRUE(master.upload(9, {0x1000, 0}, [](const Result<Bytes>&) {}, bench.now));
  EXPECT_EQ(
      master.upload(9, {0x1000, 0}, [](const Result<Bytes>&) {}, bench.now).error().code, std::errc::no_buffer_space);
}

// F15: the master falls silent, the drive finds out by itself.
TEST_F(MasterAndDrives, let_the_drive_notice_the_silence_of_the_master) {
  ASSERT_TRUE(configure(5, heartbeat_writes(127, 100ms, 300ms)));
  bench.run(2s);
  EXPECT_TRUE(left.silent.empty());
  port.connect(false);
  const Time begin = bench.now;
  ASSERT_TRUE(bench.run_until([&] { return !left.silent.empty(); }));
  EXPECT_EQ(left.silent.front(), 0x8130);
  EXPECT_LE(bench.now - begin, 300ms);
}

// F15, the other way.
TEST_F(MasterAndDrives, let_the_master_notice_that_a_drive_is_gone) {
  master.watch(5, {.heartbeat_timeout = 250ms});
  ASSERT_TRUE(configure(5, heartbeat_writes(127, 100ms, 300ms)));
  bench.run(1s);
  left.port.connect(false);
  const Time begin = bench.now;
  ASSERT_TRUE(bench.run_until([&] { return has(5, NodeMonitor::Event::lost); }));
  EXPECT_LE(bench.now - begin, 250ms);
  EXPECT_TRUE(master.monitor(5).lost());
}

// F16: power-cycled so quickly that no heartbeat is missed.
TEST_F(MasterAndDrives, tell_of_a_drive_that_was_power_cycled) {
  bench.run(10ms);
  ASSERT_TRUE(master.command(NmtCommand::start, 5, bench.now));
  bench.run(10ms);
  events.clear();
  left.slave.power_on(bench.now);
  bench.run(10ms);
  EXPECT_TRUE(has(5, NodeMonitor::Event::boot_up));
  EXPECT_EQ(left.slave.state(), NmtState::pre_operational);
}

TEST_F(MasterAndDrives, keep_a_history_of_emergencies) {
  bench.run(10ms);
  left.slave.emergency({.code = 0x3210, .error_register = 0x05}, bench.now);
  left.slave.emergency({.code = 0x8130, .error_register = 0x11}, bench.now);
  bench.run(10ms);
  ASSERT_EQ(emcies.size(), 2U);
  EXPECT_EQ(emcies[0].second.code, 0x3210);
  EXPECT_TRUE(master.emergencies(5).active());
  EXPECT_EQ(get_le(*read(5, {0x1003, 0})), 2U);
  EXPECT_EQ(get_le(*read(5, {0x1003, 1})), 0x8130U);
  EXPECT_EQ(get_le(*read(5, {0x1003, 2})), 0x3210U);
  left.slave.emergency({}, bench.now);
  bench.run(10ms);
  EXPECT_FALSE(master.emergencies(5).active());
}

const PdoSettings commands{.direction = PdoDirection::receive,
                           .number = 1,
                           .event_timer_ms = 200,
                           .mapping = {{{0x6040, 0}, 16}, {{0x60FF, 0}, 32}}};
const PdoSettings feedback{.direction = PdoDirection::transmit,
                           .number = 1,
                           .event_timer_ms = 20,
                           .mapping = {{{0x6041, 0}, 16}, {{0x606C, 0}, 32}}};

TEST_F(MasterAndDrives, set_a_pdo_up_in_the_order_of_cia_301) {
  ASSERT_TRUE(configure(5, pdo_writes(5, commands)));
  std::vector<ObjectIndex> order;
  for (const auto& [object, value] : left.written) order.push_back(object);
  EXPECT_EQ(
      order,
      (std::vector<ObjectIndex>{
          {0x1400, 1}, {0x1400, 2}, {0x1400, 5}, {0x1600, 0}, {0x1600, 1}, {0x1600, 2}, {0x1600, 0}, {0x1400, 1}}));
  EXPECT_EQ(left.written.front().second, 0x80000205U);
  EXPECT_EQ(left.written.back().second, 0x00000205U);
  // Without that order the drive refuses.
  const auto refused = configure(5, {sdo_write<std::uint32_t>({0x1600, 1}, 0x60400010)});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, SdoAbort::unsupported_access);
}

TEST_F(MasterAndDrives, find_what_does_not_read_back) {
  left.slave.set({0x2010, 0}, 0);  // a counter: it counts writes, whatever is written
  const auto different = configure(5, {sdo_write<std::uint32_t>({0x2010, 0}, 7)});
  EXPECT_TRUE(different);
  Bench other;
  VirtualBus::Port& own = other.bus.attach();
  Master lone{own, {}, {}};
  other.join(own, lone);
  VirtualBus::Port& end = other.bus.attach();
  Slave forgetful{end, 5, drive_dictionary(5), {}, {}};
  struct Forget final : Station {
    Slave& slave;
    explicit Forget(Slave& s) : slave{s} {}
    void on_frame(const CanFrame& f, Time t) override { slave.on_frame(f, t); }
    void on_time(Time t) override {
      slave.set({0x2010, 0}, 1);
      slave.on_time(t);
    }
    [[nodiscard]] Time next_wake() const override { return slave.next_wake(); }
  } forget{forgetful};
  other.join(end, forget);
  std::optional<Result<>> result;
  ASSERT_TRUE(
      lone.configure(5, {sdo_write<std::uint32_t>({0x2010, 0}, 7)}, [&](Result<> r) { result = r; }, other.now));
  ASSERT_TRUE(other.run_until([&] { return result.has_value(); }));
  ASSERT_FALSE(*result);
  EXPECT_NE(result->error().what.find("2010:00 was written and reads back differently"), std::string::npos);
}

/// A node of which only the answers to SDO requests are known, a frame each.
struct Answers final : Station {
  Answers(Bench& bench, std::function<std::optional<CanFrame>(const CanFrame&)> answer)
      : port{bench.bus.attach()}, answer_{std::move(answer)} {
    bench.join(port, *this);
  }
  void on_frame(const CanFrame& frame, Time /*now*/) override {
    if (frame.id != 0x607) return;
    requests.push_back(frame);
    const auto answer = answer_(frame);
    ASSERT_TRUE(!answer || port.send(*answer));
  }
  void on_time(Time /*now*/) override {}
  [[nodiscard]] Time next_wake() const override { return Time::max(); }
  VirtualBus::Port& port;
  std::vector<CanFrame> requests;

 private:
  std::function<std::optional<CanFrame>(const CanFrame&)> answer_;
};

CanFrame abort_of(const CanFrame& request, SdoAbort code) {
  CanFrame frame = make_frame(0x587, {0x80, request.data[1], request.data[2], request.data[3], 0, 0, 0, 0});
  std::ranges::copy(le_bytes(static_cast<std::uint32_t>(code), 4), frame.data.begin() + 4);
  return frame;
}

TEST_F(OneMaster, configures_a_node_that_never_says_how_many_bytes_it_sends) {
  Answers node{
      bench, [](const CanFrame& request) {
        const bool writes = request.data[0] >> 5 == 1;
        // Beyond the two bytes of the object stands whatever the last answer left there.
        return std::optional{make_frame(0x587, {static_cast<std::uint8_t>(writes ? 0x60 : 0x42), request.data[1],
                                                request.data[2], request.data[3], 0x64, 0, 0xAA, 0x55})};
      }};
  EXPECT_TRUE(configure(7, heartbeat_writes(127, 100ms, 0ms)));
  EXPECT_EQ(node.requests.size(), 2U) << "written and read back";
  EXPECT_FALSE(configure(7, heartbeat_writes(127, 101ms, 0ms))) << "which reads back differently";
}

TEST_F(OneMaster, writes_what_it_cannot_compare_and_leaves_out_what_may_be_missing) {
  Answers node{
      bench, [](const CanFrame& request) {
        const ObjectIndex object{static_cast<std::uint16_t>(request.data[1] | request.data[2] << 8), 0};
        if (object.index == 0x6080) return std::optional{abort_of(request, SdoAbort::no_object)};
        if (request.data[0] >> 5 == 2) return std::optional{abort_of(request, SdoAbort::write_only)};
        return std::optional{make_frame(0x587, {0x60, request.data[1], request.data[2], request.data[3], 0, 0, 0, 0})};
      }};
  std::vector<SdoWrite> writes{sdo_write<std::uint16_t>({0x6040, 0}, 6), sdo_write<std::uint32_t>({0x6080, 0}, 3000)};
  writes[0].only_if_different = true;
  writes[1].optional = true;
  const auto done = configure(7, writes);
  EXPECT_TRUE(done) << done.error().message();
  const auto wrote = [](const CanFrame& request) { return request.data[0] >> 5 == 1; };
  EXPECT_EQ(std::ranges::count_if(node.requests, wrote), 2);
  writes[1].optional = false;
  EXPECT_EQ(configure(7, writes).error().code, SdoAbort::no_object);
}

TEST_F(OneMaster, identifies_a_node_that_tells_its_vendor_only) {
  Answers node{bench, [](const CanFrame& request) {
                 if (request.data[3] != 1) return std::optional{abort_of(request, SdoAbort::no_subindex)};
                 return std::optional{make_frame(0x587, {0x43, 0x18, 0x10, 1, 0x1E, 0, 0, 0})};
               }};
  std::optional<Result<Identity>> identity;
  ASSERT_TRUE(master.identify(7, [&](Result<Identity> r) { identity = std::move(r); }, bench.now));
  ASSERT_TRUE(bench.run_until([&] { return identity.has_value(); }));
  ASSERT_TRUE(*identity);
  EXPECT_EQ(**identity, (Identity{.vendor = 0x1E}));
}

TEST_F(MasterAndDrives, uses_fixed_pdos_that_are_as_they_should_be) {
  ASSERT_TRUE(configure(5, pdo_writes(5, feedback)));
  left.written.clear();
  ASSERT_TRUE(configure(5, fixed_pdo_writes(5, feedback)));
  EXPECT_TRUE(left.written.empty()) << "nothing differs";
  PdoSettings faster = feedback;
  faster.event_timer_ms = 10;
  ASSERT_TRUE(configure(5, fixed_pdo_writes(5, faster)));
  ASSERT_EQ(left.written.size(), 1U);
  EXPECT_EQ(left.written[0].first, (ObjectIndex{0x1800, 5}));
  PdoSettings other = feedback;
  other.mapping = {{{0x606C, 0}, 32}};
  EXPECT_FALSE(configure(5, fixed_pdo_writes(5, other)));
}

TEST_F(MasterAndDrives, write_only_what_differs_when_asked) {
  ASSERT_TRUE(configure(5, {{{0x6083, 0}, {0x88, 0x13, 0, 0}, true}, {{0x6084, 0}, {1, 0, 0, 0}, true}}));
  ASSERT_EQ(left.written.size(), 1U) << "5000 was there already";
  EXPECT_EQ(left.written[0].first, (ObjectIndex{0x6084, 0}));
}

struct Driving : MasterAndDrives {
  Driving() {
    for (const NodeId node : {NodeId{5}, NodeId{6}}) {
      EXPECT_TRUE(configure(node, pdo_writes(node, commands)));
      EXPECT_TRUE(configure(node, pdo_writes(node, feedback)));
    }
    out = master.add_pdo(0x205, 6, false);
    master.on_pdo(0x185, [this](ByteView bytes, Time) {
      ++heard;
      speed = feedback.mapping.get_signed(bytes, 1);
    });
    EXPECT_TRUE(master.command(NmtCommand::start, 0, bench.now));
    bench.run(1ms);
    left.written.clear();
  }
  Result<> drive(std::int32_t rpm) {
    std::array<std::uint8_t, 8> bytes{};
    commands.mapping.set(bytes, 0, 0x000F);
    commands.mapping.set(bytes, 1, static_cast<std::uint32_t>(rpm));
    return master.send_pdo(out, bytes, bench.now);
  }
  std::size_t out = 0;
  int heard = 0;
  std::int64_t speed = 0;
};

TEST_F(Driving, brings_set_points_down_and_speeds_up) {
  ASSERT_TRUE(drive(-1234));
  bench.run(1ms);
  EXPECT_EQ(left.slave.get({0x6040, 0}), 0x000FU);
  EXPECT_EQ(static_cast<std::int32_t>(left.slave.get({0x60FF, 0})), -1234);
  left.slave.set({0x606C, 0}, static_cast<std::uint32_t>(-77));
  bench.run(25ms);
  EXPECT_EQ(speed, -77);
  const int before = heard;
  bench.run(1s);
  EXPECT_NEAR(heard - before, 50, 1) << "the event timer";
}

TEST_F(Driving, lets_the_drive_notice_missing_set_points) {
  ASSERT_TRUE(drive(100));
  bench.run(199ms);
  EXPECT_TRUE(left.silent.empty());
  bench.run(2ms);
  ASSERT_EQ(left.silent.size(), 1U);
  EXPECT_EQ(left.silent[0], 0x8250);
  EXPECT_EQ(emcies.back().second.code, 0x8250);
}

// ros_canopen#481, yarp-devices#246: commands piled up and were executed after the stop.
TEST_F(Driving, keeps_only_the_newest_set_point_while_the_bus_is_blocked) {
  left.port.connect(false);
  right.port.connect(false);  // nobody acknowledges
  for (int rpm = 1; rpm <= 300; ++rpm) {
    ASSERT_TRUE(drive(rpm));
    bench.run(1ms);
  }
  left.port.connect(true);
  bench.run(50ms);
  int executed = 0;
  for (const auto& [object, value] : left.written) executed += object.index == 0x60FF ? 1 : 0;
  EXPECT_LE(executed, 12) << "ten that the controller had taken, and the newest";
  EXPECT_EQ(left.slave.get({0x60FF, 0}), 300U);
  EXPECT_GT(master.statistics().replaced_pdos, 250U);
}

// yarp-devices#251: the other nodes lose power, the controller is never bus-off, only ENOBUFS comes.
TEST_F(Driving, takes_a_bus_without_acknowledge_for_down_and_comes_back_without_old_motion) {
  left.port.connect(false);
  right.port.connect(false);
  bool refused = false;
  for (int rpm = 1; rpm <= 1000 && !refused; ++rpm) {
    refused = !drive(rpm);
    bench.run(1ms);
  }
  EXPECT_TRUE(refused);
  ASSERT_EQ(bus_states, (std::vector{BusState::down}));
  EXPECT_EQ(drive(5).error().code, std::errc::network_down);
  EXPECT_EQ(read(5, {0x1000, 0}).error().code, std::errc::network_down);
  left.port.connect(true);
  bench.run(200ms);
  EXPECT_EQ(bus_states, (std::vector{BusState::down, BusState::active}));
  left.written.clear();
  bench.run(1s);
  EXPECT_TRUE(left.written.empty()) << "nothing of before is left";
}

// F13.
TEST_F(Driving, discards_what_waits_when_the_controller_goes_bus_off) {
  std::optional<Result<Bytes>> result;
  ASSERT_TRUE(master.upload(5, {0x1008, 0}, [&](Result<Bytes> r) { result = std::move(r); }, bench.now));
  ASSERT_TRUE(drive(7));
  port.bus_off();
  bench.run(1ms);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->error().code, std::errc::network_down);
  EXPECT_EQ(result->error().message().find("node 5: read 1008:00: CAN bus bus-off"), 0U) << result->error().message();
  EXPECT_EQ(master.bus_state(), BusState::off);
  port.restart();
  bench.run(500ms);
  EXPECT_EQ(master.bus_state(), BusState::active);
  EXPECT_TRUE(left.written.empty());
  EXPECT_TRUE(read(5, {0x1000, 0}));
}

// ros_canopen#190, #259: slow SDO reads held the trajectory up.
TEST_F(Driving, sends_pdos_past_a_block_transfer) {
  Listener listener{bench};
  bool done = false;
  ASSERT_TRUE(master.download(
      5, {0x2001, 0}, random_bytes(20'000), [&](const Result<Bytes>& r) { done = static_cast<bool>(r); }, bench.now,
      SdoTransfer::block));
  std::vector<Duration> late;
  while (!done) {
    const Time set = bench.now;
    ASSERT_TRUE(drive(static_cast<std::int32_t>(late.size())));
    const std::size_t before = listener.heard.size();
    bench.run(10ms);
    for (std::size_t i = before; i < listener.heard.size(); ++i) {
      if (listener.heard[i].first.id == 0x205) late.push_back(listener.heard[i].second - set);
    }
    ASSERT_LT(late.size(), 100U);
  }
  ASSERT_GT(late.size(), 10U);
  // The interface's queue of ten is before it, not the transfer.
  EXPECT_LT(*std::ranges::max_element(late), 11 * bus_time(135, 1'000'000) + 1ms);
}

/// Takes every frame.
struct Sink final : CanBus {
  int sent = 0;
  Result<> send(const CanFrame& /*frame*/) override { return (++sent, Result<>{}); }
  Result<std::optional<ReceivedFrame>> receive() override { return std::optional<ReceivedFrame>{}; }
  [[nodiscard]] int descriptor() const override { return -1; }
};

TEST(MasterCycle, allocates_nothing) {
  Sink sink;
  Master master{sink, {.bit_rate = 500'000, .sync = {.period = 10ms}}, {}};
  master.watch(5, {});
  Time now = Time{} + 1h;
  int heard = 0;
  master.on_pdo(0x185, [&](ByteView bytes, Time) { heard += static_cast<int>(bytes.size()); });
  const std::size_t out = master.add_pdo(0x205, 6, false);
  std::array<std::uint8_t, 8> bytes{};
  const CanFrame speed = make_frame(0x185, {0x37, 0x06, 1, 2, 3, 4});
  const CanFrame beat = make_frame(0x705, {5});
  const std::size_t before = allocations().count;
  for (int i = 0; i < 1000; ++i) {
    now += 10ms;
    master.on_time(now);
    master.on_frame(speed, now);
    master.on_frame(beat, now);
    ASSERT_TRUE(master.send_pdo(out, bytes, now));
  }
  EXPECT_EQ(allocations().count, before);
  EXPECT_EQ(heard, 6000);
  EXPECT_GE(sink.sent, 2000);
}

struct Synchronous : MasterAndDrives {
  Synchronous() : MasterAndDrives{Master::Options{.sync = {.period = 10ms}}} {}
};

// ros2_canopen#258: the halts of several drives did not take effect in one SYNC.
TEST_F(Synchronous, set_points_take_effect_in_all_drives_with_the_same_sync) {
  PdoSettings by_sync = commands;
  by_sync.transmission = transmission::every_sync(1);
  by_sync.event_timer_ms.reset();
  PdoSettings answer = feedback;
  answer.transmission = transmission::every_sync(2);
  answer.event_timer_ms.reset();
  std::vector<std::size_t> out;
  for (const NodeId node : {NodeId{5}, NodeId{6}}) {
    ASSERT_TRUE(configure(node, pdo_writes(node, by_sync)));
    ASSERT_TRUE(configure(node, pdo_writes(node, answer)));
    out.push_back(master.add_pdo(0x200U + node, 6, true));
  }
  ASSERT_TRUE(master.command(NmtCommand::start, 0, bench.now));
  bench.run(50ms);
  Listener listener{bench};
  std::array<std::uint8_t, 8> bytes{};
  by_sync.mapping.set(bytes, 1, 99);
  ASSERT_TRUE(master.send_pdo(out[0], bytes, bench.now));
  bench.run(6ms);
  ASSERT_TRUE(master.send_pdo(out[1], bytes, bench.now));
  bool one = false;
  bool both = false;
  ASSERT_TRUE(bench.run_until([&] {
    const bool left_has = left.slave.get({0x60FF, 0}) == 99;
    const bool right_has = right.slave.get({0x60FF, 0}) == 99;
    one = one || left_has != right_has;
    both = left_has && right_has;
    return both;
  }));
  EXPECT_FALSE(one);
  bench.run(1s);
  EXPECT_NEAR(static_cast<double>(listener.frames(0x080).size()), 102, 2);
  EXPECT_NEAR(static_cast<double>(listener.frames(0x185).size()), 51, 2) << "every second SYNC";
  EXPECT_EQ(listener.frames(0x205).size(), 1U) << "once set, once sent";
}

TEST_F(MasterAndDrives, answer_remote_frames_with_a_pdo) {
  PdoSettings on_request = feedback;
  on_request.transmission = transmission::remote;
  on_request.event_timer_ms.reset();
  on_request.remote_allowed = true;
  ASSERT_TRUE(configure(5, pdo_writes(5, on_request)));
  ASSERT_TRUE(master.command(NmtCommand::start, 0, bench.now));
  int heard = 0;
  master.on_pdo(0x185, [&](ByteView bytes, Time) { heard += bytes.size() == 6 ? 1 : 0; });
  bench.run(100ms);
  EXPECT_EQ(heard, 0);
  ASSERT_TRUE(master.request_pdo(0x185, 6, bench.now));
  bench.run(10ms);
  EXPECT_EQ(heard, 1);
}

TEST_F(MasterAndDrives, guard_a_node) {
  master.watch(5, {.heartbeat_timeout = {}, .guard_time = 50ms, .life_time_factor = 3});
  bench.run(500ms);
  EXPECT_EQ(master.monitor(5).state(), NmtState::pre_operational);
  EXPECT_FALSE(master.monitor(5).lost());
  left.port.connect(false);
  bench.run(300ms);
  EXPECT_TRUE(master.monitor(5).lost());
}

TEST(MasterDay, passes_without_drift) {
  Bench bench{125'000};
  VirtualBus::Port& port = bench.bus.attach();
  std::vector<NodeMonitor::Event> events;
  Master master{port,
                {.heartbeat = 500ms, .bit_rate = 125'000, .sync = {.period = 1s, .counter_overflow = 240}},
                {.node = [&](NodeId, NodeMonitor::Event event) { events.push_back(event); }, .emcy = {}, .bus = {}}};
  bench.join(port, master);
  Drive drive{bench, 5};
  std::uint64_t syncs = 0;
  struct Count final : Station {
    std::uint64_t& count;
    explicit Count(std::uint64_t& n) : count{n} {}
    void on_frame(const CanFrame& frame, Time /*now*/) override { count += frame.id == 0x080 ? 1 : 0; }
    void on_time(Time /*now*/) override {}
    [[nodiscard]] Time next_wake() const override { return Time::max(); }
  } count{syncs};
  bench.join(bench.bus.attach(), count);
  master.watch(5, {.heartbeat_timeout = 1s});
  int good = 0;
  ASSERT_TRUE(master.configure(
      5, heartbeat_writes(127, 400ms, 1500ms), [&](const Result<>& r) { good += r ? 1 : 0; }, bench.now));
  for (int minute = 0; minute < 24 * 60; ++minute) {
    ASSERT_TRUE(master.upload(5, {0x1008, 0}, [&](const Result<Bytes>& r) { good += r ? 1 : 0; }, bench.now));
    bench.run(60s);
  }
  EXPECT_EQ(good, 24 * 60 + 1);
  EXPECT_NEAR(static_cast<double>(syncs), 86'400, 1);
  EXPECT_EQ(master.sync().missed(), 0U);
  EXPECT_EQ(events, (std::vector{NodeMonitor::Event::boot_up})) << "and never lost";
  EXPECT_TRUE(drive.silent.empty());
}

TEST(MasterDiagnosis, knows_the_load_of_the_bus) {
  Bench bench{125'000};
  VirtualBus::Port& port = bench.bus.attach();
  Master master{port, {.heartbeat = {}, .bit_rate = 125'000}, {}};
  bench.join(port, master);
  VirtualBus::Port& other = bench.bus.attach();
  const CanFrame frame = make_frame(0x181, {1, 2, 3, 4, 5, 6, 7, 8});
  for (int i = 0; i < 250; ++i) {
    ASSERT_TRUE(other.send(frame));
    bench.run(10ms);
  }
  EXPECT_NEAR(master.bus_load(), 100.0 * frame_bits(frame) / 125'000, 0.002);
  EXPECT_EQ(master.statistics().received, 250U);
}

TEST(MasterLss, gives_a_node_an_id_and_hears_it_boot) {
  Bench bench;
  VirtualBus::Port& port = bench.bus.attach();
  bool booted = false;
  Master master{
      port,
      {},
      {.node = [&](NodeId node, NodeMonitor::Event e) { booted = node == 33 && e == NodeMonitor::Event::boot_up; },
       .emcy = {},
       .bus = {}}};
  bench.join(port, master);
  VirtualBus::Port& end = bench.bus.attach();
  Slave slave{end, lss_unconfigured, drive_dictionary(1), {}, {}};
  bench.join(end, slave);
  bench.run(10ms);
  std::optional<Identity> found;
  master.lss().fast_scan([&](auto result) { found = *result; }, bench.now);
  master.on_time(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return found.has_value(); }, 20s));
  EXPECT_EQ(found->serial, 0x12345678U);
  master.lss().set_node_id(
      33,
      [&](const Result<>& result) {
        EXPECT_TRUE(result);
        master.lss().switch_all(false, [](const Result<>&) {}, master.now());
      },
      bench.now);
  master.on_time(bench.now);
  ASSERT_TRUE(bench.run_until([&] { return booted; }));
  EXPECT_EQ(slave.node(), 33);
}

}  // namespace
}  // namespace regista::canopen
