// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>
#include <fake_base.hpp>

#include <algorithm>
#include <array>
#include <condition_variable>
#include <mutex>
#include <regista/device/plugin.hpp>
#include <regista/testing/fault_proxy.hpp>
#include <regista/testing/raw_client.hpp>
#include <regista/testing/test_server.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace regista::testing {

using namespace std::chrono_literals;

inline const Plugin fake_base{
    .name = "fake_base",
    .summary = "records what is done to it",
    .stops_by_itself = true,
    .create = [](Setup& setup) -> std::unique_ptr<Driver> { return std::make_unique<FakeBase>(setup); }};

// Player's numbers, from its documentation and not from our headers.
inline constexpr std::uint32_t data = 1;
inline constexpr std::uint32_t command = 2;
inline constexpr std::uint32_t request = 3;
inline constexpr std::uint32_t ack = 4;
inline constexpr std::uint32_t synch = 5;
inline constexpr std::uint32_t nack = 6;
inline constexpr std::uint32_t position2d = 4;

/// A scripted client: what stock clients send, packed by hand.
class Player : public RawClient {
 public:
  using RawClient::RawClient;

  /// Ask, and take what comes until the answer. Data on the way are counted.
  RawMessage ask(std::uint32_t interface, std::uint32_t index, std::uint32_t subtype, Bytes body = {}) {
    send(RawMessage{
        .interface = interface, .index = index, .type = request, .subtype = subtype, .body = std::move(body)});
    return answer();
  }
  RawMessage answer(Duration timeout = patience) {
    for (;; ++data_seen) {
      RawMessage message = receive_message(timeout);
      if (message.type == ack || message.type == nack) return message;
    }
  }
  RawMessage next(std::uint32_t type, Duration timeout = patience) {
    for (const Time end = Clock::now() + timeout; Clock::now() < end;) {
      RawMessage message = receive_message(timeout);
      if (message.type == type) return message;
    }
    throw std::runtime_error{"no message of that type"};
  }

  /// access 1: open, 2: close.
  RawMessage device(std::uint32_t index, std::uint32_t access = 1, std::uint32_t interface = position2d) {
    return ask(1, 0, 3, device_body(index, access, interface));
  }
  static Bytes device_body(std::uint32_t index, std::uint32_t access, std::uint32_t interface = position2d) {
    return Pack{}.u32(0).u32(0).u32(interface).u32(index).u32(access).u32(0).u32(0).bytes;
  }
  /// Subscribed to position2d:index, or the test fails.
  void open(std::uint32_t index = 0) {
    const RawMessage reply = device(index);
    ASSERT_EQ(reply.type, ack);
    ASSERT_EQ(reply.u32(16), 1U);
  }
  void pull() { ASSERT_EQ(ask(1, 0, 5, Pack{}.u32(2).bytes).type, ack); }

  static RawMessage velocity_message(double x, double y = 0, double w = 0, std::uint32_t index = 0) {
    return {.interface = position2d,
            .index = index,
            .type = command,
            .subtype = 1,
            .body = Pack{}.f64(x).f64(y).f64(w).u32(1).bytes};
  }
  void velocity(double x, double y = 0, double w = 0, std::uint32_t index = 0) const {
    send(velocity_message(x, y, w, index));
  }
  /// Everything sent so far has been handled: by the server, and by the driver of position2d:index.
  void sync(std::uint32_t index = 0) { ASSERT_EQ(ask(position2d, index, 1).type, ack); }

  std::string text_property(const std::string& key) {
    Bytes characters;
    for (const char c : key) characters.push_back(static_cast<std::byte>(c));
    const auto size = static_cast<std::uint32_t>(key.size() + 1);
    characters.resize((size + 3) / 4 * 4);
    const RawMessage reply = ask(position2d, 0, 250, Pack{}.u32(size).u32(size).raw(characters).u32(0).u32(0).bytes);
    if (reply.type != ack) return "NACK";
    const std::size_t value = 8 + characters.size();
    std::string text;
    for (std::uint32_t i = 0; i + 1 < reply.u32(value); ++i) text += static_cast<char>(reply.body.at(value + 8 + i));
    return text;
  }

  /// Ours: reasons, events, owners.
  void extend() { ASSERT_EQ(ask(1, 0, 100).type, ack); }
  /// `name` and priority for the arbiter of motion.
  void identify(const std::string& name, std::int32_t priority) {
    ASSERT_EQ(ask(1, 0, 101, Pack{}.raw(text(name)).u32(static_cast<std::uint32_t>(priority)).bytes).type, ack);
  }
  static Bytes text(const std::string& what) {
    Bytes characters;
    for (const char c : what) characters.push_back(static_cast<std::byte>(c));
    const auto size = static_cast<std::uint32_t>(what.size() + 1);
    characters.resize((size + 3) / 4 * 4);
    return Pack{}.u32(size).u32(size).raw(characters).bytes;
  }

