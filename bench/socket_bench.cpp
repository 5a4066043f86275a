// SPDX-License-Identifier: Apache-2.0
#include "socket_bench.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/tcp.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <system_error>

namespace regista::bench {

namespace {

int checked(int result, const char* what) {
  if (result < 0) throw std::system_error{errno, std::generic_category(), what};
  return result;
}

void set_option(const Descriptor& socket, int level, int name, int value) {
  checked(::setsockopt(socket.get(), level, name, &value, sizeof value), "setsockopt");
}

sockaddr_in loopback(std::uint16_t port) {
  return {.sin_family = AF_INET, .sin_port = htons(port), .sin_addr = {htonl(INADDR_LOOPBACK)}, .sin_zero = {}};
}

}  // namespace

Descriptor::~Descriptor() {
  if (number_ >= 0) ::close(number_);
}

Descriptor listen_anywhere(std::uint16_t& port) {
  Descriptor socket{checked(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), "socket")};
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  checked(::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), size), "bind");
  checked(::listen(socket.get(), SOMAXCONN), "listen");
  checked(::getsockname(socket.get(), reinterpret_cast<sockaddr*>(&address), &size), "getsockname");
  port = ntohs(address.sin_port);
  return socket;
}

Descriptor accept_from(const Descriptor& listener) {
  Descriptor socket{checked(::accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC), "accept")};
  set_option(socket, IPPROTO_TCP, TCP_NODELAY, 1);
  return socket;
}

Descriptor connect_to(std::uint16_t port, bool nodelay, int receive_buffer) {
  Descriptor socket{checked(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), "socket")};
  if (receive_buffer > 0) set_option(socket, SOL_SOCKET, SO_RCVBUF, receive_buffer);
  const sockaddr_in address = loopback(port);
  checked(::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), "connect");
  if (nodelay) set_option(socket, IPPROTO_TCP, TCP_NODELAY, 1);
  const timeval silence{.tv_sec = 5, .tv_usec = 0};
  checked(::setsockopt(socket.get(), SOL_SOCKET, SO_RCVTIMEO, &silence, sizeof silence), "setsockopt");
  return socket;
}

void send_all(const Descriptor& socket, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent < 0) throw std::system_error{errno, std::generic_category(), "send"};
    bytes = bytes.subspan(static_cast<std::size_t>(sent));
  }
}

void receive_all(const Descriptor& socket, std::span<std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t received = ::recv(socket.get(), bytes.data(), bytes.size(), 0);
    if (received < 0) throw std::system_error{errno, std::generic_category(), "recv"};
    if (received == 0) throw std::runtime_error{"the peer has left"};
    bytes = bytes.subspan(static_cast<std::size_t>(received));
  }
}

Child::~Child() {
  if (pid_ <= 0) return;
  ::kill(pid_, SIGKILL);
  ::waitpid(pid_, nullptr, 0);
}

Duration Child::cpu_time() const {
  clockid_t clock{};
  timespec time{};
  if (::clock_getcpuclockid(pid_, &clock) != 0 || ::clock_gettime(clock, &time) != 0) {
    throw std::runtime_error{"the child's CPU clock cannot be read"};
  }
  return std::chrono::seconds{time.tv_sec} + std::chrono::nanoseconds{time.tv_nsec};
}

