// SPDX-License-Identifier: Apache-2.0
// regista._core: the C++ client as the Python package sees it. What users see, with its types and docs, is robot.py.
#include <poll.h>
#include <pthread.h>
#include <pybind11/chrono.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <charconv>
#include <regista/client/robot.hpp>

#include "errors.hpp"
#include "messages.hpp"
#include "wire.hpp"

namespace regista::python {

namespace {

using namespace std::chrono_literals;
using client::Address;

/// How often this process was forked off: a robot belongs to the process that connected it.
std::atomic<unsigned> forks{0};

double to_seconds(Time time) { return seconds(time.time_since_epoch()); }

/// What a signal handler raised while this thread waited.
thread_local std::exception_ptr raised;

/// Run the handlers of the signals that came. True: one has raised.
bool take_signals() {
  const py::gil_scoped_acquire acquire;
  if (PyErr_CheckSignals() == 0) return false;
  raised = std::make_exception_ptr(py::error_already_set{});
  return true;
}

/// Seconds as Python gives them; None and what is beyond a day: a day, again and again.
Duration to_duration(double value, const char* what) {
  if (!(value >= 0)) throw py::value_error{std::string{what} + ": wants seconds, 0 or more"};
  return from_seconds(std::min(value, 86400.0));
}

Address to_address(const std::string& text) {
  const auto colon = text.find(':');
  const std::string_view name = std::string_view{text}.substr(0, colon);
  const std::uint16_t interface = interface_code(name);
  unsigned index = 0;
  if (colon != std::string::npos) {
    const char* const end = text.data() + text.size();
    if (const auto [rest, error] = std::from_chars(text.data() + colon + 1, end, index);
        error != std::errc{} || rest != end || index > std::numeric_limits<std::uint16_t>::max()) {
      throw py::value_error{"'" + text + "' is no device: wants INTERFACE:INDEX, such as position2d:0"};
    }
  }
  if (interface == 0 || interface == player::code) {
    throw py::value_error{"'" + std::string{name} + "' is no interface that this library speaks"};
  }
  return {interface, static_cast<std::uint16_t>(index)};
}

/// A function of Python that C++ may keep, copy and forget without the GIL. It is called as function(value, error);
/// what it raises is told and forgotten.
class Callback {
 public:
  explicit Callback(const py::function& function)
      : function_{new py::function{function}, [](const py::function* last) {
                    const py::gil_scoped_acquire acquire;
                    delete last;
                  }} {}

  template <std::invocable Make>
  void operator()(const client::Error::Context&, Make make) const {
    call([&](const py::function& function) { function(make(), py::none()); });
  }
  void operator()(const client::Error::Context& context, const Error& cause) const {
    call([&](const py::function& function) {
      try {
        client::raise(context, cause);
      } catch (const client::Error& error) {
        function(py::none(), to_exception(error));
      }
    });
  }

 private:
  template <typename Work>
  void call(Work work) const {
    const py::gil_scoped_acquire acquire;
    try {
      work(*function_);
    } catch (py::error_already_set& error) {
      error.discard_as_unraisable("a robot's callback");
    }
  }

  std::shared_ptr<const py::function> function_;
};

using Decoder = Result<AnyReply> (*)(std::span<const std::byte>);

Decoder reply_decoder(const AnyRequest& request) {
  return std::visit(
      []<typename M>(const M&) -> Decoder {
        return [](std::span<const std::byte> body) -> Result<AnyReply> {
          typename M::Reply reply;
          if (const Result<> decoded = xdr::decode(body, reply); !decoded) return decoded.error();
          return AnyReply{std::move(reply)};
        };
      },
      request);
}

/// The request for a property's value; `type` is that of Python.
AnyRequest get_property(const std::string& key, const py::handle& type) {
  const auto is = [&](PyTypeObject& known) { return type.ptr() == reinterpret_cast<PyObject*>(&known); };
  if (is(PyFloat_Type)) return property::GetDouble{.key = key};
  if (is(PyBool_Type)) return property::GetBool{.key = key};
  if (is(PyLong_Type)) return property::GetInt{.key = key};
  if (is(PyUnicode_Type)) return property::GetText{.key = key};
  throw py::type_error{"a property is a float, an int, a bool or a str, no " + std::string{py::str(type)}};
}

AnyRequest set_property(const std::string& key, const py::handle& value) {
  if (PyFloat_Check(value.ptr())) return property::SetDouble{.key = key, .value = py::cast<double>(value)};
  if (PyBool_Check(value.ptr())) return property::SetBool{.key = key, .value = py::cast<bool>(value)};
  if (PyLong_Check(value.ptr())) return property::SetInt{.key = key, .value = py::cast<std::int32_t>(value)};
  if (PyUnicode_Check(value.ptr())) return property::SetText{.key = key, .value = py::cast<std::string>(value)};
  throw py::type_error{"a property is a float, an int, a bool or a str, no " + std::string{py::repr(value)}};
}

/// A robot and who may use it: one thread at a time, in the process that connected it.
class Robot {
 public:
  struct Received {
    Address address;
    AnyData message;
    Time arrival;
    double stamp_s;
  };

