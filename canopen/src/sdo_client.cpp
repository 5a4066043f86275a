// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cassert>
#include <regista/canopen/sdo_client.hpp>

#include "sdo_frames.hpp"

// Figures and command specifiers are those of CiA 301, 7.2.4.3. Byte 0 of a frame is ccs or scs << 5 and flags.

namespace regista::canopen {
namespace {

constexpr int most_stalls = 3;

int specifier(const CanFrame& frame) { return frame.data[0] >> 5; }

}  // namespace

SdoClient::SdoClient(NodeId server, const Options& options) : server_{server}, options_{options} {
  assert(first_node <= server && server <= last_node);
  assert(is_block_size(options.block_size));
}

CanFrame SdoClient::frame(std::uint8_t command, std::uint32_t rest) const {
  CanFrame frame{.id = 0x600U + server_, .size = 8};
  frame.data = {command,
                static_cast<std::uint8_t>(object_.index),
                static_cast<std::uint8_t>(object_.index >> 8),
                object_.sub,
                static_cast<std::uint8_t>(rest),
                static_cast<std::uint8_t>(rest >> 8),
                static_cast<std::uint8_t>(rest >> 16),
                static_cast<std::uint8_t>(rest >> 24)};
  return frame;
}

Error SdoClient::error(std::error_code code, const std::string& more) const {
  return {code, "node " + std::to_string(server_) + ": " + (reading_ ? "read " : "write ") + to_string(object_) + more};
}

void SdoClient::begin(ObjectIndex object, State state, CanFrame request, SdoDone done, Time now) {
  offset_ = 0;
  toggle_ = crc_ = last_ = behind_ = false;
  sequence_ = 0;
  stalls_ = 0;
  announced_.reset();
  done_ = std::move(done);
  object_ = object;
  if (now < quiet_until_) {
    held_ = request;
    next_state_ = state;
    state_ = State::settling;
    deadline_ = quiet_until_;
    return;
  }
  answer_to_.reset();
  state_ = state;
  stage(request, now);
}

void SdoClient::stage(const CanFrame& frame, Time now) {
  out_ = frame;
  deadline_ = now + options_.timeout;
}

void SdoClient::expect(State state, Time now) {
  state_ = state;
  deadline_ = now + options_.timeout;
}

void SdoClient::upload(ObjectIndex object, SdoTransfer transfer, SdoDone done, Time now) {
  assert(!busy());
  reading_ = true;
  data_.clear();
  object_ = object;
  if (transfer == SdoTransfer::block) {
    // 0xA4: with CRC. The last byte, 0, forbids the node to change the protocol: who wants no blocks says so.
    block_size_ = options_.block_size;
    return begin(object, State::block_upload_initiate, frame(0xA4, block_size_), std::move(done), now);
  }
  begin(object, State::upload_initiate, standard_request(), std::move(done), now);
}

void SdoClient::download(ObjectIndex object, Bytes data, SdoTransfer transfer, SdoDone done, Time now) {
  assert(!busy());
  reading_ = false;
  data_ = std::move(data);
  object_ = object;
  if (transfer == SdoTransfer::block) {
    const auto size = static_cast<std::uint32_t>(data_.size());
    return begin(object, State::block_download_initiate, frame(0xC6, size), std::move(done), now);
  }
  begin(object, State::download_initiate, standard_request(), std::move(done), now);
}

bool SdoClient::expedited() const { return !data_.empty() && data_.size() <= 4; }

CanFrame SdoClient::standard_request() const {
  if (reading_) return frame(0x40);
  const auto size = static_cast<std::uint32_t>(data_.size());
  return expedited()
             ? frame(static_cast<std::uint8_t>(0x23U | (4 - size) << 2), static_cast<std::uint32_t>(get_le(data_)))
             : frame(0x21, size);
}

/// The node has no blocks. It has done nothing yet, so asking once more does no harm.
void SdoClient::start_standard(Time now) {
  state_ = reading_ ? State::upload_initiate : State::download_initiate;
  stage(standard_request(), now);
}

void SdoClient::pop(Time now) {
  if (last_word_) {
    last_word_.reset();
    return;
  }
  out_.reset();
  if (state_ == State::idle || state_ == State::settling) return;
  deadline_ = now + options_.timeout;
  if (state_ == State::block_download_segments) stage_block_segment(now);
}

void SdoClient::finish(Result<Bytes> result) {
  state_ = State::idle;
  deadline_ = Time::max();
  out_.reset();
  held_.reset();
  data_ = {};
  const SdoDone done = std::exchange(done_, nullptr);
  if (done) done(std::move(result));
}

bool SdoClient::initiating() const {
  return state_ == State::download_initiate || state_ == State::upload_initiate || initiating_block();
}

bool SdoClient::initiating_block() const {
  return state_ == State::block_download_initiate || state_ == State::block_upload_initiate;
}

void SdoClient::give_up(SdoAbort code, Error why, Time now) {
  if (state_ != State::settling) {
    last_word_ = frame(abort_command, static_cast<std::uint32_t>(code));
    quiet_until_ = now + options_.settle;
    // The one answer that may still come; the segments of a broken off transfer cannot be told apart.
    answer_to_ = initiating() ? std::optional{object_} : std::nullopt;
  }
  finish(std::move(why));
}

void SdoClient::abort(SdoAbort code, Time now) { give_up(code, error(code, ": we broke off"), now); }

void SdoClient::cancel(const Error& why, Time now) {
  if (!busy()) return;
  Error what = error(why.code, why.what.empty() ? "" : ": " + why.what);
  quiet_until_ = now + options_.settle;
  answer_to_.reset();
  last_word_.reset();
  finish(std::move(what));
}

void SdoClient::on_time(Time now) {
  if (state_ == State::idle || now < deadline_) return;
  if (state_ == State::settling) {
    answer_to_.reset();
    state_ = next_state_;
    stage(*std::exchange(held_, std::nullopt), now);
    return;
  }
  // The last segment of a block may be what got lost: ask for it again, before it is too late for the node too.
  if (state_ == State::block_upload_segments && stalls_ < most_stalls) {
    ++stalls_;
    answer_block(now);
    behind_ = true;  // what is still on its way belongs to the block that we gave up
    return;
  }
  const auto waited = std::chrono::duration_cast<std::chrono::milliseconds>(options_.timeout).count();
  give_up(SdoAbort::timed_out,
          error(std::make_error_code(std::errc::timed_out), ": no answer for " + std::to_string(waited) + " ms"), now);
}

void SdoClient::on_frame(const CanFrame& frame, Time now) {
  if (frame.id != 0x580U + server_ || frame.extended || frame.remote || frame.error) return;
  if (frame.size != 8) {
    ++strays_;
    return;
  }
  if (state_ == State::idle || state_ == State::settling) {
    ++strays_;
    if (answer_to_ && object_of(frame) == *answer_to_) {  // the late one: from here on all is clear
      answer_to_.reset();
      quiet_until_ = now;
      if (state_ == State::settling) {
        deadline_ = now;
        on_time(now);
      }
    }
    return;
  }
  if (frame.data[0] == abort_command) {
    if (initiating() && object_of(frame) != object_) {
      ++strays_;
      return;
    }
    const auto code = static_cast<SdoAbort>(word_of(frame));
    if (initiating_block() && code == SdoAbort::unknown_command) return start_standard(now);
    return finish(error(code));
  }
  if (out_ && state_ != State::block_download_segments && state_ != State::block_upload_segments) {
    ++strays_;  // what we have not asked for yet cannot be answered
    return;
  }
  switch (state_) {
    case State::idle:
    case State::settling:
      break;
    case State::download_initiate:
    case State::download_segment:
      return on_download_answer(frame, now);
    case State::upload_initiate:
      return on_upload_initiate(frame, now);
    case State::upload_segment:
      return on_upload_segment(frame, now);
    case State::block_download_initiate:
    case State::block_download_segments:
    case State::block_download_answer:
    case State::block_download_end:
      return on_block_answer(frame, now);
    case State::block_upload_initiate:
      if (specifier(frame) == 6 && (frame.data[0] & 1U) == 0) {
        if (object_of(frame) != object_) break;
        crc_ = (frame.data[0] & 4U) != 0;
        if ((frame.data[0] & 2U) != 0) announced_ = word_of(frame);
        if (announced_.value_or(0) > options_.most) return abort(SdoAbort::out_of_memory, now);
        state_ = State::block_upload_segments;
        CanFrame start{.id = 0x600U + server_, .size = 8};
        start.data[0] = 0xA3;
        return stage(start, now);
      }
      if (specifier(frame) == 2)
        return on_upload_initiate(frame, now);  // it answers as if no blocks had been asked for
      if (object_of(frame) == object_) return abort(SdoAbort::unknown_command, now);
      break;
    case State::block_upload_segments:
      return on_block_segment(frame, now);
    case State::block_upload_end:
      return on_block_upload_end(frame, now);
  }
  ++strays_;
}

// --- expedited and segmented -----------------------------------------------------------------------------------------

void SdoClient::on_download_answer(const CanFrame& frame, Time now) {
  if (state_ == State::download_initiate) {
    if (object_of(frame) != object_) {
      ++strays_;
      return;
    }
    if (specifier(frame) != 3) return abort(SdoAbort::unknown_command, now);
    if (expedited()) return finish(Bytes{});
    state_ = State::download_segment;
    return send_segment(now);
  }
  if (specifier(frame) != 1) return abort(SdoAbort::unknown_command, now);
  if (((frame.data[0] & 0x10U) != 0) != toggle_) return abort(SdoAbort::toggle, now);
  if (last_) return finish(Bytes{});
  toggle_ = !toggle_;
  send_segment(now);
}

void SdoClient::send_segment(Time now) {
  const std::size_t size = std::min(data_.size() - offset_, segment_bytes);
  CanFrame segment{.id = 0x600U + server_, .size = 8};
  std::copy_n(data_.begin() + static_cast<std::ptrdiff_t>(offset_), size, segment.data.begin() + 1);
  offset_ += size;
  last_ = offset_ == data_.size();
  segment.data[0] = static_cast<std::uint8_t>((toggle_ ? 0x10U : 0U) | (segment_bytes - size) << 1 | (last_ ? 1U : 0U));
  stage(segment, now);
}

void SdoClient::on_upload_initiate(const CanFrame& frame, Time now) {
  if (object_of(frame) != object_) {
    ++strays_;
    return;
  }
  if (specifier(frame) != 2) return abort(SdoAbort::unknown_command, now);
  const bool expedited = (frame.data[0] & 2U) != 0;
  const bool sized = (frame.data[0] & 1U) != 0;
  if (expedited) {
    const std::size_t size = sized ? 4U - (frame.data[0] >> 2 & 3U) : 4U;
    return finish(Bytes(frame.data.begin() + 4, frame.data.begin() + 4 + static_cast<std::ptrdiff_t>(size)));
  }
  if (sized) announced_ = word_of(frame);
  if (announced_.value_or(0) > options_.most) return abort(SdoAbort::out_of_memory, now);
  data_.reserve(announced_.value_or(0));
  state_ = State::upload_segment;
  CanFrame request{.id = 0x600U + server_, .size = 8};
  request.data[0] = 0x60;
  stage(request, now);
}

void SdoClient::on_upload_segment(const CanFrame& frame, Time now) {
  if (specifier(frame) != 0) return abort(SdoAbort::unknown_command, now);
  if (((frame.data[0] & 0x10U) != 0) != toggle_) return abort(SdoAbort::toggle, now);
  const std::size_t size = segment_bytes - (frame.data[0] >> 1 & 7U);
  if (data_.size() + size > options_.most) return abort(SdoAbort::out_of_memory, now);
  data_.insert(data_.end(), frame.data.begin() + 1, frame.data.begin() + 1 + static_cast<std::ptrdiff_t>(size));
  if ((frame.data[0] & 1U) != 0) return finish_upload(now);
  toggle_ = !toggle_;
  CanFrame request{.id = 0x600U + server_, .size = 8};
  request.data[0] = toggle_ ? 0x70 : 0x60;
  stage(request, now);
}

void SdoClient::finish_upload(Time now) {
  if (announced_ && *announced_ != data_.size()) return abort(SdoAbort::length, now);
  finish(std::move(data_));
}

// --- block download --------------------------------------------------------------------------------------------------

void SdoClient::stage_block_segment(Time now) {
  const std::size_t at = offset_ + sequence_ * segment_bytes;
  if (sequence_ > 0 && (sequence_ == block_size_ || at >= data_.size()))
    return expect(State::block_download_answer, now);
  const std::size_t size = std::min(data_.size() - at, segment_bytes);
  CanFrame segment{.id = 0x600U + server_, .size = 8};
  std::copy_n(data_.begin() + static_cast<std::ptrdiff_t>(at), size, segment.data.begin() + 1);
  ++sequence_;
  segment.data[0] = static_cast<std::uint8_t>(sequence_ | (at + size == data_.size() ? last_segment : 0U));
  stage(segment, now);
}

void SdoClient::on_block_answer(const CanFrame& frame, Time now) {
  if (specifier(frame) != 5) return abort(SdoAbort::unknown_command, now);
  const unsigned kind = frame.data[0] & 3U;
  if (state_ == State::block_download_initiate) {
    if (object_of(frame) != object_) {
      ++strays_;
      return;
    }
    if (kind != 0) return abort(SdoAbort::unknown_command, now);
    crc_ = (frame.data[0] & 4U) != 0;
    block_size_ = frame.data[4];
    if (!is_block_size(block_size_)) return abort(SdoAbort::block_size, now);
    state_ = State::block_download_segments;
    return stage_block_segment(now);
  }
  if (state_ == State::block_download_end) {
    if (kind != 1) return abort(SdoAbort::unknown_command, now);
    return finish(Bytes{});
  }
  // An answer before the block is complete: the node missed a segment and does not wait for the rest.
  if (kind != 2) return abort(SdoAbort::unknown_command, now);
  const std::uint8_t good = frame.data[1];
  const auto sent = static_cast<std::uint8_t>(sequence_ - (out_ ? 1 : 0));
  if (good > sent) return abort(SdoAbort::sequence_number, now);
  block_size_ = frame.data[2];
  if (!is_block_size(block_size_)) return abort(SdoAbort::block_size, now);
  if (good == 0 && ++stalls_ > most_stalls) return abort(SdoAbort::sequence_number, now);
  if (good > 0) stalls_ = 0;
  offset_ += good * segment_bytes;
  sequence_ = 0;
  out_.reset();
  if (offset_ < data_.size() || (data_.empty() && good == 0)) {
    state_ = State::block_download_segments;
    return stage_block_segment(now);
  }
  const std::size_t unused = offset_ - data_.size();  // of the last segment
  const std::uint16_t crc = crc_ ? sdo_crc(data_) : std::uint16_t{0};
  CanFrame end{.id = 0x600U + server_, .size = 8};
  end.data[0] = static_cast<std::uint8_t>(0xC1U | unused << 2);
  end.data[1] = static_cast<std::uint8_t>(crc);
  end.data[2] = static_cast<std::uint8_t>(crc >> 8);
  state_ = State::block_download_end;
  stage(end, now);
}

// --- block upload ----------------------------------------------------------------------------------------------------

void SdoClient::on_block_segment(const CanFrame& frame, Time now) {
  if (out_) {  // our start, or the answer to the block before, is not out yet
    ++strays_;
    return;
  }
  const std::uint8_t sequence = frame.data[0] & 0x7FU;
  const bool is_last = (frame.data[0] & last_segment) != 0;
  deadline_ = now + options_.timeout;
  behind_ = behind_ && sequence != 1;
  if (behind_) {
    ++strays_;
    return;
  }
  if (sequence == sequence_ + 1) {
    if (data_.size() > options_.most) return abort(SdoAbort::out_of_memory, now);
    data_.insert(data_.end(), frame.data.begin() + 1, frame.data.end());
    ++sequence_;
    stalls_ = 0;
    last_ = is_last;
  } else {
    ++strays_;
  }
  if (is_last || sequence == block_size_) answer_block(now);
}

void SdoClient::answer_block(Time now) {
  CanFrame answer{.id = 0x600U + server_, .size = 8};
  answer.data[0] = 0xA2;
  answer.data[1] = sequence_;
  answer.data[2] = block_size_ = options_.block_size;
  sequence_ = 0;
  state_ = last_ ? State::block_upload_end : State::block_upload_segments;
  stage(answer, now);
}

void SdoClient::on_block_upload_end(const CanFrame& frame, Time now) {
  if (specifier(frame) != 6 || (frame.data[0] & 3U) != 1) return abort(SdoAbort::unknown_command, now);
  const std::size_t unused = frame.data[0] >> 2 & 7U;
  if (unused > data_.size()) return abort(SdoAbort::length, now);
  data_.resize(data_.size() - unused);
  if (crc_ && sdo_crc(data_) != crc_of(frame)) return abort(SdoAbort::crc, now);
  if (announced_ && *announced_ != data_.size()) return abort(SdoAbort::length, now);
  CanFrame end{.id = 0x600U + server_, .size = 8};
  end.data[0] = 0xA1;
  last_word_ = end;
  finish(std::move(data_));
}

}  // namespace regista::canopen
