// SPDX-License-Identifier: Apache-2.0
#include <regista/canopen/nmt.hpp>
#include <regista/canopen/sync.hpp>
#include <stdexcept>

namespace regista::canopen {

using std::chrono::milliseconds;

SyncProducer::SyncProducer(const Options& options) : options_{options} {
  if (options.counter_overflow == 1 || options.counter_overflow > 240) {
    throw std::invalid_argument{"SYNC counter overflow " + std::to_string(options.counter_overflow) +
                                ": 0, or 2 to 240 (CiA 301, object 1019)"};
  }
}

std::optional<CanFrame> SyncProducer::on_time(Time now) {
  if (options_.period <= Duration::zero() || now < next_) return {};
  if (next_ == Time::min()) next_ = now;
  const auto late = (now - next_) / options_.period;
  missed_ += static_cast<std::uint64_t>(late);
  next_ += (late + 1) * options_.period;
  last_ = now;
  CanFrame frame{.id = sync_id};
  if (options_.counter_overflow != 0) {
    counter_ = counter_ >= options_.counter_overflow ? std::uint8_t{1} : static_cast<std::uint8_t>(counter_ + 1);
    frame.size = 1;
    frame.data[0] = counter_;
  }
  return frame;
}

namespace {
constexpr std::chrono::sys_days epoch = std::chrono::year{1984} / 1 / 1;
}

CanFrame time_frame(std::chrono::sys_time<milliseconds> time) {
  const auto day = std::chrono::floor<std::chrono::days>(time);
  const auto since_midnight = static_cast<std::uint32_t>((time - day).count());
  const auto days = static_cast<std::uint16_t>((day - epoch).count());
  CanFrame frame{.id = time_id, .size = 6};
  for (std::size_t i = 0; i < 4; ++i) frame.data[i] = static_cast<std::uint8_t>(since_midnight >> (8 * i));
  frame.data[4] = static_cast<std::uint8_t>(days);
  frame.data[5] = static_cast<std::uint8_t>(days >> 8);
  return frame;
}

std::optional<std::chrono::sys_time<milliseconds>> decode_time(const CanFrame& frame) {
  if (frame.id != time_id || frame.extended || frame.remote || frame.error || frame.size != 6) return {};
  const auto since_midnight = static_cast<std::int64_t>(get_le(frame.bytes().first(4)) & 0x0FFFFFFFU);  // 28 bits
  const auto days = static_cast<int>(get_le(frame.bytes().subspan(4)));
  return epoch + std::chrono::days{days} + milliseconds{since_midnight};
}

}  // namespace regista::canopen
