// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/core/time.hpp>
#include <regista/ssl/multicast.hpp>
#include <regista/ssl/vision.hpp>

namespace regista::camera {

/// Sends what a camera sees as SSL-Vision does: each detection, and the geometry every three seconds.
class Publisher {
 public:
  /// Throws std::system_error when there is no such interface.
  Publisher(const ssl::Group& group, const std::vector<std::string>& interfaces, ssl::Geometry geometry);

  void send(const ssl::Detection& detection, Time now);

  /// Datagrams that an interface refused, because it is down or its queue is full.
  [[nodiscard]] std::size_t lost() const { return lost_; }

 private:
  void send(const ssl::VisionPacket& packet);

  std::vector<ssl::MulticastSender> senders_;
  ssl::VisionPacket geometry_;
  ssl::VisionPacket frame_;
  Time next_geometry_ = Time::min();
  std::size_t lost_ = 0;
};

}  // namespace regista::camera
