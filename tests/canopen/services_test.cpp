// SPDX-License-Identifier: Apache-2.0
#include <regista/canopen/emcy.hpp>
#include <regista/canopen/lss.hpp>
#include <regista/canopen/nmt.hpp>
#include <regista/canopen/slave.hpp>
#include <regista/canopen/sync.hpp>

#include "bench.hpp"

namespace regista::canopen {
namespace {

using Event = NodeMonitor::Event;

struct Monitor : testing::Test {
  Time now = Time{} + 1h;
  Event hear(NodeMonitor& monitor, std::uint8_t state) { return monitor.on_frame(make_frame(0x705, {state}), now); }
  Event pass(NodeMonitor& monitor, Duration duration) { return monitor.on_time(now += duration); }
};

TEST_F(Monitor, counts_a_node_as_lost_when_its_heartbeat_stays_away) {
  NodeMonitor monitor{5, {.heartbeat_timeout = 250ms}};
  EXPECT_EQ(monitor.state(), std::nullopt);
  EXPECT_EQ(pass(monitor, 10s), Event::none) << "not before it was heard once";
  EXPECT_EQ(hear(monitor, 0x7F), Event::state_changed);
  EXPECT_EQ(hear(monitor, 0x05), Event::state_changed);
  EXPECT_EQ(pass(monitor, 249ms), Event::none);
  EXPECT_EQ(hear(monitor, 0x05), Event::none);
  EXPECT_EQ(monitor.next_wake(), now + 250ms);
  EXPECT_EQ(pass(monitor, 250ms), Event::lost);
  EXPECT_TRUE(monitor.lost());
  EXPECT_EQ(pass(monitor, 10s), Event::none) << "told once";
  EXPECT_EQ(hear(monitor, 0x05), Event::back);
}

// ros_canopen#337: a drive that was power-cycled and came back in time went unnoticed.
TEST_F(Monitor, tells_a_boot_up_even_when_no_heartbeat_was_missed) {
  NodeMonitor monitor{5, {.heartbeat_timeout = 250ms}};
  (void)hear(monitor, 0x05);
  EXPECT_EQ(hear(monitor, 0x00), Event::boot_up);
  EXPECT_EQ(monitor.state(), NmtState::pre_operational);
  EXPECT_EQ(pass(monitor, 10s), Event::none) << "it has to be told to send its heartbeat again";
}

TEST_F(Monitor, disregards_what_is_no_heartbeat) {
  NodeMonitor monitor{5, {}};
  EXPECT_EQ(hear(monitor, 0x33), Event::none);
  EXPECT_EQ(monitor.on_frame(make_frame(0x705, {5, 0}), now), Event::none);
  EXPECT_EQ(monitor.on_frame({.id = 0x705, .remote = true, .size = 1}, now), Event::none);
  EXPECT_EQ(monitor.state(), std::nullopt);
}

TEST_F(Monitor, guards_a_node_without_heartbeat) {
  NodeMonitor monitor{5, {.heartbeat_timeout = {}, .guard_time = 100ms, .life_time_factor = 2}};
  EXPECT_EQ(pass(monitor, 0ms), Event::none);
  const auto question = monitor.take_question();
  ASSERT_TRUE(question);
  EXPECT_TRUE(question->remote);
  EXPECT_EQ(question->id, 0x705U);
  EXPECT_FALSE(monitor.take_question());
  EXPECT_EQ(hear(monitor, 0x05), Event::state_changed);
  EXPECT_EQ(pass(monitor, 100ms), Event::none);
  (void)monitor.take_question();
  EXPECT_EQ(hear(monitor, 0x05), Event::none) << "the toggle bit did not alternate: no answer";
  EXPECT_EQ(pass(monitor, 100ms), Event::none);
  EXPECT_EQ(pass(monitor, 100ms), Event::lost);
  EXPECT_EQ(hear(monitor, 0x85), Event::back);
}

TEST(Emcy, is_told_in_words) {
  const Emcy emcy = *Emcy::decode(make_frame(0x083, {0x10, 0x32, 0x05, 0, 0, 0, 0, 0}));
  EXPECT_EQ(to_string(emcy), "EMCY 0x3210 DC link over-voltage (reg 0x05: generic, voltage)");
  EXPECT_EQ(emcy_text(0x8130), "life guard or heartbeat error");
  EXPECT_EQ(emcy_text(0x3299), "voltage inside the device");
  EXPECT_EQ(emcy_text(0x8250), "RPDO time-out");
  EXPECT_EQ(emcy_text(0xFF07), "device specific");
  EXPECT_EQ(emcy.encode(3), make_frame(0x083, {0x10, 0x32, 0x05, 0, 0, 0, 0, 0}));
  EXPECT_FALSE(Emcy::decode(make_frame(0x080, {})));
  EXPECT_FALSE(Emcy::decode(make_frame(0x083, {0x10, 0x32})));
}

TEST(EmcyHistory, keeps_the_last_sixteen) {
  EmcyHistory history;
  for (std::uint16_t code = 1; code <= 20; ++code) history.add({.code = code}, Time{});
  ASSERT_EQ(history.entries().size(), 16U);
  EXPECT_EQ(history.entries().front().emcy.code, 20);
  EXPECT_EQ(history.entries().back().emcy.code, 5);
  EXPECT_EQ(history.total(), 20U);
  EXPECT_TRUE(history.active());
  history.add({}, Time{});
  EXPECT_FALSE(history.active());
}

TEST(SyncProducer, keeps_its_grid_and_leaves_out_what_it_missed) {
  SyncProducer sync{{.period = 10ms, .counter_overflow = 3}};
  Time now = Time{} + 1h;
  const Time begin = now;
  std::vector<int> counters;
  for (const auto at : {0ms, 10ms, 21ms, 30ms, 65ms, 70ms}) {
    const auto frame = sync.on_time(begin + at);
    ASSERT_TRUE(frame) << at.count();
    counters.push_back(frame->data[0]);
    EXPECT_FALSE(sync.on_time(begin + at));
  }
  EXPECT_EQ(counters, (std::vector{1, 2, 3, 1, 2, 3}));
  EXPECT_EQ(sync.missed(), 2U);
  EXPECT_EQ(sync.next_wake(), begin + 80ms);
  EXPECT_THROW(SyncProducer({.counter_overflow = 1}), std::invalid_argument);
}

TEST(SyncProducer, has_a_window) {
  SyncProducer sync{{.period = 10ms, .window = 2ms}};
  const Time now = Time{} + 1h;
  (void)sync.on_time(now);
  EXPECT_TRUE(sync.in_window(now + 2ms));
  EXPECT_FALSE(sync.in_window(now + 3ms));
}

// python-canopen's example of TIME_OF_DAY: days from 1 January 1984.
TEST(TimeFrame, counts_from_1984) {
  using namespace std::chrono;
  const sys_time<milliseconds> time = sys_days{2000y / 1 / 1} + 12h + 1ms;
  const CanFrame frame = time_frame(time);
  EXPECT_EQ(frame, make_frame(0x100, {0x01, 0x2E, 0x93, 0x02, 0xD4, 0x16}));  // 43200001 ms, 5844 days
  EXPECT_EQ(decode_time(frame), time);
}

struct Lss : testing::Test {
  Time now = Time{} + 1h;
  LssMaster master{{}};
  std::vector<LssSlave> slaves;
  std::vector<CanFrame> log;

