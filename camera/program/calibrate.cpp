// SPDX-License-Identifier: Apache-2.0
#include "calibrate.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <ostream>
#include <regista/camera/calibration.hpp>
#include <regista/camera/light.hpp>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "camera_file.hpp"
#include "picker.hpp"
#include "source.hpp"

namespace regista::camera {

namespace {

constexpr double bad_fit_px = 5;

CameraFile file_for(const std::filesystem::path& file, const cv::Mat& picture) {
  CameraFile camera;
  if (std::filesystem::exists(file)) {
    camera = read_camera_file(file);
    if (std::cmp_not_equal(camera.camera.width_px, picture.cols) ||
        std::cmp_not_equal(camera.camera.height_px, picture.rows)) {
      throw std::runtime_error{fmt::format("the picture has {} x {} pixels, {} is for {} x {}", picture.cols,
                                           picture.rows, file.string(), camera.camera.width_px,
                                           camera.camera.height_px)};
    }
  }
  camera.camera.width_px = static_cast<std::uint32_t>(picture.cols);
  camera.camera.height_px = static_cast<std::uint32_t>(picture.rows);
  return camera;
}

template <typename T>
T required(Result<T> result) {
  if (!result) throw std::runtime_error{result.error().what};
  return *std::move(result);
}

/// Lines of words, without comments; each with its place, for errors.
struct Line {
  std::vector<std::string> words;
  std::string place;
};
std::vector<Line> read_lines(const std::filesystem::path& file) {
  std::ifstream in{file};
  if (!in) throw std::runtime_error{"cannot read '" + file.string() + "'"};
  std::vector<Line> lines;
  int number = 0;
  for (std::string text; std::getline(in, text);) {
    Line line{.words = {}, .place = file.string() + ':' + std::to_string(++number)};
    std::istringstream words{text.substr(0, text.find('#'))};
    for (std::string word; words >> word;) line.words.push_back(word);
    if (!line.words.empty()) lines.push_back(std::move(line));
  }
  return lines;
}

double number(const Line& line, std::size_t word) {
  std::size_t used = 0;
  double value = NAN;
  try {
    value = std::stod(line.words.at(word), &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used == 0 || used != line.words[word].size() || !std::isfinite(value))
    throw std::runtime_error{line.place + ": '" + line.words.at(word) + "' is no number"};
  return value;
}

// --- Field ----------------------------------------------------------------------------------------------------------

View read_points(const std::filesystem::path& file) {
  View view;
  for (const Line& line : read_lines(file)) {
    if (line.words.size() != 4) throw std::runtime_error{line.place + ": must be x y [m] and the pixel's x y"};
    view.points.push_back({.x = number(line, 0), .y = number(line, 1)});
    view.pixels.push_back({.x = number(line, 2), .y = number(line, 3)});
  }
  return view;
}

struct Landmark {
  std::string name;
  double x = 0;
  double y = 0;
};

/// Where lines of the field meet, in the order in which they are asked for. +x is towards one goal, +y to its left.
std::vector<Landmark> landmarks(const ssl::Geometry& field) {
  std::vector<Landmark> all;
  const double x = field.length_m / 2;
  const double y = field.width_m / 2;
  all.push_back({"centre of the field", 0, 0});
  for (const int up : {1, -1}) {
    const std::string side = up > 0 ? "+y" : "-y";
    all.push_back({"halfway line meets the touch line, " + side, 0, up * y});
    if (field.circle_radius_m > 0)
      all.push_back({"centre circle crosses the halfway line, " + side, 0, up * field.circle_radius_m});
    for (const int right : {1, -1}) {
      const std::string place = (right > 0 ? "+x " : "-x ") + side;
      all.push_back({"corner of the field, " + place, right * x, up * y});
      if (field.defence_depth_m <= 0) continue;
      const double area_y = field.defence_width_m / 2;
      all.push_back({"corner of the defence area, " + place, right * (x - field.defence_depth_m), up * area_y});
      all.push_back({"defence area meets the goal line, " + place, right * x, up * area_y});
    }
  }
  return all;
}

View point_at_landmarks(const cv::Mat& picture, const ssl::Geometry& field) {
  Picker picker{picture};
  const std::vector<Landmark> all = landmarks(field);
  std::vector<std::vector<Pixel>> picked(all.size());
  for (std::size_t i = 0; i < all.size();) {
    picked[i].clear();
    const std::string question =
        fmt::format("{}/{}: the middle of the line: {}.   Enter: not seen   Backspace: back   Esc: done", i + 1,
                    all.size(), all[i].name);
    const Picker::Answer answer = picker.ask(question, 1, picked[i]);
    if (answer == Picker::Answer::done) break;
    if (answer == Picker::Answer::next) ++i;
    if (answer == Picker::Answer::back && i > 0) --i;
  }
  View view;
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (const Pixel& pixel : picked[i]) {
      view.points.push_back({.x = all[i].x, .y = all[i].y});
      view.pixels.push_back(pixel);
    }
  }
  return view;
}

// --- Colours --------------------------------------------------------------------------------------------------------

struct Sample {
  Colour colour = Colour::none;
  Pixel pixel{};
  double radius_px = 1;
};

std::vector<Sample> read_samples(const std::filesystem::path& file) {
  std::vector<Sample> samples;
  for (const Line& line : read_lines(file)) {
    if (line.words.size() != 3 && line.words.size() != 4)
      throw std::runtime_error{line.place + ": must be a colour, the pixel's x y, and perhaps a radius [px]"};
    const auto colour = colour_named(line.words[0]);
    if (!colour) {
      throw std::runtime_error{line.place + ": '" + line.words[0] +
                               "' is none of orange, yellow, blue, green, magenta, field, white, black"};
    }
    samples.push_back({*colour, {.x = number(line, 1), .y = number(line, 2)}});
    if (line.words.size() == 4) samples.back().radius_px = number(line, 3);
  }
  return samples;
}

constexpr std::array<Colour, 8> all_colours{Colour::orange,  Colour::yellow, Colour::blue,  Colour::green,
                                            Colour::magenta, Colour::field,  Colour::white, Colour::black};

std::vector<Sample> point_at_colours(const cv::Mat& picture) {
  Picker picker{picture};
  std::vector<Sample> samples;
  for (const Colour colour : all_colours) {
    const std::string question =
        fmt::format("{}: click on several, in light and shade.   Enter: next   Esc: done", name_of(colour));
    std::vector<Pixel> picked;
    constexpr std::size_t most = 100;
    const Picker::Answer answer = picker.ask(question, most, picked);
    for (const Pixel& pixel : picked) samples.push_back({colour, pixel});
    if (answer == Picker::Answer::done) break;
  }
  return samples;
}

}  // namespace

void run(const CalibrateLens& arguments, std::ostream& report) {
  const std::vector<cv::Mat> pictures = read_pictures(arguments.pictures);
  CameraFile camera = file_for(arguments.file, pictures.front());
  std::vector<View> boards;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    if (pictures[i].size() != pictures.front().size()) throw std::runtime_error{"the pictures differ in size"};
    const auto board = find_board(view(pictures[i]), arguments.columns, arguments.rows, arguments.square_m);
    report << fmt::format("picture {}: {}\n", i + 1, board ? "board found" : "no board found, left out");
    if (board) boards.push_back(*board);
  }
  const CalibrationFit fit = required(fit_lens(boards, camera.camera));
  if (fit.rms_px > bad_fit_px) {
    throw std::runtime_error{fmt::format(
        "the board's corners are {:.1f} px off the model: is the board flat, are --board and --square right?",
        fit.rms_px)};
  }
  camera.camera = fit.camera;
  camera.has_pose = false;  // which was found with another lens
  write_camera_file(arguments.file, camera);
  report << fmt::format(
      "focal length {:.1f} px, principal point {:.1f} {:.1f}, distortion {:.4f}; corners are {:.2f} px off (rms)\n",
      fit.camera.focal_px, fit.camera.principal_x_px, fit.camera.principal_y_px, fit.camera.distortion, fit.rms_px);
}

