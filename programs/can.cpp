// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <csignal>
#include <fstream>
#include <iostream>
#include <iterator>
#include <regista/canopen/candump.hpp>
#include <regista/canopen/cia402.hpp>
#include <regista/canopen/eds.hpp>
#include <regista/canopen/master.hpp>
#include <regista/canopen/open_bus.hpp>
#include <regista/canopen/pump.hpp>
#include <regista/canopen/slave.hpp>
#include <utility>

#include "command_line.hpp"

namespace regista::canopen {
namespace {

using namespace std::chrono_literals;

constexpr const char* examples = R"(Examples:
  Who is there, and what is it?
    regista-can -b can0 scan
  Read and write objects, by number or by the names of an EDS:
    regista-can -b can0 read 5 6041 --type unsigned16
    regista-can -b can0 write 5 "profile acceleration" 5000 --eds drive.eds
  See everything, in words; or record it and look later:
    regista-can -b can0 dump --words
    regista-can -b can0 dump > bus.log && regista-can decode < bus.log
  A bus of another machine that runs socketcand:
    regista-can -b socketcand://robot:29536/can0 watch 5
  Play a device:
    regista-can -b vcan0 device 5 drive.eds

The interface is set up by the system: ip link set can0 up type can bitrate 500000 restart-ms 100)";

volatile std::sig_atomic_t interrupted = 0;

/// Ends a command.
struct Failure : std::runtime_error {
  explicit Failure(const Error& error) : std::runtime_error{error.message()}, code{error.code} {}
  std::error_code code;
};

/// Sees frames before the station behind it does.
struct Tap final : Station {
  Station* behind = nullptr;
  std::function<void(const CanFrame&)> see;
  void on_frame(const CanFrame& frame, Time now) override {
    if (see) see(frame);
    if (behind != nullptr) behind->on_frame(frame, now);
  }
  void on_time(Time now) override {
    if (behind != nullptr) behind->on_time(now);
  }
  [[nodiscard]] Time next_wake() const override { return behind == nullptr ? Time::max() : behind->next_wake(); }
};

/// What the commands share: the bus, a master on it, and a loop that runs until something is done.
class Session {
 public:
  Session(const std::string& bus_name, const Master::Options& options)
      : bus_{required(open_bus(bus_name))}, master_{*bus_, options, make_events()} {
    tap_.behind = &master_;
  }

  Master& master() { return master_; }
  Tap& tap() { return tap_; }
  CanBus& bus() { return *bus_; }
  std::function<void(NodeId, NodeMonitor::Event)> on_node;
  std::function<void(NodeId, const Emcy&)> on_emcy;

  /// False when `limit` passed or Ctrl-C came before.
  bool run_until(const std::function<bool()>& done, Duration limit) {
    Pump pump{*bus_, tap_};
    master_.on_time(Clock::now());
    const Time begin = master_.now();
    while (!done()) {
      const Duration left = limit - (master_.now() - begin);
      if (interrupted != 0 || left <= Duration::zero()) return false;
      if (const Result<> served = pump.wait(std::min<Duration>(left, 200ms)); !served) throw Failure{served.error()};
    }
    return true;
  }

  Bytes read(NodeId node, ObjectIndex object, SdoTransfer transfer) {
    return finish([&](const SdoDone& done) { return master_.upload(node, object, done, Clock::now(), transfer); });
  }
  void write(NodeId node, ObjectIndex object, const Bytes& data, SdoTransfer transfer) {
    (void)finish(
        [&](const SdoDone& done) { return master_.download(node, object, data, done, Clock::now(), transfer); });
  }

 private:
  static std::unique_ptr<CanBus> required(Result<std::unique_ptr<CanBus>> bus) {
    if (!bus) throw Failure{bus.error()};
    return *std::move(bus);
  }
  Master::Events make_events() {
    return {.node =
                [this](NodeId node, NodeMonitor::Event event) {
                  if (on_node) on_node(node, event);
                },
            .emcy =
                [this](NodeId node, const Emcy& emcy) {
                  if (on_emcy) on_emcy(node, emcy);
                },
            .bus = [](BusState state) { std::cerr << "bus: " << to_string(state) << "\n"; }};
  }
  Bytes finish(const std::function<Result<>(SdoDone)>& begin) {
    std::optional<Result<Bytes>> result;
    if (const Result<> begun = begin([&](Result<Bytes> done) { result = std::move(done); }); !begun)
      throw Failure{begun.error()};
    if (!run_until([&] { return result.has_value(); }, Duration::max()))
      throw Failure{Error{std::errc::interrupted, ""}};
    if (!*result) throw Failure{result->error()};
    return **result;
  }

