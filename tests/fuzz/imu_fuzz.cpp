// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "microstrain.hpp"

namespace {

using namespace regista::microstrain;

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

std::vector<Packet> read(Reader& reader, std::span<const std::uint8_t> bytes, std::size_t piece) {
  std::vector<Packet> packets;
  while (!bytes.empty()) {
    const auto space = reader.space();
    const std::size_t count = std::min({piece, space.size(), bytes.size()});
    require(count > 0);
    std::copy_n(bytes.begin(), count, space.begin());
    reader.filled(count);
    bytes = bytes.subspan(count);
    while (const auto packet = reader.next()) packets.push_back(*packet);
  }
  return packets;
}

bool finite(std::span<const float> values) {
  return std::ranges::all_of(values, [](float value) { return std::isfinite(value); });
}

}  // namespace

/// Any bytes, in any pieces: the same packets, and no number in them that is none. The first byte says the protocol and
/// the length of the pieces.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const Protocol protocol = (data[0] & 1) != 0 ? Protocol::mip : Protocol::single_byte;
  const std::span bytes{data + 1, size - 1};
  Reader whole{protocol};
  Reader pieces{protocol};
  const auto packets = read(whole, bytes, 700);
  const auto again = read(pieces, bytes, 1 + (data[0] >> 1));
  require(packets.size() == again.size());
  for (std::size_t i = 0; i < packets.size(); ++i) {
    require(packets[i].sample == again[i].sample && packets[i].answer == again[i].answer);
    if (!packets[i].sample) continue;
    const Sample& sample = *packets[i].sample;
    require(finite(sample.acceleration_g) && finite(sample.rate_radps) && finite(sample.field_gauss) &&
            finite(sample.sensor_from_earth));
  }
  require(whole.skipped() == pieces.skipped() && whole.skipped() <= bytes.size());
  return 0;
}
