// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <regista/canopen/sdo.hpp>

namespace regista::canopen {

/// How a transfer goes over the bus.
enum class SdoTransfer : std::uint8_t {
  standard,  ///< expedited up to 4 bytes, else in segments of 7, each acknowledged
  block,     ///< up to 127 segments in a row, with CRC; as `standard` where the node has no blocks
};

/// Called once when a transfer is over: what was read (nothing after a write), the node's abort code, or `timed_out`.
using SdoDone = std::function<void(Result<Bytes>)>;

/// The client's end of the SDO channel of one node: one transfer at a time (CiA 301, 7.2.4).
///
/// Nothing is ever repeated: a write that had no answer may have been executed, and only the caller knows whether twice
/// does harm. Within a block, segments that were lost are sent again, as the protocol has it. After a time-out the
/// channel is silent until the late answer has come, or for `settle`, so that no answer is taken for the next one's.
class SdoClient {
 public:
  struct Options {
    Duration timeout = std::chrono::milliseconds{500};  ///< between a request that was sent and its answer
    Duration settle = std::chrono::milliseconds{500};   ///< silence after a transfer that we broke off
    std::uint8_t block_size = 127;                      ///< segments in a row that we take
    std::size_t most = std::size_t{16} << 20;           ///< [bytes] that an upload may have
  };
  SdoClient(NodeId server, const Options& options);

  [[nodiscard]] bool busy() const { return state_ != State::idle; }
  /// Read or write one object. Only when not busy. `done` may start the next transfer.
  void upload(ObjectIndex object, SdoTransfer transfer, SdoDone done, Time now);
  void download(ObjectIndex object, Bytes data, SdoTransfer transfer, SdoDone done, Time now);
  /// Breaks the transfer off without telling the node: for when there is no bus any more.
  void cancel(const Error& why, Time now);

  /// Of the node's answers; all other frames are disregarded.
  void on_frame(const CanFrame& frame, Time now);
  void on_time(Time now);
  [[nodiscard]] Time next_wake() const { return state_ == State::idle ? Time::max() : deadline_; }

  /// The frame that is to be sent, if any; pop() when the bus has taken it.
  [[nodiscard]] const CanFrame* front() const { return last_word_ ? &*last_word_ : out_ ? &*out_ : nullptr; }
  void pop(Time now);

  /// Answers that belonged to nothing: late, repeated, or malformed.
  [[nodiscard]] std::uint64_t strays() const { return strays_; }

 private:
  enum class State : std::uint8_t {
    idle,
    settling,
    download_initiate,
    download_segment,
    upload_initiate,
    upload_segment,
    block_download_initiate,
    block_download_segments,  ///< sending them
    block_download_answer,    ///< all of the block sent
    block_download_end,
    block_upload_initiate,
    block_upload_segments,
    block_upload_end,
  };

  void begin(ObjectIndex object, State state, CanFrame request, SdoDone done, Time now);
  void stage(const CanFrame& frame, Time now);
  void expect(State state, Time now);
  void finish(Result<Bytes> result);
  void abort(SdoAbort code, Time now);
  void give_up(SdoAbort code, Error why, Time now);
  [[nodiscard]] bool initiating() const;
  [[nodiscard]] bool initiating_block() const;
  [[nodiscard]] bool expedited() const;
  [[nodiscard]] Error error(std::error_code code, const std::string& more = {}) const;
  [[nodiscard]] CanFrame frame(std::uint8_t command, std::uint32_t rest = 0) const;

  [[nodiscard]] CanFrame standard_request() const;
  void start_standard(Time now);
  void on_download_answer(const CanFrame& frame, Time now);
  void send_segment(Time now);
  void on_upload_initiate(const CanFrame& frame, Time now);
  void on_upload_segment(const CanFrame& frame, Time now);
  void finish_upload(Time now);
  void stage_block_segment(Time now);
  void on_block_answer(const CanFrame& frame, Time now);
  void on_block_segment(const CanFrame& frame, Time now);
  void answer_block(Time now);
  void on_block_upload_end(const CanFrame& frame, Time now);

  NodeId server_;
  Options options_;
  State state_ = State::idle;
  State next_state_ = State::idle;        ///< when the channel has settled
  std::optional<ObjectIndex> answer_to_;  ///< settling: the late answer that would end it
  Time quiet_until_ = Time::min();
  Time deadline_ = Time::max();
  std::optional<CanFrame> out_;
  std::optional<CanFrame> last_word_;  ///< has no answer and goes out whatever comes next: an abort, a block's end
  std::optional<CanFrame> held_;       ///< settling: the request that waits
  SdoDone done_;
  ObjectIndex object_;
  bool reading_ = false;
  Bytes data_;
  std::optional<std::size_t> announced_;  ///< [bytes], by the node
  std::size_t offset_ = 0;                ///< of the segment or block that is under way
  bool toggle_ = false;
  bool crc_ = false;
  bool last_ = false;
  std::uint8_t block_size_ = 0;  ///< segments in a block
  std::uint8_t sequence_ = 0;    ///< of the last segment of the block
  int stalls_ = 0;
  bool behind_ = false;  ///< segments are not ours until the first of a block
  std::uint64_t strays_ = 0;
};

}  // namespace regista::canopen
