// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/canopen/can_frame.hpp>

namespace regista::canopen {

/// Part of an object in a PDO.
struct MappedObject {
  ObjectIndex object;
  std::uint8_t bits = 0;  ///< 1 to 64
  /// As objects 1600 and 1A00 hold it (CiA 301, 7.5.2.36).
  [[nodiscard]] std::uint32_t code() const {
    return std::uint32_t{object.index} << 16 | std::uint32_t{object.sub} << 8 | bits;
  }
  static MappedObject from_code(std::uint32_t code) {
    return {{static_cast<std::uint16_t>(code >> 16), static_cast<std::uint8_t>(code >> 8)},
            static_cast<std::uint8_t>(code)};
  }
  bool operator==(const MappedObject&) const = default;
};

/// Which objects share the 64 bits of a PDO, in order.
class PdoMapping {
 public:
  PdoMapping() = default;
  /// Throws std::invalid_argument when they take more than 64 bits, or one takes none.
  PdoMapping(std::initializer_list<MappedObject> objects) : PdoMapping{std::vector<MappedObject>(objects)} {}
  explicit PdoMapping(std::vector<MappedObject> objects);

  [[nodiscard]] std::span<const MappedObject> objects() const { return objects_; }
  [[nodiscard]] std::uint8_t size_bytes() const { return static_cast<std::uint8_t>((bits_ + 7) / 8); }
  /// The place of an object. Throws std::invalid_argument if it is not mapped.
  [[nodiscard]] std::size_t position(ObjectIndex object) const;

  /// The object at a position, in a PDO's bytes; 0 when these are too short.
  [[nodiscard]] std::uint64_t get(ByteView bytes, std::size_t position) const;
  [[nodiscard]] std::int64_t get_signed(ByteView bytes, std::size_t position) const;
  /// Cuts the value to the object's bits.
  void set(std::span<std::uint8_t, 8> bytes, std::size_t position, std::uint64_t value) const;

 private:
  std::vector<MappedObject> objects_;
  std::vector<int> offsets_;  ///< [bits]
  int bits_ = 0;
};

/// As the node sees it: what it receives and what it transmits.
enum class PdoDirection : std::uint8_t { receive, transmit };

/// When a PDO goes, or takes effect (CiA 301, tables 67 and 70).
namespace transmission {
inline constexpr std::uint8_t synchronous_acyclic = 0;
/// Every n-th SYNC, n from 1 to 240.
constexpr std::uint8_t every_sync(std::uint8_t n) { return n; }
inline constexpr std::uint8_t remote_synchronous = 252;
inline constexpr std::uint8_t remote = 253;
inline constexpr std::uint8_t event_maker = 254;
inline constexpr std::uint8_t event = 255;
}  // namespace transmission

/// A PDO of a node as its dictionary is to hold it: 1400 and 1600 and on, or 1800 and 1A00 and on.
/// What is empty is not written: many nodes lack these entries.
struct PdoSettings {
  PdoDirection direction = PdoDirection::receive;
  int number = 1;            ///< 1 to 512
  std::uint32_t cob_id = 0;  ///< 11 bits; 0: as in the pre-defined connection set (numbers 1 to 4)
  std::uint8_t transmission = transmission::event;
  std::optional<std::uint16_t> inhibit_100us{};   ///< of a transmit PDO: the shortest time between two
  std::optional<std::uint16_t> event_timer_ms{};  ///< transmit: at least so often; receive: the deadline
  std::optional<std::uint8_t> sync_start{};       ///< counter of the SYNC to begin with
  bool remote_allowed = false;                    ///< of a transmit PDO: may be asked for by a remote frame
  PdoMapping mapping{};

  [[nodiscard]] std::uint32_t effective_cob_id(NodeId node) const;
};

/// One entry of a node's dictionary to write.
struct SdoWrite {
  ObjectIndex object;
  Bytes value;
  bool only_if_different = false;  ///< read first: for what wears out memory or needs another state to be written
  bool verify = true;              ///< read back when all is written
  bool optional = false;           ///< left out when the node has no such object
};

template <typename T>
SdoWrite sdo_write(ObjectIndex object, T value) {
  return {object, le_bytes(static_cast<std::uint64_t>(value), sizeof(T))};
}

/// The writes that set a PDO up, in the order that CiA 301 asks for (7.5.2.36): switch off, parameters, mapping to
/// zero, map, number of objects, switch on.
std::vector<SdoWrite> pdo_writes(NodeId node, const PdoSettings& settings);
/// For a node that does not let its PDOs be set up so: what differs is written as it stands. When the node's mapping is
/// the wanted one, none of it is.
std::vector<SdoWrite> fixed_pdo_writes(NodeId node, const PdoSettings& settings);
/// The one write that switches a PDO off.
SdoWrite pdo_off(NodeId node, PdoDirection direction, int number);

}  // namespace regista::canopen
