// SPDX-License-Identifier: Apache-2.0
#include <regista/xdr/codec.hpp>

namespace regista::xdr::detail {

bool Reader::fail(Errc code, std::size_t needed) {
  code_ = code;
  needed_ = needed;
  return false;
}

bool Reader::get_count(std::size_t& count, std::size_t element_size, std::size_t max_count) {
  std::uint32_t declared = 0;
  std::uint32_t length = 0;
  if (!get(declared) || !get(length)) return false;
  const bool fits = element_size == 1 ? padded(length) <= left() : length <= left() / element_size;
  // Stock decoders hold an array against its buffer or, when they allocate one, against the member; never against both.
  const std::size_t limit = max_count == unlimited ? declared : max_count;
  if (length > limit || !fits) {
    at_ -= 4;  // to the length, which the error is about
    return fail(Errc::bad_count, length);
  }
  count = length;
  return true;
}

Error Reader::error() const {
  const std::size_t at = position();
  const std::string field = path_.empty() ? "" : " in `" + path_ + "`";
  if (code_ == Errc::short_body) {
    return {code_, "body of " + std::to_string(end_ - begin_) + " bytes ends" + field + ", which takes bytes " +
                       std::to_string(at) + " to " + std::to_string(at + needed_)};
  }
  return {code_, "array of " + std::to_string(needed_) + " elements at byte " + std::to_string(at) + field +
                     " does not fit its count or the " + std::to_string(end_ - begin_) + " bytes of the body"};
}

}  // namespace regista::xdr::detail
