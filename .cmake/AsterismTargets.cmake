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
  if(ASTERISM_FUZZ)
    target_compile_options(${target} PRIVATE -fsanitize=fuzzer-no-link)  # what is covered guides the fuzzers
  endif()
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF CXX_VISIBILITY_PRESET hidden)
endfunction()

# asterism_command_line(SOURCE): a source that reads a command line with CLI11, which takes the compiler twice as long
# where it is to run fast.
function(asterism_command_line source)
  set_source_files_properties(${source} PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O1>")
endfunction()

# asterism_library(NAME [INTERFACE] [SOURCES ...] [HEADERS ...] [WITHOUT ...]) declares library asterism_NAME, exported
# as asterism::NAME. Its public headers, in include/ of the current folder, are asterism/NAME.hpp and all of
# asterism/NAME/ but those in WITHOUT, or else HEADERS.
function(asterism_library name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "INTERFACE" "" "SOURCES;HEADERS;WITHOUT")
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

  set(include ${CMAKE_CURRENT_SOURCE_DIR}/include)
  set(headers ${arg_HEADERS})
  if(NOT headers)
    file(GLOB_RECURSE headers RELATIVE ${include} CONFIGURE_DEPENDS ${include}/asterism/${name}/*.hpp)
    if(EXISTS ${include}/asterism/${name}.hpp)
      list(APPEND headers asterism/${name}.hpp)
    endif()
    list(REMOVE_ITEM headers "" ${arg_WITHOUT})
  endif()
  list(TRANSFORM headers PREPEND ${include}/)
  target_sources(${target} ${scope} FILE_SET HEADERS BASE_DIRS ${include} FILES ${headers})

  set_property(GLOBAL APPEND PROPERTY ASTERISM_COMPONENTS ${name})
  if(ASTERISM_INSTALL)
    install(TARGETS ${target} EXPORT Asterism_${name}
            ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
            FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
            INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})  # CMake before 3.23 knows no file sets
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
                                INSTALL_DESTINATION ${dir} NO_SET_AND_CHECK_MACRO
                                NO_CHECK_REQUIRED_COMPONENTS_MACRO)
  write_basic_package_version_file(${PROJECT_BINARY_DIR}/AsterismConfigVersion.cmake
                                   COMPATIBILITY SameMinorVersion)
  install(FILES ${PROJECT_BINARY_DIR}/AsterismConfig.cmake ${PROJECT_BINARY_DIR}/AsterismConfigVersion.cmake
          DESTINATION ${dir})
endfunction()
