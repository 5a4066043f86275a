// SPDX-License-Identifier: Apache-2.0
#include "bridge.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <random>

namespace regista::vision {

namespace {

using namespace std::chrono_literals;
using nlohmann::ordered_json;

constexpr Duration check_period = 1s;     ///< of cameras, for announcements and warnings
constexpr Duration join_period = 5s;      ///< interfaces come up
constexpr Duration halt_period = 50ms;    ///< while HALT stands
constexpr Duration publish_period = 9ms;  ///< at most 100 Hz of frames
constexpr Duration tracker_silent = 1s;   ///< then another one may be believed
constexpr int most_datagrams = 64;        ///< of one stream before the others have their turn

constexpr double lowest_rate_hz = 50;
constexpr double longest_processing_s = 0.04;
constexpr double widest_overlap_m = 0.05;

std::string text_of(std::uint64_t source) {
  const auto ip = static_cast<std::uint32_t>(source >> 16U);
  char text[32];
  (void)std::snprintf(text, sizeof text, "%u.%u.%u.%u:%u", ip >> 24U, ip >> 16U & 255U, ip >> 8U & 255U, ip & 255U,
                      static_cast<unsigned>(source & 0xFFFFU));
  return text;
}

std::string rounded(double value) {
  char text[32];
  (void)std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

/// RFC 9562, version 4.
std::string random_uuid() {
  std::random_device random;
  std::array<std::uint32_t, 4> r{};
  for (std::uint32_t& word : r) word = random();
  char text[40];
  (void)std::snprintf(text, sizeof text, "%08x-%04x-4%03x-%04x-%04x%08x", r[0], r[1] >> 16U, r[1] & 0xFFFU,
                      (r[2] >> 16U & 0x3FFFU) | 0x8000U, r[2] & 0xFFFFU, r[3]);
  return text;
}

std::int64_t nanoseconds(Time time) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(time.time_since_epoch()).count();
}

double unix_seconds(Time time, Time now) {
  const auto epoch = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration<double>(epoch).count() - seconds(now - time);
}

}  // namespace

Bridge::Bridge(BridgeConfig config, const Options& options, Log log)
    : config_{std::move(config)},
      log_{std::move(log)},
      stop_{::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)},
      tracker_{config_.tracking},
      own_uuid_{random_uuid()},
      started_{Clock::now()} {
  if (options.replay) {
    replay_ = std::make_unique<ssl::LogReader>(*options.replay);
  } else {
    if (config_.input == BridgeConfig::Input::vision) listen(ssl::LogType::vision, config_.vision);
    if (config_.input == BridgeConfig::Input::tracked) listen(ssl::LogType::tracker, config_.tracked);
    if (config_.referee) listen(ssl::LogType::referee, *config_.referee);
  }
  for (const std::string& interface : config_.publish) publishers_.emplace_back(config_.tracked, interface);
  if (options.record) recorder_ = std::make_unique<Recorder>(*options.record);
  if (config_.status_port) {
    status_server_ =
        std::make_unique<StatusServer>(*config_.status_port, [this] { return status(Clock::now()).dump(); });
    log_(LogLevel::info, "status on http://127.0.0.1:" + std::to_string(status_server_->port()) + "/");
  }
  // Of tracked vision no image's time is known, and a log's robots turned when it was recorded.
  if (config_.learn_delay && config_.input == BridgeConfig::Input::vision && !options.replay)
    delay_ = std::make_unique<DelayEstimator>();
  for (const RobotAddress& address : config_.robots) {
    const auto say = [this](bool is_warning, const std::string& text) {
      log_(is_warning ? LogLevel::warning : LogLevel::info, text);
    };
    links_.emplace_back(address, say, delay_ ? listen_to_turns(address.id) : nullptr);
    link_of(address.id) = &links_.back();
  }
}

Bridge::~Bridge() = default;

void Bridge::listen(ssl::LogType type, const ssl::Group& group) {
  const ssl::MulticastReceiver& receiver =
      streams_.emplace_back(Stream{type, ssl::MulticastReceiver{group, config_.interfaces}}).receiver;
  std::string names;
  for (const std::string& name : receiver.joined()) names += (names.empty() ? "" : ", ") + name;
  log_(LogLevel::info, "listening to " + group.address + ':' + std::to_string(group.port) +
                           (names.empty() ? ", joined on no interface" : " on " + names));
}