  std::size_t data_seen = 0;
};

/// What a fake_base records, as it happens: `log` gets `path()`.
class Recorder {
 public:
  struct Event {
    Time at{};
    std::string what;  ///< "velocity"
    std::array<double, 3> numbers{};
  };

  Recorder() {
    if (::pipe(pipe_.data()) != 0) throw std::runtime_error{"no pipe"};
    thread_ = std::thread{[this] { run(); }};
  }
  /// After the server that writes to it.
  ~Recorder() {
    ::close(pipe_[1]);
    thread_.join();
    ::close(pipe_[0]);
  }
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  [[nodiscard]] std::string path() const { return "/dev/fd/" + std::to_string(pipe_[1]); }

  /// All that the driver has written so far.
  [[nodiscard]] std::vector<Event> events(const std::string& what) const {
    constexpr std::string_view mark = "0 mark\n";  // behind it in the pipe
    std::unique_lock lock{mutex_};
    const std::size_t wanted = marks_ + 1;
    if (::write(pipe_[1], mark.data(), mark.size()) < 0) throw std::runtime_error{"no pipe"};
    changed_.wait(lock, [&] { return marks_ >= wanted; });
    std::vector<Event> found;
    std::ranges::copy_if(events_, std::back_inserter(found), [&](const Event& e) { return e.what == what; });
    return found;
  }

  /// The first event from `since` on that fits, now or soon; throws when there is none.
  template <typename Fits>
  Event first(Time since, Fits&& fits, Duration timeout = 10s) const {
    std::unique_lock lock{mutex_};
    Event found;
    const auto look = [&] {
      const auto event = std::ranges::find_if(events_, [&](const Event& e) { return e.at >= since && fits(e); });
      if (event == events_.end()) return false;
      found = *event;
      return true;
    };
    if (!changed_.wait_for(lock, timeout, look)) throw std::runtime_error{"the driver did not record that"};
    return found;
  }
  Event event(Time since, const std::string& what) const {
    return first(since, [&](const Event& e) { return e.what == what; });
  }
  Event velocity(Time since, double x) const {
    return first(since, [&](const Event& e) { return e.what == "velocity" && e.numbers[0] == x; });
  }
  /// A command that brings it to rest.
  Event rest(Time since) const {
    return first(since, [&](const Event& e) {
      return e.what == "halt" || (e.what == "velocity" && e.numbers == std::array<double, 3>{});
    });
  }

 private:
  void run() {
    std::string text;
    std::array<char, 4096> piece{};
    for (ssize_t size = 0; (size = ::read(pipe_[0], piece.data(), piece.size())) > 0;) {
      text.append(piece.data(), static_cast<std::size_t>(size));
      const std::lock_guard lock{mutex_};
      for (std::size_t end = 0; (end = text.find('\n')) != std::string::npos; text.erase(0, end + 1)) {
        std::istringstream line{text.substr(0, end)};
        Time::rep nanoseconds = 0;
        Event event;
        line >> nanoseconds >> event.what;
        event.at = Time{Duration{nanoseconds}};
        for (double& number : event.numbers) line >> number;
        if (event.what == "mark") {
          ++marks_;
        } else if (event.what != "read") {
          events_.push_back(std::move(event));
        }
      }
      changed_.notify_all();
    }
  }

  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  std::vector<Event> events_;
  std::size_t marks_ = 0;
  std::array<int, 2> pipe_{};
  std::thread thread_;
};

/// A recorder and a server with a fake_base for position2d:0, told `keys` beside.
struct Robot {
  explicit Robot(const std::string& keys = "", int rate_hz = 100, const std::string& more = "")
      : server{"driver ( name \"fake_base\" provides [\"position2d:0\"] rate " + std::to_string(rate_hz) + " log \"" +
                   recorder.path() + "\" " + keys + " )\n" + more,
               {&fake_base}} {}
  Recorder recorder;
  TestServer server;
};

/// How long something took, over repeated trials.
class Durations {
 public:
  void add(Duration duration) { all_.push_back(duration); }
  [[nodiscard]] Duration quantile(double share) {
    std::ranges::sort(all_);
    return all_.at(std::min(static_cast<std::size_t>(share * static_cast<double>(all_.size())), all_.size() - 1));
  }
  void print(const std::string& name) {
    const auto ms = [](Duration d) { return std::to_string(1e3 * seconds(d)); };
    std::printf("%s: p50 %s ms, p99 %s ms of %zu\n", name.c_str(), ms(quantile(0.5)).c_str(),
                ms(quantile(0.99)).c_str(), all_.size());
    ::testing::Test::RecordProperty(name + "_p50_ms", ms(quantile(0.5)));
    ::testing::Test::RecordProperty(name + "_p99_ms", ms(quantile(0.99)));
  }

 private:
  std::vector<Duration> all_;
};

}  // namespace regista::testing
