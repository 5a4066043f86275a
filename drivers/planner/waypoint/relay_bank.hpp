// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <regista/device/driver.hpp>
#include <string>

namespace regista {

/// The outputs of a dio, and how far it is to be believed that they stand as they were told: each command is followed
/// until its driver has taken it, and with `feedback` until the data of the dio say so.
class RelayBank {
 public:
  struct Options {
    std::uint32_t count = 0;  ///< outputs from 0 on, 1 to 32
    bool feedback = false;    ///< its data are how the outputs stand (as those of `can_motor`), not inputs
  };

  /// `failed` is told why they do not switch: from step(), or between two of them.
  RelayBank(Required<Dio> dio, const Options& options, std::function<void(const std::string& why)> failed)
      : dio_{dio}, options_{options}, failed_{std::move(failed)} {
    dio_.on_data<dio::State>([this](const dio::State& state, Time) {
      const std::uint32_t ours = options_.count < 32 ? (1U << options_.count) - 1 : ~0U;
      if (state_ != State::taken || state.count < options_.count) return;
      seen_ = state.bits & ours;
      if (seen_ == told_) settle();
    });
  }

  RelayBank(const RelayBank&) = delete;
  RelayBank& operator=(const RelayBank&) = delete;

  /// As they were last known to stand.
  [[nodiscard]] std::uint32_t bits() const { return bits_; }
  /// They are known to stand so.
  [[nodiscard]] bool stand(std::uint32_t bits) const { return state_ == State::known && bits_ == bits; }
  /// A command is on its way.
  [[nodiscard]] bool switching() const { return state_ == State::told || state_ == State::taken; }

  /// Once a beat: true when they stand as wanted; before, tells them.
  bool step(std::uint32_t wanted, Duration dt) {
    if (switching()) {
      switching_for_ += dt;
      if (switching_for_ > limit) fail(state_ == State::told ? "do not answer" : why_not());
      return false;
    }
    if (stand(wanted)) return true;
    if (!tell(wanted)) fail("are not connected");
    return false;
  }

  /// False: they are not connected.
  bool tell(std::uint32_t bits) {
    const auto answered = [this, number = number_ + 1](const Result<>& taken) {
      if (number != number_) return;  // of another time
      if (!taken) {
        return fail("refuse: " + (taken.error().what.empty() ? taken.error().message() : taken.error().what));
      }
      options_.feedback ? void(state_ = State::taken) : settle();
    };
    if (!dio_.connected() || !dio_.send(dio::OutputCommand{.count = options_.count, .bits = bits}, answered)) {
      return false;
    }
    ++number_;
    state_ = State::told;
    told_ = bits;
    seen_.reset();
    switching_for_ = {};
    return true;
  }

 private:
  static constexpr Duration limit = std::chrono::seconds{2};

  enum class State {
    known,   ///< as bits_
    told,    ///< asked for told_, not answered
    taken,   ///< told_ is to be seen in the data
    unsure,  ///< may be as before, or as told
  };

  void settle() {
    state_ = State::known;
    bits_ = told_;
  }

  void fail(const std::string& why) {
    state_ = State::unsure;
    ++number_;  // a late answer is for nobody
    failed_("the relays " + why);
  }

  /// Their driver took the command, and the data do not follow.
  [[nodiscard]] std::string why_not() const {
    if (!seen_) return "do not tell how they stand";
    std::string which;
    for (std::uint32_t i = 0; i < options_.count; ++i) {
      if (((*seen_ ^ told_) >> i & 1) == 0) continue;
      which += (which.empty() ? "" : ", ") + std::to_string(i) + (((told_ >> i) & 1) != 0 ? " is off" : " is on");
    }
    return "do not switch: " + which + "; why, the dio's driver has told";
  }

  Required<Dio> dio_;
  Options options_;
  std::function<void(const std::string&)> failed_;
  State state_ = State::known;
  std::uint32_t bits_ = 0;
  std::uint32_t told_ = 0;
  std::optional<std::uint32_t> seen_;
  std::uint32_t number_ = 0;  ///< of the last command
  Duration switching_for_{};
};

}  // namespace regista
