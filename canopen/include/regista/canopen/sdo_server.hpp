// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/sdo.hpp>

namespace regista::canopen {

/// What an SDO server serves. Errors that are not SdoAbort become `general`.
class SdoObjects {
 public:
  virtual ~SdoObjects() = default;
  virtual Result<Bytes> read_object(ObjectIndex object) = 0;
  virtual Result<> write_object(ObjectIndex object, ByteView data) = 0;
  /// [bytes] of an object of at most four, for a write that does not say how many it has; else 4.
  [[nodiscard]] virtual std::size_t short_size(ObjectIndex object) const = 0;
};

/// The server's end of an SDO channel: expedited, segmented and block, both ways (CiA 301, 7.2.4). For simulated
/// drives.
class SdoServer {
 public:
  struct Options {
    Duration timeout = std::chrono::milliseconds{1000};  ///< of the client's next frame
    std::uint8_t block_size = 127;                       ///< segments in a row that we take
    std::size_t most = std::size_t{16} << 20;            ///< [bytes] of a download
    bool block = true;                                   ///< false: refuse block transfers, as many nodes do
  };
  SdoServer(NodeId node, SdoObjects& objects, const Options& options)
      : node_{node}, objects_{objects}, options_{options} {}

  void on_frame(const CanFrame& frame, Time now);
  void on_time(Time now);
  [[nodiscard]] Time next_wake() const { return state_ == State::idle ? Time::max() : deadline_; }
  /// As in SdoClient.
  [[nodiscard]] const CanFrame* front() const { return out_ ? &*out_ : nullptr; }
  void pop(Time now);
  /// Forgets the transfer, as after a reset.
  void reset();

 private:
  enum class State : std::uint8_t {
    idle,
    download_segment,
    upload_segment,
    block_download_segments,
    block_download_end,
    block_upload_start,
    block_upload_segments,  ///< sending, then waiting for the answer
    block_upload_end,
  };

  void answer(std::uint8_t command, std::uint32_t rest, bool with_object, Time now);
  void abort(std::error_code code);
  bool load();
  void initiate_download(const CanFrame& frame, Time now);
  void on_download_segment(const CanFrame& frame, Time now);
  void initiate_upload(Time now);
  void on_upload_segment(const CanFrame& frame, Time now);
  void on_block_download(const CanFrame& frame, Time now);
  void on_block_download_segment(const CanFrame& frame, Time now);
  void on_block_upload(const CanFrame& frame, Time now);
  void start_block();
  void stage_block_segment();
  void store(Time now, std::uint8_t command);

  NodeId node_;
  SdoObjects& objects_;
  Options options_;
  State state_ = State::idle;
  Time deadline_ = Time::max();
  std::optional<CanFrame> out_;
  ObjectIndex object_;
  Bytes data_;
  std::optional<std::size_t> announced_;
  std::size_t offset_ = 0;
  bool toggle_ = false;
  bool crc_ = false;
  bool last_ = false;
  std::uint8_t block_size_ = 0;
  std::uint8_t sequence_ = 0;  ///< last good one received, or last one sent
};

}  // namespace regista::canopen
