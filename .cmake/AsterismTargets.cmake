# How every target of the project is declared, and how the package is installed.

# Compile settings of our own code; nothing of this reaches a consumer.
function(asterism_private_options target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion -Wshadow)
  if(ASTERISM_WERROR)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
  if(ASTERISM_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=address,undefined -fno-sanitize-recover=undefined
                                             -fno-omit-frame-pointer)
    target_link_options(${target} PRIVATE -fsanitize=address,undefined)
  endif()
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF CXX_VISIBILITY_PRESET hidden)
endfunction()

# asterism_library(NAME [INTERFACE] SOURCES ... ) declares library asterism_NAME, exported as asterism::NAME,
# whose public headers are in include/ of the current folder.
function(asterism_library name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "INTERFACE" "" "SOURCES")
  set(target asterism_${name})
  if(arg_INTERFACE)
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  else()
    add_library(${target} STATIC ${arg_SOURCES})
    set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE ON)
    asterism_private_options(${target})
    set(scope PUBLIC)
  endif()
  add_library(asterism::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(${target} ${scope} cxx_std_20)
  target_include_directories(
    ${target} ${scope} $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  set_property(GLOBAL APPEND PROPERTY ASTERISM_COMPONENTS ${name})
  if(ASTERISM_INSTALL)
    install(TARGETS ${target} EXPORT Asterism_${name} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
    install(EXPORT Asterism_${name} FILE Asterism_${name}.cmake NAMESPACE asterism::
            DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Asterism)
  endif()
endfunction()

# asterism_missing(TARGET WHAT PACKAGE): the one line for an optional dependency that is not there.
function(asterism_missing target what package)
  message(STATUS "Asterism: asterism::${target} is off: ${what} not found (Debian package ${package})")
endfunction()

function(asterism_install_package)
  include(CMakePackageConfigHelpers)
  set(dir ${CMAKE_INSTALL_LIBDIR}/cmake/Asterism)
  get_property(ASTERISM_COMPONENTS GLOBAL PROPERTY ASTERISM_COMPONENTS)
  configure_package_config_file(.cmake/AsterismConfig.cmake.in ${PROJECT_BINARY_DIR}/AsterismConfig.cmake
                                INSTALL_DESTINATION ${dir})
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/AsterismConfigVersion.cmake
                                   COMPATIBILITY SameMinorVersion)
  install(FILES ${PROJECT_BINARY_DIR}/AsterismConfig.cmake ${PROJECT_BINARY_DIR}/AsterismConfigVersion.cmake
          DESTINATION ${dir})
endfunction()
