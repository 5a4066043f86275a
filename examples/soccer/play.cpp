// SPDX-License-Identifier: Apache-2.0
// A little play for two teams on the field that field.sh starts: pass, shoot, and the other team's turn. The field is
// drawn where there is a terminal, and told in lines elsewhere. Ends with 1 when a robot did not move.
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numbers>
#include <optional>
#include <regista/soccer/team.hpp>
#include <string>

namespace {

using namespace regista;
using namespace std::chrono_literals;
using soccer::Team;
using soccer::TeamRobot;

constexpr double half_length_m = 4.5;
constexpr double half_width_m = 3;
constexpr Duration longest_turn = 15s;

struct Point {
  double x = 0;
  double y = 0;
};

double heading(Point from, Point to) { return std::atan2(to.y - from.y, to.x - from.x); }
double distance(Point a, Point b) { return std::hypot(b.x - a.x, b.y - a.y); }
Point place(const TeamRobot& robot) { return {robot.pose().x, robot.pose().y}; }

/// One side, which attacks towards `ahead` · x.
class Side {
 public:
  Side(Team& team, double ahead) : team_{team}, ahead_{ahead} { begin_turn(); }

  void begin_turn() {
    for (TeamRobot& robot : team_) {
      if (robot.connected()) robot.charge(true);  // a stop has switched it off
    }
    passed_ = false;
    striker_.reset();
  }

  /// True: it has shot, and the turn is over.
  bool attack(Point ball) {
    if (!striker_) striker_ = nearest(ball, {});
    TeamRobot& striker = team_[*striker_];
    const int receiver = nearest({ahead_ * 2.2, ball.y > 0 ? -1.2 : 1.2}, striker_);
    const Point goal{ahead_ * half_length_m, 0};
    const Point target = passed_ ? goal : place(team_[receiver]);
    const bool kicked = strike(striker, ball, target, passed_ ? 4.5 : 2.5);
    for (TeamRobot& robot : team_) {
      if (&robot == &striker) continue;
      const Point to = robot.id().number == receiver && !passed_ ? Point{ahead_ * 2.2, ball.y > 0 ? -1.2 : 1.2}
                                                                 : formation(robot.id().number, ball);
      robot.drive_to({.x = to.x, .y = to.y, .heading = heading(place(robot), ball)});
    }
    if (!kicked) return false;
    if (passed_) {
      ++shots;
      return true;
    }
    ++passes;
    passed_ = true;
    striker_ = receiver;
    return false;
  }

  void defend(Point ball) {
    for (TeamRobot& robot : team_) {
      const Point to = formation(robot.id().number, ball);
      robot.drive_to({.x = to.x, .y = to.y, .heading = heading(place(robot), ball)});
    }
  }

  int passes = 0;
  int shots = 0;

 private:
  [[nodiscard]] int nearest(Point to, std::optional<int> but) const {
    int best = -1;
    for (TeamRobot& robot : team_) {
      const int number = robot.id().number;
      if (number == 0 || number == but) continue;  // 0 keeps the goal
      if (best < 0 || distance(place(robot), to) < distance(place(team_[best]), to)) best = number;
    }
    return best;
  }

  /// Behind the ball, through it, and kick when it lies before the plate. True: kicked.
  static bool strike(TeamRobot& robot, Point ball, Point target, double speed_mps) {
    const double to_target = heading(ball, target);
    const double c = std::cos(to_target);
    const double s = std::sin(to_target);
    const double behind = -(c * (place(robot).x - ball.x) + s * (place(robot).y - ball.y));
    const double beside = -s * (place(robot).x - ball.x) + c * (place(robot).y - ball.y);
    const bool aims = std::abs(angle_between(robot.pose().heading, to_target)) < 0.15;
    if (robot.kicker_state().ball_detected != 0 && aims) {
      robot.kick(speed_mps);
      return true;
    }
    double back = 0.25;  // m, behind the ball
    double aside = 0;
    if (behind < 0.1) {  // round it
      back = 0.2;
      aside = beside > 0 ? 0.3 : -0.3;
    } else if (std::abs(beside) < 0.035 && aims) {
      back = 0.02;
    }
    robot.drive_to({.x = ball.x - back * c - aside * s, .y = ball.y - back * s + aside * c, .heading = to_target});
    return false;
  }

