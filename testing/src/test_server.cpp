// SPDX-License-Identifier: Apache-2.0
#include <regista/testing/test_server.hpp>

#include <algorithm>

namespace regista::testing {

TestServer::TestServer(const std::string& config, std::vector<const Plugin*> plugins)
    : server_{parse_config(config, "test.cfg"), options(std::move(plugins))}, port_{server_.port()} {
  server_.on_ready([this] {
    const std::scoped_lock lock{mutex_};
    ready_ = true;
    changed_.notify_all();
  });
  thread_ = std::thread{[this] { at_rest_ = server_.run(); }};
  std::unique_lock lock{mutex_};
  changed_.wait(lock, [this] { return ready_; });
}

TestServer::~TestServer() { stop(); }

bool TestServer::stop() {
  if (thread_.joinable()) {
    server_.stop();
    thread_.join();
  }
  return at_rest_;
}

ServerOptions TestServer::options(std::vector<const Plugin*> plugins) {
  return {.port = 0,
          .listen = {"127.0.0.1"},
          .plugins = std::move(plugins),
          .log = [this](LogLevel, const std::string& text) {
            const std::scoped_lock lock{mutex_};
            log_.push_back(text);
            changed_.notify_all();
          }};
}

std::vector<std::string> TestServer::log() const {
  const std::scoped_lock lock{mutex_};
  return log_;
}

std::string TestServer::logged(std::string_view text, Duration timeout) const {
  std::unique_lock lock{mutex_};
  const auto find = [&] {
    return std::ranges::find_if(log_, [&](const std::string& line) { return line.find(text) != std::string::npos; });
  };
  if (changed_.wait_for(lock, timeout, [&] { return find() != log_.end(); })) return *find();
  std::string all = "the server did not log \"" + std::string{text} + "\" but:";
  for (const std::string& line : log_) all += "\n  " + line;
  throw std::runtime_error{all};
}

}  // namespace regista::testing
