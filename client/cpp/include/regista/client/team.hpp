// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <list>
#include <regista/client/robot.hpp>

namespace regista::client {

/// Several robots, one loop:
///
///     Team team;
///     for (const char* host : {"robot1", "robot2"}) team.add(host);
///     while (team.read(100ms)) {
///       for (Robot& robot : team) robot.position2d().set_velocity({.w = 0.5});
///     }
class Team {
 public:
  /// Connect one more. The reference stays valid as long as the team.
  Robot& add(std::string host, std::uint16_t port = 6665, Options options = {}) {
    return robots_.emplace_back(std::move(host), port, std::move(options));
  }

  /// Take in what came from any robot, waiting up to `timeout` for the first. False: none came in time. When robots
  /// fail, the others are read before the first failure is thrown.
  bool read(Duration timeout);

  [[nodiscard]] std::size_t size() const { return robots_.size(); }
  [[nodiscard]] auto begin() { return robots_.begin(); }
  [[nodiscard]] auto end() { return robots_.end(); }

 private:
  std::list<Robot> robots_;
};

}  // namespace regista::client