  std::unique_ptr<CanBus> bus_;
  Master master_;
  Tap tap_;
};

const std::map<std::string, DataType> types{{"boolean", DataType::boolean},
                                            {"integer8", DataType::integer8},
                                            {"integer16", DataType::integer16},
                                            {"integer32", DataType::integer32},
                                            {"integer64", DataType::integer64},
                                            {"unsigned8", DataType::unsigned8},
                                            {"unsigned16", DataType::unsigned16},
                                            {"unsigned32", DataType::unsigned32},
                                            {"unsigned64", DataType::unsigned64},
                                            {"real32", DataType::real32},
                                            {"real64", DataType::real64},
                                            {"string", DataType::visible_string},
                                            {"hex", DataType::domain}};

struct Arguments {
  std::string bus = "can0";
  Duration timeout = 500ms;
  int node = 0;
  int last = last_node;
  std::string object;
  std::string value;
  std::string eds;
  std::string type;
  std::string file;
  std::string nmt;
  bool block = false;
  bool rate = false;
  bool words = false;
  std::uint64_t count = 0;
  double seconds = 0;
  int set_node = 0;
  std::vector<std::uint32_t> identity;
};

NodeId node_of(const Arguments& a) { return static_cast<NodeId>(a.node); }

ObjectDictionary dictionary(const Arguments& a) {
  return a.eds.empty() ? ObjectDictionary{} : load_eds(a.eds, a.node == 0 ? std::nullopt : std::optional{node_of(a)});
}

Master::Options options(const Arguments& a) {
  // A tool that comes and goes must not be a heartbeat that drives learn to wait for.
  return {.heartbeat = {}, .sdo = {.timeout = a.timeout}, .lss = {}};
}

struct Target {
  ObjectIndex object;
  DataType type = DataType::domain;
};

Target target(const Arguments& a, const ObjectDictionary& dictionary, DataType fallback) {
  const auto object = dictionary.parse(a.object);
  if (!object) throw Failure{object.error()};
  const ObjectEntry* entry = dictionary.find(*object);
  DataType type = entry != nullptr ? entry->type : fallback;
  if (!a.type.empty()) type = types.at(a.type);
  return {*object, type};
}

void print_rate(const Arguments& a, std::size_t bytes, Time begin) {
  if (!a.rate) return;
  const double took_s = seconds(Clock::now() - begin);
  std::fprintf(stderr, "%zu bytes in %.3f s: %.0f bytes/s\n", bytes, took_s, static_cast<double>(bytes) / took_s);
}

int read(const Arguments& a) {
  const ObjectDictionary known = dictionary(a);
  const Target from = target(a, known, DataType::domain);
  Session session{a.bus, options(a)};
  const Time begin = Clock::now();
  const Bytes bytes = session.read(node_of(a), from.object, a.block ? SdoTransfer::block : SdoTransfer::standard);
  print_rate(a, bytes.size(), begin);
  if (a.file.empty()) {
    std::cout << format(from.type, bytes) << "\n";
    return 0;
  }
  std::ofstream file{a.file, std::ios::binary};
  std::ranges::copy(bytes, std::ostreambuf_iterator<char>{file});
  if (!file.flush()) throw Failure{Error{std::errc::io_error, "write " + a.file}};
  return 0;
}

int write(const Arguments& a) {
  const ObjectDictionary known = dictionary(a);
  const Target to = target(a, known, DataType::domain);
  Bytes bytes;
  if (!a.file.empty()) {
    std::ifstream file{a.file, std::ios::binary};
    if (!file) throw Failure{Error{std::errc::no_such_file_or_directory, a.file}};
    bytes.assign(std::istreambuf_iterator<char>{file}, {});
  } else if (const auto encoded = encode(to.type, a.value)) {
    bytes = *encoded;
  } else {
    throw Failure{encoded.error()};
  }
  Session session{a.bus, options(a)};
  const Time begin = Clock::now();
  session.write(node_of(a), to.object, bytes, a.block ? SdoTransfer::block : SdoTransfer::standard);
  print_rate(a, bytes.size(), begin);
  return 0;
}

/// Asks all nodes at once for what they are.
int scan(const Arguments& a) {
  Session session{a.bus, options(a)};
  struct Found {
    std::optional<Bytes> type;
    std::string name;
    std::optional<Identity> identity;
  };
  std::map<int, Found> found;
  int open = 0;
  for (int id = first_node; id <= a.last; ++id) {
    const auto node = static_cast<NodeId>(id);
    ++open;
    const Result<> begun = session.master().upload(
        node, {0x1000, 0},
        [&, node](const Result<Bytes>& type) {
          --open;
          if (!type && type.error().code == std::errc::timed_out) return;
          found[node].type = type ? std::optional{*type} : std::nullopt;
          open += 2;
          const Time now = session.master().now();
          const auto named = session.master().upload(
              node, {0x1008, 0},
              [&, node](const Result<Bytes>& name) {
                --open;
                if (name) found[node].name = format(DataType::visible_string, *name);
              },
              now);
          const auto identified = session.master().identify(
              node,
              [&, node](const Result<Identity>& identity) {
                --open;
                if (identity) found[node].identity = *identity;
              },
              now);
          if (!named || !identified) open = 0;
        },
        Clock::now());
    if (!begun) throw Failure{begun.error()};
  }
  (void)session.run_until([&] { return open <= 0; }, 60s);
  for (const auto& [node, device] : found) {
    const auto state = session.master().monitor(static_cast<NodeId>(node)).state();
    const auto profile =
        device.type ? get_le(ByteView{*device.type}.first(std::min<std::size_t>(2, device.type->size()))) : 0;
    std::cout << "node " << node << "  profile " << profile << "  '" << device.name << "'";
    if (device.identity) std::cout << "  " << to_string(*device.identity);
    if (state) std::cout << "  " << to_string(*state);
    std::cout << "\n";
  }
  if (found.empty()) {
    std::cerr << "nobody answers. Is the bit rate right, is the bus terminated, are the drives powered?\n";
    return 1;
  }
  return 0;
}

int dump(const Arguments& a) {
  auto bus = open_bus(a.bus);
  if (!bus) throw Failure{bus.error()};
  Tap tap;
  std::uint64_t seen = 0;
  const std::string interface = a.bus.substr(a.bus.rfind('/') + 1);
  tap.see = [&](const CanFrame& frame) {
    const double now_s = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    std::cout << to_string(LogEntry{now_s, interface, frame});
    if (a.words) std::cout << "  " << describe(frame);
    std::cout << "\n" << std::flush;  // at once: it is watched, or read by another program
    ++seen;
  };
  Pump pump{**bus, tap};
  std::cerr << "listening on " << a.bus << "\n" << std::flush;
  const Time end = a.seconds > 0 ? Clock::now() + from_seconds(a.seconds) : Time::max();
  while (interrupted == 0 && (a.count == 0 || seen < a.count) && Clock::now() < end) {
    if (const Result<> served = pump.wait(std::min<Duration>(end - Clock::now(), 200ms)); !served)
      throw Failure{served.error()};
  }
  return 0;
}

int decode_log() {
  std::string line;
  bool good = true;
  while (std::getline(std::cin, line)) {
    if (line.empty()) continue;
    if (const auto entry = parse_log_line(line)) {
      std::cout << to_string(*entry) << "  " << describe(entry->frame) << "\n";
    } else {
      std::cerr << entry.error().what << "\n";
      good = false;
    }
  }
  return good ? 0 : 1;
}

const std::map<std::string, NmtCommand> nmt_commands{{"start", NmtCommand::start},
                                                     {"stop", NmtCommand::stop},
                                                     {"pre-operational", NmtCommand::pre_operational},
                                                     {"reset", NmtCommand::reset_node},
                                                     {"reset-communication", NmtCommand::reset_communication}};

int nmt(const Arguments& a) {
  Session session{a.bus, options(a)};
  if (const Result<> sent = session.master().command(nmt_commands.at(a.nmt), node_of(a), Clock::now()); !sent) {
    throw Failure{sent.error()};
  }
  (void)session.run_until([&] { return session.master().statistics().sent > 0; }, 1s);
  return 0;
}

/// Polls a drive and prints what changes.
int watch(const Arguments& a) {
  Session session{a.bus, options(a)};
  std::string last;
  session.on_emcy = [&](NodeId node, const Emcy& emcy) {
    if (node == node_of(a)) std::cout << to_string(emcy) << "\n" << std::flush;
  };
  session.on_node = [&](NodeId node, NodeMonitor::Event event) {
    if (node != node_of(a)) return;
    if (event == NodeMonitor::Event::boot_up) std::cout << "boot-up" << "\n" << std::flush;
    if (event == NodeMonitor::Event::state_changed) {
      std::cout << "NMT " << to_string(*session.master().monitor(node).state()) << "\n" << std::flush;
    }
  };
  const Time end = a.seconds > 0 ? Clock::now() + from_seconds(a.seconds) : Time::max();
  while (interrupted == 0 && Clock::now() < end) {
    std::string line;
    try {
      const auto object = [&](std::uint16_t index) {
        return get_le(session.read(node_of(a), {index, 0}, SdoTransfer::standard));
      };
      const auto statusword = static_cast<std::uint16_t>(object(0x6041));
      const auto state = cia402_state(statusword);
      const std::uint64_t speed = object(0x606C);
      line = "0x" + hex(statusword, 4) + " " + (state ? to_string(*state) : "no state of CiA 402") + ", " +
             std::to_string(static_cast<std::int32_t>(speed)) + " of velocity units, error 0x" + hex(object(0x603F), 4);
    } catch (const Failure& failure) {
      if (failure.code == std::errc::interrupted) break;
      line = failure.what();
    }
    if (line != last) std::cout << line << "\n" << std::flush;
    last = line;
    (void)session.run_until([] { return false; }, 100ms);
  }
  return 0;
}

int lss(const Arguments& a) {
  Session session{a.bus, options(a)};
  LssMaster& master = session.master().lss();
  std::optional<Result<std::optional<Identity>>> found;
  if (a.identity.empty()) {
    master.fast_scan([&](auto result) { found = std::move(result); }, Clock::now());
  } else {
    const Identity wanted{a.identity[0], a.identity[1], a.identity[2], a.identity[3]};
    master.select(
        wanted,
        [&, wanted](const Result<>& result) {
          found = result ? Result<std::optional<Identity>>{std::optional{wanted}} : result.error();
        },
        Clock::now());
  }
  if (!session.run_until([&] { return found.has_value(); }, 60s)) throw Failure{Error{std::errc::timed_out, "LSS"}};
  if (!*found) throw Failure{found->error()};
  if (!**found) {
    std::cerr << "no node without a node id answers\n";
    return 1;
  }
  std::cout << to_string(***found) << "\n";
  const auto run = [&](auto&& begin) {
    std::optional<Result<>> done;
    begin([&](const Result<>& result) { done = result; });
    if (!session.run_until([&] { return done.has_value(); }, 5s)) throw Failure{Error{std::errc::timed_out, "LSS"}};
    return *done;
  };
  std::optional<Error> failed;
  if (a.set_node != 0) {
    const auto set = run([&](auto done) { master.set_node_id(static_cast<NodeId>(a.set_node), done, Clock::now()); });
    if (!set) {
      failed = set.error();
    } else if (const auto stored = run([&](auto done) { master.store(done, Clock::now()); }); !stored) {
      std::cerr << stored.error().message() << ": it is lost when the power goes\n";
    }
  }
  bool booted = false;
  session.on_node = [&](NodeId node, NodeMonitor::Event event) {
    booted = booted || (std::cmp_equal(node, a.set_node) && event == NodeMonitor::Event::boot_up);
  };
  (void)run([&](auto done) { master.switch_all(false, done, Clock::now()); });
  if (failed) throw Failure{*failed};
  if (a.set_node != 0 && !session.run_until([&] { return booted; }, 1s)) {
    std::cerr << "node " << a.set_node << " does not boot up by itself: reset it, by power or (all nodes without one) "
              << "`nmt reset-communication`, with the node id that it had\n";
  }
  return 0;
}

/// Plays the device that an EDS describes, until Ctrl-C. An 0x2002 that is written raises that emergency.
int device(const Arguments& a) {
  auto bus = open_bus(a.bus);
  if (!bus) throw Failure{bus.error()};
  Slave* self = nullptr;
  std::optional<Emcy> raised;
  const auto written = [&](ObjectIndex object, ByteView data) -> std::optional<SdoAbort> {
    const bool is_long = data.size() > 32;
    std::cout << "written " << to_string(object) << " = "
              << (is_long ? std::to_string(data.size()) + " bytes"
                          : format(self->dictionary().find(object)->type, data))
              << "\n"
              << std::flush;
    if (object == ObjectIndex{0x2002, 0}) {
      const auto code = static_cast<std::uint16_t>(get_le(data));
      raised = Emcy{code, static_cast<std::uint8_t>(code == 0 ? 0 : 1), {}};
    }
    return {};
  };
  Slave slave{**bus,
              node_of(a),
              load_eds(a.eds, a.node == int{lss_unconfigured} ? NodeId{1} : node_of(a)),
              {.written = written,
               .reading = {},
               .state = [](NmtState state) { std::cout << to_string(state) << "\n"
                                                       << std::flush; },
               .silent = [](std::uint16_t code) { std::cout << emcy_text(code) << "\n"
                                                            << std::flush; }},
              {.timeout = 2 * a.timeout}};  // who asks gives up before who is asked
  self = &slave;
  Pump pump{**bus, slave};
  std::cout << "ready" << "\n" << std::flush;
  while (interrupted == 0) {
    if (const Result<> served = pump.wait(200ms); !served) throw Failure{served.error()};
    if (raised) slave.emergency(*std::exchange(raised, std::nullopt), Clock::now());
  }
  return 0;
}

int list_objects(const Arguments& a) {
  const ObjectDictionary known = dictionary(a);
  for (const auto& [object, entry] : known.objects) {
    constexpr std::array access{"ro", "wo", "rw", "const"};
    std::cout << to_string(object) << "\t" << hex(static_cast<std::uint64_t>(entry.type), 4) << "\t"
              << access[static_cast<std::size_t>(entry.access)] << "\t" << (entry.mappable ? "pdo" : "-") << "\t"
              << format(entry.type, entry.value) << "\t" << entry.name << "\n";
  }
  return 0;
}

int configure(const Arguments& a) {
  const ObjectDictionary known = dictionary(a);
  const std::vector<SdoWrite> writes = known.configuration();
  if (!a.file.empty()) {
    const Bytes bytes = concise_dcf(writes);
    std::ofstream file{a.file, std::ios::binary};
    std::ranges::copy(bytes, std::ostreambuf_iterator<char>{file});
    if (!file.flush()) throw Failure{Error{std::errc::io_error, "write " + a.file}};
    return 0;
  }
  Session session{a.bus, options(a)};
  std::optional<Result<>> result;
  const Result<> begun =
      session.master().configure(node_of(a), writes, [&](const Result<>& done) { result = done; }, Clock::now());
  if (!begun) throw Failure{begun.error()};
  if (!session.run_until([&] { return result.has_value(); }, Duration::max()))
    throw Failure{Error{std::errc::interrupted, ""}};
  if (!*result) throw Failure{result->error()};
  std::cout << writes.size() << " objects written and read back\n";
  return 0;
}

int run(int argc, char** argv) {
  Arguments a;
  CLI::App app{"Looks at a CANopen bus, and talks to its nodes."};
  app.require_subcommand(1);
  app.footer(examples);
  app.set_version_flag("--version", REGISTA_VERSION);
  app.add_option("-b,--bus", a.bus, "A CAN interface, or socketcand://HOST[:PORT]/BUS")->capture_default_str();
  double timeout_s = 0.5;
  app.add_option("--timeout", timeout_s, "Of an answer, in seconds")
      ->capture_default_str()
      ->check(CLI::Range(0.001, 60.0));
  const auto with_node = [&](CLI::App* command, int most = last_node) {
    command->add_option("NODE", a.node, "1 to 127")->required()->check(CLI::Range(1, most));
  };
  const auto with_object = [&](CLI::App* command) {
    with_node(command);
    command->add_option("OBJECT", a.object, "6040, 1018:01, or a name of the EDS")->required();
    command->add_option("--eds", a.eds, "EDS or DCF of the device: names and types");
    std::vector<std::string> names;
    for (const auto& [name, type] : types) names.push_back(name);
    command->add_option("--type", a.type, "Of the value; without one, and without an EDS, hex bytes")
        ->check(CLI::IsMember(names));
    command->add_option("--file", a.file, "The value as bytes of a file");
    command->add_flag("--block", a.block, "Block transfer");
    command->add_flag("--rate", a.rate, "Tell how fast it was");
  };

  auto* scan_command = app.add_subcommand("scan", "Who is there");
  scan_command->add_option("--last", a.last, "The last node id to ask")->check(CLI::Range(1, 127));
  auto* read_command = app.add_subcommand("read", "Read an object");
  with_object(read_command);
  auto* write_command = app.add_subcommand("write", "Write an object");
  with_object(write_command);
  write_command->add_option("VALUE", a.value, "Decimal, 0x…, text, or hex bytes, as its type is");
  auto* configure_command = app.add_subcommand("configure", "Write what a DCF sets and differs, and read it back");
  with_node(configure_command);
  configure_command->add_option("DCF", a.eds)->required();
  configure_command->add_option("--concise", a.file, "Only write it as a concise DCF (object 1F22) to this file");
  auto* dump_command = app.add_subcommand("dump", "All frames, as candump -L");
  dump_command->add_flag("--words", a.words, "And what they mean");
  dump_command->add_option("--count", a.count, "So many");
  dump_command->add_option("--seconds", a.seconds, "For so long");
  auto* decode_command = app.add_subcommand("decode", "A log of candump -L on standard input, in words");
  auto* nmt_command = app.add_subcommand("nmt", "Start, stop or reset nodes");
  std::vector<std::string> commands;
  for (const auto& [name, command] : nmt_commands) commands.push_back(name);
  nmt_command->add_option("COMMAND", a.nmt)->required()->check(CLI::IsMember(commands));
  nmt_command->add_option("NODE", a.node, "All of them without one")->check(CLI::Range(1, 127));
  auto* watch_command = app.add_subcommand("watch", "A drive's state, live");
  with_node(watch_command);
  watch_command->add_option("--seconds", a.seconds, "For so long");
  auto* lss_command = app.add_subcommand("lss", "Find a node that has no node id, and give it one");
  lss_command->add_option("--set", a.set_node, "The node id to give")->check(CLI::Range(1, 127));
  lss_command->add_option("--select", a.identity, "Not any, but VENDOR PRODUCT REVISION SERIAL")->expected(4);
  auto* objects_command = app.add_subcommand("objects", "What an EDS describes");
  objects_command->add_option("EDS", a.eds)->required();
  objects_command->add_option("--node", a.node, "For $NODEID")->check(CLI::Range(1, 127));
  auto* device_command = app.add_subcommand("device", "Play the device that an EDS describes");
  with_node(device_command, lss_unconfigured);
  device_command->add_option("EDS", a.eds)->required();
  if (const auto done = parse(app, argc, argv)) return *done;
  a.timeout = from_seconds(timeout_s);

  struct sigaction action{};
  action.sa_handler = [](int) { interrupted = 1; };
  for (const int signal : {SIGINT, SIGTERM}) (void)sigaction(signal, &action, nullptr);
  try {
    if (scan_command->parsed()) return scan(a);
    if (read_command->parsed()) return read(a);
    if (write_command->parsed()) return write(a);
    if (configure_command->parsed()) return configure(a);
    if (dump_command->parsed()) return dump(a);
    if (decode_command->parsed()) return decode_log();
    if (nmt_command->parsed()) return nmt(a);
    if (watch_command->parsed()) return watch(a);
    if (lss_command->parsed()) return lss(a);
    if (objects_command->parsed()) return list_objects(a);
    return device(a);
  } catch (const std::exception& error) {
    std::cerr << "regista-can: " << error.what() << "\n";
  }
  return 1;
}

}  // namespace
}  // namespace regista::canopen

int main(int argc, char** argv) { return regista::canopen::run(argc, argv); }