  [[nodiscard]] Point formation(int number, Point ball) const {
    constexpr std::array spread{0.0, -0.6, 0.6, -1.8, 0.0, 1.8};
    constexpr std::array depth{-4.3, -3.0, -3.0, -1.2, -1.8, -1.2};
    const auto index = static_cast<std::size_t>(number) % spread.size();
    if (index == 0) return {ahead_ * depth[0], std::clamp(ball.y, -0.45, 0.45)};
    const double forward = 0.35 * (ahead_ * ball.x + half_length_m);
    const Point wanted{ahead_ * (depth[index] + forward), spread[index] + 0.25 * ball.y};
    const double room_m = 0.8;  // for who plays the ball
    const double apart = distance(ball, wanted);
    if (apart >= room_m) return wanted;
    const double away = apart > 0 ? heading(ball, wanted) : 0;
    return {ball.x + room_m * std::cos(away), ball.y + room_m * std::sin(away)};
  }

  Team& team_;
  double ahead_;
  std::optional<int> striker_;
  bool passed_ = false;
};

/// The field as people see it.
class Picture {
 public:
  Picture() : draws_{::isatty(STDOUT_FILENO) == 1} {
    if (draws_) std::printf("\033[2J\033[?25l");
  }
  ~Picture() {
    if (draws_) std::printf("\033[?25h\n");
  }
  Picture(const Picture&) = delete;
  Picture& operator=(const Picture&) = delete;

  void show(const Team& team, const std::string& line, Time now) {
    if (now - shown_ < (draws_ ? Duration{100ms} : Duration{2s})) return;
    shown_ = now;
    if (draws_) draw(team);
    std::printf("%s%s\n", line.c_str(), draws_ ? "\033[K" : "");
    (void)std::fflush(stdout);
  }

 private:
  static constexpr int columns = 73;
  static constexpr int rows = 25;

  static void draw(const Team& team) {
    std::array<std::string, static_cast<std::size_t>(columns * rows)> cells;
    const auto at = [&](double x, double y) -> std::string& {
      const int column = static_cast<int>(std::lround((x / (2 * half_length_m + 0.6) + 0.5) * (columns - 1)));
      const int row = static_cast<int>(std::lround((0.5 - y / (2 * half_width_m + 0.6)) * (rows - 1)));
      return cells[static_cast<std::size_t>(std::clamp(row, 0, rows - 1) * columns +
                                            std::clamp(column, 0, columns - 1))];
    };
    for (double x = -half_length_m; x <= half_length_m; x += 0.1) at(x, half_width_m) = at(x, -half_width_m) = "-";
    for (double y = -half_width_m; y <= half_width_m; y += 0.1) {
      for (const double x : {-half_length_m, 0.0, half_length_m}) at(x, y) = std::abs(y) < 0.5 && x != 0 ? "#" : "|";
    }
    for (double angle = 0; angle < 6.28; angle += 0.3) at(0.5 * std::cos(angle), 0.5 * std::sin(angle)) = ".";
    for (const ssl::TrackedRobot& robot : team.seen()) {
      const bool yellow = robot.id.team == ssl::Team::yellow;
      // Which way it looks.
      at(robot.pose.x + 0.17 * std::cos(robot.pose.heading), robot.pose.y + 0.27 * std::sin(robot.pose.heading)) =
          yellow ? "\033[33m'\033[0m" : "\033[36m'\033[0m";
      at(robot.pose.x, robot.pose.y) =
          (yellow ? "\033[1;33m" : "\033[1;36m") + std::to_string(robot.id.number) + "\033[0m";
    }
    if (const auto ball = team.ball()) at(ball->position.x, ball->position.y) = "\033[1;31mo\033[0m";
    std::printf("\033[H");
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        const std::string& cell = cells[static_cast<std::size_t>(row * columns + column)];
        std::printf("%s", cell.empty() ? " " : cell.c_str());
      }
      std::printf("\n");
    }
  }

  bool draws_;
  Time shown_{};
};

