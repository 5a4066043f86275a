// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <regista/canopen/sdo_client.hpp>
#include <regista/canopen/sdo_server.hpp>

#include "bench.hpp"

namespace regista::canopen {
namespace {

struct Memory final : SdoObjects {
  std::map<ObjectIndex, Bytes> objects;
  SdoAbort refuse{};
  Result<Bytes> read_object(ObjectIndex object) override {
    if (refuse != SdoAbort{}) return Error{refuse, ""};
    const auto found = objects.find(object);
    if (found == objects.end()) return Error{SdoAbort::no_object, ""};
    return found->second;
  }
  Result<> write_object(ObjectIndex object, ByteView data) override {
    if (refuse != SdoAbort{}) return Error{refuse, ""};
    objects[object].assign(data.begin(), data.end());
    return {};
  }
  [[nodiscard]] std::size_t short_size(ObjectIndex object) const override {
    const auto found = objects.find(object);
    return found == objects.end() ? 4 : std::min<std::size_t>(found->second.size(), 4);
  }
};

/// Puts a client or a server on a bus.
template <typename End>
struct OnBus final : Station {
  OnBus(Bench& bench, End& end) : port{bench.bus.attach()}, end{end} { bench.join(port, *this); }
  void on_frame(const CanFrame& frame, Time now) override { end.on_frame(frame, now); }
  void on_time(Time now) override {
    end.on_time(now);
    while (end.front() != nullptr && port.send(*end.front())) end.pop(now);
    retry = end.front() != nullptr ? now + 100us : Time::max();
  }
  [[nodiscard]] Time next_wake() const override { return std::min(retry, end.next_wake()); }
  VirtualBus::Port& port;
  End& end;
  Time retry = Time::max();
};

constexpr NodeId node = 5;
constexpr ObjectIndex object{0x2001, 0};

struct Sdo : testing::Test {
  Bench bench;
  Memory memory;
  SdoServer::Options server_options;
  SdoClient::Options client_options;
  SdoServer server{node, memory, server_options};
  SdoClient client{node, client_options};
  OnBus<SdoClient> client_end{bench, client};
  OnBus<SdoServer> server_end{bench, server};

