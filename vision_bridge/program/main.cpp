// SPDX-License-Identifier: Apache-2.0
#include <spdlog/async.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sysexits.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <iostream>
#include <regista/device/config.hpp>

#include "bridge.hpp"

namespace {

using namespace regista;

/// For the signal handler, which can be given nothing.
vision::Bridge* running = nullptr;

struct Arguments {
  std::string config;
  std::string replay;
  std::string record;
  std::vector<std::string> interfaces;
  std::string log_level = "info";
  bool check = false;
};

std::shared_ptr<spdlog::logger> make_logger(const std::string& level) {
  // On a thread of its own, bounded, the oldest dropped: a stopped terminal must not delay a pose.
  constexpr std::size_t most_messages = 1024;
  spdlog::init_thread_pool(most_messages, 1);
  auto logger =
      std::make_shared<spdlog::async_logger>("regista", std::make_shared<spdlog::sinks::stderr_color_sink_mt>(),
                                             spdlog::thread_pool(), spdlog::async_overflow_policy::overrun_oldest);
  logger->set_level(spdlog::level::from_str(level));
  return logger;
}

int serve(const Arguments& arguments) {
  vision::BridgeConfig config = vision::read_bridge_config(arguments.config);
  if (!arguments.interfaces.empty()) config.interfaces = arguments.interfaces;
  if (arguments.check) {
    std::cout << arguments.config << ": " << config.robots.size() << " robots, no errors\n";
    return EX_OK;
  }
  const auto logger = make_logger(arguments.log_level);
  vision::Bridge::Options options;
  if (!arguments.replay.empty()) options.replay = arguments.replay;
  if (!arguments.record.empty()) options.record = arguments.record;
  vision::Bridge bridge{std::move(config), options, [logger](vision::LogLevel level, const std::string& text) {
                          logger->log(level == vision::LogLevel::info ? spdlog::level::info : spdlog::level::warn, "{}",
                                      text);
                        }};
  running = &bridge;
  for (const int number : {SIGINT, SIGTERM}) std::signal(number, [](int) { running->stop(); });
  std::cout << "regista-vision-bridge: ready\n" << std::flush;
  bridge.run();
  for (const int number : {SIGINT, SIGTERM}) std::signal(number, SIG_DFL);
  running = nullptr;
  spdlog::shutdown();
  return EX_OK;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Hear what the cameras of RoboCup's Small Size League see, and tell each robot where it is.\n\n"
      "  regista-vision-bridge examples/vision.cfg\n"
      "  regista-vision-bridge --interface eth0 --record match.log team.cfg\n"
      "  regista-vision-bridge --replay match.log team.cfg\n\n"
      "docs/ssl-vision.md explains the configuration, and what is sent.",
      "regista-vision-bridge"};
  Arguments arguments;
  app.set_version_flag("--version", "regista-vision-bridge " REGISTA_VERSION);
  app.add_option("config", arguments.config, "The configuration")->required();
  app.add_option("--interface", arguments.interfaces,
                 "Network interfaces to listen on, such as eth0 or lo, instead of the configuration's (all but lo)")
      ->allow_extra_args(false);
  auto* record = app.add_option("--record", arguments.record, "Write all that is heard into a log file of the league");
  app.add_option("--replay", arguments.replay,
                 "Take a log file of the league for the network, at its own speed, and end")
      ->excludes(record);
  app.add_option("--log-level", arguments.log_level, "info, warning or off")
      ->check(CLI::IsMember({"info", "warning", "off"}));
  app.add_flag("--check", arguments.check, "Read the configuration and say what is wrong");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? EX_OK : EX_USAGE;
  }
  try {
    return serve(arguments);
  } catch (const ConfigError& error) {
    std::cerr << error.what() << '\n';
    return EX_CONFIG;
  } catch (const std::system_error& error) {
    std::cerr << "regista-vision-bridge: " << error.what() << '\n';
    return EX_OSERR;
  } catch (const std::exception& error) {
    std::cerr << "regista-vision-bridge: " << error.what() << '\n';
    return EX_SOFTWARE;
  }
}
