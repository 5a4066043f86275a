// SPDX-License-Identifier: Apache-2.0
#include <spdlog/async.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sysexits.h>

#include <CLI/CLI.hpp>
#include <asio/io_context.hpp>
#include <asio/signal_set.hpp>
#include <charconv>
#include <cstdio>
#include <iostream>
#include <regista/client/robot.hpp>
#include <regista/server/playback.hpp>
#include <regista/server/server.hpp>
#include <thread>

namespace {

using namespace regista;

struct Arguments {
  std::string config;
  std::optional<std::uint16_t> port;
  std::vector<std::string> listen;
  std::vector<std::filesystem::path> plugin_folders;
  std::string log_level = "info";
  bool json_log = false;
  bool check = false;
  std::string status;
};

/// Where plugins are, seen from where this program is: the build tree and an installation look alike.
std::filesystem::path usual_plugin_folder() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() / "lib" / "regista";
}

std::shared_ptr<spdlog::logger> make_logger(const Arguments& arguments) {
  // On a thread of its own, bounded, the oldest dropped: a full disk or a stopped terminal must not stop a robot.
  constexpr std::size_t most_messages = 8192;
  spdlog::init_thread_pool(most_messages, 1);
  auto logger =
      std::make_shared<spdlog::async_logger>("regista", std::make_shared<spdlog::sinks::stderr_color_sink_mt>(),
                                             spdlog::thread_pool(), spdlog::async_overflow_policy::overrun_oldest);
  logger->set_level(spdlog::level::from_str(arguments.log_level));
  if (arguments.json_log) logger->set_pattern(R"({"time":"%Y-%m-%dT%H:%M:%S.%f%z","level":"%l",%v})");
  return logger;
}

/// What a running server says of itself.
int print_status(const std::string& server) {
  const auto colon = server.rfind(':');
  const std::string host = server.substr(0, colon);
  std::uint16_t port = 6665;
  if (colon != std::string::npos) {
    const char* end = server.data() + server.size();
    if (const auto read = std::from_chars(server.data() + colon + 1, end, port);
        read.ec != std::errc{} || read.ptr != end) {
      std::cerr << "regista-server: --status wants HOST:PORT, such as localhost:6665, not '" << server << "'\n";
      return EX_USAGE;
    }
  }
  try {
    client::Robot robot{host.empty() ? "localhost" : host, port};
    std::cout << robot.status() << '\n';
    return EX_OK;
  } catch (const client::Error& error) {
    std::cerr << error.what() << '\n';
    return EX_UNAVAILABLE;
  }
}

/// As JSON writes a string.
std::string json_string(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      std::array<char, 8> escaped{};
      std::snprintf(escaped.data(), escaped.size(), "\\u%04x", static_cast<unsigned>(c));
      out += escaped.data();
    } else {
      out += c;
    }
  }
  return out + '"';
}