/// How far each robot went, as the cameras saw it.
class Ways {
 public:
  void take(const Team& team) {
    for (const ssl::TrackedRobot& robot : team.seen()) {
      const auto [known, is_new] = ways_.try_emplace(robot.id, Way{.last = robot.pose});
      const double step_m = regista::distance(known->second.last, robot.pose);
      if (step_m < 0.02) continue;  // noise
      known->second.length_m += step_m;
      known->second.last = robot.pose;
    }
  }
  /// Says which did not, and returns how many did.
  [[nodiscard]] std::size_t moved(Team& team, double least_m) {
    std::size_t count = 0;
    for (const TeamRobot& robot : team) {
      if (ways_[robot.id()].length_m >= least_m) {
        ++count;
      } else {
        (void)std::fprintf(stderr, "%s did not move\n", to_string(robot.id()).c_str());
      }
    }
    return count;
  }

 private:
  struct Way {
    Pose2d last;
    double length_m = 0;
  };
  std::map<ssl::RobotId, Way> ways_;
};

volatile std::sig_atomic_t ended = 0;

int play(Duration duration) {
  Team yellow{"team.cfg", ssl::Team::yellow, {.speed_mps = 1.5, .acceleration_mps2 = 2.5, .gain = 5}};
  Team blue{"team.cfg", ssl::Team::blue, {.speed_mps = 1.5, .acceleration_mps2 = 2.5, .gain = 5}};
  Side left{yellow, 1};
  Side right{blue, -1};
  Ways ways;
  const Time until = Clock::now() + duration;
  Time turn_began = Clock::now();
  bool lefts_turn = true;
  {
    Picture picture;
    while (ended == 0 && Clock::now() < until) {
      (void)yellow.read(10ms);
      (void)blue.read(0ms);
      const Time now = Clock::now();
      const auto seen = yellow.ball();
      if (!seen) continue;
      const Point ball{seen->position.x, seen->position.y};
      ways.take(yellow);
      Side& attacker = lefts_turn ? left : right;
      (lefts_turn ? right : left).defend(ball);
      if (attacker.attack(ball) || now - turn_began > longest_turn) {
        lefts_turn = !lefts_turn;
        turn_began = now;
        (lefts_turn ? left : right).begin_turn();
      }
      char line[160];
      (void)std::snprintf(
          line, sizeof line, "%s attacks; yellow: %d passes, %d shots; blue: %d passes, %d shots; ball (%.1f, %.1f)",
          lefts_turn ? "yellow" : "blue", left.passes, left.shots, right.passes, right.shots, ball.x, ball.y);
      picture.show(yellow, line, now);
    }
  }
  const std::size_t moved = ways.moved(yellow, 0.1) + ways.moved(blue, 0.1);
  std::printf("%zu robots moved; %d passes, %d shots\n", moved, left.passes + right.passes, left.shots + right.shots);
  return moved == yellow.size() + blue.size() ? 0 : 1;
}

}  // namespace

/// play [SECONDS]
int main(int argc, char** argv) {
  for (const int number : {SIGINT, SIGTERM}) (void)std::signal(number, [](int) { ended = 1; });
  try {
    return play(argc > 1 ? from_seconds(std::atof(argv[1])) : Duration{24h});
  } catch (const std::exception& error) {
    (void)std::fprintf(stderr, "play: %s\n", error.what());
    return 1;
  }
}
