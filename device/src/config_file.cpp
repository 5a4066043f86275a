// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <regista/device/config_file.hpp>
#include <utility>

namespace regista {
namespace {

constexpr std::size_t max_file_bytes = std::size_t{1} << 20;
constexpr std::size_t max_total_bytes = std::size_t{8} << 20;
constexpr std::size_t max_depth = 16;
constexpr std::size_t max_keys = 256;

// What things cost of `max_total_bytes` beside their text, so that neither a million empty includes nor a million empty
// sections take for ever.
constexpr std::size_t file_cost = 4096;
constexpr std::size_t section_cost = 256;
constexpr std::size_t value_cost = 64;

struct Unit {
  std::string_view name;
  double factor;  ///< to SI
};
constexpr std::array length_units{Unit{"m", 1}, Unit{"cm", 0.01}, Unit{"mm", 0.001}};
constexpr std::array angle_units{Unit{"degrees", std::numbers::pi / 180}, Unit{"radians", 1}};

// The characters of Player's grammar; <cctype> depends on the locale.
constexpr bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
constexpr bool is_digit(char c) { return c >= '0' && c <= '9'; }
constexpr bool is_blank(char c) { return c == ' ' || c == '\t'; }
constexpr bool is_line_end(char c) { return c == '\n' || c == '\r'; }
constexpr bool is_word(char c) { return is_letter(c) || is_digit(c) || c == '.' || c == '-' || c == '_' || c == ':'; }
constexpr bool begins_number(char c) { return is_digit(c) || c == '+' || c == '-' || c == '.'; }
constexpr bool continues_number(char c) { return begins_number(c) || is_letter(c) || c == '_'; }
constexpr bool is_control(char c) { return (c >= 0 && c < ' ' && c != '\t' && !is_line_end(c)) || c == '\x7f'; }

std::string in_quotes(std::string_view text) { return "'" + std::string{text} + "'"; }

std::string in_hex(char c) {
  char text[8];
  (void)std::snprintf(text, sizeof text, "0x%02X", static_cast<unsigned>(static_cast<unsigned char>(c)));
  return text;
}

struct Token {
  enum class Type : std::uint8_t { word, number, string, open, close, open_tuple, close_tuple, end };

  Type type = Type::end;
  std::string_view text;  ///< as written, a string without its quotes
  Place place;
};

/// Cuts a text into tokens.
class Lexer {
 public:
  Lexer(std::string_view text, std::string file) : text_{text}, place_{std::move(file), 1, 1} {
    if (text_.starts_with("\xEF\xBB\xBF")) text_.remove_prefix(3);  // byte order mark of Windows editors
  }

  Token next() {
    skip_blanks_and_comments();
    Token token{.text = text_.substr(0, 1), .place = place_};
    if (text_.empty()) return token;
    const char c = text_.front();
    if (is_letter(c)) return word();
    if (begins_number(c)) return number();
    if (c == '"') return string();
    if (c == '(') token.type = Token::Type::open;
    if (c == ')') token.type = Token::Type::close;
    if (c == '[') token.type = Token::Type::open_tuple;
    if (c == ']') token.type = Token::Type::close_tuple;
    if (token.type == Token::Type::end) throw ConfigError{place_, stray(c)};
    advance(1);
    return token;
  }

 private:
  static std::string stray(char c) {
    switch (c) {
      case ';':
        return "';' has no meaning here: a statement ends with its value";
      case ',':
        return "',' has no meaning here: values are separated by spaces";
      case '=':
        return "'=' has no meaning here: write the key, a space, the value";
      case '{':
      case '}':
        return in_quotes({&c, 1}) + " has no meaning here: a section is in ( )";
      case '\'':
        return "' has no meaning here: text is in \"double quotes\"";
      case '/':
        return "'/' has no meaning here: a comment starts with #, and a path is in \"quotes\"";
      default:
        break;
    }
    if (c < 0) return "byte " + in_hex(c) + ": outside of strings and comments only ASCII";
    return in_quotes({&c, 1}) + " has no meaning here";
  }