  Robot(std::string host, std::uint16_t port, double timeout, std::string name, std::int32_t priority, bool pull,
        bool reconnect) {
    client::Options options{.timeout = to_duration(timeout, "timeout"),
                            .mode = pull ? player::DataMode::pull : player::DataMode::push,
                            .name = std::move(name),
                            .priority = priority,
                            .reconnect = reconnect,
                            .interrupted = &take_signals};
    wait([&] { robot_ = std::make_unique<client::Robot>(std::move(host), port, std::move(options)); });
  }
  ~Robot() {
    try {
      close();
    } catch (py::error_already_set& error) {
      error.discard_as_unraisable("closing a robot");
    }
  }
  Robot(const Robot&) = delete;
  Robot& operator=(const Robot&) = delete;

  void close() {
    if (!robot_) return;
    if (forks_ != forks) {
      robot_->connection().abandon();
      robot_.reset();
      return;
    }
    wait([&] { robot_->connection().close(); });
    robot_.reset();
    if (raised) std::rethrow_exception(std::exchange(raised, nullptr));
  }

  /// Call `work` with the GIL held: it must not block.
  template <typename Work>
  std::invoke_result_t<Work&> use(Work work) {
    const Use use{*this};
    try {
      return work();
    } catch (const client::Error& error) {
      raise(error);
    }
  }
  /// Call `work`, which may block, without the GIL. A signal handler that raises ends it.
  template <typename Work>
  std::invoke_result_t<Work&> wait(Work work) {
    const Use use{*this};
    try {
      const py::gil_scoped_release release;
      return work();
    } catch (const client::Error& error) {
      if (raised) std::rethrow_exception(std::exchange(raised, nullptr));
      raise(error);
    }
  }

  [[nodiscard]] client::Robot& robot() {
    if (!robot_) throw py::value_error{"this robot is closed"};
    return *robot_;
  }

  /// Ask without waiting: a later read() calls `on_reply` with (reply, error).
  void post(Address to, const AnyRequest& request, const py::function& on_reply) {
    use([&] {
      const client::Connection& connection = robot().connection();
      client::Error::Context context{connection.host(), connection.port(),
                                     to == client::server_address ? "" : to_string(to), std::string{name_of(request)}};
      const Result<> sent =
          robot().connection().post(to, request,
                                    [context, decode = reply_decoder(request),
                                     call = Callback{on_reply}](const Result<std::span<const std::byte>>& body) {
                                      const Result<AnyReply> reply = body ? decode(*body) : body.error();
                                      if (reply) {
                                        call(context, [&] { return to_python(AnyReply{*reply}); });
                                      } else {
                                        call(context, reply.error());
                                      }
                                    });
      if (!sent) client::raise(context, sent.error());
    });
  }
  /// Open a device without waiting: a later read() calls `on_open` with (None, error).
  void open(const std::string& address, const py::function& on_open) {
    use([&] {
      const client::Connection& connection = robot().connection();
      robot().open(to_address(address),
                   [context = client::Error::Context{connection.host(), connection.port(), address, "subscribe"},
                    call = Callback{on_open}](const Result<std::string>& driver) {
                     if (driver) {
                       call(context, [] { return py::none(); });
                     } else {
                       call(context, driver.error());
                     }
                   });
    });
  }

  bool read(double timeout) {
    const Duration duration = to_duration(timeout, "timeout");
    // What is there comes without letting go of the GIL.
    if (use([&] { return robot().read(0ns); })) return true;
    return duration > 0ns && wait([&] { return robot().read(duration); });
  }

  /// Keep what comes for messages(): the newest `limit`.
  void record(std::size_t limit) {
    use([&] {
      limit_ = limit;
      if (limit == 0) return robot().listen({});
      robot().listen([this](const xdr::Header& header, const AnyData& data, Time arrival) {
        if (received_.size() == limit_) {
          received_.pop_front();
          ++overflows_;
        }
        received_.push_back({{header.address.interface, header.address.index}, data, arrival, header.timestamp_s});
      });
    });
  }
  std::deque<Received> take_received() {
    return use([&] { return std::exchange(received_, {}); });
  }

