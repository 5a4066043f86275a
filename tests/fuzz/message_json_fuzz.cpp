// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "../../programs/message_json.hpp"

using namespace regista;

namespace {

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

}  // namespace

/// JSON that encodes decodes to JSON that encodes to the same bytes; other text is refused by the two exceptions.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const auto bytes = message_json::encode(message_json::Json::parse(data, data + size));
    if (!bytes) return 0;
    xdr::Header header;
    require(static_cast<bool>(xdr::decode(*bytes, header)));
    const auto body = std::span{*bytes}.subspan(xdr::header_size);
    std::size_t used = 0;
    const auto message = message_json::decode(header, body, used);
    require(message && used == body.size());
    const auto again = message_json::encode(message_json::Json::parse(message->dump()));
    require(again && *again == *bytes);
  } catch (const nlohmann::json::exception&) {
    return 0;
  } catch (const message_json::Mismatch&) {
    return 0;
  }
  return 0;
}
