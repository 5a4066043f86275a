// SPDX-License-Identifier: Apache-2.0
#include <regista/xdr/framer.hpp>

namespace regista::xdr {

namespace {

// A read of this size takes a hundred commands at once; an idle client keeps one such buffer.
constexpr std::size_t usual_size = 8 * 1024;

std::string human(std::size_t bytes) {
  constexpr std::size_t mib = std::size_t{1} << 20;
  return bytes % mib == 0 ? std::to_string(bytes / mib) + " MiB" : std::to_string(bytes) + " bytes";
}

}  // namespace

std::span<std::byte> Framer::space() {
  if (taken_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + taken_, filled_ - taken_);
    stream_position_ += taken_;
    filled_ -= taken_;
    taken_ = 0;
  }
  if (filled_ == 0 && buffer_.size() > usual_size) buffer_ = {};  // a large message has passed
  if (filled_ == buffer_.size()) buffer_.resize(std::max(usual_size, buffer_.size() * 2));
  return std::span{buffer_}.subspan(filled_);
}

Result<std::optional<Frame>> Framer::next() {
  const auto bytes = std::span<const std::byte>{buffer_}.subspan(taken_, filled_ - taken_);
  if (bytes.size() < header_size) return std::optional<Frame>{};
  Frame frame;
  if (const Result<> decoded = decode(bytes, frame.header); !decoded) return decoded.error();
  if (frame.header.size > max_body_) {
    constexpr std::size_t offset_of_size = 36;
    return Error{Errc::oversize, "size " + std::to_string(frame.header.size) + " > limit " + human(max_body_) +
                                     " at byte " + std::to_string(stream_position_ + taken_ + offset_of_size)};
  }
  if (bytes.size() - header_size < frame.header.size) return std::optional<Frame>{};
  frame.body = bytes.subspan(header_size, frame.header.size);
  taken_ += header_size + frame.header.size;
  return std::optional{frame};
}

}  // namespace regista::xdr
