// SPDX-License-Identifier: Apache-2.0
#include <poll.h>

#include <algorithm>
#include <regista/client/team.hpp>

namespace regista::client {

using namespace std::chrono_literals;

bool Team::read(Duration timeout) {
  const Time until = Clock::now() + std::min<Duration>(timeout, 24h);
  std::vector<pollfd> polls;
  for (;;) {
    bool any = false;
    std::exception_ptr failure;
    Time wake = until;
    polls.clear();
    for (Robot& robot : robots_) {
      try {
        any = robot.read(0ms) || any;
      } catch (const Error&) {
        if (!failure) failure = std::current_exception();
      }
      wake = std::min(wake, robot.wake_time());
      polls.push_back({.fd = robot.fileno(), .events = robot.connection().poll_events(), .revents = 0});
    }
    if (failure) std::rethrow_exception(failure);
    const Time now = Clock::now();
    if (any || now >= until) return any;
    const auto left = std::max(wake - now, Duration{});
    const auto whole = std::chrono::duration_cast<std::chrono::seconds>(left);
    const timespec pause{.tv_sec = whole.count(), .tv_nsec = (left - whole).count()};
    (void)::ppoll(polls.data(), polls.size(), &pause, nullptr);
  }
}

}  // namespace regista::client
