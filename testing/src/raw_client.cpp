// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <limits>
#include <regista/testing/raw_client.hpp>
#include <stdexcept>
#include <system_error>

namespace regista::testing {

namespace {

constexpr std::size_t header_size = 40;
constexpr std::size_t banner_size = 32;

std::uint32_t word(const Bytes& bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8 | std::to_integer<std::uint32_t>(bytes.at(offset + i));
  return value;
}

double number(const Bytes& bytes, std::size_t offset) {
  return std::bit_cast<double>(std::uint64_t{word(bytes, offset)} << 32 | word(bytes, offset + 4));
}

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error{errno, std::generic_category(), "RawClient: " + what};
}

/// False: nothing to be read before `end`.
bool readable(int socket, Time end) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now()).count();
  pollfd descriptor{.fd = socket, .events = POLLIN, .revents = 0};
  return ::poll(&descriptor, 1, static_cast<int>(std::max<std::int64_t>(left, 0))) > 0;
}

}  // namespace

Bytes from_hex(std::string_view digits) {
  Bytes bytes;
  int high = -1;
  for (const char c : digits) {
    if (c == ' ') continue;
    const int digit = c <= '9' ? c - '0' : (c | 0x20) - 'a' + 10;
    if (digit < 0 || digit > 15) throw std::invalid_argument{"from_hex: no hexadecimal digit"};
    if (high >= 0) bytes.push_back(static_cast<std::byte>(high << 4 | digit));
    high = high >= 0 ? -1 : digit;
  }
  if (high >= 0) throw std::invalid_argument{"from_hex: half a byte"};
  return bytes;
}

std::string to_hex(const Bytes& bytes) {
  constexpr std::string_view digits = "0123456789abcdef";
  std::string text;
  for (const std::byte byte : bytes) {
    text += digits[std::to_integer<std::size_t>(byte >> 4)];
    text += digits[std::to_integer<std::size_t>(byte & std::byte{15})];
  }
  return text;
}

Pack& Pack::u32(std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) bytes.push_back(static_cast<std::byte>(value >> shift & 0xff));
  return *this;
}

Pack& Pack::f64(double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  return u32(static_cast<std::uint32_t>(bits >> 32)).u32(static_cast<std::uint32_t>(bits));
}

Pack& Pack::raw(const Bytes& more) {
  bytes.insert(bytes.end(), more.begin(), more.end());
  return *this;
}

Bytes RawMessage::encode(std::optional<std::uint32_t> claimed_size) const {
  return Pack{}
      .u32(host)
      .u32(robot)
      .u32(interface)
      .u32(index)
      .u32(type)
      .u32(subtype)
      .f64(timestamp_s)
      .u32(sequence)
      .u32(claimed_size.value_or(static_cast<std::uint32_t>(body.size())))
      .raw(body)
      .bytes;
}

std::uint32_t RawMessage::u32(std::size_t offset) const { return word(body, offset); }
double RawMessage::f64(std::size_t offset) const { return number(body, offset); }

RawClient::RawClient(std::uint16_t port, int receive_buffer)
    : socket_{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)} {
  if (socket_ < 0) fail("socket");
  if (receive_buffer > 0) ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
  const int on = 1;
  ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  try {
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) fail("connect");
    for (const std::byte byte : receive(banner_size)) banner_ += static_cast<char>(byte);
  } catch (...) {
    close();
    throw;
  }
}

RawClient::~RawClient() { close(); }

void RawClient::send(const Bytes& bytes) const {
  for (std::size_t sent = 0; sent < bytes.size();) {
    const ssize_t size = ::send(socket_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
    if (size < 0) fail("send");
    sent += static_cast<std::size_t>(size);
  }
}

std::size_t RawClient::try_send(const Bytes& bytes) const {
  const ssize_t size = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (size >= 0) return static_cast<std::size_t>(size);
  return errno == EAGAIN ? 0 : std::numeric_limits<std::size_t>::max();
}

Bytes RawClient::receive(std::size_t size, Duration timeout) const {
  const Time end = Clock::now() + timeout;
  Bytes bytes(size);
  for (std::size_t got = 0; got < size;) {
    if (!readable(socket_, end)) {
      throw std::runtime_error{"RawClient: " + std::to_string(got) + " of " + std::to_string(size) +
                               " bytes came in time"};
    }
    const ssize_t more = ::recv(socket_, bytes.data() + got, size - got, 0);
    if (more < 0) fail("receive");
    if (more == 0) throw std::runtime_error{"RawClient: the server closed the connection"};
    got += static_cast<std::size_t>(more);
  }
  return bytes;
}

RawMessage RawClient::receive_message(Duration timeout) const {
  const Bytes header = receive(header_size, timeout);
  return {.host = word(header, 0),
          .robot = word(header, 4),
          .interface = word(header, 8),
          .index = word(header, 12),
          .type = word(header, 16),
          .subtype = word(header, 20),
          .timestamp_s = number(header, 24),
          .sequence = word(header, 32),
          .body = receive(word(header, 36), timeout)};
}

bool RawClient::silent_for(Duration duration) const { return !readable(socket_, Clock::now() + duration); }

bool RawClient::closed_by_peer(Duration timeout) const {
  const Time end = Clock::now() + timeout;
  Bytes bytes(65536);
  while (readable(socket_, end)) {
    if (::recv(socket_, bytes.data(), bytes.size(), 0) <= 0) return true;
  }
  return false;
}

void RawClient::end_output() const { ::shutdown(socket_, SHUT_WR); }

void RawClient::close() {
  if (socket_ >= 0) ::close(std::exchange(socket_, -1));
}

void RawClient::reset() {
  const linger at_once{.l_onoff = 1, .l_linger = 0};
  ::setsockopt(socket_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  close();
}

}  // namespace regista::testing
