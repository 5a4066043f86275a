// SPDX-License-Identifier: Apache-2.0
#include "picker.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <opencv2/highgui.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace regista::camera {

namespace {

constexpr const char* window = "regista-camera";
constexpr double widest_px = 1280;
constexpr int lens_px = 160;  ///< of the magnified square around the mouse
constexpr int magnified = 8;

}  // namespace

Picker::Picker(const cv::Mat& picture) : picture_{picture}, scale_{std::min(1.0, widest_px / picture.cols)} {
  if (std::getenv("DISPLAY") == nullptr && std::getenv("WAYLAND_DISPLAY") == nullptr)  // NOLINT(concurrency-mt-unsafe)
    throw std::runtime_error{"there is no display to point at things on: give a file instead"};
  cv::namedWindow(window, cv::WINDOW_AUTOSIZE);
  cv::setMouseCallback(window, &Picker::on_mouse, this);
}

Picker::~Picker() { cv::destroyWindow(window); }

void Picker::on_mouse(int event, int x, int y, int /*flags*/, void* self) {
  auto& picker = *static_cast<Picker*>(self);
  picker.mouse_ = {x, y};
  if (event == cv::EVENT_LBUTTONDOWN) picker.clicked_ = true;
}

void Picker::draw(const std::string& question, const std::vector<Pixel>& picked) {
  cv::Mat screen;
  cv::resize(picture_, screen, {}, scale_, scale_, cv::INTER_AREA);
  for (const Pixel& p : picked)
    cv::drawMarker(screen, cv::Point2d{p.x * scale_, p.y * scale_}, {0, 255, 255}, cv::MARKER_CROSS, 12, 1);
  cv::Mat lens;
  const cv::Point2f centre{static_cast<float>(mouse_.x / scale_), static_cast<float>(mouse_.y / scale_)};
  cv::getRectSubPix(picture_, {lens_px / magnified, lens_px / magnified}, centre, lens);
  cv::resize(lens, lens, {lens_px, lens_px}, 0, 0, cv::INTER_NEAREST);
  cv::drawMarker(lens, {lens_px / 2, lens_px / 2}, {255, 255, 255}, cv::MARKER_CROSS, lens_px, 1);
  const bool is_left = mouse_.x > screen.cols / 2;
  const cv::Rect corner{is_left ? 0 : screen.cols - lens_px, screen.rows - lens_px, lens_px, lens_px};
  if (corner.x >= 0 && corner.y >= 0) lens.copyTo(screen(corner));
  cv::rectangle(screen, {0, 0, screen.cols, 28}, {0, 0, 0}, cv::FILLED);
  cv::putText(screen, question, {8, 20}, cv::FONT_HERSHEY_SIMPLEX, 0.5, {255, 255, 255}, 1, cv::LINE_AA);
  cv::imshow(window, screen);
}

Picker::Answer Picker::ask(const std::string& question, std::size_t most, std::vector<Pixel>& picked) {
  constexpr int frame_ms = 30;
  constexpr int enter = 13;
  constexpr int escape = 27;
  constexpr int backspace = 8;
  clicked_ = false;
  while (picked.size() < most) {
    draw(question, picked);
    const int key = cv::waitKey(frame_ms);
    if (key == enter || key == ' ') return Answer::next;
    if (key == backspace) return Answer::back;
    if (key == escape || cv::getWindowProperty(window, cv::WND_PROP_VISIBLE) < 1) return Answer::done;
    if (std::exchange(clicked_, false)) picked.push_back({.x = mouse_.x / scale_, .y = mouse_.y / scale_});
  }
  return Answer::next;
}

}  // namespace regista::camera
