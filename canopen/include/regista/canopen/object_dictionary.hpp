// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <regista/canopen/pdo.hpp>
#include <regista/core/result.hpp>
#include <string_view>

namespace regista::canopen {

/// With the numbers of CiA 301, table 44.
enum class DataType : std::uint16_t {
  boolean = 0x01,
  integer8 = 0x02,
  integer16 = 0x03,
  integer32 = 0x04,
  unsigned8 = 0x05,
  unsigned16 = 0x06,
  unsigned32 = 0x07,
  real32 = 0x08,
  visible_string = 0x09,
  octet_string = 0x0A,
  unicode_string = 0x0B,
  time_of_day = 0x0C,
  time_difference = 0x0D,
  domain = 0x0F,
  integer24 = 0x10,
  real64 = 0x11,
  integer40 = 0x12,
  integer48 = 0x13,
  integer56 = 0x14,
  integer64 = 0x15,
  unsigned24 = 0x16,
  unsigned40 = 0x18,
  unsigned48 = 0x19,
  unsigned56 = 0x1A,
  unsigned64 = 0x1B,
};
/// [bytes]; 0 for those of any length.
std::size_t size_of(DataType type);
bool is_signed(DataType type);

/// Bytes from text: numbers in decimal, hex (0x) or octal (0), reals, strings as they stand, other types as pairs of
/// hex digits. Fails with `invalid_argument` or `result_out_of_range`, and says why.
Result<Bytes> encode(DataType type, std::string_view text);
/// The other way; for people. Bytes of the wrong length are shown as hex.
std::string format(DataType type, ByteView bytes);

enum class Access : std::uint8_t { read_only, write_only, read_write, constant };

/// One object of a dictionary: an index with its sub-index.
struct ObjectEntry {
  std::string name;  ///< "Identity object / Vendor-ID"
  DataType type = DataType::unsigned32;
  Access access = Access::read_write;
  bool mappable = false;
  Bytes value{};                              ///< the default
  std::optional<Bytes> configured{};          ///< what a DCF sets
  std::optional<std::int64_t> low{}, high{};  ///< limits of an integer

  [[nodiscard]] bool readable() const { return access != Access::write_only; }
  [[nodiscard]] bool writable() const { return access == Access::write_only || access == Access::read_write; }
};

/// The objects of a kind of device, as an EDS describes them, or of one device, as a DCF does.
struct ObjectDictionary {
  std::map<ObjectIndex, ObjectEntry> objects;
  std::string vendor;  ///< for people
  std::string product;
  std::optional<NodeId> node;     ///< of a DCF
  std::optional<int> bit_rate{};  ///< [bit/s], of a DCF

  [[nodiscard]] const ObjectEntry* find(ObjectIndex object) const;
  /// By name, by "6040" or "0x6040", "6040:0" or "1018:01" (both hexadecimal). A name may be the last part of one, in
  /// any case, if only one object has it. Fails with `invalid_argument`, and says what was meant perhaps.
  [[nodiscard]] Result<ObjectIndex> parse(std::string_view text) const;
  /// What a DCF sets, in the order of indices, but each PDO switched off while it is set up.
  [[nodiscard]] std::vector<SdoWrite> configuration() const;
};

/// A concise DCF, as object 1F22 holds it (CiA 302-3): number of entries, then index, sub-index, size, data of each.
Bytes concise_dcf(std::span<const SdoWrite> writes);
Result<std::vector<SdoWrite>> parse_concise_dcf(ByteView bytes);

}  // namespace regista::canopen
