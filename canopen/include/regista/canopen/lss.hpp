// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <regista/canopen/can_frame.hpp>
#include <regista/core/result.hpp>

namespace regista::canopen {

/// Object 1018: who a node is, worldwide.
struct Identity {
  std::uint32_t vendor = 0;
  std::uint32_t product = 0;
  std::uint32_t revision = 0;
  std::uint32_t serial = 0;
  bool operator==(const Identity&) const = default;
};
std::string to_string(const Identity& identity);

inline constexpr std::uint32_t lss_master_id = 0x7E5, lss_slave_id = 0x7E4;
inline constexpr NodeId lss_unconfigured = 255;

/// Layer setting services (CiA 305): finds nodes by their identity and gives them a node id and a bit rate. One service
/// at a time; each tells how it ended. Most slaves answer within 20 ms; CiA 305 does not say.
class LssMaster {
 public:
  struct Options {
    Duration timeout = std::chrono::milliseconds{100};  ///< of an answer; each question of the fast scan takes it whole
  };
  using Done = std::function<void(Result<>)>;
  using Found = std::function<void(Result<std::optional<Identity>>)>;
  using Word = std::function<void(Result<std::uint32_t>)>;

  explicit LssMaster(const Options& options) : options_{options} {}

  [[nodiscard]] bool busy() const { return state_ != State::idle; }
  // All of these: only when not busy.

  /// Finds one node that has no node id yet and leaves it, alone, in configuration state; empty if there is none.
  void fast_scan(Found found, Time now);
  /// Puts the node of this identity, and no other, into configuration state. Fails with `timed_out`.
  void select(const Identity& identity, Done done, Time now);
  /// Every node into configuration state, or back to waiting. Has no answer: it is done when it is sent.
  void switch_all(bool configuration, Done done, Time now);
  /// Of the node in configuration state. 1 to 127, or 255 for none; takes effect when the node is waiting again.
  void set_node_id(NodeId node, Done done, Time now);
  /// [bit/s] of CiA 305, table 1: 1000000, 800000, 500000, 250000, 125000, 50000, 20000 or 10000.
  void set_bit_rate(int bit_rate, Done done, Time now);
  /// All nodes in configuration state change to the bit rate that was set: silence for `delay`, change, silence again.
  void activate_bit_rate(std::chrono::milliseconds delay, Done done, Time now);
  void store(Done done, Time now);
  void inquire_node_id(Word id, Time now);
  /// 0x5A vendor, 0x5B product, 0x5C revision, 0x5D serial number.
  void inquire(std::uint8_t command, Word value, Time now);

  void on_frame(const CanFrame& frame, Time now);
  void on_time(Time now);
  [[nodiscard]] Time next_wake() const { return deadline_; }
  /// As in SdoClient.
  [[nodiscard]] const CanFrame* front() const { return next_ < out_.size() ? &out_[next_] : nullptr; }
  void pop(Time now);

 private:
  enum class State : std::uint8_t { idle, sending, answer, fast_scan };
  void begin(State state, std::vector<CanFrame> frames, std::uint8_t expected, Word done, Time now);
  void finish(Result<std::uint32_t> result);
  void scan_step(bool answered, Time now);
  void ask(Time now);

  Options options_;
  State state_ = State::idle;
  Time deadline_ = Time::max();
  std::vector<CanFrame> out_;
  std::size_t next_ = 0;
  std::uint8_t expected_ = 0;  ///< command of the answer
  Word done_;
  Found found_;
  // The fast scan: bits are asked for from the top; no answer means that no node has a 0 there.
  std::array<std::uint32_t, 4> scanned_{};
  std::uint8_t part_ = 0;
  int bit_ = 0;
  bool answered_ = false;
  bool present_ = false;
};

/// The other end, for simulated drives.
class LssSlave {
 public:
  LssSlave(const Identity& identity, NodeId node) : identity_{identity}, node_{node}, pending_{node} {}

  /// The answer, if there is one.
  std::optional<CanFrame> on_frame(const CanFrame& frame);
  /// The node was reset, by NMT or power: a new node id counts from here. One that had none takes it at once.
  void reset();
  [[nodiscard]] NodeId node() const { return node_; }  ///< 255: none yet
  [[nodiscard]] std::uint8_t bit_timing() const { return bit_timing_; }
  [[nodiscard]] bool configuring() const { return configuring_; }

 private:
  std::optional<CanFrame> on_fast_scan(const CanFrame& frame);
  [[nodiscard]] bool is_within(int limit, std::uint32_t value) const;

  Identity identity_;
  NodeId node_;
  NodeId pending_;
  std::uint8_t bit_timing_ = 0;
  bool configuring_ = false;
  int selected_ = 0;       ///< parts of the identity that have matched
  int identified_ = 0;     ///< limits of it that were kept
  std::uint8_t scan_ = 0;  ///< the part that the fast scan is at
};

}  // namespace regista::canopen
