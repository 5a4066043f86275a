// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <regista/camera/image.hpp>
#include <regista/ssl/vision.hpp>

/// The league's model of a camera, there and back.
namespace regista::camera {

/// Where a point of the field's frame [m] is seen. None behind the camera, or further out than its lens bends.
std::optional<Pixel> project(const ssl::CameraCalibration& camera, const Point3d& point);

/// What is seen at a pixel, if it is `height_m` above the field. None at the horizon and above it.
std::optional<Point3d> to_field(const ssl::CameraCalibration& camera, const Pixel& pixel, double height_m);

/// From a pixel to the direction in the camera's frame, as x/z and y/z.
Pixel undistort(const ssl::CameraCalibration& camera, const Pixel& pixel);

}  // namespace regista::camera
