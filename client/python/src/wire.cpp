// SPDX-License-Identifier: Apache-2.0
#include "wire.hpp"

#include "message_json.hpp"

namespace regista::python {

namespace py = pybind11;

py::tuple wire_decode(const py::bytes& bytes) {
  const auto text = static_cast<std::string_view>(bytes);
  auto rest = std::as_bytes(std::span{text});
  py::list messages;
  while (rest.size() >= xdr::header_size) {
    const auto failed = [&](const std::string& what) {
      throw py::value_error{"byte " + std::to_string(text.size() - rest.size()) + ": " + what};
    };
    xdr::Header header;
    if (const Result<> decoded = xdr::decode(rest, header); !decoded) failed(decoded.error().message());
    if (rest.size() - xdr::header_size < header.size) break;
    std::size_t used = 0;
    const Result<message_json::Json> message =
        message_json::decode(header, rest.subspan(xdr::header_size, header.size), used);
    if (!message) failed(message.error().message());
    messages.append(message->dump());
    rest = rest.subspan(xdr::header_size + header.size);
  }
  return py::make_tuple(messages, rest.size());
}

py::bytes wire_encode(const std::string& json) {
  try {
    const Result<std::vector<std::byte>> bytes = message_json::encode(message_json::Json::parse(json));
    if (!bytes) throw py::value_error{bytes.error().message()};
    return {reinterpret_cast<const char*>(bytes->data()), bytes->size()};
  } catch (const message_json::Mismatch& error) {
    throw py::value_error{error.what()};
  } catch (const nlohmann::json::exception& error) {  // a number beyond the largest double
    throw py::value_error{error.what()};
  }
}

}  // namespace regista::python
