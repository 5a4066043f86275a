// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cassert>
#include <regista/canopen/pdo.hpp>
#include <stdexcept>

namespace regista::canopen {
namespace {

constexpr std::uint32_t off = 0x80000000;        // bit 31 of a COB-ID entry: the PDO does not exist
constexpr std::uint32_t no_remote = 0x40000000;  // bit 30, of a transmit PDO

constexpr std::uint64_t mask(int bits) { return bits >= 64 ? ~0ULL : (1ULL << bits) - 1; }

std::uint16_t communication(PdoDirection direction, int number) {
  return static_cast<std::uint16_t>((direction == PdoDirection::receive ? 0x1400 : 0x1800) + number - 1);
}

}  // namespace

PdoMapping::PdoMapping(std::vector<MappedObject> objects) : objects_{std::move(objects)} {
  for (const MappedObject& object : objects_) {
    if (object.bits < 1 || object.bits > 64 || bits_ + object.bits > 64) {
      throw std::invalid_argument{"PDO mapping: " + to_string(object.object) + " with " + std::to_string(object.bits) +
                                  " bits after " + std::to_string(bits_) + ": a PDO has 64"};
    }
    offsets_.push_back(bits_);
    bits_ += object.bits;
  }
}

std::size_t PdoMapping::position(ObjectIndex object) const {
  const auto found = std::ranges::find(objects_, object, &MappedObject::object);
  if (found == objects_.end()) throw std::invalid_argument{"PDO mapping: " + to_string(object) + " is not in it"};
  return static_cast<std::size_t>(found - objects_.begin());
}

std::uint64_t PdoMapping::get(ByteView bytes, std::size_t position) const {
  assert(position < objects_.size());
  if (offsets_[position] + objects_[position].bits > static_cast<int>(8 * bytes.size())) return 0;
  return get_le(bytes) >> offsets_[position] & mask(objects_[position].bits);
}

std::int64_t PdoMapping::get_signed(ByteView bytes, std::size_t position) const {
  const std::uint64_t sign = 1ULL << (objects_[position].bits - 1);
  return static_cast<std::int64_t>((get(bytes, position) ^ sign) - sign);
}

void PdoMapping::set(std::span<std::uint8_t, 8> bytes, std::size_t position, std::uint64_t value) const {
  assert(position < objects_.size());
  const std::uint64_t field = mask(objects_[position].bits) << offsets_[position];
  const std::uint64_t all = (get_le(bytes) & ~field) | (value << offsets_[position] & field);
  for (std::size_t i = 0; i < 8; ++i) bytes[i] = static_cast<std::uint8_t>(all >> (8 * i));
}

std::uint32_t PdoSettings::effective_cob_id(NodeId node) const {
  if (cob_id != 0) return cob_id;
  // CiA 301, 7.3.5: 0x180, 0x280, … and 0x200, 0x300, … plus the node id.
  const int base = direction == PdoDirection::receive ? 0x200 : 0x180;
  return static_cast<std::uint32_t>(base + (number - 1) * 0x100 + node);
}

std::vector<SdoWrite> pdo_writes(NodeId node, const PdoSettings& settings) {
  if (settings.number < 1 || settings.number > 512 || (settings.cob_id == 0 && settings.number > 4)) {
    throw std::invalid_argument{"PDO " + std::to_string(settings.number) +
                                ": the number is 1 to 512, and above 4 it needs a COB-ID of its own"};
  }
  const std::uint16_t parameters = communication(settings.direction, settings.number);
  const auto mapping = static_cast<std::uint16_t>(parameters + 0x200);
  const bool transmits = settings.direction == PdoDirection::transmit;
  const std::uint32_t cob_id =
      settings.effective_cob_id(node) | (transmits && !settings.remote_allowed ? no_remote : 0U);

  std::vector<SdoWrite> writes;
  writes.push_back(sdo_write<std::uint32_t>({parameters, 1}, cob_id | off));
  writes.push_back(sdo_write<std::uint8_t>({parameters, 2}, settings.transmission));
  if (settings.inhibit_100us) {
    writes.push_back(sdo_write<std::uint16_t>({parameters, 3}, *settings.inhibit_100us));
    writes.back().optional = true;  // without it more come, and that is all
  }
  if (settings.event_timer_ms) writes.push_back(sdo_write<std::uint16_t>({parameters, 5}, *settings.event_timer_ms));
  if (settings.sync_start) writes.push_back(sdo_write<std::uint8_t>({parameters, 6}, *settings.sync_start));
  writes.push_back(sdo_write<std::uint8_t>({mapping, 0}, 0));
  std::uint8_t count = 0;
  for (const MappedObject& object : settings.mapping.objects()) {
    writes.push_back(sdo_write<std::uint32_t>({mapping, ++count}, object.code()));
  }
  writes.push_back(sdo_write<std::uint8_t>({mapping, 0}, count));
  writes.push_back(sdo_write<std::uint32_t>({parameters, 1}, cob_id));
  return writes;
}

std::vector<SdoWrite> fixed_pdo_writes(NodeId node, const PdoSettings& settings) {
  const std::vector<SdoWrite> writes = pdo_writes(node, settings);
  std::vector<SdoWrite> last;
  for (auto write = writes.begin(); write != writes.end(); ++write) {
    // Not the steps on the way: PDO off, no objects in it.
    if (std::ranges::find(write + 1, writes.end(), write->object, &SdoWrite::object) != writes.end()) continue;
    last.push_back(*write);
    last.back().only_if_different = true;
  }
  return last;
}

SdoWrite pdo_off(NodeId node, PdoDirection direction, int number) {
  const PdoSettings settings{.direction = direction, .number = number};
  const std::uint32_t cob_id = number <= 4 ? settings.effective_cob_id(node) : 0U;
  SdoWrite write = sdo_write<std::uint32_t>({communication(direction, number), 1}, cob_id | off);
  write.verify = false;  // nodes keep other bits of a PDO that does not exist
  return write;
}

}  // namespace regista::canopen
