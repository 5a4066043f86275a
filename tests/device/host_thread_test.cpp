// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <future>
#include <regista/device/host.hpp>

namespace regista {
namespace {

using namespace std::chrono_literals;

/// Beats once an hour: whatever happens sooner was a message or the descriptor.
class Sleeper final : public Driver {
 public:
  Sleeper(Setup& setup, int descriptor) : base_{setup.provide<Position2d>()}, descriptor_{descriptor} {
    base_.on<position2d::VelocityCommand>([this](const position2d::VelocityCommand& c) {
      if (c.velocity.x != 0) commanded.set_value(c.velocity.x);
    });
  }
  Result<> read(const Tick&) override {
    std::uint64_t count = 0;
    const ssize_t size = ::read(descriptor_, &count, sizeof count);
    if (size > 0 && ++taken == 1) told.set_value();
    if (size == 0 && lets_go) descriptor_ = -1;  // a negative one is not waited for
    return {};
  }
  void publish() override { base_.send(position2d::State{}); }
  void halt() noexcept override { halted.store(true); }
  std::span<const int> descriptors() const override { return {&descriptor_, 1}; }

  std::promise<double> commanded;
  std::promise<void> told;
  bool lets_go = false;  ///< of a descriptor that hung up
  std::atomic<int> taken{0};
  std::atomic<bool> halted{false};

 private:
  Port<Position2d> base_;
  int descriptor_;
};

struct Bench {
  explicit Bench(int to_read = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) : descriptor{to_read} {
    auto setup = std::make_unique<Setup>(Section{});
    auto made = std::make_unique<Sleeper>(*setup, descriptor);
    driver = made.get();
    host.emplace("sleeper", std::move(setup), std::move(made), HostOptions{.rate_hz = 1.0 / 3600});
    link = &host->add_link(&woken);
  }
  ~Bench() {
    host.reset();
    ::close(descriptor);
  }
  template <typename M>
  void post(const M& message) {
    link->down.put(link->down.no_lane, [&](Inbound& in) {
      in = {.session = 1, .port = 0, .arrived = Clock::now(), .reply_to = {.session = 1}, .message = message};
    });
    host->wakeup().notify();
  }
  /// The next that comes up, if it comes within ten seconds.
  template <typename Message>
  bool wait_for() {
    int& waiting = came[Outbound{std::in_place_type<Message>}.index()];
    for (const Time end = Clock::now() + 10s; Clock::now() < end;) {
      woken.clear();
      link->up.drain([&](Outbound& out) { ++came[out.index()]; });
      if (waiting > 0) {
        --waiting;
        return true;
      }
      pollfd polled{.fd = woken.descriptor(), .events = POLLIN, .revents = 0};
      ::poll(&polled, 1, 10000);
    }
    return false;
  }

  std::array<int, std::variant_size_v<Outbound>> came{};  ///< of each kind, and not waited for yet
  int descriptor;
  Wakeup woken;
  Sleeper* driver = nullptr;
  std::optional<DriverHost> host;
  Link* link = nullptr;
};

TEST(HostThread, wakes_for_messages_and_descriptors_and_not_only_for_beats) {
  Bench bench;
  auto commanded = bench.driver->commanded.get_future();
  auto told = bench.driver->told.get_future();
  HostThread thread{*bench.host};
  bench.post(AnyRequest{player::Subscribe{}});
  ASSERT_TRUE(bench.wait_for<Reply>());
  ASSERT_TRUE(bench.wait_for<Sample>()) << "the first beat";

  bench.post(AnyCommand{position2d::VelocityCommand{.velocity = {.x = 1}}});
  ASSERT_EQ(commanded.wait_for(10s), std::future_status::ready);
  EXPECT_EQ(commanded.get(), 1);

  const std::uint64_t one = 1;
  ASSERT_EQ(::write(bench.descriptor, &one, sizeof one), 8);
  EXPECT_EQ(told.wait_for(10s), std::future_status::ready);
  EXPECT_TRUE(bench.wait_for<Sample>());
}

TEST(HostThread, takes_a_descriptor_that_hung_up_and_was_left_so_for_a_fault) {
  const auto pipe = [](std::array<int, 2>& ends) { return ::pipe2(ends.data(), O_NONBLOCK | O_CLOEXEC); };
  const auto sockets = [](std::array<int, 2>& ends) {
    return ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends.data());
  };
  for (const std::function<int(std::array<int, 2>&)>& make :
       {std::function<int(std::array<int, 2>&)>{pipe}, {sockets}}) {
    std::array<int, 2> ends{};
    ASSERT_EQ(make(ends), 0);
    Bench bench{ends[0]};
    HostThread thread{*bench.host};
    bench.post(AnyRequest{player::Subscribe{}});
    ASSERT_TRUE(bench.wait_for<Reply>());
    const std::array<std::uint64_t, 100> numbers{};
    ASSERT_EQ(::write(ends[1], numbers.data(), sizeof numbers), sizeof numbers);
    ::close(ends[1]);
    // Not before it had everything; and not called without end, which would never be told.
    while (bench.host->metrics().faults != 1) ASSERT_TRUE(bench.wait_for<Notice>());
    EXPECT_EQ(bench.driver->taken, 100);
  }
}

TEST(HostThread, leaves_a_driver_alone_that_lets_go_of_what_hung_up) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe2(ends.data(), O_NONBLOCK | O_CLOEXEC), 0);
  Bench bench{ends[0]};
  bench.driver->lets_go = true;
  HostThread thread{*bench.host};
  bench.post(AnyRequest{player::Subscribe{}});
  ASSERT_TRUE(bench.wait_for<Reply>());
  ASSERT_TRUE(bench.wait_for<Sample>()) << "the first beat";
  ::close(ends[1]);
  ASSERT_TRUE(bench.wait_for<Sample>());
  for (int i = 0; i < 3; ++i) {
    bench.post(AnyRequest{position2d::GetGeometry{}});
    ASSERT_TRUE(bench.wait_for<Reply>());
  }
  EXPECT_EQ(bench.host->metrics().faults, 0);
}

TEST(HostThread, brings_the_driver_to_rest_when_it_stops) {
  Bench bench;
  HostThread thread{*bench.host};
  bench.post(AnyRequest{player::Subscribe{}});
  ASSERT_TRUE(bench.wait_for<Reply>());
  EXPECT_FALSE(thread.stopped());
  thread.request_stop();
  for (const Time end = Clock::now() + 10s; !thread.stopped() && Clock::now() < end;) {
    pollfd polled{.fd = bench.woken.descriptor(), .events = POLLIN, .revents = 0};
    ::poll(&polled, 1, 10000);
    bench.woken.clear();
  }
  EXPECT_TRUE(thread.stopped());
  EXPECT_TRUE(bench.driver->halted);
}

TEST(HostThread, lets_another_thread_look_and_give_up) {
  Bench bench;
  HostThread thread{*bench.host};
  bench.post(AnyRequest{player::Subscribe{}});
  ASSERT_TRUE(bench.wait_for<Reply>());
  (void)bench.host->busy_since();
  EXPECT_FALSE(bench.host->give_up());
  bench.host->wakeup().notify();
  // Its notice comes after those of the start.
  while (bench.host->metrics().faults != 1) ASSERT_TRUE(bench.wait_for<Notice>());
}

}  // namespace
}  // namespace regista