  void skip_blanks_and_comments() {
    bool in_comment = false;
    while (!text_.empty()) {
      const char c = text_.front();
      check_control(c);
      if (is_line_end(c)) in_comment = false;
      if (c == '#') in_comment = true;
      if (!in_comment && !is_blank(c) && !is_line_end(c)) return;
      advance(1);
    }
  }

  Token word() {
    std::size_t size = 1;
    while (size < text_.size() && is_word(text_[size])) ++size;
    return take(Token::Type::word, size + index_suffix(size));
  }

  /// `color[0] [255 0 0]`: an index right behind a word belongs to it, if a value follows on the line. So
  /// `limits[5]` is still a key and its tuple.
  [[nodiscard]] std::size_t index_suffix(std::size_t begin) const {
    const std::string_view rest = text_.substr(begin);
    std::size_t end = 1;
    while (end < rest.size() && is_digit(rest[end])) ++end;
    if (!rest.starts_with('[') || end == 1 || end >= rest.size() || rest[end] != ']') return 0;
    const std::size_t value = rest.find_first_not_of(" \t", end + 1);
    if (value == std::string_view::npos) return 0;
    const char c = rest[value];
    std::size_t size = 0;
    while (value + size < rest.size() && is_letter(rest[value + size])) ++size;
    const bool is_value = begins_number(c) || c == '"' || c == '[' || parse_boolean(rest.substr(value, size));
    return is_value ? end + 1 : 0;
  }

  Token number() {
    std::size_t size = 1;
    while (size < text_.size() && continues_number(text_[size])) ++size;
    Token token = take(Token::Type::number, size);
    if (!parse_number(token.text)) throw ConfigError{token.place, in_quotes(token.text) + " is not a number"};
    return token;
  }

  Token string() {
    const Place begin = place_;
    advance(1);
    const std::size_t size = std::min(text_.find_first_of("\"\r\n"), text_.size());
    if (size == text_.size() || text_[size] != '"')
      throw ConfigError{begin, "the string is not closed on its line: add '\"'"};
    const std::string_view content = text_.substr(0, size);
    for (const char c : content) {
      check_control(c);
      advance(1);
    }
    advance(1);
    return {Token::Type::string, content, begin};
  }

  Token take(Token::Type type, std::size_t size) {
    Token token{type, text_.substr(0, size), place_};
    advance(size);
    return token;
  }

  void check_control(char c) const {
    if (is_control(c)) throw ConfigError{place_, "control character " + in_hex(c) + ": is this a text file?"};
  }

  void advance(std::size_t size) {
    for (; size > 0; --size) {
      const char c = text_.front();
      text_.remove_prefix(1);
      const bool is_line = c == '\n' || (c == '\r' && !text_.starts_with('\n'));
      if (is_line) {
        ++place_.line;
        place_.column = 1;
      } else if ((static_cast<unsigned char>(c) & 0xC0U) != 0x80U) {  // RFC 3629: not the tail of a character
        ++place_.column;
      }
    }
  }

  std::string_view text_;
  Place place_;
};

/// Reads sections of the given types from one text and those that it includes.
class Parser {
 public:
  Parser(const Loader& load, std::span<const std::string_view> types) : load_{load}, types_{types} {}

  void parse_file(std::string_view text, const std::string& name) {
    if (text.size() > max_file_bytes) throw ConfigError{{name}, "longer than 1 MiB"};
    charge(file_cost + text.size(), {name});
    files_.push_back(name);
    Lexer lexer{text, name};
    for (Token token = lexer.next(); token.type != Token::Type::end;) token = parse_statement(lexer, token);
    files_.pop_back();
  }

  std::vector<Section> finish() {
    const Units units = read_units();
    for (Section& section : sections_) section.set_units(units);
    return std::move(sections_);
  }
  [[nodiscard]] std::vector<Value>& plugins() { return plugins_; }