  [[nodiscard]] py::dict counters() {
    return use([&] {
      const client::Connection::Counters& counters = robot().connection().counters();
      py::dict result;
      result["overflows"] = overflows_;
      result["superseded"] = counters.superseded;
      result["undecodable"] = counters.undecodable;
      result["unwanted"] = counters.unwanted;
      result["stray"] = counters.stray;
      result["notices"] = counters.notices;
      result["dropped_by_server"] = counters.dropped_by_server;
      return result;
    });
  }

 private:
  class Use {
   public:
    explicit Use(Robot& robot) : robot_{robot} {
      if (robot.forks_ != forks) {
        throw std::runtime_error{"this robot was connected by the parent process: connect one of your own"};
      }
      if (robot.busy_.exchange(true)) {
        throw std::runtime_error{"this robot is in use, by another thread or below a signal handler: one at a time"};
      }
    }
    ~Use() { robot_.busy_ = false; }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    Robot& robot_;
  };

  const unsigned forks_ = forks;
  std::atomic<bool> busy_ = false;
  std::size_t limit_ = 0;
  std::uint64_t overflows_ = 0;
  std::deque<Received> received_;
  std::unique_ptr<client::Robot> robot_;
};

/// A device of any interface.
class Device {
 public:
  Device(std::shared_ptr<Robot> robot, const std::string& address)
      : robot_{std::move(robot)}, proxy_{robot_->wait([&] { return &robot_->robot().device(to_address(address)); })} {}

  [[nodiscard]] std::string address() const { return to_string(proxy_->address()); }
  [[nodiscard]] const std::string& driver() const { return proxy_->driver(); }
  [[nodiscard]] std::uint64_t count() {
    return use([&] { return proxy_->count(); });
  }
  [[nodiscard]] std::optional<double> age() {
    return use([&] { return proxy_->count() == 0 ? std::nullopt : std::optional{seconds(proxy_->age())}; });
  }

  [[nodiscard]] std::uint8_t subtype_of(const py::handle& type) const {
    return data_subtype(type, proxy_->address().interface);
  }
  /// (value, count, arrival, stamp), the same objects until another comes.
  py::tuple latest(std::uint8_t subtype) {
    return use([&] { return cached(subtype).sample; });
  }
  py::object value(std::uint8_t subtype) {
    return use([&] { return cached(subtype).value; });
  }

  void send(const py::handle& message) {
    const AnyCommand command = to_command(message);
    use([&] {
      const Result<> sent = robot_->robot().connection().send(proxy_->address(), command);
      if (!sent) client::raise(context(name_of(command)), sent.error());
    });
  }

  py::object request(const py::handle& message) { return ask(to_request(message)); }
  py::object ask(const AnyRequest& asked) {
    return to_python(robot_->wait([&] {
      Result<AnyReply> reply = robot_->robot().connection().request(proxy_->address(), asked);
      if (!reply) client::raise(context(name_of(asked)), reply.error());
      return *std::move(reply);
    }));
  }

  py::object property(const std::string& key, const py::handle& type) { return ask(get_property(key, type)); }
  void set_property(const std::string& key, const py::handle& value) { ask(python::set_property(key, value)); }

  // Without waiting; see Robot::post().
  void post(const py::handle& request, const py::function& on_reply) {
    robot_->post(proxy_->address(), to_request(request), on_reply);
  }
  void post_property(const std::string& key, const py::handle& type, const py::function& on_reply) {
    robot_->post(proxy_->address(), get_property(key, type), on_reply);
  }
  void post_set_property(const std::string& key, const py::handle& value, const py::function& on_reply) {
    robot_->post(proxy_->address(), python::set_property(key, value), on_reply);
  }

  py::object motion(const std::string& group) {
    std::optional<player::Motion> motion = robot_->wait([&] {
      require_connected();
      return proxy_->motion(group);
    });
    return motion ? to_python(*std::move(motion)) : py::none();
  }
  void take(const std::string& group, bool blend) {
    robot_->wait([&] {
      require_connected();
      proxy_->take(group, blend);
    });
  }
  void release(const std::string& group) {
    robot_->wait([&] {
      require_connected();
      proxy_->release(group);
    });
  }
  void keep_alive(bool on) {
    use([&] { proxy_->keep_alive(on); });
  }