void Bridge::stop() noexcept { (void)::eventfd_write(stop_.get(), 1); }

RobotLink*& Bridge::link_of(ssl::RobotId id) { return by_id_[ssl::index(id)]; }

// ---- The loop

void Bridge::run() {
  if (replay_) {
    const auto first = replay_->next();
    if (first && *first) {
      next_record_ = **first;
      replay_offset_ns_ = nanoseconds(Clock::now() + 500ms) - next_record_->received_ns;  // time to connect
    }
  }
  std::vector<pollfd> polls;
  for (;;) {
    polls.assign(1, {.fd = stop_.get(), .events = POLLIN, .revents = 0});
    for (const Stream& stream : streams_)
      polls.push_back({.fd = stream.receiver.fileno(), .events = POLLIN, .revents = 0});
    const std::size_t first_link = polls.size();
    for (const RobotLink& link : links_) polls.push_back(link.poll());
    const std::size_t first_status = polls.size();
    if (status_server_) status_server_->add_polls(polls);

    Time wake = checked_ + check_period;
    for (const RobotLink& link : links_) wake = std::min(wake, link.wake_time());
    if (referee_ && referee_->command == ssl::Command::halt) wake = std::min(wake, halted_again_ + halt_period);
    if (next_record_)
      wake = std::min(wake, Time{std::chrono::nanoseconds{next_record_->received_ns + replay_offset_ns_}});
    const Duration left = std::max(wake - Clock::now(), Duration{});
    const timespec timeout{.tv_sec = left / 1s, .tv_nsec = (left % 1s).count()};
    (void)::ppoll(polls.data(), polls.size(), &timeout, nullptr);

    const Time now = Clock::now();
    if (polls[0].revents != 0) return;
    std::size_t poll = 1;
    for (Stream& stream : streams_) {
      if (polls[poll++].revents != 0) receive(stream, now);
    }
    if (replay_) {
      replay_due(now);
      if (!next_record_) return;
    }
    poll = first_link;
    for (RobotLink& link : links_) {
      if (polls[poll++].revents != 0 || link.wake_time() <= now) link.service();
    }
    const bool status_ready = std::any_of(polls.begin() + static_cast<std::ptrdiff_t>(first_status), polls.end(),
                                          [](const pollfd& p) { return p.revents != 0; });
    if (status_ready) status_server_->service();
    on_time(now);
  }
}

void Bridge::receive(Stream& stream, Time now) {
  for (int i = 0; i < most_datagrams; ++i) {
    const auto datagram = stream.receiver.receive();
    if (!datagram) return;
    if (recorder_) recorder_->add(stream.type, datagram->bytes);
    take(stream.type, *datagram, i == 0 ? now : Clock::now());
  }
}

void Bridge::replay_due(Time now) {
  while (next_record_ && next_record_->received_ns + replay_offset_ns_ <= nanoseconds(now)) {
    take(next_record_->type, {.bytes = next_record_->datagram}, now);
    auto next = replay_->next();
    if (!next) log_(LogLevel::warning, "the log ends early: " + next.error().message());
    next_record_ = next ? *std::move(next) : std::nullopt;
  }
}

void Bridge::on_time(Time now) {
  if (referee_ && referee_->command == ssl::Command::halt && now - halted_again_ >= halt_period) halt_robots(now);
  if (now - checked_ >= check_period) {
    checked_ = now;
    announce_cameras(now);
    if (delay_) use_delay();
    std::set<std::string> current;
    for (const std::string& warning : warnings(now)) {
      if (!warned_.contains(warning)) log_(LogLevel::warning, warning);
      current.insert(warning);
    }
    warned_ = std::move(current);
  }
  if (now - joined_ >= join_period) {
    joined_ = now;
    for (Stream& stream : streams_) stream.receiver.join_new();
  }
}

// ---- What comes in

void Bridge::take(ssl::LogType type, const ssl::MulticastReceiver::Datagram& datagram, Time arrival) {
  switch (type) {
    case ssl::LogType::vision_2010:
    case ssl::LogType::vision:
      if (config_.input == BridgeConfig::Input::vision) take_vision(datagram, arrival);
      break;
    case ssl::LogType::tracker:
      if (config_.input == BridgeConfig::Input::tracked) take_tracked(datagram.bytes, arrival);
      break;
    case ssl::LogType::referee:
      take_referee(datagram.bytes, arrival);
      break;
    case ssl::LogType::index:
      break;
  }
}