 private:
  /// Each of these takes a statement's first token, and gives the first one behind the statement.
  Token parse_statement(Lexer& lexer, const Token& first) {
    if (first.type == Token::Type::close) throw ConfigError{first.place, "')' closes nothing: delete it"};
    require_key(first);
    if (first.text == "include") return parse_include(lexer, first);
    if (first.text == "plugin") return parse_plugin(lexer, first);
    if (first.text == "define") return parse_template(lexer, first);
    const Token second = lexer.next();
    if (second.type == Token::Type::open) {
      sections_.push_back(parse_section(lexer, first));
      return lexer.next();
    }
    if (is_section(first.text) && !begins_value(first, second))
      throw ConfigError{first.place, in_quotes(first.text) + " needs '('"};
    return parse_field(lexer, globals_, first, second);
  }

  Token parse_include(Lexer& lexer, const Token& keyword) {
    const Token name = lexer.next();
    if (name.type != Token::Type::string || name.place.line != keyword.place.line)
      throw ConfigError{keyword.place, "include needs a file in quotes on its line: include \"base.cfg\""};
    const std::filesystem::path directory = std::filesystem::path{keyword.place.file}.parent_path();
    const std::string file = (directory / std::filesystem::path{name.text}).lexically_normal().string();
    if (std::ranges::find(files_, file) != files_.end())
      throw ConfigError{name.place, in_quotes(file) + " includes itself: " + chain() + " > " + file};
    if (files_.size() >= max_depth)
      throw ConfigError{name.place, "more than " + std::to_string(max_depth) + " files deep: " + chain()};
    const auto text = load_(file);
    if (!text) throw ConfigError{name.place, text.error().message()};
    parse_file(*text, file);
    return lexer.next();
  }

  Token parse_plugin(Lexer& lexer, const Token& keyword) {
    const Token name = lexer.next();
    if (name.type != Token::Type::string || name.place.line != keyword.place.line)
      throw ConfigError{keyword.place, "plugin needs a name in quotes on its line: plugin \"my_driver\""};
    charge(value_cost, name.place);
    plugins_.push_back({Value::Type::text, std::string{name.text}, name.place});
    return lexer.next();
  }

  Token parse_template(Lexer& lexer, const Token& keyword) {
    const Token name = lexer.next();
    const Token type = name.type == Token::Type::word ? lexer.next() : Token{};
    const Token open = type.type == Token::Type::word ? lexer.next() : Token{};
    if (open.type != Token::Type::open)
      throw ConfigError{keyword.place, "define needs a name, a type and a section: define base driver( ... )"};
    if (is_section(name.text) || is_keyword(name.text))
      throw ConfigError{name.place, in_quotes(name.text) + " is a word of the language: choose another name"};
    if (const auto same = templates_.find(name.text); same != templates_.end())
      throw ConfigError{name.place, in_quotes(name.text) + " is already defined at " + to_string(same->second.place())};
    templates_.emplace(name.text, parse_section(lexer, type));
    return lexer.next();
  }

  /// Behind its '(' and up to its ')'.
  Section parse_section(Lexer& lexer, const Token& type) {
    Section section = begin_section(type);
    for (Token token = lexer.next(); token.type != Token::Type::close;) {
      if (token.type == Token::Type::end)
        throw ConfigError{type.place, "section " + in_quotes(type.text) + " is not closed: add ')'"};
      require_key(token);
      const Token second = lexer.next();
      if (second.type == Token::Type::open) {
        throw ConfigError{token.place, in_quotes(token.text) + " begins inside of section " + in_quotes(type.text) +
                                           ", opened at " + to_string(type.place) + ": is a ')' missing?"};
      }
      if (token.text == "include" || token.text == "define")
        throw ConfigError{token.place, in_quotes(token.text) + " must stand outside of sections"};
      token = parse_field(lexer, section, token, second);
    }
    return section;
  }

  /// Empty, or with what its template sets.
  Section begin_section(const Token& type) {
    charge(section_cost, type.place);
    if (type.text == "interface") {
      throw ConfigError{type.place,
                        "interface plugins are not loaded; a driver sends data of its own through 'opaque:0'"};
    }
    if (is_section(type.text)) return {std::string{type.text}, type.place};
    const auto found = templates_.find(type.text);
    if (found == templates_.end()) throw ConfigError{type.place, unknown_section(type.text)};
    const Section& base = found->second;
    Section section{base.type(), type.place};
    for (Section::Field field : base.fields()) {
      for (const Value& value : field.values) charge(value_cost + value.text.size(), type.place);
      field.inherited = true;
      section.add(std::move(field));
    }
    return section;
  }