  Result<Bytes> read(ObjectIndex what, SdoTransfer transfer = SdoTransfer::standard) {
    std::optional<Result<Bytes>> result;
    client.upload(what, transfer, [&](Result<Bytes> done) { result = std::move(done); }, bench.now);
    if (!bench.run_until([&] { return result.has_value(); }, 60s)) return Error{std::errc::timed_out, "test"};
    return *result;
  }
  Result<Bytes> write(ObjectIndex what, Bytes data, SdoTransfer transfer = SdoTransfer::standard) {
    std::optional<Result<Bytes>> result;
    client.download(what, std::move(data), transfer, [&](Result<Bytes> done) { result = std::move(done); }, bench.now);
    if (!bench.run_until([&] { return result.has_value(); }, 60s)) return Error{std::errc::timed_out, "test"};
    return *result;
  }
};

TEST_F(Sdo, carries_any_size_there_and_back_in_either_way) {
  for (const SdoTransfer transfer : {SdoTransfer::standard, SdoTransfer::block}) {
    for (const std::size_t size : {0U, 1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U, 13U, 14U, 15U, 100U, 888U, 889U, 890U, 5000U}) {
      const Bytes data = random_bytes(size, static_cast<unsigned>(size));
      memory.objects.clear();
      const auto written = write(object, data, transfer);
      ASSERT_TRUE(written) << written.error().message();
      ASSERT_EQ(memory.objects[object], data);
      const auto back = read(object, transfer);
      ASSERT_TRUE(back) << back.error().message();
      ASSERT_EQ(*back, data) << size;
    }
  }
  EXPECT_EQ(client.strays(), 0U);
}

TEST_F(Sdo, sends_the_frames_of_cia_301) {
  Listener listener{bench};
  ASSERT_TRUE(write({0x1017, 0}, {0xE8, 0x03}));
  memory.objects[{0x1000, 0}] = {0x92, 0x01, 0x02, 0x00};
  ASSERT_TRUE(read({0x1000, 0}));
  bench.run(1ms);
  const std::vector<CanFrame> requests = listener.frames(0x605);
  const std::vector<CanFrame> answers = listener.frames(0x585);
  ASSERT_EQ(requests.size(), 2U);
  ASSERT_EQ(answers.size(), 2U);
  EXPECT_EQ(requests[0], make_frame(0x605, {0x2B, 0x17, 0x10, 0x00, 0xE8, 0x03, 0x00, 0x00}));
  EXPECT_EQ(answers[0], make_frame(0x585, {0x60, 0x17, 0x10, 0x00, 0x00, 0x00, 0x00, 0x00}));
  EXPECT_EQ(requests[1], make_frame(0x605, {0x40, 0x00, 0x10, 0x00, 0x00, 0x00, 0x00, 0x00}));
  EXPECT_EQ(answers[1], make_frame(0x585, {0x43, 0x00, 0x10, 0x00, 0x92, 0x01, 0x02, 0x00}));
}

// An 8-byte frame takes 111 to 135 bits, so 128 frames for 889 bytes leave 51.4 to 62.6 kB/s at 1 Mbit/s.
TEST_F(Sdo, uses_nearly_all_of_the_bus_in_block_transfers) {
  const Bytes data = random_bytes(100'000);
  for (const bool up : {false, true}) {
    const std::uint64_t bits_before = bench.bus.bits();
    const Time begin = bench.now;
    if (up) {
      ASSERT_EQ(*read(object, SdoTransfer::block), data);
    } else {
      ASSERT_TRUE(write(object, data, SdoTransfer::block));
    }
    const double took_s = seconds(bench.now - begin);
    const double rate = static_cast<double>(data.size()) / took_s;
    const double busy = static_cast<double>(bench.bus.bits() - bits_before) / (took_s * 1e6);
    const double limit = 889.0 * 1e6 / (128 * 115.0);  // 115 bits is the mean of random data
    EXPECT_GE(busy, 0.999);
    EXPECT_GE(rate / limit, 0.95);
    EXPECT_LE(rate / limit, 1.02);
    RecordProperty(up ? "upload_of_limit" : "download_of_limit", std::to_string(rate / limit));
    std::printf("block %s: %.0f bytes/s, %.3f of the limit\n", up ? "upload" : "download", rate, rate / limit);
  }
}

TEST_F(Sdo, survives_the_loss_of_any_segment_of_a_block) {
  const Bytes data = random_bytes(300);
  memory.objects[object] = data;
  for (int lost = 0; lost < 43; ++lost) {
    for (const bool up : {false, true}) {
      int segment = 0;
      bench.bus.lose = [&](const CanFrame& frame) {
        const bool is_segment = frame.id == (up ? 0x585U : 0x605U) && (frame.data[0] & 0x7FU) != 0 &&
                                (frame.data[0] & 0x7FU) <= 43U && frame.data[0] != 0x40;
        return is_segment && segment++ == lost;
      };
      const auto result = up ? read(object, SdoTransfer::block) : write(object, data, SdoTransfer::block);
      // The last segment of a download is acknowledged by nobody when it is lost: only the time-out helps.
      if (up || lost != 42) {
        ASSERT_TRUE(result) << lost << (up ? " up: " : " down: ") << result.error().message();
        ASSERT_EQ(up ? *result : memory.objects[object], data);
      } else {
        EXPECT_EQ(result.error().code, std::errc::timed_out);
      }
      bench.bus.lose = [](const CanFrame&) { return false; };
      bench.run(2s);
    }
  }
}

TEST_F(Sdo, ends_in_words_with_each_abort_code) {
  for (const std::uint32_t code :
       {0x05030000U, 0x05040000U, 0x05040001U, 0x05040002U, 0x05040003U, 0x05040004U, 0x05040005U, 0x06010000U,
        0x06010001U, 0x06010002U, 0x06020000U, 0x06040041U, 0x06040042U, 0x06040043U, 0x06040047U, 0x06060000U,
        0x06070010U, 0x06070012U, 0x06070013U, 0x06090011U, 0x06090030U, 0x06090031U, 0x06090032U, 0x06090036U,
        0x060A0023U, 0x08000000U, 0x08000020U, 0x08000021U, 0x08000022U, 0x08000023U, 0x08000024U}) {
    memory.refuse = static_cast<SdoAbort>(code);
    for (const SdoTransfer transfer : {SdoTransfer::standard, SdoTransfer::block}) {
      const auto up = read(object, transfer);
      ASSERT_FALSE(up);
      EXPECT_EQ(up.error().code, static_cast<SdoAbort>(code));
      const auto down = write(object, random_bytes(20), transfer);
      ASSERT_FALSE(down);
      EXPECT_EQ(down.error().code, static_cast<SdoAbort>(code));
      EXPECT_NE(down.error().message().find("node 5: write 2001:00: SDO abort 0x" + hex(code, 8)), std::string::npos);
      EXPECT_EQ(down.error().message().find("unknown code"), std::string::npos);
    }
  }
  memory.refuse = static_cast<SdoAbort>(0x06090099);  // a maker's own
  EXPECT_NE(read(object).error().message().find("0x06090099: unknown code"), std::string::npos);
}

/// A client alone, whose frames and answers are written down here.
struct Trace : testing::Test {
  SdoClient client{node, {}};
  Time now = Time{} + 1h;
  std::vector<Result<Bytes>> results;
  SdoDone done = [this](Result<Bytes> result) { results.push_back(std::move(result)); };

  std::vector<CanFrame> sent(int most = 1000) {
    std::vector<CanFrame> frames;
    for (; client.front() != nullptr && most > 0; --most) {
      frames.push_back(*client.front());
      client.pop(now);
    }
    return frames;
  }
  void answer(std::initializer_list<std::uint8_t> bytes) { client.on_frame(make_frame(0x585, bytes), now); }
  void pass(Duration duration) {
    now += duration;
    client.on_time(now);
  }
};

// ros2_canopen#194, #364: 20 ms broke drives that answer in 30.
TEST_F(Trace, waits_half_a_second_by_default) {
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  ASSERT_EQ(sent().size(), 1U);
  pass(499ms);
  EXPECT_TRUE(results.empty());
  answer({0x4B, 0x41, 0x60, 0x00, 0x37, 0x06, 0, 0});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(*results[0], (Bytes{0x37, 0x06}));
}

// canopen#25: a retry after a time-out wrote twice.
TEST_F(Trace, never_writes_twice_by_itself) {
  client.download({0x2010, 0}, {1}, SdoTransfer::standard, done, now);
  ASSERT_EQ(sent().size(), 1U);
  pass(500ms);
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].error().code, std::errc::timed_out);
  EXPECT_EQ(results[0].error().message(),
            "node 5: write 2010:00: no answer for 500 ms: " + std::make_error_code(std::errc::timed_out).message());
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x80, 0x10, 0x20, 0x00, 0x00, 0x00, 0x04, 0x05})}));
  for (int i = 0; i < 10; ++i) pass(500ms);
  EXPECT_TRUE(sent().empty());
}