void Bridge::take_vision(const ssl::MulticastReceiver::Datagram& datagram, Time arrival) {
  const auto packet = decoder_.decode(datagram.bytes);
  if (!packet) {
    ++undecodable_;
    return;
  }
  if ((*packet)->geometry) {
    field_ = (*packet)->geometry;
    tracker_.take(*field_);
  }
  if (!(*packet)->detection) return;
  const ssl::Detection& frame = *(*packet)->detection;
  const std::uint64_t source = std::uint64_t{datagram.source_address} << 16U | datagram.source_port;
  const Verdict verdict = tracker_.take(frame, source, arrival);
  if (verdict == Verdict::too_many) return;
  heard(frame.camera, source).interfaces.insert(datagram.interface);
  if (delay_ && verdict == Verdict::taken) learn_delay(frame);
  for (const ssl::RobotId id : tracker_.corrected()) {
    RobotLink* link = link_of(id);
    if (link == nullptr) continue;
    if (const auto robot = tracker_.robot(id)) link->offer(robot->pose, robot->time, arrival);
  }
  if (!publishers_.empty() && verdict == Verdict::taken && arrival - published_ >= publish_period) publish(arrival);
}

Bridge::Heard& Bridge::heard(std::uint32_t camera, std::uint64_t source) {
  const auto known = std::ranges::find_if(
      heard_, [&](const Heard& other) { return other.camera == camera && other.source == source; });
  if (known != heard_.end()) return *known;
  if (heard_.size() == 2 * max_cameras) heard_.erase(heard_.begin());
  return heard_.emplace_back(Heard{.camera = camera, .source = source, .interfaces = {}});
}

RobotLink::OnTurn Bridge::listen_to_turns(ssl::RobotId id) {
  return [this, id](double rate_radps, double stamp_s, Time arrival, Duration way) {
    delay_->turning(id, rate_radps, stamp_s, arrival, way);
  };
}

/// From headings as cameras see them: what is filtered lags by itself. Misread ones are far off.
void Bridge::learn_delay(const ssl::Detection& frame) {
  constexpr double misread_rad = 0.5;
  const Time captured = tracker_.captured() + tracker_.delay();
  for (const ssl::DetectedRobot& seen : frame.robots) {
    if (link_of(seen.id) == nullptr || !seen.heading_rad) continue;
    const auto robot = tracker_.predict(seen.id, tracker_.captured());
    if (robot && std::abs(angle_between(robot->pose.heading, *seen.heading_rad)) < misread_rad)
      delay_->seen(seen.id, frame.camera, *seen.heading_rad, captured);
  }
}

void Bridge::use_delay() {
  const auto learnt = delay_->estimate();
  if (!learnt) return;
  if (!std::exchange(delay_known_, true))
    log_(LogLevel::info, "vision takes " + rounded(1e3 * seconds(learnt->delay)) + " ms beyond its timestamps");
  tracker_.set_delay(learnt->delay);
}

/// Somebody else has filtered: passed on as it is. Its times are Unix times of a clock that nobody has compared with
/// ours, so the age is what is told in the configuration.
void Bridge::take_tracked(std::span<const std::byte> bytes, Time arrival) {
  const auto frame = ssl::decode_tracked(bytes);
  if (!frame) {
    ++undecodable_;
    return;
  }
  if (frame->uuid == own_uuid_ || (!config_.tracker.empty() && frame->source_name != config_.tracker)) return;
  if (frame->uuid != tracker_uuid_) {
    if (!tracker_uuid_.empty() && arrival - tracker_heard_ < tracker_silent) return;
    tracker_uuid_ = frame->uuid;
    log_(LogLevel::info, "tracker '" + frame->source_name + "' " + frame->uuid + " is believed");
  }
  tracker_heard_ = arrival;
  for (const ssl::TrackedRobot& robot : frame->robots) {
    if (RobotLink* link = link_of(robot.id); link != nullptr && robot.visibility > 0)
      link->offer(robot.pose, arrival - tracker_.delay(), arrival);
  }
}