  Token parse_field(Lexer& lexer, Section& section, const Token& key, const Token& first) {
    if (!begins_value(key, first)) throw ConfigError{key.place, no_value(key, first)};
    Section::Field field{.key = std::string{key.text}, .place = key.place, .values = {}};
    if (first.type == Token::Type::open_tuple) {
      field.values = parse_tuple(lexer, key, first);
    } else {
      field.values.push_back(parse_value(first));
    }
    section.add(std::move(field));
    if (section.fields().size() > max_keys)
      throw ConfigError{key.place, "more than " + std::to_string(max_keys) + " keys in one section"};
    const Token behind = lexer.next();
    const bool is_loose = behind.type == Token::Type::number || behind.type == Token::Type::string;
    if (is_loose && behind.place.line == first.place.line && first.type != Token::Type::open_tuple)
      throw ConfigError{behind.place, "several values of " + in_quotes(key.text) + " need brackets: [ ]"};
    return behind;
  }

  /// Behind its '[' and up to its ']'.
  std::vector<Value> parse_tuple(Lexer& lexer, const Token& key, const Token& open) {
    std::vector<Value> values;
    for (Token token = lexer.next(); token.type != Token::Type::close_tuple; token = lexer.next()) {
      if (token.type == Token::Type::open_tuple) throw ConfigError{token.place, "a tuple cannot hold a tuple"};
      if (token.type == Token::Type::end || token.type == Token::Type::open || token.type == Token::Type::close)
        throw ConfigError{open.place, "the tuple of " + in_quotes(key.text) + " is not closed: add ']'"};
      values.push_back(parse_value(token));
    }
    if (values.empty()) throw ConfigError{open.place, "the tuple of " + in_quotes(key.text) + " is empty"};
    return values;
  }

  Value parse_value(const Token& token) {
    charge(value_cost, token.place);
    Value value{.text = std::string{token.text}, .place = token.place};
    if (token.type == Token::Type::number) value.type = Value::Type::number;
    if (token.type == Token::Type::word) {
      if (!parse_boolean(token.text))
        throw ConfigError{token.place, "text needs quotes: \"" + std::string{token.text} + "\""};
      value.type = Value::Type::boolean;
    }
    return value;
  }

  [[nodiscard]] Units read_units() const {
    Units units;
    const std::string length = globals_.text("unit_length", "m");
    const auto* length_unit = std::ranges::find(length_units, length, &Unit::name);
    if (length_unit == length_units.end())
      throw globals_.error("unit_length", R"(must be "m", "cm" or "mm", not ")" + length + '"');
    units.metres = length_unit->factor;
    units.length_name = length_unit->name;

    const std::string angle = globals_.text("unit_angle", "degrees");
    const auto* angle_unit = std::ranges::find(angle_units, angle, &Unit::name);
    if (angle_unit == angle_units.end())
      throw globals_.error("unit_angle", R"(must be "degrees" or "radians", not ")" + angle + '"');
    units.radians = angle_unit->factor;
    units.angle_name = angle_unit->name;
    globals_.check_unused();
    return units;
  }

  [[nodiscard]] bool is_section(std::string_view word) const { return std::ranges::find(types_, word) != types_.end(); }
  static bool is_keyword(std::string_view word) {
    return word == "include" || word == "plugin" || word == "define" || word == "interface";
  }

  [[nodiscard]] std::string unknown_section(std::string_view type) const {
    std::vector<std::string> known{types_.begin(), types_.end()};
    for (const auto& [name, section] : templates_) known.push_back(name);
    std::string text = "unknown section " + in_quotes(type);
    if (const std::string hint = did_you_mean(type, known); !hint.empty()) return text + hint;
    text += "; known are ";
    for (const std::string_view name : types_) text += (name == types_.front() ? "" : ", ") + in_quotes(name);
    return text + " and what define has named before";
  }