TEST_F(Trace, does_not_take_a_late_answer_for_that_of_the_next_request) {
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  (void)sent();
  pass(500ms);
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  EXPECT_EQ(sent().size(), 1U) << "the abort, and not yet the request";
  pass(10ms);
  answer({0x4B, 0x41, 0x60, 0x00, 0x11, 0x11, 0, 0});  // to the first
  EXPECT_EQ(results.size(), 1U);
  EXPECT_EQ(sent().size(), 1U) << "now the way is clear";
  answer({0x4B, 0x41, 0x60, 0x00, 0x22, 0x22, 0, 0});
  ASSERT_EQ(results.size(), 2U);
  EXPECT_EQ(*results[1], (Bytes{0x22, 0x22}));
  EXPECT_EQ(client.strays(), 1U);
}

TEST_F(Trace, asks_again_when_the_late_answer_never_comes) {
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  (void)sent();
  pass(500ms);
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  (void)sent();
  pass(499ms);
  EXPECT_TRUE(sent().empty());
  pass(1ms);
  EXPECT_EQ(sent().size(), 1U);
}

// ros_canopen and others: an answer about another object is not ours.
TEST_F(Trace, disregards_the_answer_to_another_object) {
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  (void)sent();
  answer({0x4B, 0x40, 0x60, 0x00, 0x11, 0x11, 0, 0});
  answer({0x80, 0x40, 0x60, 0x00, 0x00, 0x00, 0x02, 0x06});
  EXPECT_TRUE(results.empty());
  EXPECT_EQ(client.strays(), 2U);
}

