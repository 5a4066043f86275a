// SPDX-License-Identifier: Apache-2.0
#include <regista/xdr/error.hpp>
#include <string>

namespace regista::xdr {

const std::error_category& error_category() noexcept {
  static const class Category final : public std::error_category {
    [[nodiscard]] const char* name() const noexcept override { return "player wire"; }
    [[nodiscard]] std::string message(int code) const override {
      switch (static_cast<Errc>(code)) {
        case Errc::short_body:
          return "message too short";
        case Errc::bad_count:
          return "array count out of range";
        case Errc::oversize:
          return "message too large";
        case Errc::unknown_interface:
          return "unknown interface";
        case Errc::unknown_message:
          return "unknown message";
      }
      return "unknown error";
    }
  } category;
  return category;
}

}  // namespace regista::xdr
