// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/xdr/codec.hpp>

namespace regista::xdr {

/// One message of a stream. `body` points into the framer's buffer.
struct Frame {
  Header header;
  std::span<const std::byte> body;
};

/// Cuts a stream of bytes into messages, however the bytes arrive. Passive: the owner reads into `space()`, says how
/// much came with `commit()`, and takes frames until there is none.
///
/// The buffer grows with the bytes that came, not with what a header claims.
class Framer {
 public:
  /// `max_body`: a header that claims more is an error [bytes].
  explicit Framer(std::size_t max_body = std::size_t{1} << 20) : max_body_{max_body} {}

  /// Where the next bytes go; never empty. Frames taken before are gone.
  std::span<std::byte> space();
  /// So many bytes of `space()` were filled.
  void commit(std::size_t size) { filled_ += size; }

  /// The next whole message; empty when more bytes are needed. After an error (`oversize`) the stream cannot be
  /// followed any further: "size 4294967295 > limit 1 MiB at byte 1234".
  Result<std::optional<Frame>> next();

  /// A message has begun and is not complete.
  [[nodiscard]] bool within_message() const { return filled_ > taken_; }

 private:
  std::vector<std::byte> buffer_;
  std::size_t taken_ = 0;   ///< bytes of the buffer that were given out
  std::size_t filled_ = 0;  ///< bytes of the buffer that have come
  std::size_t max_body_;
  std::uint64_t stream_position_ = 0;  ///< of `buffer_[0]`
};

}  // namespace regista::xdr
