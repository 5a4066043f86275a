// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <fstream>
#include <iterator>
#include <regista/canopen/eds.hpp>

namespace regista::canopen {
namespace {

struct Value {
  std::string text;
  int line = 0;
};
struct Section {
  std::string name;
  int line = 0;
  std::map<std::string, Value> keys;  // in lower case
};

std::string_view stripped(std::string_view text) {
  constexpr std::string_view blanks = " \t\r\n";
  const std::size_t begin = std::min(text.find_first_not_of(blanks), text.size());
  return text.substr(begin, text.find_last_not_of(blanks) + 1 - begin);
}

std::string lower(std::string_view text) {
  std::string result{text};
  for (char& c : result) {
    if ('A' <= c && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return result;
}

std::optional<std::uint16_t> hex_digits(std::string_view text) {
  std::uint16_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  if (error != std::errc{} || end != text.data() + text.size() || text.empty()) return {};
  return value;
}

class Reader {
 public:
  Reader(std::string_view text, std::string file, std::optional<NodeId> node) : file_{std::move(file)}, node_{node} {
    split(text);
  }

  ObjectDictionary read() {
    ObjectDictionary dictionary;
    if (const Section* info = section("deviceinfo")) {
      dictionary.vendor = text(*info, "vendorname");
      dictionary.product = text(*info, "productname");
    }
    for (const char* name : {"devicecomissioning", "devicecommissioning"}) {  // the first is how CiA 306 spells it
      const Section* commissioning = section(name);
      if (commissioning == nullptr) continue;
      if (const Value* id = find(*commissioning, "nodeid")) {
        const auto number = integer(*id);
        if (number < int{first_node} || number > int{last_node})
          fail(id->line, "NodeID " + id->text + " is not from 1 to 127");
        dictionary.node = static_cast<NodeId>(number);
        if (!node_) node_ = dictionary.node;
      }
      if (const Value* rate = find(*commissioning, "baudrate")) {
        const auto kilobit = integer(*rate);
        if (kilobit < 1 || kilobit > 10'000) fail(rate->line, "Baudrate " + rate->text + " is no bit rate in kbit/s");
        dictionary.bit_rate = static_cast<int>(kilobit * 1000);
      }
    }
    for (const auto& [name, section] : sections_) {
      if (name.size() != 4) continue;
      if (const auto index = hex_digits(name)) read_object(dictionary, section, *index);
    }
    for (const char* list : {"mandatoryobjects", "optionalobjects", "manufacturerobjects"}) check_list(list);
    return dictionary;
  }

 private:
  [[noreturn]] void fail(int line, const std::string& text) const { throw EdsError{file_, line, text}; }

  void split(std::string_view text) {
    Section* current = nullptr;
    for (int line = 1; !text.empty(); ++line) {
      const std::size_t end = std::min(text.find('\n'), text.size());
      std::string_view content = stripped(text.substr(0, end));
      text.remove_prefix(std::min(end + 1, text.size()));
      if (line == 1 && content.starts_with("\xEF\xBB\xBF")) content.remove_prefix(3);
      if (content.empty() || content.front() == ';' || content.front() == '#') continue;
      if (content.front() == '[') {
        const std::size_t close = content.find(']');
        if (close == std::string_view::npos) fail(line, "'[' without ']'");
        const std::string_view name = stripped(content.substr(1, close - 1));
        const auto [at, is_new] = sections_.try_emplace(lower(name), Section{std::string{name}, line, {}});
        if (!is_new) {
          fail(line,
               "section [" + std::string{name} + "] is there twice, first in line " + std::to_string(at->second.line));
        }
        current = &at->second;
        continue;
      }
      const std::size_t equals = content.find('=');
      if (equals == std::string_view::npos)
        fail(line, "neither [section] nor key=value: '" + std::string{content} + "'");
      if (current == nullptr) fail(line, "a key before the first [section]");
      std::string_view value = content.substr(equals + 1);
      value = stripped(value.substr(0, std::min(value.find(" ;"), value.find("\t;"))));
      current->keys[lower(stripped(content.substr(0, equals)))] = {std::string{value}, line};
    }
  }

  [[nodiscard]] const Section* section(const std::string& name) const {
    const auto found = sections_.find(name);
    return found == sections_.end() ? nullptr : &found->second;
  }
  /// A key with a value; an empty one counts as absent.
  static const Value* find(const Section& section, const std::string& key) {
    const auto found = section.keys.find(key);
    return found == section.keys.end() || found->second.text.empty() ? nullptr : &found->second;
  }
  static std::string text(const Section& section, const std::string& key) {
    const Value* value = find(section, key);
    return value == nullptr ? std::string{} : value->text;
  }

  /// A number, or numbers and $NODEID with + between them.
  [[nodiscard]] std::int64_t integer(const Value& value) const {
    std::int64_t sum = 0;
    std::string_view rest = value.text;
    while (true) {
      const std::size_t plus = std::min(rest.find('+', rest.starts_with('+') ? 1 : 0), rest.size());
      const std::string_view term = stripped(rest.substr(0, plus));
      if (lower(term) == "$nodeid") {
        sum += node_.value_or(0);
      } else {
        const auto bytes = encode(DataType::integer64, term);
        if (!bytes) fail(value.line, "'" + value.text + "' is no number");
        if (__builtin_add_overflow(sum, static_cast<std::int64_t>(get_le(*bytes)), &sum)) {
          fail(value.line, "'" + value.text + "' is too large");
        }
      }
      if (plus == rest.size()) return sum;
      rest.remove_prefix(plus + 1);
    }
  }
  [[nodiscard]] std::int64_t integer(const Section& section, const std::string& key, std::int64_t otherwise,
                                     std::int64_t least, std::int64_t most) const {
    const Value* value = find(section, key);
    if (value == nullptr) return otherwise;
    const std::int64_t number = integer(*value);
    if (number < least || number > most) {
      fail(value->line, value->text + " is not from " + std::to_string(least) + " to " + std::to_string(most));
    }
    return number;
  }

  [[nodiscard]] std::optional<Bytes> bytes(const Section& section, const std::string& key, DataType type) const {
    const Value* value = find(section, key);
    return value == nullptr ? std::nullopt : std::optional{bytes(*value, type)};
  }
  [[nodiscard]] Bytes bytes(const Value& value, DataType type) const {
    std::string content = value.text;
    if (lower(content).find("$nodeid") != std::string::npos && size_of(type) != 0) {
      content = std::to_string(integer(value));
    }
    auto encoded = encode(type, content);
    if (encoded) return *std::move(encoded);
    if (size_of(type) == 0) return {content.begin(), content.end()};  // a text where bytes are meant: as it stands
    fail(value.line, encoded.error().what);
  }

  [[nodiscard]] DataType data_type(const Section& section) const {
    const Value* value = find(section, "datatype");
    if (value == nullptr) fail(section.line, "[" + section.name + "] has no DataType");
    const std::int64_t number = integer(*value);
    const bool known = (0x01 <= number && number <= 0x0D) || number == 0x0F || (0x10 <= number && number <= 0x16) ||
                       (0x18 <= number && number <= 0x1B);
    if (!known) fail(value->line, "no DataType of CiA 301: " + value->text);
    return static_cast<DataType>(number);
  }

  [[nodiscard]] Access access(const Section& section) const {
    const Value* value = find(section, "accesstype");
    if (value == nullptr) return Access::read_write;
    const std::string name = lower(value->text);
    if (name == "ro") return Access::read_only;
    if (name == "wo") return Access::write_only;
    if (name == "const") return Access::constant;
    if (name == "rw" || name == "rwr" || name == "rww") return Access::read_write;
    fail(value->line, "no AccessType: '" + value->text + "' (ro, wo, rw, rwr, rww, const)");
  }

  [[nodiscard]] ObjectEntry entry(const Section& section, const std::string& name, DataType fallback) const {
    ObjectEntry entry;
    entry.name = name;
    entry.type = find(section, "datatype") == nullptr && fallback != DataType{} ? fallback : data_type(section);
    entry.access = access(section);
    entry.mappable = integer(section, "pdomapping", 0, 0, 1) != 0;
    entry.value = bytes(section, "defaultvalue", entry.type).value_or(Bytes(size_of(entry.type)));
    entry.configured = bytes(section, "parametervalue", entry.type);
    if (1 <= size_of(entry.type) && size_of(entry.type) <= 4 && entry.type != DataType::real32) {
      for (const auto& [key, limit] : {std::pair{"lowlimit", &entry.low}, {"highlimit", &entry.high}}) {
        if (const Value* value = find(section, key)) *limit = signed_value(entry.type, bytes(*value, entry.type));
      }
    }
    return entry;
  }
  static std::int64_t signed_value(DataType type, ByteView bytes) {
    const std::uint64_t value = get_le(bytes);
    if (!is_signed(type)) return static_cast<std::int64_t>(value);
    const std::uint64_t sign = 1ULL << (8 * bytes.size() - 1);
    return static_cast<std::int64_t>((value ^ sign) - sign);
  }

  void read_object(ObjectDictionary& dictionary, const Section& section, std::uint16_t index) {
    constexpr int domain = 2, variable = 7, array = 8, record = 9;
    const std::string name = text(section, "parametername");
    const std::int64_t type = integer(section, "objecttype", variable, 0, 0xFF);
    if (type == variable || type == domain) {
      dictionary.objects[{index, 0}] = entry(section, name, type == domain ? DataType::domain : DataType{});
      return;
    }
    if (type != array && type != record) return;  // definitions of types: nothing to read or write
    if (const auto count = integer(section, "compactsubobj", 0, 0, 254); count > 0) {
      return read_compact(dictionary, section, index, name, static_cast<int>(count));
    }
    const std::string prefix = lower(section.name) + "sub";
    for (auto at = sections_.lower_bound(prefix); at != sections_.end() && at->first.starts_with(prefix); ++at) {
      const auto sub = hex_digits(std::string_view{at->first}.substr(prefix.size()));
      if (!sub || *sub > 0xFF) fail(at->second.line, "no sub-index in [" + at->second.name + "]");
      dictionary.objects[{index, static_cast<std::uint8_t>(*sub)}] =
          entry(at->second, name + " / " + text(at->second, "parametername"), DataType{});
    }
  }

  /// CiA 306, 4.6.4: one description for all sub-objects; names and values that differ are in sections of their own.
  void read_compact(ObjectDictionary& dictionary, const Section& section, std::uint16_t index, const std::string& name,
                    int count) {
    const std::string key = lower(section.name);
    const Section* names = this->section(key + "name");
    const Section* values = this->section(key + "value");
    dictionary.objects[{index, 0}] = {.name = name + " / NrOfObjects",
                                      .type = DataType::unsigned8,
                                      .access = Access::read_only,
                                      .value = {static_cast<std::uint8_t>(count)}};
    ObjectEntry each = entry(section, name, DataType{});
    for (int sub = 1; sub <= count; ++sub) {
      ObjectEntry one = each;
      const std::string number = std::to_string(sub);
      const Value* own_name = names == nullptr ? nullptr : find(*names, number);
      one.name = name + " / " + (own_name == nullptr ? name + number : own_name->text);
      if (values != nullptr) {
        if (const Value* value = find(*values, number)) one.configured = bytes(*value, one.type);
      }
      dictionary.objects[{index, static_cast<std::uint8_t>(sub)}] = std::move(one);
    }
  }

  void check_list(const std::string& name) const {
    const Section* list = section(name);
    if (list == nullptr) return;
    for (const auto& [key, value] : list->keys) {
      if (key == "supportedobjects" || value.text.empty()) continue;
      const std::int64_t index = integer(value);
      if (index < 0 || index > 0xFFFF || section(lower(hex(static_cast<std::uint64_t>(index), 4))) == nullptr) {
        fail(value.line, "[" + list->name + "] names " + value.text + ", which has no section");
      }
    }
  }

  std::string file_;
  std::optional<NodeId> node_;
  std::map<std::string, Section> sections_;  // by name in lower case
};

}  // namespace

ObjectDictionary parse_eds(std::string_view text, const std::string& file, std::optional<NodeId> node) {
  return Reader{text, file, node}.read();
}

ObjectDictionary load_eds(const std::string& file, std::optional<NodeId> node) {
  std::ifstream stream{file, std::ios::binary};
  if (!stream) throw EdsError{file, 0, "cannot be read"};
  const std::string text{std::istreambuf_iterator<char>{stream}, {}};
  return parse_eds(text, file, node);
}

}  // namespace regista::canopen