  /// Lets both ends talk until the service is over.
  void run() {
    while (master.busy()) {
      while (master.front() != nullptr) {
        const CanFrame frame = *master.front();
        log.push_back(frame);
        master.pop(now);
        for (LssSlave& slave : slaves) {
          if (const auto answer = slave.on_frame(frame)) master.on_frame(*answer, now);
        }
      }
      if (!master.busy()) return;
      now = std::max(now, master.next_wake());
      master.on_time(now);
    }
  }
};

TEST_F(Lss, finds_nodes_one_after_the_other_and_gives_them_ids) {
  const std::vector<Identity> identities{
      {0xF4, 0x402, 0x10001, 0x12345678}, {0xF4, 0x402, 0x10001, 0x12345679}, {0xFFFFFFFF, 0, 0x80000000, 1}};
  for (const Identity& identity : identities) slaves.emplace_back(identity, lss_unconfigured);
  slaves.emplace_back(Identity{1, 1, 1, 1}, NodeId{9});  // has one already
  std::vector<Identity> found;
  NodeId next = 20;
  while (true) {
    std::optional<Identity> one;
    master.fast_scan([&](auto result) { one = *result; }, now);
    run();
    if (!one) break;
    found.push_back(*one);
    bool ok = false;
    master.set_node_id(next++, [&](Result<> result) { ok = static_cast<bool>(result); }, now);
    run();
    ASSERT_TRUE(ok);
    master.switch_all(false, [](const Result<>&) {}, now);
    run();
    ASSERT_LE(found.size(), 3U);
  }
  EXPECT_EQ(found.size(), 3U);
  for (const Identity& identity : identities) EXPECT_NE(std::ranges::find(found, identity), found.end());
  EXPECT_EQ(slaves[3].node(), 9);
  std::vector<int> ids;
  for (const LssSlave& slave : slaves) ids.push_back(slave.node());
  std::ranges::sort(ids);
  EXPECT_EQ(ids, (std::vector{9, 20, 21, 22}));
}

TEST_F(Lss, selects_by_identity_and_configures) {
  slaves.emplace_back(Identity{1, 2, 3, 4}, NodeId{9});
  slaves.emplace_back(Identity{1, 2, 3, 5}, NodeId{10});
  int good = 0;
  const auto count = [&](const Result<>& result) { good += result ? 1 : 0; };
  master.select({1, 2, 3, 5}, count, now);
  run();
  EXPECT_FALSE(slaves[0].configuring());
  ASSERT_TRUE(slaves[1].configuring());
  std::uint32_t serial = 0;
  master.inquire(0x5D, [&](Result<std::uint32_t> value) { serial = *value; }, now);
  run();
  EXPECT_EQ(serial, 5U);
  master.set_bit_rate(500'000, count, now);
  run();
  EXPECT_EQ(slaves[1].bit_timing(), 2);
  EXPECT_EQ(log.back(), make_frame(0x7E5, {0x13, 0, 2, 0, 0, 0, 0, 0}));
  master.store(count, now);
  run();
  EXPECT_EQ(good, 3);
}

CanFrame lss_request(std::uint8_t command, std::uint32_t word = 0) {
  CanFrame frame = make_frame(lss_master_id, {command, 0, 0, 0, 0, 0, 0, 0});
  std::ranges::copy(le_bytes(word, 4), frame.data.begin() + 1);
  return frame;
}

// Lely's coctl: lss_ident_nonconf and lss_identity timed out.
TEST(LssSlave, tells_that_it_is_there_when_it_is_asked_by_limits_or_has_no_node_id) {
  LssSlave slave{{0xF4, 0x402, 0x10001, 0x12345678}, lss_unconfigured};
  const auto answer = [](std::uint8_t command) { return make_frame(lss_slave_id, {command, 0, 0, 0, 0, 0, 0, 0}); };
  EXPECT_EQ(slave.on_frame(lss_request(0x4C)), answer(0x50));
  const auto identify = [&](std::array<std::uint32_t, 6> limits) {
    std::optional<CanFrame> last;
    for (std::uint8_t i = 0; i < 6; ++i) {
      EXPECT_FALSE(last);
      last = slave.on_frame(lss_request(static_cast<std::uint8_t>(0x46 + i), limits[i]));
    }
    return last;
  };
  constexpr std::uint32_t all = 0xFFFFFFFF;
  EXPECT_EQ(identify({0xF4, 0x402, 0, all, 0, all}), answer(0x4F));
  EXPECT_EQ(identify({0xF4, 0x402, 0x10001, 0x10001, 0x12345678, 0x12345678}), answer(0x4F));
  EXPECT_FALSE(identify({0xF5, 0x402, 0, all, 0, all}));
  EXPECT_FALSE(identify({0xF4, 0x401, 0, all, 0, all}));
  EXPECT_FALSE(identify({0xF4, 0x402, 0x10002, all, 0, all}));
  EXPECT_FALSE(identify({0xF4, 0x402, 0, 0x10000, 0, all}));
  EXPECT_FALSE(identify({0xF4, 0x402, 0, all, 0x12345679, all}));
  EXPECT_FALSE(identify({0xF4, 0x402, 0, all, 0, 0x12345677}));
  LssSlave other{{0xF4, 0x402, 0x10001, 0x12345678}, NodeId{9}};
  EXPECT_FALSE(other.on_frame(lss_request(0x4C)));
}

// Lely's coctl: node 77 was 78 before anybody had reset it (CiA 305: the pending node id counts after a reset).
TEST(LssSlave, keeps_a_node_id_that_it_has_until_it_is_reset) {
  Bench bench;
  VirtualBus::Port& port = bench.bus.attach();
  Slave slave{port, 77, {}, {}, {}};
  bench.join(port, slave);
  Listener listener{bench};
  VirtualBus::Port& us = bench.bus.attach();
  const auto send = [&](const CanFrame& frame) {
    ASSERT_TRUE(us.send(frame));
    bench.run(1ms);
  };
  bench.run(1ms);
  send(lss_request(0x04, 1));
  send(lss_request(0x11, 78));
  send(lss_request(0x04, 0));
  EXPECT_EQ(slave.node(), 77);
  send(nmt_frame(NmtCommand::reset_communication, 77));
  EXPECT_EQ(slave.node(), 78);
  EXPECT_EQ(listener.frames(0x700 + 77).size(), 1U);
  EXPECT_EQ(listener.frames(0x700 + 78), std::vector{make_frame(0x700 + 78, {0})});
}

TEST_F(Lss, tells_what_did_not_work) {
  Result<> result;
  const auto keep = [&](const Result<>& done) { result = done; };
  master.select({1, 2, 3, 5}, keep, now);
  run();
  EXPECT_EQ(result.error().code, std::errc::timed_out);
  slaves.emplace_back(Identity{1, 2, 3, 4}, NodeId{9});
  master.switch_all(true, keep, now);
  run();
  EXPECT_TRUE(result);
  master.set_node_id(200, keep, now);
  run();
  EXPECT_EQ(result.error().what, "LSS: node id out of range, error 1/0");
  master.set_bit_rate(123, keep, now);
  EXPECT_EQ(result.error().code, std::errc::invalid_argument);
}

}  // namespace
}  // namespace regista::canopen
