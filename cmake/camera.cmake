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
