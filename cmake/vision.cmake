# SPDX-License-Identifier: Apache-2.0
# The league's messages, what is made of them, and regista-vision-bridge: all that needs protobuf.

find_package(Protobuf REQUIRED)
set(generated ${PROJECT_BINARY_DIR}/ssl)
file(MAKE_DIRECTORY ${generated})
add_custom_command(OUTPUT ${generated}/ssl.pb.cc ${generated}/ssl.pb.h
                   COMMAND protobuf::protoc --cpp_out=${generated} --proto_path=${PROJECT_SOURCE_DIR}/ssl/proto ssl.proto
                   DEPENDS ${PROJECT_SOURCE_DIR}/ssl/proto/ssl.proto VERBATIM)
regista_floor(ssl LEVEL 2 USES core
              SOURCES ssl/src/log_file.cpp ssl/src/messages.cpp ssl/src/multicast.cpp ${generated}/ssl.pb.cc ${generated}/ssl.pb.h
              LINKS protobuf::libprotobuf-lite)
target_include_directories(regista_ssl SYSTEM PRIVATE ${generated})
set_source_files_properties(${generated}/ssl.pb.cc PROPERTIES COMPILE_OPTIONS -w SKIP_LINTING ON)
regista_floor(vision LEVEL 3 FOLDER vision_bridge USES ssl control device core
              SOURCES vision_bridge/src/clock_map.cpp vision_bridge/src/config.cpp vision_bridge/src/delay_estimator.cpp
                      vision_bridge/src/tracker.cpp)
regista_floor(soccer LEVEL 4 USES vision client ssl control core SOURCES soccer/src/team.cpp)
if(REGISTA_PYTHON)
  return()
endif()
set(program vision_bridge/program)
regista_program(regista-vision-bridge
                SOURCES ${program}/main.cpp ${program}/bridge.cpp ${program}/recorder.cpp
                        ${program}/robot_link.cpp ${program}/status_server.cpp
                USES vision ssl client device metrics core
                LINKS spdlog::spdlog CLI11::CLI11 nlohmann_json::nlohmann_json Threads::Threads)
regista_program(regista-field-sim SOURCES programs/field_sim.cpp USES sim ssl core LINKS CLI11::CLI11)
