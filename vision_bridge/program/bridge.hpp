// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <list>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <regista/ssl/referee.hpp>
#include <regista/vision/delay_estimator.hpp>
#include <set>

#include "recorder.hpp"
#include "robot_link.hpp"
#include "status_server.hpp"

namespace regista::vision {

enum class LogLevel : std::uint8_t { info, warning };

/// From the cameras to the robots: one thread, one loop, nothing in it blocks.
class Bridge {
 public:
  using Log = std::function<void(LogLevel level, const std::string& text)>;

  struct Options {
    std::optional<std::filesystem::path> replay;  ///< a log file instead of the network
    std::optional<std::filesystem::path> record;
  };

  /// Throws std::exception, naming it, for a port, interface or file that cannot be had.
  Bridge(BridgeConfig config, const Options& options, Log log);
  ~Bridge();
  Bridge(const Bridge&) = delete;
  Bridge& operator=(const Bridge&) = delete;

  /// Until stop(), or the end of what is replayed.
  void run();
  /// From any thread, and from signal handlers.
  void stop() noexcept;

 private:
  struct Stream {
    ssl::LogType type;
    ssl::MulticastReceiver receiver;
  };
  /// A camera, as it comes in by the network.
  struct Heard {
    std::uint32_t camera = 0;
    std::uint64_t source = 0;
    std::set<int> interfaces;
    bool announced = false;
  };

  [[nodiscard]] RobotLink::OnTurn listen_to_turns(ssl::RobotId id);
  void listen(ssl::LogType type, const ssl::Group& group);
  void receive(Stream& stream, Time now);
  void take(ssl::LogType type, const ssl::MulticastReceiver::Datagram& datagram, Time arrival);
  void take_vision(const ssl::MulticastReceiver::Datagram& datagram, Time arrival);
  void take_tracked(std::span<const std::byte> bytes, Time arrival);
  void take_referee(std::span<const std::byte> bytes, Time arrival);
  Heard& heard(std::uint32_t camera, std::uint64_t source);
  RobotLink*& link_of(ssl::RobotId id);
  void learn_delay(const ssl::Detection& frame);
  void use_delay();
  void publish(Time now);
  void replay_due(Time now);
  void on_time(Time now);
  void announce_cameras(Time now);
  void halt_robots(Time now);
  [[nodiscard]] std::vector<std::string> warnings(Time now) const;
  [[nodiscard]] nlohmann::ordered_json status(Time now) const;

  BridgeConfig config_;
  Log log_;
  ssl::Descriptor stop_;
  std::list<Stream> streams_;
  std::vector<ssl::MulticastSender> publishers_;
  std::unique_ptr<Recorder> recorder_;
  std::unique_ptr<StatusServer> status_server_;
  std::unique_ptr<ssl::LogReader> replay_;
  std::optional<ssl::LogRecord> next_record_;
  std::int64_t replay_offset_ns_ = 0;  ///< our clock minus the log's

  ssl::VisionDecoder decoder_;
  Tracker tracker_;
  std::unique_ptr<DelayEstimator> delay_;  ///< none: it is not learnt
  bool delay_known_ = false;
  std::list<RobotLink> links_;
  std::array<RobotLink*, ssl::most_robots> by_id_{};
  std::vector<Heard> heard_;

  std::string own_uuid_;
  std::string tracker_uuid_;
  Time tracker_heard_{};
  std::optional<ssl::Referee> referee_;
  Time referee_heard_{};
  Time halted_again_{};
  Time published_{};
  std::uint32_t published_frames_ = 0;
  Time checked_{};
  Time joined_{};
  Time started_;
  std::set<std::string> warned_;
  std::optional<ssl::Geometry> field_;
  std::uint64_t undecodable_ = 0;
};

}  // namespace regista::vision
