// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <regista/device/config_file.hpp>
#include <regista/device/host.hpp>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace regista {

/// One driver in its host, one subscriber of all its ports, and time that passes when a test says so.
class Bench {
 public:
  static constexpr SessionId session = 1;

  /// `keys`: what stands in the driver's section beside its name.
  template <typename D>
  static Bench of(const std::string& keys = "") {
    return Bench{keys, [](Setup& setup) -> std::unique_ptr<Driver> { return std::make_unique<D>(setup); }};
  }

  Bench(const std::string& keys, const std::function<std::unique_ptr<Driver>(Setup&)>& create, double rate_hz = 100) {
    auto setup =
        std::make_unique<Setup>(parse_config("driver ( name \"driver\" " + keys + " )", "test.cfg").drivers.at(0));
    auto driver = create(*setup);
    host_ = std::make_unique<DriverHost>("driver", std::move(setup), std::move(driver),
                                         HostOptions{.rate_hz = rate_hz, .motion = {}});
    link_ = &host_->add_link(&woken_);
    for (std::size_t port = 0; port < host_->ports().size(); ++port) {
      subscribed_ = request(player::Subscribe{.access = player::Access::open}, port);
    }
  }

  /// What the last subscription was answered.
  [[nodiscard]] const Result<AnyReply>& subscribed() const { return *subscribed_; }

  template <CommandType M>
  void send(const M& command, std::size_t port = 0) {
    put(host_->lane(*link_, port, AnyCommand{command}), port, AnyCommand{command});
    cycle();
  }

  /// To the last request; it may come later than ask() returned.
  [[nodiscard]] const std::optional<Result<AnyReply>>& last_reply() const { return reply_; }

  /// Repeat a set-point often enough for its lease.
  template <CommandType M>
  void drive(const M& command, Duration duration) {
    for (const Time end = now_ + duration; now_ < end;) {
      send(command);
      run(std::min<Duration>(std::chrono::milliseconds{100}, end - now_));
    }
  }

  template <RequestType M>
  Result<typename M::Reply> ask(const M& message, std::size_t port = 0) {
    const Result<AnyReply> reply = request(message, port);
    if (!reply) return reply.error();
    return std::get<typename M::Reply>(*reply);
  }

  void run(Duration duration) {
    for (const Time end = now_ + duration; now_ < end;) {
      now_ = std::min(now_ + std::chrono::milliseconds{1}, end);
      cycle();
    }
  }

  /// The newest of its kind; fails the test when there is none.
  template <DataType D>
  [[nodiscard]] D latest() const {
    for (auto sample = samples_.rbegin(); sample != samples_.rend(); ++sample) {
      if (const D* data = std::get_if<D>(&sample->data)) return *data;
    }
    ADD_FAILURE() << "nothing published of " << D::message.name;
    return {};
  }

  DriverHost& host() { return *host_; }
  [[nodiscard]] Time now() const { return now_; }
  std::vector<Sample>& samples() { return samples_; }
  /// What was told to the clients since the last call, a line each.
  std::string events() { return std::exchange(events_, {}); }

 private:
  Result<AnyReply> request(AnyRequest message, std::size_t port) {
    reply_.reset();
    put(Mailbox<Inbound, 256>::no_lane, port, std::move(message));
    cycle();
    return reply_.value_or(Error{std::errc::timed_out, "no reply"});
  }

  template <typename Message>
  void put(std::size_t lane, std::size_t port, Message message) {
    ASSERT_TRUE(link_->down.put(lane, [&](Inbound& inbound) {
      inbound = {
          .session = session, .port = port, .arrived = now_, .reply_to = {.session = session}, .message = message};
    }));
  }

  void cycle() {
    host_->cycle(now_);
    link_->up.drain([&](Outbound& out) {
      if (const Sample* sample = std::get_if<Sample>(&out)) {
        samples_.push_back(*sample);
      } else if (const Reply* reply = std::get_if<Reply>(&out)) {
        reply_ = reply->answer;
      } else if (const auto* event = std::get_if<player::Event>(&std::get<Notice>(out).message)) {
        events_ += std::string{event->text.view()} + '\n';
      }
    });
  }

  Wakeup woken_;
  std::unique_ptr<DriverHost> host_;
  Link* link_ = nullptr;
  Time now_ = Time{std::chrono::seconds{1000}};
  std::optional<Result<AnyReply>> subscribed_;
  std::optional<Result<AnyReply>> reply_;
  std::vector<Sample> samples_;
  std::string events_;
};

}  // namespace regista
