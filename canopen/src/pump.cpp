// SPDX-License-Identifier: Apache-2.0
#include <poll.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <unistd.h>
#include <algorithm>
#include <regista/canopen/pump.hpp>
#include <system_error>

namespace regista::canopen {
namespace {

int checked(int result, const char* what) {
  if (result < 0) throw std::system_error{errno, std::generic_category(), what};
  return result;
}

}  // namespace

Pump::Pump(CanBus& bus, Station& station) : bus_{bus}, station_{station} {
  timer_ = checked(::timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK), "timerfd_create");
  epoll_ = checked(::epoll_create1(EPOLL_CLOEXEC), "epoll_create1");
  for (const int descriptor : {timer_, bus.descriptor()}) {
    epoll_event event{.events = EPOLLIN, .data = {.fd = descriptor}};
    checked(::epoll_ctl(epoll_, EPOLL_CTL_ADD, descriptor, &event), "epoll_ctl");
  }
  itimerspec at_once{.it_interval = {}, .it_value = {.tv_sec = 0, .tv_nsec = 1}};
  ::timerfd_settime(timer_, 0, &at_once, nullptr);
}

Pump::~Pump() {
  ::close(epoll_);
  ::close(timer_);
}

Result<> Pump::run(Time now) {
  Result<> served = serve(bus_, station_, now);
  const Time next = station_.next_wake();
  // Set too early it only fires for nothing, once; setting it anew for each frame would be a system call each.
  if (now < armed_ && armed_ <= next) return served;
  armed_ = next;
  // CLOCK_MONOTONIC is what steady_clock reads. A time of zero would switch the timer off; one that is past fires at
  // once.
  const auto since_boot = std::max<std::chrono::nanoseconds>(next.time_since_epoch(), std::chrono::nanoseconds{1});
  const auto whole = std::chrono::floor<std::chrono::seconds>(since_boot);
  itimerspec when{};
  if (next != Time::max()) {
    when.it_value.tv_sec = whole.count();
    when.it_value.tv_nsec = (since_boot - whole).count();
  }
  ::timerfd_settime(timer_, TFD_TIMER_ABSTIME, &when, nullptr);
  return served;
}

Result<> Pump::wait(Duration longest) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(longest).count();
  pollfd ready{.fd = epoll_, .events = POLLIN, .revents = 0};
  (void)::poll(&ready, 1, static_cast<int>(std::clamp<std::int64_t>(left, 0, 60'000)));
  return run(Clock::now());
}

}  // namespace regista::canopen
