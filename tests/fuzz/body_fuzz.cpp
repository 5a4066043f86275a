// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>
#include <regista/xdr/registry.hpp>

using namespace regista;

namespace {

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

template <typename Body>
std::vector<std::byte> encoded(const xdr::Header& header, const Body& body) {
  std::vector<std::byte> bytes(xdr::header_size + xdr::encoded_size(body));
  require(xdr::encode_message(header, body, bytes) == bytes.size());
  return bytes;
}

/// What can be decoded encodes to a body that decodes to the same bits; what cannot has a reason.
template <typename Body>
void check(const xdr::Header& header, std::span<const std::byte> body) {
  Body value;
  std::size_t used = 0;
  if (const Result<> decoded = xdr::decode(body, value, &used); !decoded) {
    require(decoded.error().code == xdr::Errc::short_body || decoded.error().code == xdr::Errc::bad_count);
    require(!decoded.error().what.empty());
    return;
  }
  require(used <= body.size());
  const std::vector<std::byte> once = encoded(header, value);
  require(once.size() - xdr::header_size == used);
  Body again;
  require(static_cast<bool>(xdr::decode(std::span{once}.subspan(xdr::header_size), again, &used)));
  require(used == once.size() - xdr::header_size);
  require(encoded(header, again) == once);
}

}  // namespace

/// A header chooses the message, the rest is its body: every message of every interface.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto input = std::as_bytes(std::span{data, size});
  xdr::Header header;
  if (!xdr::decode(input, header)) return 0;
  const auto body = input.subspan(xdr::header_size);
  const bool known = xdr::with_body_type(header, [&]<typename Body>() { check<Body>(header, body); });
  if (!known) require(!xdr::unknown_message(header).what.empty());

  AnyCommand command;
  const Result<> decoded = xdr::decode_any(header, body, command);
  require(decoded || !decoded.error().what.empty());
  return 0;
}
