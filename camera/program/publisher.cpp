// SPDX-License-Identifier: Apache-2.0
#include "publisher.hpp"

namespace regista::camera {

namespace {

using namespace std::chrono_literals;
constexpr Duration geometry_period = 3s;  // as SSL-Vision

}  // namespace

Publisher::Publisher(const ssl::Group& group, const std::vector<std::string>& interfaces, ssl::Geometry geometry) {
  for (const std::string& interface : interfaces) senders_.emplace_back(group, interface);
  geometry_.geometry = std::move(geometry);
}

void Publisher::send(const ssl::Detection& detection, Time now) {
  if (now >= next_geometry_) {
    next_geometry_ = now + geometry_period;
    send(geometry_);
  }
  frame_.detection = detection;
  send(frame_);
}

void Publisher::send(const ssl::VisionPacket& packet) {
  const std::vector<std::byte> bytes = ssl::encode(packet);
  for (ssl::MulticastSender& sender : senders_) {
    if (!sender.send(bytes)) ++lost_;
  }
}

}  // namespace regista::camera
