// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/device/driver.hpp>
#include <string>

namespace regista {

/// A position2d that records what is done to it, and misbehaves when told to.
///
/// | Key                | Value                                                                      | Default |
/// |--------------------|----------------------------------------------------------------------------|---------|
/// | `log`              | file, FIFO or /dev/fd/N that gets a line for each event                    | none    |
/// | `echo`             | boolean: publish each command's velocity at once, from its handler         | no      |
/// | `samples`          | to publish on each beat; above 1 it floods                                 | 1       |
/// | `fault`            | "throw", "error", "hang" or "segfault"                                     | none    |
/// | `at`               | the call that does it: "open", "read", "publish", "command" or "request"   | "read"  |
/// | `after`            | so many such calls go well first, over the driver's whole life             | 0       |
/// | `times`            | so many do not, then all go well again                                     | 1       |
/// | `seconds`          | that a hang lasts; with many `times` and few seconds it is a slow driver   | 1       |
/// | `out_of_band`      | boolean: there is a way to stop it while it hangs                          | no      |
///
/// A line is the monotonic time in ns, the event, and its numbers: "81276312 velocity 0.5 0 0". Events: open, read,
/// velocity x y w, position x y heading, request, halt, close, stop_out_of_band.
class FakeBase final : public Driver {
 public:
  explicit FakeBase(Setup& setup);
  ~FakeBase() override;
  FakeBase(const FakeBase&) = delete;
  FakeBase& operator=(const FakeBase&) = delete;

  Result<> open() override;
  Result<> read(const Tick& tick) override;
  void publish() override;
  void halt() noexcept override;
  void close() noexcept override;
  bool stop_out_of_band() noexcept override;

 private:
  [[gnu::format(printf, 2, 3)]] void log(const char* format, ...) const noexcept;
  /// Count this call, and misbehave in it when it is one of those.
  Result<> call(std::string_view place);

  Port<Position2d> port_;
  bool echo_;
  std::int64_t samples_;
  std::string fault_;
  std::string at_;
  std::int64_t after_;
  std::int64_t times_;
  Duration hang_;
  bool out_of_band_;
  int log_ = -1;
  std::int64_t calls_ = 0;
  position2d::State state_;
};

}  // namespace regista
