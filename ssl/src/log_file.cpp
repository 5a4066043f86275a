// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <bit>
#include <concepts>
#include <regista/ssl/log_file.hpp>
#include <stdexcept>
#include <string_view>

namespace regista::ssl {

namespace {

constexpr std::string_view magic = "SSL_LOG_FILE";
constexpr std::int32_t version = 1;
constexpr std::int32_t longest_datagram = 65536;

template <std::integral T>
void put(std::ostream& file, T value) {
  using U = std::make_unsigned_t<T>;
  std::array<char, sizeof(T)> bytes{};
  for (std::size_t i = 0; i < sizeof(T); ++i)
    bytes[i] = static_cast<char>(static_cast<U>(value) >> (8 * (sizeof(T) - 1 - i)) & 0xFFU);
  file.write(bytes.data(), sizeof(T));
}

template <std::integral T>
T get(std::istream& file) {
  using U = std::make_unsigned_t<T>;
  std::array<char, sizeof(T)> bytes{};
  file.read(bytes.data(), sizeof(T));
  U value = 0;
  for (const char byte : bytes) value = static_cast<U>(value << 8U | static_cast<unsigned char>(byte));
  return static_cast<T>(value);
}

}  // namespace

LogReader::LogReader(const std::filesystem::path& file) : file_{file, std::ios::binary} {
  if (!file_) throw std::runtime_error{"cannot read " + file.string()};
  std::array<char, magic.size()> head{};
  file_.read(head.data(), head.size());
  const auto found = get<std::int32_t>(file_);
  if (!file_ || std::string_view{head.data(), head.size()} != magic)
    throw std::runtime_error{file.string() + " is no log file of the league: it does not begin with SSL_LOG_FILE"};
  if (found != version)
    throw std::runtime_error{file.string() + ": version " + std::to_string(found) + " is not known, only 1"};
}

Result<std::optional<LogRecord>> LogReader::next() {
  if (file_.peek() == std::char_traits<char>::eof()) return std::optional<LogRecord>{};
  LogRecord record{
      .received_ns = get<std::int64_t>(file_), .type = static_cast<LogType>(get<std::int32_t>(file_)), .datagram = {}};
  const auto size = get<std::int32_t>(file_);
  // What indexed files end with is longer than a datagram, and for those who jump about.
  if (file_ && record.type == LogType::index) return std::optional<LogRecord>{};
  if (!file_ || size < 0 || size > longest_datagram)
    return Error{std::errc::bad_message, "a record of " + std::to_string(size) + " bytes"};
  record.datagram.resize(static_cast<std::size_t>(size));
  file_.read(reinterpret_cast<char*>(record.datagram.data()), size);
  if (!file_) return Error{std::errc::bad_message, "the last record is cut short"};
  return std::optional{std::move(record)};
}

LogWriter::LogWriter(const std::filesystem::path& file) : file_{file, std::ios::binary | std::ios::trunc} {
  file_.write(magic.data(), magic.size());
  put(file_, version);
  if (!file_) throw std::runtime_error{"cannot write " + file.string()};
}

Result<> LogWriter::write(std::int64_t received_ns, LogType type, std::span<const std::byte> datagram) {
  put(file_, received_ns);
  put(file_, static_cast<std::int32_t>(type));
  put(file_, static_cast<std::int32_t>(datagram.size()));
  file_.write(reinterpret_cast<const char*>(datagram.data()), static_cast<std::streamsize>(datagram.size()));
  if (!file_) return Error{std::errc::io_error, "log"};
  return {};
}

}  // namespace regista::ssl
