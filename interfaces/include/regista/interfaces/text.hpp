// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <utility>

namespace regista {

/// A string as Player sends it: bytes whose count includes the terminating NUL. Stock receivers call strcmp on them
/// without looking, so a Text made from a string carries its NUL; one that came from a peer is kept as it was.
class Text {
 public:
  Text() = default;
  Text(std::string_view text) {  // NOLINT(google-explicit-constructor)
    bytes_.reserve(text.size() + 1);
    bytes_.append(text).push_back('\0');
  }
  Text(const char* text) : Text{std::string_view{text}} {}         // NOLINT(google-explicit-constructor)
  Text(const std::string& text) : Text{std::string_view{text}} {}  // NOLINT(google-explicit-constructor)

  /// Take the bytes of the wire as they are, with or without a NUL.
  static Text from_bytes(std::string bytes) {
    Text text;
    text.bytes_ = std::move(bytes);
    return text;
  }

  /// What a person reads: all before the first NUL.
  [[nodiscard]] std::string_view view() const {
    const std::string_view all{bytes_};
    return all.substr(0, all.find('\0'));
  }
  /// What travels, the NUL included.
  [[nodiscard]] const std::string& bytes() const { return bytes_; }
  std::string& bytes() { return bytes_; }

  friend bool operator==(const Text&, const Text&) = default;

 private:
  std::string bytes_;
};

}  // namespace regista
