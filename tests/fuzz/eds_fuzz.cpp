// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>
#include <regista/canopen/eds.hpp>
#include <string>

using namespace regista;
using namespace regista::canopen;

namespace {

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

}  // namespace

/// What can be read has values that go to text and back; what cannot names the file.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ObjectDictionary dictionary;
  try {
    dictionary = parse_eds({reinterpret_cast<const char*>(data), size}, "fuzz.eds", NodeId{5});
  } catch (const EdsError& error) {
    require(std::string{error.what()}.starts_with("fuzz.eds:"));
    return 0;
  }
  for (const auto& [object, entry] : dictionary.objects) {
    require(size_of(entry.type) == 0 || entry.value.size() == size_of(entry.type));
    const std::string text = format(entry.type, entry.value);
    const bool exact =
        entry.type != DataType::real32 && entry.type != DataType::real64 && entry.type != DataType::visible_string;
    if (exact) {
      const auto again = encode(entry.type, text);
      require(again && *again == entry.value);
    }
    require(dictionary.parse(to_string(object)) && *dictionary.parse(to_string(object)) == object);
  }
  const auto writes = dictionary.configuration();
  require(static_cast<bool>(parse_concise_dcf(concise_dcf(writes))));
  return 0;
}
