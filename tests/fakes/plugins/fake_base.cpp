// SPDX-License-Identifier: Apache-2.0
#include "fake_base.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <stdexcept>
#include <thread>

namespace regista {

namespace {

std::string one_of(const Section& config, std::string_view key, std::string fallback,
                   std::initializer_list<std::string_view> words) {
  std::string word = config.text(key, std::move(fallback));
  if (config.has(key) && std::ranges::find(words, word) == words.end()) {
    throw config.error(key, "is no such word: \"" + word + '"' + did_you_mean(word, words));
  }
  return word;
}

}  // namespace

FakeBase::FakeBase(Setup& setup)
    : port_{setup.provide<Position2d>()},
      echo_{setup.config.boolean("echo", false)},
      samples_{setup.config.integer("samples", 1, {.min = 0})},
      fault_{one_of(setup.config, "fault", "", {"throw", "error", "hang", "segfault"})},
      at_{one_of(setup.config, "at", "read", {"open", "read", "publish", "command", "request"})},
      after_{setup.config.integer("after", 0, {.min = 0})},
      times_{setup.config.integer("times", 1, {.min = 1})},
      hang_{setup.config.duration("seconds", std::chrono::seconds{1})},
      out_of_band_{setup.config.boolean("out_of_band", false)} {
  if (setup.config.has("log")) {
    const std::string file = setup.config.file("log").string();
    log_ = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (log_ < 0)
      throw setup.config.error("log", "cannot be opened: " + std::error_code{errno, std::generic_category()}.message());
  }
  port_.on<position2d::VelocityCommand>([this](const position2d::VelocityCommand& command) -> Result<> {
    const BodyVelocity& velocity = command.velocity;
    log("velocity %.9g %.9g %.9g", velocity.x, velocity.y, velocity.w);
    state_.velocity = velocity;
    if (echo_) port_.send(state_);
    return call("command");
  });
  port_.on<position2d::PositionCommand>([this](const position2d::PositionCommand& command) -> Result<> {
    log("position %.9g %.9g %.9g", command.pose.x, command.pose.y, command.pose.heading);
    return call("command");
  });
  port_.on<position2d::GetGeometry>([this](const auto&) -> Result<position2d::Geometry> {
    log("request");
    if (Result<> called = call("request"); !called) return called.error();
    return position2d::Geometry{.size = {.width = 0.3, .length = 0.4, .height = 0.2}};
  });
  port_.on<position2d::SetOdometry>([this](const position2d::SetOdometry& request) -> Result<Empty> {
    state_.pose = request.pose;
    return Empty{};
  });
}

FakeBase::~FakeBase() {
  if (log_ >= 0) (void)::close(log_);
}

Result<> FakeBase::open() {
  log("open");
  return call("open");
}

Result<> FakeBase::read(const Tick& tick) {
  log("read");
  const FieldVelocity velocity = to_field(state_.velocity, state_.pose.heading);
  state_.pose.x += velocity.x * seconds(tick.dt);
  state_.pose.y += velocity.y * seconds(tick.dt);
  state_.pose.heading = wrap_angle(state_.pose.heading + velocity.w * seconds(tick.dt));
  return call("read");
}

void FakeBase::publish() {
  for (std::int64_t i = 0; i < samples_; ++i) port_.send(state_);
  if (Result<> called = call("publish"); !called) throw std::runtime_error{called.error().message()};
}

void FakeBase::halt() noexcept {
  log("halt");
  state_.velocity = {};
}

void FakeBase::close() noexcept { log("close"); }

bool FakeBase::stop_out_of_band() noexcept {
  if (out_of_band_) log("stop_out_of_band");
  return out_of_band_;
}

void FakeBase::log(const char* format, ...) const noexcept {
  if (log_ < 0) return;
  char line[128];
  int length =
      std::snprintf(line, sizeof line, "%lld ", static_cast<long long>(Clock::now().time_since_epoch().count()));
  std::va_list arguments;
  va_start(arguments, format);
  length += std::vsnprintf(line + length, sizeof line - static_cast<std::size_t>(length), format, arguments);
  va_end(arguments);
  line[length++] = '\n';  // 22 + 9 + 3 * 17 bytes at most
  (void)!::write(log_, line, static_cast<std::size_t>(length));
}

Result<> FakeBase::call(std::string_view place) {
  if (fault_.empty() || place != at_) return {};
  const std::int64_t number = calls_++;
  if (number < after_ || number >= after_ + times_) return {};
  if (fault_ == "throw") throw std::runtime_error{"made-up fault"};
  if (fault_ == "hang") std::this_thread::sleep_for(hang_);
  if (fault_ == "segfault") (void)std::raise(SIGSEGV);
  if (fault_ == "error") return Error{std::errc::io_error, "made-up fault"};
  return {};
}

}  // namespace regista
