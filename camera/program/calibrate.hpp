// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

/// The three steps of `regista-camera calibrate`. Each reads the camera's file, if there is one, and writes it with
/// what was found. Throw std::exception with what is wrong and what to do.
namespace regista::camera {

struct CalibrateLens {
  std::filesystem::path file;
  std::vector<std::string> pictures;
  int columns = 9;
  int rows = 6;
  double square_m = 0;
};
void run(const CalibrateLens& arguments, std::ostream& report);

struct CalibrateField {
  std::filesystem::path file;
  std::string picture;
  std::string division;                         ///< "A", "B", or "": the file's
  std::optional<std::filesystem::path> points;  ///< else they are pointed at
};
void run(const CalibrateField& arguments, std::ostream& report);

struct CalibrateColours {
  std::filesystem::path file;
  std::string picture;
  std::optional<std::filesystem::path> samples;  ///< else they are pointed at
};
void run(const CalibrateColours& arguments, std::ostream& report);

}  // namespace regista::camera