 protected:
  template <typename Work>
  std::invoke_result_t<Work&> use(Work work) {
    return robot_->use([&]() -> std::invoke_result_t<Work&> {
      require_connected();
      return work();
    });
  }
  /// The proxy lives as long as the robot is not closed.
  void require_connected() { (void)robot_->robot(); }

  [[nodiscard]] client::Error::Context context(std::string_view asked) {
    const client::Connection& connection = robot_->robot().connection();
    return {connection.host(), connection.port(), to_string(proxy_->address()), std::string{asked}};
  }

  std::shared_ptr<Robot> robot_;
  client::ProxyBase* proxy_;

 private:
  struct Cached {
    std::uint64_t count = 0;
    py::object value{};
    py::tuple sample{};
  };

  const Cached& cached(std::uint8_t subtype) {
    Cached& cached = cache_[subtype];
    const std::uint64_t count = proxy_->count_of(subtype);
    if (!cached.value || cached.count != count) {
      std::optional<client::AnySample> sample = proxy_->latest_of(subtype);
      if (!sample)
        throw py::key_error{to_string(proxy_->address()) + " has no data of subtype " + std::to_string(subtype)};
      cached.count = count;
      cached.value = to_python(std::move(sample->value));
      cached.sample = py::make_tuple(cached.value, sample->count, to_seconds(sample->arrival), sample->stamp_s);
    }
    return cached;
  }

  std::map<std::uint8_t, Cached> cache_;
};

class Position2d final : public Device {
 public:
  Position2d(std::shared_ptr<Robot> robot, std::uint16_t index)
      : Device{std::move(robot), "position2d:" + std::to_string(index)} {}

  void set_velocity(double x, double y, double w) {
    use([&] { base().set_velocity({x, y, w}); });
  }
  void go_to(const Pose2d& goal, const BodyVelocity& limits) {
    use([&] { base().go_to(goal, limits); });
  }
  void stop() {
    robot_->wait([&] {
      require_connected();
      base().stop();
    });
  }
  bool is_at(const Pose2d& goal, const client::Tolerance& tolerance) {
    return use([&] { return base().is_at(goal, tolerance); });
  }
  void set_odometry(const Pose2d& pose) {
    robot_->wait([&] {
      require_connected();
      base().set_odometry(pose);
    });
  }
  client::Position2dProxy& base() { return static_cast<client::Position2dProxy&>(*proxy_); }

 private:
  friend class Follower;
};

/// What follow() does, for who owns the loop.
class Follower {
 public:
  Follower(std::shared_ptr<Position2d> base, std::vector<Pose2d> path, const client::Tolerance& tolerance)
      : base_{std::move(base)}, follower_{base_->base(), std::move(path), tolerance} {}
  bool step() {
    return base_->use([&] { return follower_.step(); });
  }

