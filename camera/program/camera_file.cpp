// SPDX-License-Identifier: Apache-2.0
#include "camera_file.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <regista/device/config_file.hpp>
#include <system_error>

namespace regista::camera {

namespace {

std::vector<double> list(const Section& section, std::string_view key, std::size_t count, Range range = {}) {
  std::vector<double> values = section.numbers(key, range);
  if (values.size() != count) throw section.error(key, "must be " + std::to_string(count) + " numbers");
  return values;
}

void read_camera(const Section& section, CameraFile& out) {
  ssl::CameraCalibration& camera = out.camera;
  camera.camera = static_cast<std::uint32_t>(section.integer("id", 0, {.min = 0, .max = 1000}));
  const auto size = list(section, "size", 2, {.min = 16, .max = 16384});
  camera.width_px = static_cast<std::uint32_t>(size[0]);
  camera.height_px = static_cast<std::uint32_t>(size[1]);
  if (section.has("focal")) {
    camera.focal_px = section.number("focal", {.min = 1, .max = 1e5});
    const auto principal = list(section, "principal", 2, {.min = -1e5, .max = 1e5});
    camera.principal_x_px = principal[0];
    camera.principal_y_px = principal[1];
    camera.distortion = section.number("distortion", 0, {.min = -10, .max = 10});
  }
  if (section.has("rotation")) {
    const auto q = list(section, "rotation", 4, {.min = -1, .max = 1});
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (std::abs(norm - 1) > 1e-3) throw section.error("rotation", "must be a quaternion of length 1");
    std::ranges::transform(q, camera.rotation.begin(), [=](double part) { return part / norm; });
    const auto t = list(section, "translation", 3, {.min = -100, .max = 100});
    camera.translation = {.x = t[0], .y = t[1], .z = t[2]};
    out.has_pose = true;
  }
  out.detector.yellow_height_m = section.length("yellow_height", out.detector.yellow_height_m, {.min = 0, .max = 1});
  out.detector.blue_height_m = section.length("blue_height", out.detector.blue_height_m, {.min = 0, .max = 1});
  section.check_unused();
}

void read_field(const Section& section, ssl::Geometry& field) {
  field.length_m = section.length("length", field.length_m, {.min = 1, .max = 100});
  field.width_m = section.length("width", field.width_m, {.min = 1, .max = 100});
  field.boundary_m = section.length("boundary", field.boundary_m, {.min = 0, .max = 10});
  field.goal_width_m = section.length("goal_width", field.goal_width_m, {.min = 0, .max = 10});
  field.goal_depth_m = section.length("goal_depth", field.goal_depth_m, {.min = 0, .max = 10});
  field.defence_depth_m = section.length("defence_depth", field.defence_depth_m, {.min = 0, .max = 10});
  field.defence_width_m = section.length("defence_width", field.defence_width_m, {.min = 0, .max = 20});
  field.circle_radius_m = section.length("circle_radius", field.circle_radius_m, {.min = 0, .max = 10});
  section.check_unused();
}

ColourModel read_colour(const Section& section) {
  const auto colour = colour_named(section.text("name"));
  if (!colour) throw section.error("name", "must be orange, yellow, blue, green, magenta, field, white or black");
  const auto bgr = list(section, "bgr", 3, {.min = 0, .max = 255});
  const auto spread = list(section, "spread", 3, {.min = 0.01, .max = 3});
  section.check_unused();
  return {.colour = *colour, .bgr = {bgr[0], bgr[1], bgr[2]}, .spread = {spread[0], spread[1], spread[2]}};
}

}  // namespace

CameraFile read_camera_file(const std::filesystem::path& file) {
  constexpr std::array<std::string_view, 3> types{"camera", "field", "colour"};
  CameraFile out;
  bool has_camera = false;
  std::vector<Colour> seen;
  for (const Section& section : read_sections(file, types)) {
    if (section.type() == "camera") {
      if (std::exchange(has_camera, true)) throw ConfigError{section.place(), "a second section 'camera'"};
      read_camera(section, out);
    } else if (section.type() == "field") {
      read_field(section, out.field);
    } else {
      const ColourModel model = read_colour(section);
      if (std::ranges::find(seen, model.colour) != seen.end())
        throw ConfigError{section.place(), "a second colour '" + std::string{name_of(model.colour)} + "'"};
      seen.push_back(model.colour);
      *std::ranges::find(out.detector.colours, model.colour, &ColourModel::colour) = model;
    }
  }
  if (!has_camera) throw ConfigError{{.file = file.string()}, "has no section 'camera'"};
  return out;
}

void write_camera_file(const std::filesystem::path& file, const CameraFile& camera) {
  const ssl::CameraCalibration& c = camera.camera;
  std::string text = fmt::format(
      "# Written by regista-camera calibrate. docs/camera.md explains it.\ncamera(\n  id {}\n  size [{} {}]\n",
      c.camera, c.width_px, c.height_px);
  if (c.focal_px > 0) {
    text += fmt::format("  focal {:.3f}\n  principal [{:.3f} {:.3f}]\n  distortion {:.6f}\n", c.focal_px,
                        c.principal_x_px, c.principal_y_px, c.distortion);
  }
  if (camera.has_pose) {
    const auto& [x, y, z, w] = c.rotation;
    text += fmt::format("  rotation [{:.8f} {:.8f} {:.8f} {:.8f}]\n  translation [{:.5f} {:.5f} {:.5f}]\n", x, y, z, w,
                        c.translation.x, c.translation.y, c.translation.z);
  }
  text += fmt::format("  yellow_height {}\n  blue_height {}\n)\n", camera.detector.yellow_height_m,
                      camera.detector.blue_height_m);
  const ssl::Geometry& f = camera.field;
  text += fmt::format("field(\n  length {}\n  width {}\n  boundary {}\n  goal_width {}\n  goal_depth {}\n", f.length_m,
                      f.width_m, f.boundary_m, f.goal_width_m, f.goal_depth_m);
  text += fmt::format("  defence_depth {}\n  defence_width {}\n  circle_radius {}\n)\n", f.defence_depth_m,
                      f.defence_width_m, f.circle_radius_m);
  for (const ColourModel& m : camera.detector.colours) {
    text += fmt::format("colour( name \"{}\" bgr [{:.1f} {:.1f} {:.1f}] spread [{:.3f} {:.3f} {:.3f}] )\n",
                        name_of(m.colour), m.bgr[0], m.bgr[1], m.bgr[2], m.spread[0], m.spread[1], m.spread[2]);
  }
  // In one step: a full disk leaves the old file.
  const std::filesystem::path beside = file.string() + ".new";
  std::ofstream out{beside};
  out << text;
  out.close();
  if (!out) throw std::system_error{errno, std::generic_category(), "write " + beside.string()};
  std::filesystem::rename(beside, file);
}

}  // namespace regista::camera