void run(const CalibrateField& arguments, std::ostream& report) {
  const cv::Mat picture = read_pictures({arguments.picture}).front();
  CameraFile camera = file_for(arguments.file, picture);
  if (!arguments.division.empty()) camera.field = arguments.division == "A" ? division_a() : division_b();
  const View points = arguments.points ? read_points(*arguments.points) : point_at_landmarks(picture, camera.field);
  const CalibrationFit fit = required(fit_pose(points, camera.camera));
  for (std::size_t i = 0; i < points.points.size(); ++i) {
    const Point3d& p = points.points[i];
    report << fmt::format("({:.3f}, {:.3f}) m at ({:.1f}, {:.1f}): {:.2f} px off{}\n", p.x, p.y, points.pixels[i].x,
                          points.pixels[i].y, fit.errors_px[i],
                          fit.errors_px[i] > bad_fit_px ? "; is it the right point?" : "");
  }
  if (fit.rms_px > bad_fit_px) {
    throw std::runtime_error{
        fmt::format("the points are {:.1f} px off the model (rms): nothing is written. A wrong point moves all others",
                    fit.rms_px)};
  }
  camera.camera = fit.camera;
  camera.has_pose = true;
  write_camera_file(arguments.file, camera);
  const Point3d place = ssl::position(fit.camera);
  report << fmt::format("the camera is at ({:.3f}, {:.3f}, {:.3f}) m; points are {:.2f} px off (rms)\n", place.x,
                        place.y, place.z, fit.rms_px);
}

