# SPDX-License-Identifier: Apache-2.0
# regista-camera: all that needs OpenCV.

# regista_opencv(MODULE...): targets regista_opencv_MODULE. Debian's packages of single modules have no file for CMake;
# libopencv-dev has one, and 400 MB more.
function(regista_opencv)
  find_path(OPENCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
  foreach(module IN LISTS ARGN)
    find_library(OPENCV_${module} opencv_${module} REQUIRED)
    add_library(regista_opencv_${module} INTERFACE)
    target_link_libraries(regista_opencv_${module} INTERFACE ${OPENCV_${module}})
    target_include_directories(regista_opencv_${module} SYSTEM INTERFACE ${OPENCV_INCLUDE_DIR})
  endforeach()
endfunction()
regista_opencv(core imgproc calib3d imgcodecs videoio highgui)

set(opencv ${OPENCV_calib3d} ${OPENCV_imgproc} ${OPENCV_core})
regista_floor(camera LEVEL 3 USES ssl core
              SOURCES camera/src/blobs.cpp camera/src/calibration.cpp camera/src/colours.cpp camera/src/detector.cpp
                      camera/src/light.cpp camera/src/projection.cpp
              LINKS ${opencv})
target_include_directories(regista_camera SYSTEM PRIVATE ${OPENCV_INCLUDE_DIR})
set(program camera/program)
find_package(fmt REQUIRED)
regista_program(regista-camera
                SOURCES ${program}/main.cpp ${program}/calibrate.cpp ${program}/camera_file.cpp ${program}/overlay.cpp
                        ${program}/picker.cpp ${program}/publisher.cpp ${program}/source.cpp
                USES camera ssl device core
                LINKS regista_opencv_highgui regista_opencv_imgcodecs regista_opencv_imgproc regista_opencv_videoio
                      regista_opencv_core fmt::fmt CLI11::CLI11 nlohmann_json::nlohmann_json Threads::Threads)