// embedded-office/canopen-stack#146: the timer of one transfer aborted the next.
TEST_F(Trace, leaves_no_timer_behind) {
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  (void)sent();
  pass(400ms);
  answer({0x4B, 0x41, 0x60, 0x00, 0x37, 0x06, 0, 0});
  EXPECT_EQ(client.next_wake(), Time::max());
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  (void)sent();
  pass(200ms);
  EXPECT_EQ(results.size(), 1U);
  EXPECT_TRUE(client.busy());
}

// CANopenNode#426: the server missed segment 2 and answers before we have sent all.
TEST_F(Trace, goes_back_when_the_server_answers_a_block_early) {
  const Bytes data = random_bytes(70);
  client.download(object, data, SdoTransfer::block, done, now);
  ASSERT_EQ(sent().size(), 1U);
  answer({0xA4, 0x01, 0x20, 0x00, 10, 0, 0, 0});
  ASSERT_EQ(sent(4).size(), 4U);  // of ten
  answer({0xA2, 1, 10, 0, 0, 0, 0, 0});
  const std::vector<CanFrame> again = sent();
  ASSERT_EQ(again.size(), 9U);
  EXPECT_EQ(again[0].data[0], 1);
  EXPECT_EQ(again[0].data[1], data[7]) << "from the second on, numbered anew";
  EXPECT_EQ(again[8].data[0], 9 | 0x80);
  answer({0xA2, 9, 10, 0, 0, 0, 0, 0});
  ASSERT_EQ(sent().size(), 1U);
  answer({0xA1, 0, 0, 0, 0, 0, 0, 0});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_TRUE(results[0]);
}

// A block that came to a stand: what was asked for again is not mixed with what was still on its way.
TEST_F(Trace, is_not_confused_by_segments_that_come_after_it_asked_again) {
  client.upload(object, SdoTransfer::block, done, now);
  (void)sent();
  answer({0xC6, 0x01, 0x20, 0x00, 21, 0, 0, 0});
  (void)sent();
  answer({1, 1, 1, 1, 1, 1, 1, 1});
  pass(500ms);
  const std::vector<CanFrame> asked = sent();
  ASSERT_EQ(asked.size(), 1U);
  EXPECT_EQ(asked[0], make_frame(0x605, {0xA2, 1, 127, 0, 0, 0, 0, 0}));
  answer({2, 2, 2, 2, 2, 2, 2, 2});
  answer({3 | 0x80, 3, 3, 3, 3, 3, 3, 3});
  EXPECT_TRUE(sent().empty()) << "a second answer would be for the block that follows";
  answer({1, 2, 2, 2, 2, 2, 2, 2});
  answer({2 | 0x80, 3, 3, 3, 3, 3, 3, 3});
  ASSERT_EQ(sent().size(), 1U);
  const Bytes whole{1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3};
  const std::uint16_t crc = sdo_crc(whole);
  answer({0xC1, static_cast<std::uint8_t>(crc), static_cast<std::uint8_t>(crc >> 8), 0, 0, 0, 0, 0});
  ASSERT_EQ(results.size(), 1U);
  ASSERT_TRUE(results[0]) << results[0].error().message();
  EXPECT_EQ(*results[0], whole);
}

TEST_F(Trace, aborts_when_the_server_acknowledges_what_was_not_sent) {
  client.download(object, random_bytes(70), SdoTransfer::block, done, now);
  (void)sent();
  answer({0xA4, 0x01, 0x20, 0x00, 10, 0, 0, 0});
  (void)sent(4);
  answer({0xA2, 5, 10, 0, 0, 0, 0, 0});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].error().code, SdoAbort::sequence_number);
}

// canopen#408: an end frame followed the abort.
TEST_F(Trace, says_nothing_more_after_an_abort) {
  client.download(object, random_bytes(70), SdoTransfer::block, done, now);
  (void)sent();
  answer({0xA4, 0x01, 0x20, 0x00, 10, 0, 0, 0});
  (void)sent(4);
  answer({0x80, 0x01, 0x20, 0x00, 0x21, 0x00, 0x00, 0x08});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].error().code, SdoAbort::local_control);
  answer({0xA2, 4, 10, 0, 0, 0, 0, 0});
  pass(1s);
  EXPECT_TRUE(sent().empty());
}