void Bridge::take_referee(std::span<const std::byte> bytes, Time arrival) {
  const auto referee = ssl::decode_referee(bytes);
  if (!referee) {
    ++undecodable_;
    return;
  }
  const bool is_halt = referee->command == ssl::Command::halt;
  const bool was_halt = referee_ && referee_->command == ssl::Command::halt;
  referee_ = *referee;
  referee_heard_ = arrival;
  if (is_halt && !was_halt) {
    log_(LogLevel::info, "referee: HALT");
    halt_robots(arrival);
  } else if (!is_halt && was_halt) {
    log_(LogLevel::info, "referee: no longer HALT");
    for (RobotLink& link : links_) link.end_halt();
  }
}

void Bridge::halt_robots(Time now) {
  halted_again_ = now;
  for (RobotLink& link : links_) link.halt();
}

// ---- What goes out

void Bridge::publish(Time now) {
  published_ = now;
  ssl::TrackedFrame frame{.uuid = own_uuid_,
                          .source_name = std::string{bridge_name},
                          .frame_number = ++published_frames_,
                          .timestamp_s = unix_seconds(now, Clock::now()),
                          .robots = {},
                          .balls = {}};
  const auto visibility = [](Duration unseen) {
    return unseen < 100ms ? 1.0 : std::max(0.0, 1 - seconds(unseen - 100ms) / 0.9);
  };
  for (const ssl::Team team : {ssl::Team::yellow, ssl::Team::blue}) {
    for (std::uint8_t number = 0; number < ssl::robots_per_team; ++number) {
      const auto robot = tracker_.predict({team, number}, now);
      if (!robot) continue;
      ssl::TrackedRobot& out = frame.robots.emplace_back();
      out = {
          .id = robot->id, .pose = robot->pose, .velocity = robot->velocity, .visibility = visibility(robot->unseen)};
    }
  }
  if (const auto ball = tracker_.predict_ball(now)) {
    ssl::TrackedBall& out = frame.balls.emplace_back();
    out = {.position = ball->position,
           .velocity = Point3d{.x = ball->vx, .y = ball->vy, .z = 0},
           .visibility = visibility(ball->unseen)};
  }
  const std::vector<std::byte> bytes = ssl::encode(frame);
  for (ssl::MulticastSender& publisher : publishers_) (void)publisher.send(bytes);
}

// ---- What people see

void Bridge::announce_cameras(Time now) {
  for (const CameraReport& camera : tracker_.cameras(now)) {
    Heard& place = heard(camera.id, camera.source);
    const bool speaks = camera.rate_hz > 0;
    if (speaks == place.announced) continue;
    place.announced = speaks;
    std::string names;
    for (const int index : place.interfaces)
      names += (names.empty() ? "" : ", ") + (replay_ ? "the log" : ssl::interface_name_of(index));
    const std::string name = "camera " + std::to_string(camera.id);
    if (speaks) {
      log_(LogLevel::info,
           name + ": " + rounded(camera.rate_hz) + " Hz from " + text_of(camera.source) + " by " + names);
    } else {
      log_(LogLevel::warning, name + " is silent");
    }
  }
}

/// Without numbers, so that each is told once.
std::vector<std::string> Bridge::warnings(Time now) const {
  std::vector<std::string> texts;
  const auto cameras = tracker_.cameras(now);
  for (const CameraReport& camera : cameras) {
    const std::string name = "camera " + std::to_string(camera.id);
    if (camera.rate_hz > 0 && camera.rate_hz < lowest_rate_hz)
      texts.push_back(name + " sends less than 50 frames a second");
    if (camera.processing_s > longest_processing_s)
      texts.push_back(name + ": vision takes longer than 40 ms for a frame");
    if (camera.overlap_m > widest_overlap_m)
      texts.push_back(name + " disagrees with others by more than 50 mm: calibrate the cameras");
    if (camera.foreign > 0)
      texts.push_back(name + " is sent by two computers; only " + text_of(camera.source) + " is believed");
  }
  if (delay_ && delay_->disagree())
    texts.emplace_back("robots disagree about vision's delay, which is not learnt: tell 'delay'");
  if (field_ && field_->is_2010) texts.emplace_back("the field's geometry comes in the layout of 2010");
  if (config_.input == BridgeConfig::Input::vision && cameras.empty() && !replay_ && now - started_ > 3s)
    texts.push_back("no vision is heard on " + config_.vision.address + ':' + std::to_string(config_.vision.port));
  return texts;
}

