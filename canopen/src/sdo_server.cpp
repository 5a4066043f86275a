// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <regista/canopen/sdo_server.hpp>

#include "sdo_frames.hpp"

// Command specifiers of CiA 301, 7.2.4.3.

namespace regista::canopen {

void SdoServer::reset() {
  state_ = State::idle;
  deadline_ = Time::max();
  out_.reset();
  data_ = {};
}

void SdoServer::pop(Time now) {
  out_.reset();
  if (state_ == State::idle) return;
  deadline_ = now + options_.timeout;
  if (state_ == State::block_upload_segments) stage_block_segment();
}

void SdoServer::on_time(Time now) {
  if (state_ == State::idle || now < deadline_) return;
  abort(SdoAbort::timed_out);
}

void SdoServer::answer(std::uint8_t command, std::uint32_t rest, bool with_object, Time now) {
  CanFrame frame{.id = 0x580U + node_, .size = 8};
  frame.data[0] = command;
  if (with_object) {
    frame.data[1] = static_cast<std::uint8_t>(object_.index);
    frame.data[2] = static_cast<std::uint8_t>(object_.index >> 8);
    frame.data[3] = object_.sub;
    std::ranges::copy(le_bytes(rest, 4), frame.data.begin() + 4);
  } else {
    std::ranges::copy(le_bytes(rest, 4), frame.data.begin() + 1);
  }
  out_ = frame;
  deadline_ = now + options_.timeout;
}

void SdoServer::abort(std::error_code code) {
  const auto number =
      code.category() == sdo_category() ? static_cast<std::uint32_t>(code.value()) : std::uint32_t{0x08000000};
  answer(abort_command, number, true, Time{});
  state_ = State::idle;
  deadline_ = Time::max();
  data_ = {};
}

void SdoServer::on_frame(const CanFrame& frame, Time now) {
  if (frame.id != 0x600U + node_ || frame.extended || frame.remote || frame.error || frame.size != 8) return;
  if (frame.data[0] == abort_command) return reset();
  if (state_ == State::block_download_segments) return on_block_download_segment(frame, now);
  switch (frame.data[0] >> 5) {
    case 0:
      return on_download_segment(frame, now);
    case 1:
      return initiate_download(frame, now);
    case 2:
      object_ = object_of(frame);
      return initiate_upload(now);
    case 3:
      return on_upload_segment(frame, now);
    case 5:
      return on_block_upload(frame, now);
    case 6:
      return on_block_download(frame, now);
    default:
      return abort(SdoAbort::unknown_command);
  }
}

/// Reads the object into data_; aborts when that is refused.
bool SdoServer::load() {
  auto data = objects_.read_object(object_);
  if (!data) {
    abort(data.error().code);
    return false;
  }
  data_ = *std::move(data);
  offset_ = 0;
  toggle_ = last_ = false;
  return true;
}

/// Writes what has arrived, and answers with `command`.
void SdoServer::store(Time now, std::uint8_t command) {
  state_ = State::idle;
  if (announced_ && *announced_ != data_.size()) return abort(SdoAbort::length);
  if (const Result<> written = objects_.write_object(object_, data_); !written) return abort(written.error().code);
  answer(command, 0, command == 0x60, now);
  data_ = {};
}

// --- expedited and segmented -----------------------------------------------------------------------------------------

void SdoServer::initiate_download(const CanFrame& frame, Time now) {
  object_ = object_of(frame);
  const bool expedited = (frame.data[0] & 2U) != 0;
  const bool sized = (frame.data[0] & 1U) != 0;
  announced_.reset();
  if (expedited) {
    const std::size_t size = sized ? 4U - (frame.data[0] >> 2 & 3U) : objects_.short_size(object_);
    data_.assign(frame.data.begin() + 4, frame.data.begin() + 4 + static_cast<std::ptrdiff_t>(size));
    return store(now, 0x60);
  }
  if (sized) announced_ = word_of(frame);
  if (announced_.value_or(0) > options_.most) return abort(SdoAbort::out_of_memory);
  data_.clear();
  toggle_ = false;
  state_ = State::download_segment;
  answer(0x60, 0, true, now);
}

void SdoServer::on_download_segment(const CanFrame& frame, Time now) {
  if (state_ != State::download_segment) return abort(SdoAbort::unknown_command);
  if (((frame.data[0] & 0x10U) != 0) != toggle_) return abort(SdoAbort::toggle);
  const std::size_t size = segment_bytes - (frame.data[0] >> 1 & 7U);
  if (data_.size() + size > options_.most) return abort(SdoAbort::out_of_memory);
  data_.insert(data_.end(), frame.data.begin() + 1, frame.data.begin() + 1 + static_cast<std::ptrdiff_t>(size));
  const auto command = static_cast<std::uint8_t>(toggle_ ? 0x30 : 0x20);
  toggle_ = !toggle_;
  if ((frame.data[0] & 1U) != 0) return store(now, command);
  answer(command, 0, false, now);
}

void SdoServer::initiate_upload(Time now) {
  if (!load()) return;
  const auto size = static_cast<std::uint32_t>(data_.size());
  state_ = State::idle;
  if (1 <= size && size <= 4) {
    return answer(static_cast<std::uint8_t>(0x43U | (4 - size) << 2), static_cast<std::uint32_t>(get_le(data_)), true,
                  now);
  }
  state_ = State::upload_segment;
  answer(0x41, size, true, now);
}

void SdoServer::on_upload_segment(const CanFrame& frame, Time now) {
  if (state_ != State::upload_segment) return abort(SdoAbort::unknown_command);
  if (((frame.data[0] & 0x10U) != 0) != toggle_) return abort(SdoAbort::toggle);
  const std::size_t size = std::min(data_.size() - offset_, segment_bytes);
  CanFrame segment{.id = 0x580U + node_, .size = 8};
  std::copy_n(data_.begin() + static_cast<std::ptrdiff_t>(offset_), size, segment.data.begin() + 1);
  offset_ += size;
  const bool is_last = offset_ == data_.size();
  segment.data[0] =
      static_cast<std::uint8_t>((toggle_ ? 0x10U : 0U) | (segment_bytes - size) << 1 | (is_last ? 1U : 0U));
  toggle_ = !toggle_;
  out_ = segment;
  deadline_ = now + options_.timeout;
  if (is_last) state_ = State::idle;
}

// --- block download --------------------------------------------------------------------------------------------------

void SdoServer::on_block_download(const CanFrame& frame, Time now) {
  if (!options_.block) return abort(SdoAbort::unknown_command);
  if ((frame.data[0] & 1U) == 0) {  // initiate
    object_ = object_of(frame);
    crc_ = (frame.data[0] & 4U) != 0;
    announced_.reset();
    if ((frame.data[0] & 2U) != 0) announced_ = word_of(frame);
    if (announced_.value_or(0) > options_.most) return abort(SdoAbort::out_of_memory);
    data_.clear();
    sequence_ = 0;
    last_ = false;
    state_ = State::block_download_segments;
    return answer(0xA4, options_.block_size, true, now);
  }
  if (state_ != State::block_download_end) return abort(SdoAbort::unknown_command);
  const std::size_t unused = frame.data[0] >> 2 & 7U;
  if (unused > data_.size()) return abort(SdoAbort::length);
  data_.resize(data_.size() - unused);
  if (crc_ && sdo_crc(data_) != crc_of(frame)) return abort(SdoAbort::crc);
  store(now, 0xA1);
}

void SdoServer::on_block_download_segment(const CanFrame& frame, Time now) {
  const std::uint8_t sequence = frame.data[0] & 0x7FU;
  const bool is_last = (frame.data[0] & last_segment) != 0;
  deadline_ = now + options_.timeout;
  if (sequence == sequence_ + 1) {
    if (data_.size() > options_.most) return abort(SdoAbort::out_of_memory);
    data_.insert(data_.end(), frame.data.begin() + 1, frame.data.end());
    ++sequence_;
    last_ = is_last;
  }
  if (!is_last && sequence != options_.block_size) return;
  const std::uint32_t answered = sequence_ | std::uint32_t{options_.block_size} << 8;
  sequence_ = 0;
  if (last_) state_ = State::block_download_end;
  answer(0xA2, answered, false, now);
}

// --- block upload ----------------------------------------------------------------------------------------------------

void SdoServer::on_block_upload(const CanFrame& frame, Time now) {
  if (!options_.block) return abort(SdoAbort::unknown_command);
  switch (frame.data[0] & 3U) {
    case 0: {
      object_ = object_of(frame);
      crc_ = (frame.data[0] & 4U) != 0;
      block_size_ = frame.data[4];
      if (!is_block_size(block_size_)) return abort(SdoAbort::block_size);
      const std::size_t threshold = frame.data[5];  // below it we may change the protocol, and do
      if (!load()) return;
      if (threshold != 0 && data_.size() <= threshold) return initiate_upload(now);
      state_ = State::block_upload_start;
      return answer(0xC6, static_cast<std::uint32_t>(data_.size()), true, now);
    }
    case 3:
      if (state_ != State::block_upload_start) return abort(SdoAbort::unknown_command);
      return start_block();
    case 2: {
      if (state_ != State::block_upload_segments) return abort(SdoAbort::unknown_command);
      const std::uint8_t good = frame.data[1];
      if (good > sequence_) return abort(SdoAbort::sequence_number);
      block_size_ = frame.data[2];
      if (!is_block_size(block_size_)) return abort(SdoAbort::block_size);
      offset_ += good * segment_bytes;
      deadline_ = now + options_.timeout;
      if (offset_ < data_.size() || (data_.empty() && good == 0)) return start_block();
      const std::uint32_t crc = crc_ ? sdo_crc(data_) : 0U;
      const auto unused = static_cast<unsigned>(offset_ - data_.size());
      state_ = State::block_upload_end;
      return answer(static_cast<std::uint8_t>(0xC1U | unused << 2), crc, false, now);
    }
    default:  // the client has all; it expects no answer
      if (state_ == State::block_upload_end) reset();
  }
}

void SdoServer::start_block() {
  sequence_ = 0;
  last_ = false;
  state_ = State::block_upload_segments;
  stage_block_segment();
}

void SdoServer::stage_block_segment() {
  const std::size_t at = offset_ + sequence_ * segment_bytes;
  out_.reset();
  if (sequence_ > 0 && (sequence_ == block_size_ || at >= data_.size())) return;  // all sent
  const std::size_t size = std::min(data_.size() - at, segment_bytes);
  CanFrame segment{.id = 0x580U + node_, .size = 8};
  std::copy_n(data_.begin() + static_cast<std::ptrdiff_t>(at), size, segment.data.begin() + 1);
  ++sequence_;
  segment.data[0] = static_cast<std::uint8_t>(sequence_ | (at + size == data_.size() ? last_segment : 0U));
  out_ = segment;
}

}  // namespace regista::canopen
