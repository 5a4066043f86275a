// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <regista/core/time.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace regista::testing {

using Bytes = std::vector<std::byte>;

/// From hexadecimal digits; blanks are skipped.
[[nodiscard]] Bytes from_hex(std::string_view digits);
[[nodiscard]] std::string to_hex(const Bytes& bytes);

/// Packs numbers as the wire has them, big-endian, without the server's codec: `Pack{}.u32(4).f64(0.5).bytes`.
struct Pack {
  Bytes bytes;
  Pack& u32(std::uint32_t value);
  Pack& f64(double value);
  Pack& raw(const Bytes& more);
};

/// A message as it stands on the wire: the fields of docs/protocol.md.
struct RawMessage {
  std::uint32_t host = 0;
  std::uint32_t robot = 0;
  std::uint32_t interface = 0;
  std::uint32_t index = 0;
  std::uint32_t type = 0;
  std::uint32_t subtype = 0;
  double timestamp_s = 0;
  std::uint32_t sequence = 0;
  Bytes body{};

  /// With the size of the body, unless another is claimed.
  [[nodiscard]] Bytes encode(std::optional<std::uint32_t> claimed_size = {}) const;
  /// The 32-bit word at an offset of the body; throws std::out_of_range.
  [[nodiscard]] std::uint32_t u32(std::size_t offset) const;
  [[nodiscard]] double f64(std::size_t offset) const;
};

/// A client that shares no code with the server's side of the wire: a socket, and bytes that a test makes up.
/// Everything throws std::runtime_error when it fails or takes longer than its time-out.
class RawClient {
 public:
  static constexpr Duration patience = std::chrono::seconds{10};

  /// Connects and takes the banner. `receive_buffer`: of the socket [bytes]; 0: the system's.
  explicit RawClient(std::uint16_t port, int receive_buffer = 0);
  ~RawClient();
  RawClient(RawClient&& other) noexcept
      : socket_{std::exchange(other.socket_, -1)}, banner_{std::move(other.banner_)} {}
  RawClient& operator=(RawClient&&) = delete;

  [[nodiscard]] const std::string& banner() const { return banner_; }
  [[nodiscard]] int socket() const { return socket_; }

  void send(const Bytes& bytes) const;
  void send(const RawMessage& message) const { send(message.encode()); }
  /// As much as the peer takes at once, less than all when it does not read; SIZE_MAX: the connection is gone.
  [[nodiscard]] std::size_t try_send(const Bytes& bytes) const;
  [[nodiscard]] Bytes receive(std::size_t size, Duration timeout = patience) const;
  [[nodiscard]] RawMessage receive_message(Duration timeout = patience) const;
  /// Nothing to be read comes within `duration`.
  [[nodiscard]] bool silent_for(Duration duration) const;
  /// Reads on and disregards it, until the peer closes. False: it did not.
  [[nodiscard]] bool closed_by_peer(Duration timeout = patience) const;

  /// No more will be sent, but answers are read (FIN).
  void end_output() const;
  void close();
  /// Close without a farewell (RST).
  void reset();

 private:
  int socket_ = -1;
  std::string banner_;
};

}  // namespace regista::testing
