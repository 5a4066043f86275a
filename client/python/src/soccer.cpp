// SPDX-License-Identifier: Apache-2.0
// regista._soccer: soccer::Team as the Python package sees it. What users see, with its types and docs, is soccer.py.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <regista/soccer/team.hpp>

#include "errors.hpp"

namespace regista::python {

namespace {

using Three = std::tuple<double, double, double>;

ssl::Team to_team(const std::string& name) {
  if (name == "yellow") return ssl::Team::yellow;
  if (name == "blue") return ssl::Team::blue;
  throw py::value_error{"a team is \"yellow\" or \"blue\", not '" + name + "'"};
}

Pose2d to_pose(const Three& t) { return {.x = std::get<0>(t), .y = std::get<1>(t), .heading = std::get<2>(t)}; }

/// A team and who may use it: one thread at a time.
class Team {
 public:
  Team(const std::filesystem::path& config, const std::string& team, const soccer::TeamOptions& options) {
    const ssl::Team colour = to_team(team);
    wait([&] { team_ = std::make_unique<soccer::Team>(config, colour, options); });
  }
  [[nodiscard]] soccer::Team& team() {
    if (!team_) throw py::value_error{"this team is closed"};
    if (busy_) throw std::runtime_error{"this team is in use by another thread: one at a time"};
    return *team_;
  }
  [[nodiscard]] soccer::TeamRobot& robot(int number) { return team()[number]; }
  /// Call `work`, which may block, without the GIL.
  template <typename Work>
  std::invoke_result_t<Work&> wait(Work work) {
    struct Use {
      bool& busy;
      explicit Use(bool& flag) : busy{flag} { busy = true; }
      ~Use() { busy = false; }
    } const use{busy_};
    try {
      const py::gil_scoped_release release;
      return work();
    } catch (const client::Error& error) {
      raise(error);
    } catch (const std::system_error& error) {
      PyErr_SetString(PyExc_OSError, error.what());
      throw py::error_already_set{};
    }
  }
  void close() {
    if (!team_) return;
    (void)team();
    wait([&] { team_.reset(); });
  }

 private:
  bool busy_ = false;  ///< guarded by the GIL
  std::unique_ptr<soccer::Team> team_;
};

/// (team, id, x, y, heading, vx, vy, w, visibility)
py::tuple to_python(const ssl::TrackedRobot& robot) {
  const FieldVelocity velocity = robot.velocity.value_or(FieldVelocity{});
  return py::make_tuple(robot.id.team == ssl::Team::yellow ? "yellow" : "blue", robot.id.number, robot.pose.x,
                        robot.pose.y, robot.pose.heading, velocity.x, velocity.y, velocity.w, robot.visibility);
}

}  // namespace

PYBIND11_MODULE(_soccer, m) {
  py::class_<Team>{m, "Team"}
      .def(py::init([](const std::filesystem::path& config, const std::string& team, double speed, double acceleration,
                       double turn_rate, double gain, const std::string& name, std::int32_t priority) {
        return std::make_unique<Team>(config, team,
                                      soccer::TeamOptions{.speed_mps = speed,
                                                          .acceleration_mps2 = acceleration,
                                                          .turn_rate_radps = turn_rate,
                                                          .gain = gain,
                                                          .name = name,
                                                          .priority = priority});
      }))
      .def("close", &Team::close)
      .def("read",
           [](Team& self, double timeout) {
             if (!(timeout >= 0)) throw py::value_error{"timeout: wants seconds, 0 or more"};
             soccer::Team& team = self.team();
             const bool any = self.wait([&] { return team.read(from_seconds(std::min(timeout, 86400.0))); });
             if (PyErr_CheckSignals() != 0) throw py::error_already_set{};
             return any;
           })
      .def("numbers",
           [](Team& self) {
             std::vector<int> numbers;
             for (const soccer::TeamRobot& robot : self.team()) numbers.push_back(robot.id().number);
             return numbers;
           })
      .def("seen",
           [](Team& self) {
             py::list list;
             for (const ssl::TrackedRobot& robot : self.team().seen()) list.append(to_python(robot));
             return list;
           })
      .def("ball",
           [](Team& self) -> py::object {
             const auto ball = self.team().ball();
             if (!ball) return py::none();
             const Point3d velocity = ball->velocity.value_or(Point3d{});
             return py::make_tuple(ball->position.x, ball->position.y, ball->position.z, velocity.x, velocity.y,
                                   velocity.z, ball->visibility);
           })
      .def("seen_age",
           [](Team& self) -> std::optional<double> {
             const Duration age = self.team().seen_age();
             return age == Duration::max() ? std::nullopt : std::optional{seconds(age)};
           })
      .def("connected", [](Team& self, int number) { return self.robot(number).connected(); })
      .def("pose",
           [](Team& self, int number) {
             const Pose2d& pose = self.robot(number).pose();
             return Three{pose.x, pose.y, pose.heading};
           })
      .def("velocity",
           [](Team& self, int number) {
             const BodyVelocity& velocity = self.robot(number).velocity();
             return Three{velocity.x, velocity.y, velocity.w};
           })
      .def("is_at",
           [](Team& self, int number, const Three& goal, double distance_m, double heading_rad) {
             return self.robot(number).is_at(to_pose(goal), {.distance_m = distance_m, .heading_rad = heading_rad});
           })
      .def("stopped_because", [](Team& self, int number) { return self.robot(number).stopped_because(); })
      .def("drive_to", [](Team& self, int number, const Three& goal) { self.robot(number).drive_to(to_pose(goal)); })
      .def("set_velocity",
           [](Team& self, int number, const Three& v) {
             self.robot(number).set_velocity({.x = std::get<0>(v), .y = std::get<1>(v), .w = std::get<2>(v)});
           })
      .def("go_to",
           [](Team& self, int number, const Three& goal) {
             soccer::TeamRobot& robot = self.robot(number);
             self.wait([&] { robot.go_to(to_pose(goal)); });
           })
      .def("kick",
           [](Team& self, int number, double speed) {
             soccer::TeamRobot& robot = self.robot(number);
             self.wait([&] { robot.kick(speed); });
           })
      .def("chip",
           [](Team& self, int number, double speed, double angle) {
             soccer::TeamRobot& robot = self.robot(number);
             self.wait([&] { robot.chip(speed, angle); });
           })
      .def("dribble",
           [](Team& self, int number, double speed) {
             soccer::TeamRobot& robot = self.robot(number);
             self.wait([&] { robot.dribble(speed); });
           })
      .def("charge",
           [](Team& self, int number, bool on) {
             soccer::TeamRobot& robot = self.robot(number);
             self.wait([&] { robot.charge(on); });
           })
      .def("kicker", [](Team& self, int number) {
        soccer::TeamRobot& robot = self.robot(number);
        const kicker::State state = self.wait([&] { return robot.kicker_state(); });
        return py::make_tuple(state.charged != 0, state.ball_detected != 0, state.kick_count);
      });
}

}  // namespace regista::python
