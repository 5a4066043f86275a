// SPDX-License-Identifier: Apache-2.0
#include "recorder.hpp"

#include <chrono>
#include <utility>

namespace regista::vision {

namespace {
constexpr std::size_t most_bytes = std::size_t{8} << 20;
}  // namespace

Recorder::Recorder(const std::filesystem::path& file)
    : log_{file}, thread_{[this](const std::stop_token& stop) { run(stop); }} {}

Recorder::~Recorder() = default;

void Recorder::add(ssl::LogType type, std::span<const std::byte> datagram) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  {
    const std::scoped_lock lock{mutex_};
    if (bytes_ + datagram.size() > most_bytes) {
      ++dropped_;
      return;
    }
    bytes_ += datagram.size();
    queue_.push_back({.received_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count(),
                      .type = type,
                      .datagram = {datagram.begin(), datagram.end()}});
  }
  filled_.notify_one();
}

void Recorder::run(const std::stop_token& stop) {
  std::deque<ssl::LogRecord> records;
  for (;;) {
    {
      std::unique_lock lock{mutex_};
      if (!filled_.wait(lock, stop, [this] { return !queue_.empty(); })) return;
      records = std::exchange(queue_, {});
      bytes_ = 0;
    }
    for (const ssl::LogRecord& record : records) {
      if (log_.write(record.received_ns, record.type, record.datagram)) {
        ++written_;
      } else {
        ++dropped_;
      }
    }
  }
}

}  // namespace regista::vision