TEST_F(Trace, breaks_off_with_the_code_of_what_is_wrong) {
  const auto code_after = [&](auto&& talk) {
    results.clear();
    pass(600ms);  // the channel has settled
    talk();
    EXPECT_EQ(results.size(), 1U);
    const std::vector<CanFrame> frames = sent();
    EXPECT_FALSE(frames.empty());
    EXPECT_EQ(frames.back().data[0], 0x80);
    EXPECT_EQ(results[0].error().code.value(), static_cast<int>(get_le(ByteView{frames.back().data}.subspan(4))));
    return static_cast<SdoAbort>(results[0].error().code.value());
  };
  EXPECT_EQ(SdoAbort::toggle, code_after([&] {
              client.upload(object, SdoTransfer::standard, done, now);
              (void)sent();
              answer({0x41, 0x01, 0x20, 0x00, 20, 0, 0, 0});
              (void)sent();
              answer({0x10, 1, 2, 3, 4, 5, 6, 7});
            }));
  EXPECT_EQ(SdoAbort::unknown_command, code_after([&] {
              client.upload(object, SdoTransfer::standard, done, now);
              (void)sent();
              answer({0xE0, 0x01, 0x20, 0x00, 20, 0, 0, 0});
            }));
  EXPECT_EQ(SdoAbort::length, code_after([&] {
              client.upload(object, SdoTransfer::standard, done, now);
              (void)sent();
              answer({0x41, 0x01, 0x20, 0x00, 20, 0, 0, 0});
              (void)sent();
              answer({0x01, 1, 2, 3, 4, 5, 6, 7});
            }));
  EXPECT_EQ(SdoAbort::out_of_memory, code_after([&] {
              client.upload(object, SdoTransfer::standard, done, now);
              (void)sent();
              answer({0x41, 0x01, 0x20, 0x00, 0xFF, 0xFF, 0xFF, 0xFF});
            }));
  EXPECT_EQ(SdoAbort::block_size, code_after([&] {
              client.download(object, random_bytes(20), SdoTransfer::block, done, now);
              (void)sent();
              answer({0xA4, 0x01, 0x20, 0x00, 128, 0, 0, 0});
            }));
  EXPECT_EQ(SdoAbort::crc, code_after([&] {
              client.upload(object, SdoTransfer::block, done, now);
              (void)sent();
              answer({0xC6, 0x01, 0x20, 0x00, 7, 0, 0, 0});
              (void)sent();
              answer({0x81, 1, 2, 3, 4, 5, 6, 7});
              (void)sent();
              answer({0xC1, 0xAA, 0x55, 0, 0, 0, 0, 0});
            }));
}

// What other nodes do, and CiA 301 lets them (7.2.4.3).
TEST_F(Trace, takes_four_bytes_when_an_expedited_answer_does_not_say_how_many) {
  client.upload({0x6041, 0}, SdoTransfer::standard, done, now);
  (void)sent();
  answer({0x42, 0x41, 0x60, 0x00, 0x37, 0x06, 0xAA, 0xBB});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(*results[0], (Bytes{0x37, 0x06, 0xAA, 0xBB}));
}

TEST_F(Trace, takes_segments_until_the_last_when_no_size_was_announced) {
  client.upload(object, SdoTransfer::standard, done, now);
  (void)sent();
  answer({0x40, 0x01, 0x20, 0x00, 0, 0, 0, 0});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x60, 0, 0, 0, 0, 0, 0, 0})}));
  answer({0x00, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x70, 0, 0, 0, 0, 0, 0, 0})}));
  answer({0x1B, 8, 9, 0, 0, 0, 0, 0});  // five of seven are unused
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(*results[0], (Bytes{1, 2, 3, 4, 5, 6, 7, 8, 9}));
}

TEST_F(Trace, takes_a_block_without_size_and_crc) {
  client.upload(object, SdoTransfer::block, done, now);
  (void)sent();
  answer({0xC0, 0x01, 0x20, 0x00, 0, 0, 0, 0});
  (void)sent();
  answer({0x81, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0xA2, 1, 127, 0, 0, 0, 0, 0})}));
  answer({0xC9, 0xDE, 0xAD, 0, 0, 0, 0, 0});  // a CRC means nothing then
  ASSERT_EQ(results.size(), 1U);
  ASSERT_TRUE(results[0]) << results[0].error().message();
  EXPECT_EQ(*results[0], (Bytes{1, 2, 3, 4, 5}));
}