  static void require_key(const Token& token) {
    if (token.type == Token::Type::word) return;
    if (token.type == Token::Type::open)
      throw ConfigError{token.place, "'(' needs the section's type before it: driver("};
    const bool is_string = token.type == Token::Type::string;
    throw ConfigError{token.place, "expected a key, found " +
                                       (is_string ? '"' + std::string{token.text} + '"' : in_quotes(token.text))};
  }

  static bool begins_value(const Token& key, const Token& token) {
    const bool is_value = token.type == Token::Type::word || token.type == Token::Type::number ||
                          token.type == Token::Type::string || token.type == Token::Type::open_tuple;
    return is_value && token.place.line == key.place.line;
  }

  static std::string no_value(const Token& key, const Token& next) {
    if (next.type == Token::Type::open) return in_quotes(key.text) + " must stand outside of sections";
    return in_quotes(key.text) + " has no value on its line";
  }

  void charge(std::size_t bytes, const Place& place) {
    total_bytes_ += bytes;
    if (total_bytes_ > max_total_bytes)
      throw ConfigError{place, "the configuration is larger than 8 MiB with its includes and templates"};
  }

  [[nodiscard]] std::string chain() const {
    std::string text;
    for (const std::string& file : files_) text += (text.empty() ? "" : " > ") + file;
    return text;
  }

  const Loader& load_;
  std::span<const std::string_view> types_;
  std::vector<std::string> files_;  ///< open now, the innermost last
  std::size_t total_bytes_ = 0;
  Section globals_{"(outside of sections)", {}};
  std::map<std::string, Section, std::less<>> templates_;
  std::vector<Section> sections_;
  std::vector<Value> plugins_;
};

/// A Parser that has read all.
Parser parsed(std::string_view text, const std::string& name, const Loader& load,
              std::span<const std::string_view> types) {
  Parser parser{load, types};
  parser.parse_file(text, std::filesystem::path{name}.lexically_normal().string());
  return parser;
}

std::string text_of(const std::filesystem::path& file) {
  auto text = load_file(file);
  if (!text) throw ConfigError{{file.string()}, text.error().code.message()};
  return *std::move(text);
}

}  // namespace

Result<std::string> load_file(const std::filesystem::path& file) {
  const auto error = [&](int code) {
    return Error{std::error_code{code, std::generic_category()}, "read " + file.string()};
  };
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> stream{std::fopen(file.c_str(), "rb"), std::fclose};
  if (!stream) return error(errno);
  std::string text(max_file_bytes + 1, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), stream.get()));
  if (std::ferror(stream.get()) != 0) return error(errno);
  if (text.size() > max_file_bytes) return error(EFBIG);
  return text;
}

ConfigFile parse_config(std::string_view text, const std::string& name, const Loader& load) {
  constexpr std::array<std::string_view, 2> types{"driver", "server"};
  Parser parser = parsed(text, name, load, types);
  ConfigFile config{.server = {}, .drivers = {}, .plugins = std::move(parser.plugins())};
  for (Section& section : parser.finish()) {
    if (section.type() == "driver") {
      config.drivers.push_back(std::move(section));
    } else if (config.server.place().line) {
      throw ConfigError{section.place(),
                        "a second section 'server'; the first is at " + to_string(config.server.place())};
    } else {
      config.server = std::move(section);
    }
  }
  if (!config.server.place().line) config.server = Section{"server", {name, 1, 1}};
  return config;
}

ConfigFile read_config(const std::filesystem::path& file) { return parse_config(text_of(file), file.string()); }

std::vector<Section> parse_sections(std::string_view text, const std::string& name,
                                    std::span<const std::string_view> types, const Loader& load) {
  Parser parser = parsed(text, name, load, types);
  if (!parser.plugins().empty()) throw ConfigError{parser.plugins().front().place, "plugins are for regista-server"};
  return parser.finish();
}

std::vector<Section> read_sections(const std::filesystem::path& file, std::span<const std::string_view> types) {
  return parse_sections(text_of(file), file.string(), types);
}

}  // namespace regista