void run(const CalibrateColours& arguments, std::ostream& report) {
  const cv::Mat picture = read_pictures({arguments.picture}).front();
  CameraFile camera = file_for(arguments.file, picture);
  const std::vector<Sample> samples = arguments.samples ? read_samples(*arguments.samples) : point_at_colours(picture);
  LightMap light;
  light.measure(view(picture));
  std::map<Colour, std::vector<Bgr>> pixels;
  for (const Sample& sample : samples) {
    for (int y = 0; y < picture.rows; ++y) {
      for (int x = 0; x < picture.cols; ++x) {
        if (std::hypot(x - sample.pixel.x, y - sample.pixel.y) > sample.radius_px) continue;
        const auto& bgr = picture.at<cv::Vec3b>(y, x);
        const std::uint8_t* normal = light.table(x, y);
        pixels[sample.colour].push_back({static_cast<double>(normal[bgr[0]]), static_cast<double>(normal[bgr[1]]),
                                         static_cast<double>(normal[bgr[2]])});
      }
    }
  }
  for (ColourModel& model : camera.detector.colours) {
    const auto seen = pixels.find(model.colour);
    if (seen == pixels.end()) {
      report << fmt::format("{}: no samples, as before\n", name_of(model.colour));
      continue;
    }
    model = required(learn_colour(model.colour, seen->second));
    report << fmt::format("{}: {} pixels\n", name_of(model.colour), seen->second.size());
  }
  // Whoever looks like another colour will be mistaken.
  const ColourTable table{camera.detector.colours};
  for (const auto& [colour, seen] : pixels) {
    std::map<Colour, std::size_t> taken;
    for (const Bgr& bgr : seen) {
      const std::array<std::uint8_t, 3> bytes{static_cast<std::uint8_t>(bgr[0]), static_cast<std::uint8_t>(bgr[1]),
                                              static_cast<std::uint8_t>(bgr[2])};
      ++taken[table(bytes.data())];
    }
    for (const auto& [other, count] : taken) {
      if (other != colour && 10 * count > seen.size())
        report << fmt::format("warning: {} of {} pixels of {} look like {}\n", count, seen.size(), name_of(colour),
                              name_of(other));
    }
  }
  write_camera_file(arguments.file, camera);
}

}  // namespace regista::camera