TEST_F(Trace, sends_a_block_without_crc_to_a_node_that_knows_none_and_in_blocks_as_small_as_it_wants) {
  client.download(object, {1, 2, 3, 4, 5, 6, 7, 8, 9}, SdoTransfer::block, done, now);
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0xC6, 0x01, 0x20, 0x00, 9, 0, 0, 0})}));
  answer({0xA0, 0x01, 0x20, 0x00, 1, 0, 0, 0});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x01, 1, 2, 3, 4, 5, 6, 7})}));
  answer({0xA2, 1, 1, 0, 0, 0, 0, 0});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x81, 8, 9, 0, 0, 0, 0, 0})}));
  answer({0xA2, 1, 1, 0, 0, 0, 0, 0});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0xD5, 0, 0, 0, 0, 0, 0, 0})}));
  answer({0xA1, 0, 0, 0, 0, 0, 0, 0});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_TRUE(results[0]);
}

// canopen's own server, and many drives: block transfers are refused.
TEST_F(Trace, goes_on_without_blocks_where_a_node_refuses_them) {
  client.download(object, {1, 2, 3, 4, 5}, SdoTransfer::block, done, now);
  (void)sent();
  answer({0x80, 0x01, 0x20, 0x00, 0x01, 0x00, 0x04, 0x05});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x21, 0x01, 0x20, 0x00, 5, 0, 0, 0})}));
  answer({0x60, 0x01, 0x20, 0x00, 0, 0, 0, 0});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x05, 1, 2, 3, 4, 5, 0, 0})}));
  answer({0x20, 0, 0, 0, 0, 0, 0, 0});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_TRUE(results[0]);
  client.upload(object, SdoTransfer::block, done, now);
  (void)sent();
  answer({0x80, 0x01, 0x20, 0x00, 0x01, 0x00, 0x04, 0x05});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x40, 0x01, 0x20, 0x00, 0, 0, 0, 0})}));
  answer({0x4F, 0x01, 0x20, 0x00, 9, 0, 0, 0});
  ASSERT_EQ(results.size(), 2U);
  EXPECT_EQ(*results[1], Bytes{9});
  client.upload(object, SdoTransfer::standard, done, now);
  (void)sent();
  answer({0x80, 0x01, 0x20, 0x00, 0x01, 0x00, 0x04, 0x05});
  ASSERT_EQ(results.size(), 3U);
  EXPECT_EQ(results[2].error().code, SdoAbort::unknown_command) << "there is nothing simpler to try";
}

// The protocol switch (pst), which we do not ask for; python-canopen's server takes it all the same.
TEST_F(Trace, follows_a_node_that_answers_a_block_upload_with_segments) {
  client.upload(object, SdoTransfer::block, done, now);
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0xA4, 0x01, 0x20, 0x00, 127, 0, 0, 0})}));
  answer({0x41, 0x01, 0x20, 0x00, 5, 0, 0, 0});
  EXPECT_EQ(sent(), (std::vector{make_frame(0x605, {0x60, 0, 0, 0, 0, 0, 0, 0})}));
  answer({0x05, 1, 2, 3, 4, 5, 0, 0});
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(*results[0], (Bytes{1, 2, 3, 4, 5}));
  client.upload(object, SdoTransfer::block, done, now);
  (void)sent();
  answer({0x4B, 0x01, 0x20, 0x00, 7, 8, 0, 0});
  ASSERT_EQ(results.size(), 2U);
  EXPECT_EQ(*results[1], (Bytes{7, 8}));
}

// CANopenNode#39: the request that followed the end of a block upload at once was lost.
TEST_F(Sdo, answers_the_request_right_after_the_end_of_a_block_upload) {
  memory.objects[object] = random_bytes(100);
  memory.objects[{0x1000, 0}] = {1, 2, 3, 4};
  std::optional<Result<Bytes>> second;
  client.upload(
      object, SdoTransfer::block,
      [&](Result<Bytes> first) {
        ASSERT_TRUE(first);
        client.upload({0x1000, 0}, SdoTransfer::standard, [&](Result<Bytes> r) { second = std::move(r); }, bench.now);
      },
      bench.now);
  ASSERT_TRUE(bench.run_until([&] { return second.has_value(); }, 100ms));
  EXPECT_TRUE(*second);
}

