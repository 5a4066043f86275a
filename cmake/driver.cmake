# SPDX-License-Identifier: Apache-2.0
# How a driver is built, in this tree and in yours: find_package(regista) brings it.

include_guard()
include(GNUInstallDirs)
set(REGISTA_PLUGIN_EXPORTS ${CMAKE_CURRENT_LIST_DIR}/plugin.map)

# regista_driver(NAME SOURCES file... [USES floor...] [LINKS library...] [NOT_INSTALLED])
#   The plugin NAME.so, in lib/regista of the build tree and of what is installed. All sources but plugin.cpp are also
#   the static library driver_NAME, which tests link.
#   USES: floors beside device, such as sim; LINKS: other libraries.
function(regista_driver name)
  cmake_parse_arguments(arg "NOT_INSTALLED" "" "SOURCES;USES;LINKS" ${ARGN})
  list(TRANSFORM arg_USES PREPEND regista::)
  set(libraries regista::device ${arg_USES} ${arg_LINKS})
  set(entry ${arg_SOURCES})
  list(FILTER entry INCLUDE REGEX "(^|/)plugin\\.cpp$")
  if(entry)
    list(REMOVE_ITEM arg_SOURCES ${entry})
    add_library(driver_${name} STATIC ${arg_SOURCES})
    target_link_libraries(driver_${name} PUBLIC ${libraries})
    target_include_directories(driver_${name} INTERFACE ${CMAKE_CURRENT_SOURCE_DIR})
    set_target_properties(driver_${name} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    set(arg_SOURCES ${entry})
    set(libraries driver_${name})
  endif()
  add_library(${name} MODULE ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE ${libraries})
  # One symbol goes out. None comes in but from libraries: what is missing is told here and not by the server; clang
  # keeps its sanitizers in the program, so only gcc can tell.
  target_link_options(${name} PRIVATE LINKER:--version-script=${REGISTA_PLUGIN_EXPORTS}
                                      $<$<CXX_COMPILER_ID:GNU>:LINKER:-z,defs>)
  set_target_properties(${name} PROPERTIES PREFIX "" LINK_DEPENDS ${REGISTA_PLUGIN_EXPORTS}
                                           LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/lib/regista)
  if(NOT arg_NOT_INSTALLED)
    install(TARGETS ${name} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/regista)
  endif()
endfunction()
