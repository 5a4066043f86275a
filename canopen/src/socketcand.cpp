// SPDX-License-Identifier: Apache-2.0
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <regista/canopen/socketcand.hpp>

namespace regista::canopen {
namespace {

constexpr std::size_t most_out = 4096;  // bytes that wait for the network
constexpr std::size_t most_message = 4096;

Error last_error(const std::string& what) { return {std::error_code{errno, std::generic_category()}, what}; }

std::string_view next_word(std::string_view& text) {
  const std::size_t begin = std::min(text.find_first_not_of(' '), text.size());
  const std::size_t end = std::min(text.find(' ', begin), text.size());
  const std::string_view word = text.substr(begin, end - begin);
  text.remove_prefix(end);
  return word;
}

template <typename T>
bool from_hex(std::string_view text, T& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  return error == std::errc{} && end == text.data() + text.size() && !text.empty();
}

bool wait_for(int socket, short events, Time until) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now()).count();
  pollfd ready{.fd = socket, .events = events, .revents = 0};
  return left > 0 && ::poll(&ready, 1, static_cast<int>(left)) > 0;
}

}  // namespace

std::string socketcand_send(const CanFrame& frame) {
  // Eight digits mean 29 bits (doc/protocol.md); bytes are unpadded.
  std::string text = "< send " + hex(frame.id, frame.extended ? 8 : 3) + " " + std::to_string(frame.size);
  for (const std::uint8_t byte : frame.bytes()) {
    text += ' ';
    if (byte >= 0x10) text += hex(byte >> 4U, 1);
    text += hex(byte & 0xFU, 1);
  }
  return text + " >";
}

std::optional<CanFrame> parse_socketcand(std::string_view message) {
  const std::string_view kind = next_word(message);
  const std::string_view id = next_word(message);
  CanFrame frame;
  if (!from_hex(id, frame.id)) return {};
  (void)next_word(message);  // seconds, of the other machine's clock
  if (kind == "error") {
    frame.error = true;
    frame.size = 8;
    return frame;
  }
  if (kind != "frame") return {};
  frame.extended = id.size() == 8;
  if (frame.id > (frame.extended ? 0x1FFFFFFFU : 0x7FFU)) return {};
  const std::string_view data = next_word(message);
  if (data.size() % 2 != 0 || data.size() > 16) return {};
  frame.size = static_cast<std::uint8_t>(data.size() / 2);
  for (std::size_t i = 0; i < frame.size; ++i) {
    if (!from_hex(data.substr(2 * i, 2), frame.data[i])) return {};
  }
  return frame;
}

Result<std::unique_ptr<SocketCand>> SocketCand::open(const std::string& host, std::uint16_t port,
                                                     const std::string& bus, Duration timeout) {
  const Time until = Clock::now() + timeout;
  const std::string where = "socketcand " + host + ":" + std::to_string(port) + " " + bus;
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found); error != 0) {
    return Error{std::errc::host_unreachable, where + ": " + ::gai_strerror(error)};
  }
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> addresses{found, &::freeaddrinfo};
  int socket = -1;
  for (const addrinfo* address = found; address != nullptr && socket < 0; address = address->ai_next) {
    socket = ::socket(address->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (socket < 0) continue;
    int error = ::connect(socket, address->ai_addr, address->ai_addrlen) == 0 ? 0 : errno;
    if (error == EINPROGRESS) {
      socklen_t size = sizeof error;
      error = ETIMEDOUT;
      if (wait_for(socket, POLLOUT, until)) ::getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &size);
    }
    if (error != 0) {
      ::close(socket);
      socket = -1;
      errno = error;
    }
  }
  if (socket < 0) return last_error(where);
  std::unique_ptr<SocketCand> can{new SocketCand{socket, where}};
  const int on = 1;
  (void)::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);

  const auto expect = [&](const std::string& said, std::string_view wanted) -> Result<> {
    if (!said.empty() && ::send(socket, said.data(), said.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(said.size())) {
      return last_error(where);
    }
    const auto answer = can->next_message(until);
    if (!answer) return answer.error();
    std::string_view text = *answer;
    if (next_word(text) != wanted) return Error{std::errc::protocol_error, where + ": '" + *answer + "'"};
    return {};
  };
  if (auto hi = expect("", "hi"); !hi) return hi.error();
  if (auto opened = expect("< open " + bus + " >", "ok"); !opened) return opened.error();
  if (auto raw = expect("< rawmode >", "ok"); !raw) return raw.error();
  return can;
}

SocketCand::~SocketCand() { ::close(socket_); }

/// Reads what the network has; false if there was nothing.
Result<bool> SocketCand::fill() {
  in_.erase(0, read_);
  read_ = 0;
  std::array<char, 4096> buffer{};
  const ssize_t size = ::recv(socket_, buffer.data(), buffer.size(), 0);
  if (size == 0) return Error{std::errc::connection_reset, where_};
  if (size < 0) {
    if (errno == EAGAIN || errno == EINTR) return false;
    return last_error(where_);
  }
  in_.append(buffer.data(), static_cast<std::size_t>(size));
  return true;
}

Result<std::string> SocketCand::next_message(Time until) {
  while (true) {
    const std::size_t begin = in_.find('<', read_);
    const std::size_t end = begin == std::string::npos ? begin : in_.find('>', begin);
    if (end != std::string::npos) {
      read_ = end + 1;
      return in_.substr(begin + 1, end - begin - 1);
    }
    if (in_.size() - read_ > most_message) return Error{std::errc::protocol_error, where_ + ": no end of message"};
    const auto more = fill();
    if (!more) return more.error();
    if (!*more && !wait_for(socket_, POLLIN, until)) return Error{std::errc::timed_out, where_};
  }
}

Result<> SocketCand::send(const CanFrame& frame) {
  if (frame.remote) return Error{std::errc::operation_not_supported, where_ + ": it carries no remote frames"};
  if (out_.size() > most_out) {
    const ssize_t taken = ::send(socket_, out_.data(), out_.size(), MSG_NOSIGNAL);
    if (taken < 0 && errno != EAGAIN) return last_error(where_);
    if (taken > 0) out_.erase(0, static_cast<std::size_t>(taken));
    if (out_.size() > most_out) return Error{std::errc::no_buffer_space, where_};
  }
  out_ += socketcand_send(frame);
  const ssize_t taken = ::send(socket_, out_.data(), out_.size(), MSG_NOSIGNAL);
  if (taken < 0 && errno != EAGAIN && errno != EINTR) return last_error(where_);
  if (taken > 0) out_.erase(0, static_cast<std::size_t>(taken));
  return {};
}

Result<std::optional<ReceivedFrame>> SocketCand::receive() {
  while (true) {
    const auto message = next_message(Time{});
    if (!message) {
      if (message.error().code == std::errc::timed_out) return std::optional<ReceivedFrame>{};
      return message.error();
    }
    if (const auto frame = parse_socketcand(*message)) return std::optional{ReceivedFrame{*frame, Clock::now()}};
  }
}

}  // namespace regista::canopen
