# SPDX-License-Identifier: Apache-2.0
# The package: find_package(regista) gives regista::core and every other floor, and regista_driver().

include(CMakePackageConfigHelpers)
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/regista)
configure_package_config_file(cmake/regista-config.cmake.in ${PROJECT_BINARY_DIR}/regista-config.cmake
                              INSTALL_DESTINATION ${package})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/regista-config-version.cmake COMPATIBILITY SameMinorVersion)
install(EXPORT regista NAMESPACE regista:: FILE regista-targets.cmake DESTINATION ${package})
install(FILES ${PROJECT_BINARY_DIR}/regista-config.cmake ${PROJECT_BINARY_DIR}/regista-config-version.cmake
              cmake/driver.cmake cmake/plugin.map DESTINATION ${package})
install(FILES README.md CHANGELOG.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES dist/regista-server.service DESTINATION ${CMAKE_INSTALL_LIBDIR}/systemd/system)
