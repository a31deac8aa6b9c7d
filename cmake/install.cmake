include(CMakePackageConfigHelpers)
set(package_folder lib/cmake/Lightstage)
install(EXPORT LightstageTargets NAMESPACE Lightstage:: DESTINATION ${package_folder})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/LightstageConfigVersion.cmake COMPATIBILITY SameMinorVersion)
file(WRITE ${PROJECT_BINARY_DIR}/LightstageConfig.cmake
     "include(\${CMAKE_CURRENT_LIST_DIR}/dependencies.cmake)\ninclude(\${CMAKE_CURRENT_LIST_DIR}/LightstageTargets.cmake)\n")
install(FILES ${PROJECT_BINARY_DIR}/LightstageConfig.cmake ${PROJECT_BINARY_DIR}/LightstageConfigVersion.cmake
              ${PROJECT_SOURCE_DIR}/cmake/dependencies.cmake DESTINATION ${package_folder})

# Access to the stage's devices without root. udev reads this folder below /usr; docs/hardware.md says what to do elsewhere.
install(FILES ${PROJECT_SOURCE_DIR}/capture/udev/70-lightstage.rules DESTINATION lib/udev/rules.d)