ordered_json Bridge::status(Time now) const {
  ordered_json cameras = ordered_json::array();
  for (const CameraReport& camera : tracker_.cameras(now)) {
    ordered_json interfaces = ordered_json::array();
    for (const Heard& place : heard_) {
      if (place.camera != camera.id || place.source != camera.source) continue;
      for (const int index : place.interfaces) interfaces.push_back(ssl::interface_name_of(index));
    }
    cameras.push_back({{"id", camera.id},
                       {"source", text_of(camera.source)},
                       {"interfaces", std::move(interfaces)},
                       {"rate_hz", camera.rate_hz},
                       {"processing_ms", 1e3 * camera.processing_s},
                       {"noise_mm", 1e3 * camera.noise_m},
                       {"noise_mrad", 1e3 * camera.noise_rad},
                       {"overlap_mm", 1e3 * camera.overlap_m},
                       {"frames", camera.frames},
                       {"lost", camera.lost},
                       {"duplicates", camera.duplicates},
                       {"foreign", camera.foreign},
                       {"late", camera.late},
                       {"mirrored", camera.mirrored}});
  }
  ordered_json robots = ordered_json::array();
  for (const RobotLink& link : links_) {
    const RobotLink::Counters& counters = link.counters();
    ordered_json robot{
        {"id", to_string(link.address().id)},
        {"server", link.address().host + ':' + std::to_string(link.address().port)},
        {"connected", link.connected()},
        {"connects", counters.connects},
        {"sent", counters.sent},
        {"superseded", counters.superseded},
        {"unsent", counters.unsent},
        {"halts", counters.halts},
        {"age_ms", {{"p50", 1e3 * link.ages_s().at(0.5)}, {"p99", 1e3 * link.ages_s().at(0.99)}}},
        {"latency_us", {{"p50", 1e6 * link.latencies_s().at(0.5)}, {"p99", 1e6 * link.latencies_s().at(0.99)}}}};
    const auto estimate = tracker_.predict(link.address().id, now);
    robot["seen"] = estimate.has_value();
    if (estimate) {
      robot["pose"] = {{"x_m", estimate->pose.x}, {"y_m", estimate->pose.y}, {"heading_rad", estimate->pose.heading}};
      robot["resting"] = estimate->resting;
    }
    robots.push_back(std::move(robot));
  }
  ordered_json delay{{"ms", 1e3 * seconds(tracker_.delay())}, {"told", !config_.learn_delay}};
  if (delay_) {
    delay["learnt"] = delay_known_;
    if (const auto learnt = delay_->estimate(); learnt && delay_known_) {
      delay["sd_ms"] = 1e3 * seconds(learnt->sd);
      delay["turns"] = learnt->turns;
    }
  }
  const TrackerCounters& counters = tracker_.counters();
  ordered_json status{{"version", REGISTA_VERSION},
                      {"uptime_s", seconds(now - started_)},
                      {"warnings", warnings(now)},
                      {"undecodable", undecodable_},
                      {"delay", std::move(delay)},
                      {"cameras", std::move(cameras)},
                      {"robots", std::move(robots)},
                      {"refused",
                       {{"outliers", counters.outliers},
                        {"flips", counters.flips},
                        {"misread", counters.misread},
                        {"out_of_field", counters.out_of_field},
                        {"too_many_cameras", counters.too_many_cameras}}},
                      {"reacquired", counters.reacquired}};
  if (referee_) {
    status["referee"] = {{"halt", referee_->command == ssl::Command::halt},
                         {"command", static_cast<int>(referee_->command)},
                         {"heard_s", seconds(now - referee_heard_)}};
  }
  if (const auto ball = tracker_.predict_ball(now))
    status["ball"] = {{"x_m", ball->position.x}, {"y_m", ball->position.y}, {"vx_mps", ball->vx}, {"vy_mps", ball->vy}};
  if (field_)
    status["field"] = {
        {"length_m", field_->length_m}, {"width_m", field_->width_m}, {"boundary_m", field_->boundary_m}};
  if (recorder_) status["recorder"] = {{"written", recorder_->written()}, {"dropped", recorder_->dropped()}};
  return status;
}

}  // namespace regista::vision