 private:
  std::shared_ptr<Position2d> base_;
  client::Follower follower_;
};

template <typename Class>
void define_device(Class& device) {
  device.def_property_readonly("address", &Device::address)
      .def_property_readonly("driver", &Device::driver)
      .def_property_readonly("count", &Device::count)
      .def_property_readonly("age", &Device::age)
      .def("subtype_of", &Device::subtype_of)
      .def("latest", &Device::latest)
      .def("value", &Device::value)
      .def("send", &Device::send)
      .def("request", &Device::request)
      .def("property", &Device::property)
      .def("set_property", &Device::set_property)
      .def("post", &Device::post)
      .def("post_property", &Device::post_property)
      .def("post_set_property", &Device::post_set_property)
      .def("motion", &Device::motion)
      .def("take", &Device::take)
      .def("release", &Device::release)
      .def("keep_alive", &Device::keep_alive);
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  (void)::pthread_atfork(nullptr, nullptr, [] { ++forks; });

  py::class_<Robot, std::shared_ptr<Robot>>{m, "Robot"}
      .def(py::init<std::string, std::uint16_t, double, std::string, std::int32_t, bool, bool>())
      .def("close", &Robot::close)
      .def("open", &Robot::open)
      .def("post",
           [](Robot& robot, const py::handle& request, const py::function& on_reply) {
             robot.post(client::server_address, to_request(request), on_reply);
           })
      .def("read", &Robot::read)
      .def("record", &Robot::record)
      .def("messages",
           [](Robot& robot) {
             const py::object type = py::module_::import("regista.message").attr("Received");
             py::list list;
             for (Robot::Received& received : robot.take_received()) {
               list.append(type(to_string(received.address), to_python(std::move(received.message)),
                                to_seconds(received.arrival), received.stamp_s));
             }
             return list;
           })
      .def("counters", &Robot::counters)
      .def("devices",
           [](Robot& robot) {
             const auto devices = robot.wait([&] { return robot.robot().devices(); });
             std::vector<std::pair<std::string, std::string>> list;
             for (const auto& device : devices) list.emplace_back(to_string(device.address), device.driver);
             return list;
           })
      .def("stop", [](Robot& robot) { robot.wait([&] { robot.robot().stop(); }); })
      .def("reconnect", [](Robot& robot) { robot.wait([&] { robot.robot().reconnect(); }); })
      .def("status", [](Robot& robot) { return robot.wait([&] { return robot.robot().status(); }); })
      .def("events",
           [](Robot& robot) {
             py::list list;
             for (player::Event& event : robot.use([&] { return robot.robot().events(); })) {
               list.append(to_python(std::move(event)));
             }
             return list;
           })
      .def_property_readonly("connected",
                             [](Robot& robot) { return robot.use([&] { return robot.robot().connected(); }); })
      .def_property_readonly(
          "server", [](Robot& robot) { return robot.use([&] { return robot.robot().connection().server(); }); })
      .def_property_readonly(
          "extended", [](Robot& robot) { return robot.use([&] { return robot.robot().connection().extended(); }); })
      .def_property_readonly(
          "generation", [](Robot& robot) { return robot.use([&] { return robot.robot().connection().generation(); }); })
      .def("fileno", [](Robot& robot) { return robot.use([&] { return robot.robot().fileno(); }); })
      .def("poll_events",
           [](Robot& robot) { return robot.use([&] { return robot.robot().connection().poll_events(); }); })
      .def_property_readonly("wake_time", [](Robot& robot) {
        const Time time = robot.use([&] { return robot.robot().wake_time(); });
        return time == Time::max() ? std::numeric_limits<double>::infinity() : to_seconds(time);
      });

  py::class_<Device, std::shared_ptr<Device>> device{m, "Device"};
  device.def(py::init<std::shared_ptr<Robot>, const std::string&>());
  define_device(device);

  // Poses are (x, y, heading), velocities (x, y, w), tolerances (distance, heading).
  using Three = std::tuple<double, double, double>;
  using Two = std::pair<double, double>;
  const auto pose = [](const Three& t) { return Pose2d{std::get<0>(t), std::get<1>(t), std::get<2>(t)}; };
  const auto tolerance = [](const Two& t) { return client::Tolerance{t.first, t.second}; };
  const auto poses = [](const std::vector<Three>& list) {
    std::vector<Pose2d> path;
    for (const auto& [x, y, heading] : list) path.push_back({x, y, heading});
    return path;
  };
  py::class_<Position2d, Device, std::shared_ptr<Position2d>>{m, "Position2d"}
      .def(py::init<std::shared_ptr<Robot>, std::uint16_t>())
      .def("set_velocity", &Position2d::set_velocity)
      .def("go_to",
           [pose](Position2d& base, const Three& goal, const Three& limits) {
             base.go_to(pose(goal), {std::get<0>(limits), std::get<1>(limits), std::get<2>(limits)});
           })
      .def("stop", &Position2d::stop)
      .def("is_at", [pose, tolerance](Position2d& base, const Three& goal,
                                      const Two& near) { return base.is_at(pose(goal), tolerance(near)); })
      .def("set_odometry", [pose](Position2d& base, const Three& here) { base.set_odometry(pose(here)); });

  py::class_<Follower>{m, "Follower"}
      .def(py::init(
          [poses, tolerance](std::shared_ptr<Position2d> base, const std::vector<Three>& path, const Two& near) {
            return std::make_unique<Follower>(std::move(base), poses(path), tolerance(near));
          }))
      .def("step", &Follower::step);

  m.def("device_name",
        [](std::uint16_t interface, std::uint16_t index) { return to_string(Address{interface, index}); });
  m.def("device_code", [](const std::string& address) {
    const auto [interface, index] = to_address(address);
    return std::pair{interface, index};
  });
  m.def("first_data", [](const std::string& address) { return first_data(to_address(address).interface); });
  m.def("wire_decode", &wire_decode);
  m.def("wire_encode", &wire_encode);
  m.def("wire_frame", [](const py::handle& message, const std::string& device, std::uint8_t subtype, bool answer) {
    const Address address = to_address(device);
    return frame(message, {.address = {.interface = address.interface, .index = address.index},
                           .kind = answer ? Kind::ack : Kind::data,
                           .subtype = subtype});
  });
}

}  // namespace regista::python