std::size_t Child::resident_bytes() const {
  std::ifstream file{"/proc/" + std::to_string(pid_) + "/statm"};
  std::size_t total = 0;
  std::size_t resident = 0;
  file >> total >> resident;
  return resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

ServerProcess start_server(const std::string& config) {
  std::string path = "/tmp/regista-bench-XXXXXX";
  const Descriptor file{checked(::mkstemp(path.data()), "mkstemp")};
  std::ofstream{path} << config;
  std::array<int, 2> ends{};
  checked(::pipe2(ends.data(), O_CLOEXEC), "pipe");
  Child child{checked(::fork(), "fork")};
  if (child.pid() == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::dup2(ends[1], STDOUT_FILENO);
    ::execl(REGISTA_SERVER, REGISTA_SERVER, "--port", "0", "--listen", "127.0.0.1", "--log-level", "error", "--plugins",
            REGISTA_FAKES, path.c_str(), nullptr);
    std::_Exit(127);
  }
  ::close(ends[1]);
  std::FILE* output = ::fdopen(ends[0], "r");
  std::uint16_t port = 0;
  const int read = std::fscanf(output, "regista-server: ready on 127.0.0.1:%hu", &port);
  std::fclose(output);
  ::unlink(path.c_str());
  if (read != 1) throw std::runtime_error{"regista-server did not start"};
  return {std::move(child), port};
}

Client::Client(std::uint16_t port, bool nodelay, int receive_buffer)
    : socket_{connect_to(port, nodelay, receive_buffer)} {
  std::array<std::byte, xdr::banner_size> banner;
  receive_all(socket_, banner);
}

xdr::Frame Client::receive(Kind kind, std::uint8_t subtype) {
  for (;;) {
    auto frame = framer_.next();
    if (!frame) throw std::runtime_error{frame.error().what};
    if (*frame) {
      const xdr::Header& header = (*frame)->header;
      if (header.kind == kind && header.subtype == subtype) return **frame;
      if (header.kind == Kind::nack) throw std::runtime_error{"the server refused a request"};
      continue;
    }
    const std::span<std::byte> space = framer_.space();
    const ssize_t received = ::recv(socket_.get(), space.data(), space.size(), 0);
    if (received <= 0) throw std::runtime_error{"no answer within five seconds"};
    framer_.commit(static_cast<std::size_t>(received));
  }
}

void Client::subscribe(player::DeviceAddress address) {
  if (request(server_address, player::Subscribe{.address = address}).access != player::Access::open) {
    throw std::runtime_error{"subscribe"};
  }
}

nlohmann::json Client::status() {
  return nlohmann::json::parse(request(server_address, player::GetStatus{}).json.view());
}

double quantile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return std::nan("");
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
}

Options::Options(int argc, char** argv) {
  const std::span arguments{argv, static_cast<std::size_t>(argc)};
  for (std::size_t i = 1; i < arguments.size(); ++i) {
    const std::string_view argument = arguments[i];
    if (argument == "--quick") {
      quick = true;
    } else if (argument == "--json" && i + 1 < arguments.size()) {
      json = arguments[++i];
    } else {
      std::fprintf(stderr, "usage: %s [--quick] [--json FILE]\n", arguments[0]);
      std::exit(EXIT_FAILURE);
    }
  }
  rlimit descriptors{};
  ::getrlimit(RLIMIT_NOFILE, &descriptors);
  descriptors.rlim_cur = descriptors.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &descriptors);
}

Report::Report(Options options) : options_{std::move(options)} {
  double load = 0;
  ::getloadavg(&load, 1);
  tables_["load_average"] = load;
  std::printf("%ld processors, load average %.2f\n", ::sysconf(_SC_NPROCESSORS_ONLN), load);
}

Report::~Report() {
  if (!options_.json.empty()) std::ofstream{options_.json} << tables_.dump(2) << '\n';
}

void Report::add(const std::string& table, nlohmann::ordered_json row) {
  const auto cell = [](const nlohmann::ordered_json& value) {
    if (value.is_string()) return value.get<std::string>();
    if (!value.is_number_float()) return value.dump();
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), "%.2f", value.get<double>());
    return std::string{text.data()};
  };
  const auto print = [](bool first, const std::string& text) { std::printf(first ? "%-40s" : " %12s", text.c_str()); };
  if (!tables_.contains(table)) {
    std::printf("\n%s\n", table.c_str());
    for (const auto& [key, value] : row.items()) print(key == "what", key);
    std::printf("\n");
  }
  for (const auto& [key, value] : row.items()) print(key == "what", cell(value));
  std::printf("\n");
  std::fflush(stdout);
  tables_[table].push_back(std::move(row));
}

}  // namespace regista::bench