// CANopenNode#242: ENOBUFS in the middle of a block.
TEST(SdoOnAFullBus, keeps_the_segment_that_the_bus_did_not_take) {
  Bench bench{125'000, 2};  // two frames wait, the third is refused
  Memory memory;
  SdoServer server{node, memory, {}};
  SdoClient client{node, {}};
  OnBus<SdoClient> client_end{bench, client};
  OnBus<SdoServer> server_end{bench, server};
  const Bytes data = random_bytes(3000);
  bool done = false;
  client.download(
      object, data, SdoTransfer::block,
      [&](Result<Bytes> result) {
        done = true;
        EXPECT_TRUE(result) << result.error().message();
      },
      bench.now);
  ASSERT_TRUE(bench.run_until([&] { return done; }));
  EXPECT_EQ(memory.objects[object], data);
  EXPECT_EQ(client.strays(), 0U);
}

// node-canopen#50: a block took longer than segments, for a timer between its frames.
TEST_F(Sdo, is_faster_in_blocks_than_in_segments) {
  const Bytes data = random_bytes(8'000);
  const auto duration = [&](SdoTransfer transfer, bool up) {
    const Time begin = bench.now;
    EXPECT_TRUE(up ? read(object, transfer) : write(object, data, transfer));
    return seconds(bench.now - begin);
  };
  // Two frames for 7 bytes, or one and a 127th.
  for (const bool up : {false, true}) {
    EXPECT_NEAR(duration(SdoTransfer::standard, up) / duration(SdoTransfer::block, up), 2, 0.1);
  }
}

// CANopenNode#123: 100 kB stood still at 30 %. Here some segments get lost besides, and acknowledgements too.
TEST_F(Sdo, carries_100_kilobytes_over_a_bus_that_loses_frames) {
  const Bytes data = random_bytes(100'000);
  std::mt19937 random{7};
  for (const bool up : {false, true}) {
    memory.objects[object] = up ? data : Bytes{};
    int since_last = 0;
    bench.bus.lose = [&](const CanFrame& frame) {
      // Of the segments, and never the last of a block: of a download, nobody asks for that again.
      const unsigned sequence = frame.data[0] & 0x7FU;
      const bool is_segment = frame.id == (up ? 0x585U : 0x605U) && 1 <= sequence && sequence <= 100 &&
                              frame.data[0] == sequence && ++since_last > 150;
      if (is_segment && random() % 50 == 0) return (since_last = 0, true);
      return false;
    };
    const auto result = up ? read(object, SdoTransfer::block) : write(object, data, SdoTransfer::block);
    bench.bus.lose = [](const CanFrame&) { return false; };
    ASSERT_TRUE(result) << result.error().message();
    EXPECT_TRUE((up ? *result : memory.objects[object]) == data);
    bench.run(2s);
  }
}

TEST_F(Sdo, serves_a_write_that_does_not_say_how_many_bytes_it_has) {
  Listener listener{bench};
  VirtualBus::Port& stranger = bench.bus.attach();
  memory.objects[object] = {0, 0};
  ASSERT_TRUE(stranger.send(make_frame(0x605, {0x22, 0x01, 0x20, 0x00, 0x34, 0x12, 0, 0})));
  bench.run(1ms);
  ASSERT_EQ(listener.frames(0x585).size(), 1U);
  EXPECT_EQ(listener.frames(0x585)[0], make_frame(0x585, {0x60, 0x01, 0x20, 0x00, 0, 0, 0, 0}));
  EXPECT_EQ(memory.objects[object], (Bytes{0x34, 0x12}));
}

TEST_F(Sdo, refuses_what_is_no_protocol) {
  Listener listener{bench};
  VirtualBus::Port& stranger = bench.bus.attach();
  const auto code_after = [&](std::initializer_list<std::initializer_list<std::uint8_t>> frames) {
    listener.heard.clear();
    for (const auto& bytes : frames) {
      EXPECT_TRUE(stranger.send(make_frame(0x605, bytes)));
      bench.run(1ms);
    }
    const auto answers = listener.frames(0x585);
    return answers.empty() || answers.back().data[0] != 0x80
               ? SdoAbort{}
               : static_cast<SdoAbort>(get_le(ByteView{answers.back().data}.subspan(4)));
  };
  memory.objects[object] = random_bytes(20);
  EXPECT_EQ(code_after({{0xE0, 1, 0x20, 0, 0, 0, 0, 0}}), SdoAbort::unknown_command);
  EXPECT_EQ(code_after({{0x60, 0, 0, 0, 0, 0, 0, 0}}), SdoAbort::unknown_command) << "nothing to upload";
  EXPECT_EQ(code_after({{0x40, 1, 0x20, 0, 0, 0, 0, 0}, {0x70, 0, 0, 0, 0, 0, 0, 0}}), SdoAbort::toggle);
  EXPECT_EQ(code_after({{0x21, 1, 0x20, 0, 9, 0, 0, 0}, {0x10, 0, 0, 0, 0, 0, 0, 0}}), SdoAbort::toggle);
  EXPECT_EQ(code_after({{0x21, 1, 0x20, 0, 9, 0, 0, 0}, {0x01, 0, 0, 0, 0, 0, 0, 0}}), SdoAbort::length);
  EXPECT_EQ(code_after({{0x21, 1, 0x20, 0, 9, 0, 0, 0xF0}}), SdoAbort::out_of_memory);
  EXPECT_EQ(code_after({{0xA4, 1, 0x20, 0, 0, 0, 0, 0}}), SdoAbort::block_size);
  EXPECT_EQ(
      code_after({{0xA4, 1, 0x20, 0, 2, 0, 0, 0}, {0xA3}, {0xA3, 0, 0, 0, 0, 0, 0, 0}, {0xA2, 3, 2, 0, 0, 0, 0, 0}}),
      SdoAbort::sequence_number);
  EXPECT_EQ(code_after({{0xC6, 1, 0x20, 0, 7, 0, 0, 0}, {0x81, 1, 2, 3, 4, 5, 6, 7}, {0xC1, 1, 1, 0, 0, 0, 0, 0}}),
            SdoAbort::crc);
  bench.run(2s);
  listener.heard.clear();
  EXPECT_EQ(code_after({{0x21, 1, 0x20, 0, 9, 0, 0, 0}}), SdoAbort{});
  bench.run(2s);
  EXPECT_EQ(listener.frames(0x585).back(), make_frame(0x585, {0x80, 1, 0x20, 0, 0, 0, 4, 5}))
      << "the client fell silent";
}

TEST(SdoClient, outlives_any_answer) {
  std::mt19937 random{1};
  for (int round = 0; round < 2000; ++round) {
    const SdoTransfer transfer = round % 2 == 0 ? SdoTransfer::block : SdoTransfer::standard;
    int results = 0;
    SdoClient client{node, {}};
    Time now = Time{} + 1h;
    const auto finished = [&](const Result<Bytes>&) { ++results; };
    if (round % 4 < 2) {
      client.upload(object, transfer, finished, now);
    } else {
      client.download(object, random_bytes(50), transfer, finished, now);
    }
    for (int i = 0; i < 20; ++i) {
      while (client.front() != nullptr) client.pop(now);
      CanFrame frame{.id = 0x585, .size = 8};
      for (std::uint8_t& byte : frame.data) byte = static_cast<std::uint8_t>(random());
      if (random() % 4 != 0) std::ranges::copy(Bytes{0x01, 0x20, 0x00}, frame.data.begin() + 1);
      client.on_frame(frame, now += 1ms);
    }
    for (int i = 0; i < 20 && client.busy(); ++i) {
      while (client.front() != nullptr) client.pop(now);
      client.on_time(now += 500ms);
    }
    ASSERT_EQ(results, 1);
    ASSERT_FALSE(client.busy());
  }
}

// The published check value of CRC-16/XMODEM, the polynomial of CiA 301: "123456789" gives 0x31C3.
TEST(SdoCrc, is_that_of_the_standard) { EXPECT_EQ(sdo_crc(ascii("123456789")), 0x31C3); }

}  // namespace
}  // namespace regista::canopen
