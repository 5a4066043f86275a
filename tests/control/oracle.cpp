// SPDX-License-Identifier: Apache-2.0
// Lets Python ask our filters, so that oracle_*_test.py can compare them with implementations that share no code with
// ours. Reads a command a line from stdin and prints a line of numbers for each.
//
//   oracle_control kalman N M              f q input h r z        -> x p nis
//   oracle_control odometry                vx vy w dt_ns          -> x y heading
//   oracle_control translation DENSITY     predict ax ay dt_ns | position x y sd | velocity x y sd   -> x p
//   oracle_control orientation RATE BIAS SD predict w dt_ns | heading h sd                           -> x p
//   oracle_control pose ACC TURN BIAS SLIP predict dt_ns | wheels v w sd sd | gyro w sd | heading h sd |
//                                          position x y sd | reset x y h sd sd                       -> x p

#include <cstdio>
#include <iostream>
#include <limits>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "regista/control/odometry.hpp"
#include "regista/control/orientation_filter.hpp"
#include "regista/control/pose_ekf.hpp"
#include "regista/control/translation_filter.hpp"

namespace {

using namespace regista;
using namespace regista::control;

double number(std::istream& line) {
  double value = 0;
  if (!(line >> value)) throw std::runtime_error{"a number is missing"};
  return value;
}

Duration nanoseconds(std::istream& line) { return std::chrono::nanoseconds{static_cast<std::int64_t>(number(line))}; }

template <int rows, int columns>
Eigen::Matrix<double, rows, columns> matrix(std::istream& line) {
  Eigen::Matrix<double, rows, columns> result;
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) result(i, j) = number(line);
  }
  return result;
}

void print(double value) { std::printf("%.17g ", value); }

template <typename Matrix>
void print_matrix(const Matrix& m) {
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    for (Eigen::Index j = 0; j < m.cols(); ++j) print(m(i, j));
  }
}

template <typename Kalman>
void print_state(const Kalman& kalman) {
  print_matrix(kalman.x);
  print_matrix(kalman.p);
}

/// Calls `step(command word, line)` for each line; without words the word is empty.
template <typename Step>
void each_line(bool words, Step step) {
  for (std::string text; std::getline(std::cin, text);) {
    std::istringstream line{text};
    std::string word;
    if (words) line >> word;
    step(word, line);
    std::puts("");
  }
}

template <int n, int m>
void kalman() {
  KalmanFilter<n> filter;
  each_line(false, [&](const std::string&, std::istream& line) {
    const auto f = matrix<n, n>(line);
    const auto q = matrix<n, n>(line);
    const auto input = matrix<n, 1>(line);
    filter.predict(f, q, input);
    const auto h = matrix<m, n>(line);
    const auto r = matrix<m, m>(line);
    const auto z = matrix<m, 1>(line);
    const auto result = filter.template correct<m>(z - h * filter.x, h, r, std::numeric_limits<double>::infinity());
    print_state(filter);
    print(result.nis);
  });
}

void kalman(int n, int m) {
  switch (10 * n + m) {
    case 11:
      return kalman<1, 1>();
    case 21:
      return kalman<2, 1>();
    case 32:
      return kalman<3, 2>();
    case 42:
      return kalman<4, 2>();
    case 63:
      return kalman<6, 3>();
    case 64:
      return kalman<6, 4>();
    default:
      throw std::runtime_error{"no such size"};
  }
}

void odometry() {
  Odometry odometry;
  each_line(false, [&](const std::string&, std::istream& line) {
    const double vx = number(line), vy = number(line), w = number(line);
    const Pose2d pose = odometry.step({.x = vx, .y = vy, .w = w}, nanoseconds(line));
    print(pose.x), print(pose.y), print(pose.heading);
  });
}

void translation(double density) {
  TranslationFilter filter{{.acceleration_density = density, .gate = 1e9}};
  each_line(true, [&](const std::string& word, std::istream& line) {
    const double x = number(line), y = number(line);
    if (word == "predict") filter.predict({.x = x, .y = y}, nanoseconds(line));
    if (word == "position") filter.correct(PositionMeasurement{.x = x, .y = y, .sd_m = number(line)});
    if (word == "velocity") filter.correct(VelocityMeasurement{.x = x, .y = y, .sd_mps = number(line)});
    print_state(filter.state().kalman);
  });
}

void orientation(double rate_density, double bias_density, double bias_sd) {
  OrientationFilter filter{
      {.rate_density = rate_density, .bias_density = bias_density, .initial_bias_sd_radps = bias_sd, .gate = 1e9}};
  each_line(true, [&](const std::string& word, std::istream& line) {
    const double value = number(line);
    if (word == "predict") filter.predict(value, nanoseconds(line));
    if (word == "heading") filter.correct({.heading_rad = value, .sd_rad = number(line)});
    print_state(filter.state().kalman);
  });
}

void pose(double acceleration, double turn, double bias, double slip) {
  PoseEkf ekf{{.acceleration_density = acceleration,
               .turn_density = turn,
               .bias_density = bias,
               .slip_density = slip,
               .gate = 1e9}};
  each_line(true, [&](const std::string& word, std::istream& line) {
    const double a = number(line);
    if (word == "predict") ekf.predict({}, std::chrono::nanoseconds{static_cast<std::int64_t>(a)});
    if (word == "gyro") ekf.correct(GyroMeasurement{.w_radps = a, .sd_radps = number(line)});
    if (word == "heading") ekf.correct(HeadingMeasurement{.heading_rad = a, .sd_rad = number(line)});
    if (word == "position") {
      const double y = number(line);
      ekf.correct(PositionMeasurement{.x = a, .y = y, .sd_m = number(line)});
    }
    if (word == "wheels") {
      const double w = number(line), speed_sd = number(line);
      ekf.correct(WheelMeasurement{.speed_mps = a, .w_radps = w, .speed_sd_mps = speed_sd, .w_sd_radps = number(line)});
    }
    if (word == "reset") {
      const double y = number(line), heading = number(line), position_sd = number(line);
      ekf.reset({.x = a, .y = y, .heading = heading}, position_sd, number(line));
    }
    print_state(ekf.state().kalman);
  });
}

}  // namespace

int main(int argc, char** argv) try {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  const std::string& what = arguments.at(0);
  const auto argument = [&](std::size_t i) { return std::stod(arguments.at(i)); };
  if (what == "kalman") kalman(std::stoi(arguments.at(1)), std::stoi(arguments.at(2)));
  if (what == "odometry") odometry();
  if (what == "translation") translation(argument(1));
  if (what == "orientation") orientation(argument(1), argument(2), argument(3));
  if (what == "pose") pose(argument(1), argument(2), argument(3), argument(4));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "oracle_control: %s\n", error.what());
  return 1;
}
