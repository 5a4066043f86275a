// SPDX-License-Identifier: Apache-2.0
#include <poll.h>
#include <pthread.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>

#include <regista/device/host.hpp>

namespace regista {

namespace {

/// The other end is gone, and has left nothing to read.
bool is_dead(const pollfd& polled) {
  if ((polled.revents & (POLLERR | POLLHUP | POLLRDHUP | POLLNVAL)) == 0) return false;
  int left = 0;
  return ::ioctl(polled.fd, FIONREAD, &left) != 0 || left == 0;
}

}  // namespace

HostThread::HostThread(DriverHost& host, int realtime_priority)
    : host_{host}, realtime_priority_{realtime_priority}, thread_{[this] { run(); }} {}

HostThread::~HostThread() {
  request_stop();
  thread_.join();
}

void HostThread::request_stop() {
  stop_.store(true, std::memory_order_release);
  host_.wakeup().notify();
}

void HostThread::run() {
  pthread_setname_np(pthread_self(), host_.name().substr(0, 15).c_str());
  // The default slack of 50 µs would be the jitter of every beat.
  prctl(PR_SET_TIMERSLACK, 1);
  if (realtime_priority_ > 0) {
    const sched_param priority{.sched_priority = realtime_priority_};
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);  // not permitted: the beat's jitter will tell
  }
  std::vector<pollfd> polled;
  bool descriptor_ready = false;
  int dead = -1;  // the descriptor that the driver was called for although it is
  while (!stop_.load(std::memory_order_acquire)) {
    const Time due = host_.cycle(Clock::now(), descriptor_ready);
    polled.assign(1, {.fd = host_.wakeup().descriptor(), .events = POLLIN, .revents = 0});
    for (const int descriptor : host_.descriptors())
      polled.push_back({.fd = descriptor, .events = POLLIN | POLLRDHUP, .revents = 0});
    timespec wait{};
    if (due != Time::max()) {
      const Duration left = std::max(due - Clock::now(), Duration{});
      wait.tv_sec = static_cast<std::time_t>(left / std::chrono::seconds{1});
      wait.tv_nsec = static_cast<long>((left % std::chrono::seconds{1}).count());
    }
    descriptor_ready = false;
    const int left_dead = std::exchange(dead, -1);
    if (::ppoll(polled.data(), polled.size(), due == Time::max() ? nullptr : &wait, nullptr) <= 0) continue;
    if (polled.front().revents != 0) host_.wakeup().clear();
    for (std::size_t i = 1; i < polled.size(); ++i) {
      descriptor_ready |= polled[i].revents != 0;
      if (is_dead(polled[i])) dead = polled[i].fd;
    }
    // It stays ready for ever: the driver would be called without end.
    if (dead >= 0 && dead == left_dead) host_.descriptor_left_dead(dead);
  }
  host_.shut_down(Clock::now());
  stopped_.store(true, std::memory_order_release);
  host_.notify_users();
}

}  // namespace regista