int serve(const Arguments& arguments) {
  const ConfigFile config = read_config(arguments.config);
  const auto logger = make_logger(arguments);
  ServerOptions options{.port = arguments.check ? std::optional<std::uint16_t>{0} : arguments.port,
                        .listen = arguments.check ? std::vector<std::string>{"127.0.0.1"} : arguments.listen,
                        .plugin_folders = arguments.plugin_folders,
                        .plugins = {&playback}};
  options.plugin_folders.push_back(usual_plugin_folder());
  options.plugin_folders.emplace_back(REGISTA_PLUGIN_FOLDER);
  const auto log = [logger, json = arguments.json_log](LogLevel level, const std::string& text) {
    constexpr std::array levels{spdlog::level::info, spdlog::level::warn, spdlog::level::err};
    // The wall clock stands before it, and may jump.
    const double monotonic_s = seconds(Clock::now().time_since_epoch());
    const auto severity = levels[std::min<std::size_t>(static_cast<std::size_t>(level), levels.size() - 1)];
    if (json) {
      logger->log(severity, R"("monotonic_s":{:.6f},"message":{})", monotonic_s, json_string(text));
    } else {
      logger->log(severity, "[{:.6f}] {}", monotonic_s, text);
    }
  };
  options.log = log;
  Server server{config, std::move(options)};
  if (arguments.check) {
    std::cout << arguments.config << ": " << config.drivers.size() << " drivers, no errors\n";
    return EX_OK;
  }

  asio::io_context signals_io;
  asio::signal_set signals{signals_io, SIGINT, SIGTERM};
  std::function<void(int)> wait_for_signal = [&](int count) {
    signals.async_wait([&, count](const asio::error_code& error, int) {
      if (error) return;
      if (count > 0) std::_Exit(EXIT_FAILURE);  // asked twice: now
      server.stop();
      wait_for_signal(count + 1);
    });
  };
  wait_for_signal(0);
  std::jthread signal_thread{[&] { signals_io.run(); }};

  server.on_ready([&] {
    std::cout << "regista-server: ready on " << server.endpoints().front() << '\n' << std::flush;
  });
  server.on_hang([&] {
    log(LogLevel::error, "a driver has hung for too long: exiting, so that the service is started again");
    logger->flush();
    spdlog::shutdown();
    std::_Exit(70);  // EX_SOFTWARE; its thread cannot be ended
  });
  const bool at_rest = server.run();
  signals_io.stop();
  if (!at_rest) std::_Exit(70);
  spdlog::shutdown();
  return EX_OK;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Serve a robot's devices over TCP, to clients of Player 3.\n\n"
      "  regista-server examples/sim.cfg\n"
      "  regista-server --port 0 --log-level warning robot.cfg",
      "regista-server"};
  Arguments arguments;
  app.set_version_flag("--version", "regista-server " REGISTA_VERSION);
  auto* config = app.add_option("config", arguments.config, "The configuration, docs/configuration.md");
  auto* status =
      app.add_option("--status", arguments.status,
                     "Ask a running server (HOST:PORT) for its clients, queues, drops, beats and owners, as JSON")
          ->expected(0, 1)
          ->default_str("localhost:6665")
          ->excludes(config);
  app.add_option("--port", arguments.port, "TCP port instead of the configuration's; 0: any free one")
      ->excludes(status);  // which names its own
  app.add_option("--listen", arguments.listen,
                 "Addresses to listen on instead of the configuration's (127.0.0.1 and ::1)")
      ->allow_extra_args(false);  // one each: what follows may be the configuration
  app.add_option("--plugins", arguments.plugin_folders, "Folders to look for plugins in, before the usual one")
      ->allow_extra_args(false);
  app.add_option("--log-level", arguments.log_level, "info, warning, error or off")
      ->check(CLI::IsMember({"info", "warning", "error", "off"}));
  app.add_flag("--json-log", arguments.json_log, "One JSON object a line on stderr");
  app.add_flag("--check", arguments.check,
               "Read the configuration and make the drivers, move nothing, and say what is wrong");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? EX_OK : EX_USAGE;
  }
  if (status->count() > 0) return print_status(arguments.status.empty() ? "localhost:6665" : arguments.status);
  if (arguments.config.empty()) {
    std::cerr << "regista-server: which configuration? Try: regista-server examples/sim.cfg\n";
    return EX_USAGE;
  }
  rlimit descriptors{};
  if (::getrlimit(RLIMIT_NOFILE, &descriptors) == 0) {
    descriptors.rlim_cur = descriptors.rlim_max;
    ::setrlimit(RLIMIT_NOFILE, &descriptors);
  }
  try {
    return serve(arguments);
  } catch (const ConfigError& error) {
    std::cerr << error.what() << '\n';
    return EX_CONFIG;
  } catch (const ListenError& error) {
    std::cerr << error.what() << '\n';
    return EX_OSERR;
  } catch (const std::exception& error) {
    std::cerr << "regista-server: " << error.what() << '\n';
    return EX_SOFTWARE;
  }
}
