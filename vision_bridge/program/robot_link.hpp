// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>

#include <array>
#include <functional>
#include <regista/client/connection.hpp>
#include <regista/core/geometry.hpp>
#include <regista/vision/config.hpp>

namespace regista::vision {

/// A window over the last values of something.
class Quantiles {
 public:
  void add(double value) { values_[count_++ % values_.size()] = value; }
  /// 0 when there is none.
  [[nodiscard]] double at(double share) const;

 private:
  std::array<double, 512> values_{};
  std::size_t count_ = 0;
};

/// The way to one robot's server. Never blocks: what cannot be sent now is replaced by what comes next, and no more
/// than one pose waits in the kernel. Connects again with back-off.
class RobotLink {
 public:
  using Log = std::function<void(bool is_warning, const std::string& text)>;

  /// The robot turned at `rate_radps` when its server's clock said `stamp_s`. `way`: half the shortest round trip.
  using OnTurn = std::function<void(double rate_radps, double stamp_s, Time arrival, Duration way)>;

  /// `on_turn`: empty for who does not want to know.
  RobotLink(const RobotAddress& address, Log log, OnTurn on_turn);

  /// The robot was there when the image was taken that came at `arrival`.
  void offer(const Pose2d& pose, Time captured, Time arrival);
  /// Bring all that the server has to rest, whoever drives it: now, or once what is being asked is answered.
  void halt();
  /// The HALT is over.
  void end_halt() { is_halt_ = stop_waits_ = false; }
  /// Go on with whatever is under way. For a loop: when `poll()` is ready, or at `wake_time()`.
  void service();
  [[nodiscard]] pollfd poll() const;
  [[nodiscard]] Time wake_time() const { return retry_at_ ? *retry_at_ : connection_.wake_time(); }

  [[nodiscard]] const RobotAddress& address() const { return address_; }
  [[nodiscard]] bool connected() const { return connection_.connected(); }

  struct Counters {
    std::uint64_t sent = 0;
    std::uint64_t superseded = 0;  ///< replaced by a newer pose before they could be sent
    std::uint64_t unsent = 0;      ///< no connection
    std::uint64_t halts = 0;       ///< acknowledged
    std::uint64_t connects = 0;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const Quantiles& ages_s() const { return ages_s_; }            ///< of the poses when they were sent
  [[nodiscard]] const Quantiles& latencies_s() const { return latencies_s_; }  ///< from the datagram to send()

 private:
  struct Pending {
    Pose2d pose;
    Time captured;
    Time arrival;
  };

  void greet();
  void ask_motion();
  [[nodiscard]] Duration way() const;
  void lose(const std::string& why);
  void say_once(const std::string& why);
  void flush();

  RobotAddress address_;
  client::Address device_;
  Log log_;
  OnTurn on_turn_;
  std::optional<Pending> pending_;
  bool greeted_ = false;
  Time ask_motion_at_{};                  ///< max(): asked
  bool is_halt_ = false;                  ///< halt() was called last, not end_halt()
  bool stop_waits_ = false;               ///< for the answer to what was asked before
  std::optional<Time> retry_at_{Time{}};  ///< empty: connecting or connected
  Duration back_off_{};
  std::string last_failure_;
  Counters counters_;
  Quantiles ages_s_;
  Quantiles latencies_s_;
  client::Connection connection_;  // the last: its handlers use all of the above
};

}  // namespace regista::vision
