// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <functional>
#include <iostream>

#include "command_line.hpp"
#include "message_json.hpp"

namespace regista {
namespace {

constexpr const char* examples = R"(Examples:
  What is this?
    regista-wire decode 0100007f00001a090000000400000000000000040000000200000000000000000000000000000000
  There and back:
    regista-wire decode < messages.hex | regista-wire encode
  Drive ahead at 0.3 m/s, by hand:
    echo '{"header": {"addr": {"host": 0, "robot": 0, "interf": 4, "index": 0}, "type": 2, "subtype": 1,
      "timestamp": 0, "seq": 0}, "fields": {"vel": {"px": 0.3, "py": 0, "pa": 0}, "state": 1}}' |
      tr -d '\n' | regista-wire encode

Fields have Player's names. Strings have one character a byte, their NUL (\u0000) included; "inf", "-inf" and "nan" are
strings; "x_count" and the header's "size" may be left out when encoding; "fields" is null when there is no body.
Lines with errors are told on stderr and left out; the exit code is then 1.)";

std::string_view stripped(std::string_view text) {
  constexpr std::string_view blanks = " \t\r\n";
  const std::size_t begin = std::min(text.find_first_not_of(blanks), text.size());
  return text.substr(begin, text.find_last_not_of(blanks) + 1 - begin);
}

Error invalid(std::string what) { return {std::errc::invalid_argument, std::move(what)}; }

Result<std::vector<std::byte>> from_hex(std::string_view text) {
  constexpr std::string_view digits = "0123456789abcdefABCDEF";
  if (const std::size_t at = text.find_first_not_of(digits); at != std::string_view::npos) {
    return invalid("character " + std::to_string(at + 1) + " is not a hex digit");
  }
  if (text.size() % 2 != 0) return invalid("odd number of hex digits (" + std::to_string(text.size()) + ")");
  std::vector<std::byte> bytes(text.size() / 2);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    unsigned char byte = 0;
    std::from_chars(&text[2 * i], &text[2 * i] + 2, byte, 16);
    bytes[i] = std::byte{byte};
  }
  return bytes;
}

std::string to_hex(std::span<const std::byte> bytes) {
  constexpr std::string_view digits = "0123456789abcdef";
  std::string hex;
  hex.reserve(2 * bytes.size());
  for (const std::byte byte : bytes) {
    hex += digits[std::to_integer<std::size_t>(byte >> 4)];
    hex += digits[std::to_integer<std::size_t>(byte & std::byte{0xf})];
  }
  return hex;
}

/// What to print for one input line. `note` is for stderr, and no error.
using Convert = std::function<Result<std::string>(std::string_view line, std::string& note)>;

Result<std::string> decode_line(std::string_view hex, std::string& note) {
  const auto bytes = from_hex(hex);
  if (!bytes) return bytes.error();
  xdr::Header header;
  if (bytes->size() < xdr::header_size) {
    return Error{xdr::Errc::short_body, "a header takes 40 bytes, here are " + std::to_string(bytes->size())};
  }
  (void)xdr::decode(*bytes, header);
  const auto body = std::span{*bytes}.subspan(xdr::header_size);
  if (header.size != body.size()) {
    return Error{header.size > body.size() ? xdr::Errc::short_body : xdr::Errc::oversize,
                 "the header promises a body of " + std::to_string(header.size) + " bytes, here are " +
                     std::to_string(body.size())};
  }
  std::size_t used = 0;
  const auto message = message_json::decode(header, body, used);
  if (!message) return message.error();
  if (used < body.size()) note = std::to_string(body.size() - used) + " bytes after the last field disregarded";
  return message->dump(-1, ' ', true);
}

Result<std::string> encode_line(std::string_view text, std::string& /*note*/) {
  try {
    const auto bytes = message_json::encode(message_json::Json::parse(text));
    if (!bytes) return bytes.error();
    return to_hex(*bytes);
  } catch (const nlohmann::json::parse_error& error) {  // "[…] parse error at line 1, column 9: syntax error …"
    const std::string_view what = error.what();
    return invalid("not JSON at byte " + std::to_string(error.byte) + ": " +
                   std::string{what.substr(what.find(": ") + 2)});
  } catch (const nlohmann::json::exception& error) {  // "[…] number overflow parsing '1e999'"
    const std::string_view what = error.what();
    return invalid(std::string{what.substr(what.find("] ") + 2)});
  } catch (const message_json::Mismatch& error) {
    return invalid(error.what());
  }
}

/// Whether it went without an error.
bool convert(std::string_view input, const std::string& place, const Convert& convert_line) {
  std::string note;
  const auto output = convert_line(input, note);
  if (!output) {
    const bool plain = output.error().code == std::errc::invalid_argument;  // the text says it all
    std::cerr << place << ": " << (plain ? output.error().what : output.error().message()) << '\n' << std::flush;
    return false;
  }
  if (!note.empty()) std::cerr << place << ": " << note << '\n' << std::flush;
  std::cout << *output << '\n' << std::flush;  // each at once: we may stand in a pipe
  return true;
}

bool convert_lines(const Convert& convert_line) {
  bool good = true;
  std::string line;
  for (std::size_t number = 1; std::getline(std::cin, line); ++number) {
    const std::string_view input = stripped(line);
    if (!input.empty()) good = convert(input, "line " + std::to_string(number), convert_line) && good;
  }
  return good;
}

int run(int argc, char** argv) {
  CLI::App app{"Player's wire format as JSON, and back."};
  app.require_subcommand(1);
  app.footer(examples);
  app.set_version_flag("--version", REGISTA_VERSION);
  auto* decode = app.add_subcommand("decode", "Whole messages (header and body) in hex, one a line, to JSON");
  std::vector<std::string> messages;
  decode->add_option("MESSAGE", messages, "In hex; without any, standard input is read");
  auto* encode = app.add_subcommand("encode", "JSON on standard input, one message a line, to hex");
  for (auto* subcommand : {decode, encode}) subcommand->footer(examples);
  if (const auto done = parse(app, argc, argv)) return *done;

  if (encode->parsed()) return convert_lines(encode_line) ? 0 : 1;
  if (messages.empty()) return convert_lines(decode_line) ? 0 : 1;
  bool good = true;
  for (std::size_t i = 0; i < messages.size(); ++i) {
    good = convert(stripped(messages[i]), "argument " + std::to_string(i + 1), decode_line) && good;
  }
  return good ? 0 : 1;
}

}  // namespace
}  // namespace regista

int main(int argc, char** argv) { return regista::run(argc, argv); }
