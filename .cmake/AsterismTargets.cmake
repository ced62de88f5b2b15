# Functions that declare the project's targets and install the package.

# Compile settings of the project's own code; they do not reach consumers.
function(asterism_private_options target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion -Wshadow)
  if(ASTERISM_WERROR)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
  if(ASTERISM_SANITIZE STREQUAL thread)
    target_compile_options(${target} PRIVATE -fsanitize=thread)
    target_link_options(${target} PRIVATE -fsanitize=thread)
  elseif(ASTERISM_SANITIZE)
    # Without the checks that AddressSanitizer duplicates: they double the compile time.
    target_compile_options(${target} PRIVATE -fsanitize=address,undefined -fno-sanitize=null,object-size,vptr,pointer-overflow
                                             -fno-sanitize-recover=undefined -fno-omit-frame-pointer)
    target_compile_definitions(${target} PRIVATE EIGEN_INITIALIZE_MATRICES_BY_NAN)
    target_link_options(${target} PRIVATE -fsanitize=address,undefined)
  endif()
  if(ASTERISM_FUZZ)
    target_compile_options(${target} PRIVATE -fsanitize=fuzzer-no-link)  # coverage guides the fuzzers
  endif()
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF CXX_VISIBILITY_PRESET hidden)
endfunction()

# asterism_share_precompiled(TARGET HEADER...): one precompiled header per folder, as it takes longer to compile than most of its
# programs: that of the first target, which therefore must not have compile definitions of its own.
function(asterism_share_precompiled target)
  get_property(first DIRECTORY PROPERTY ASTERISM_PRECOMPILED)
  if(first)
    target_precompile_headers(${target} REUSE_FROM ${first})
  else()
    target_precompile_headers(${target} PRIVATE ${ARGN})
    set_property(DIRECTORY PROPERTY ASTERISM_PRECOMPILED ${target})
  endif()
endfunction()

# asterism_command_line(SOURCE): for a source that parses a command line with CLI11, which takes twice as long
# to compile with full optimisation. It cannot share the precompiled headers, which have the other options.
function(asterism_command_line source)
  set_source_files_properties(${source} PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O1>" SKIP_PRECOMPILE_HEADERS ON)
endfunction()

# asterism_library(NAME [INTERFACE] [SOURCES ...] [HEADERS ...] [WITHOUT ...]) declares library asterism_NAME,
# static unless BUILD_SHARED_LIBS, exported as asterism::NAME. Its public headers, in include/ of the current
# folder, are HEADERS or, by default, asterism/NAME.hpp and all of asterism/NAME/ except those in WITHOUT.
function(asterism_library name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "INTERFACE" "" "SOURCES;HEADERS;WITHOUT")
  set(target asterism_${name})
  if(arg_INTERFACE)
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  else()
    add_library(${target} ${arg_SOURCES})
    # Before 1.0, a minor version may change the ABI.
    set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE ON VERSION ${PROJECT_VERSION}
                          SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR} INSTALL_RPATH "$ORIGIN"
                          DEFINE_SYMBOL "") # no library has a macro of its own, so that they can share a precompiled header
    get_target_property(type ${target} TYPE)
    if(type STREQUAL "STATIC_LIBRARY")
      target_compile_definitions(${target} PRIVATE ASTERISM_API=)
    endif()
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
            LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT Asterism_runtime NAMELINK_COMPONENT Asterism_dev
            ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT Asterism_dev
            FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT Asterism_dev
            INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})  # for CMake before 3.23, which has no file sets
    install(EXPORT Asterism_${name} FILE Asterism_${name}.cmake NAMESPACE asterism::
            DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Asterism COMPONENT Asterism_dev)
    export(EXPORT Asterism_${name} FILE ${PROJECT_BINARY_DIR}/Asterism_${name}.cmake NAMESPACE asterism::)
  endif()
endfunction()

# asterism_pkg_config(NAME [REQUIRES MODULE...] [CFLAGS FLAG...] [INCLUDES DIR...] [LIBRARIES LIBRARY...]
# [PRIVATE LIBRARY...]) writes asterism-NAME.pc. The arguments are the dependencies of the library's users:
# pkg-config modules, flags, and libraries (names or files) that have no module.
function(asterism_pkg_config name)
  if(NOT ASTERISM_INSTALL)
    return()
  endif()
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "REQUIRES;CFLAGS;INCLUDES;LIBRARIES;PRIVATE")
  get_target_property(type asterism_${name} TYPE)
  if(type STREQUAL "STATIC_LIBRARY") # its users also link its private libraries
    list(APPEND arg_LIBRARIES ${arg_PRIVATE})
    set(arg_PRIVATE "")
  endif()
  foreach(list IN ITEMS LIBRARIES PRIVATE)
    list(TRANSFORM arg_${list} REPLACE "^[^/]+$" "-l\\0")
  endforeach()
  if(NOT type STREQUAL "INTERFACE_LIBRARY")
    list(PREPEND arg_LIBRARIES "-L\${libdir}" -lasterism_${name})
  endif()
  list(REMOVE_ITEM arg_INCLUDES "" ${CMAKE_CXX_IMPLICIT_INCLUDE_DIRECTORIES})
  list(TRANSFORM arg_INCLUDES PREPEND "-isystem ") # as system headers: OpenCV's cause warnings in C++20
  list(PREPEND arg_CFLAGS "-I\${includedir}" ${arg_INCLUDES})

  set(dir ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig)
  file(RELATIVE_PATH prefix ${dir} ${CMAKE_INSTALL_PREFIX})
  string(REGEX REPLACE "/$" "" prefix ${prefix})
  file(RELATIVE_PATH libdir ${CMAKE_INSTALL_PREFIX} ${CMAKE_INSTALL_FULL_LIBDIR})
  file(RELATIVE_PATH includedir ${CMAKE_INSTALL_PREFIX} ${CMAKE_INSTALL_FULL_INCLUDEDIR})
  foreach(list IN ITEMS REQUIRES CFLAGS LIBRARIES PRIVATE)
    list(JOIN arg_${list} " " ${list})
  endforeach()
  file(WRITE ${PROJECT_BINARY_DIR}/asterism-${name}.pc "\
prefix=\${pcfiledir}/${prefix}
libdir=\${prefix}/${libdir}
includedir=\${prefix}/${includedir}

Name: asterism-${name}
Description: ${PROJECT_DESCRIPTION} (C++20)
Version: ${PROJECT_VERSION}
Requires: ${REQUIRES}
Cflags: ${CFLAGS}
Libs: ${LIBRARIES}
Libs.private: ${PRIVATE}
")
  install(FILES ${PROJECT_BINARY_DIR}/asterism-${name}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig
          COMPONENT Asterism_dev)
endfunction()

# asterism_find_module(FILE): a find module that this build and users of the package need.
function(asterism_find_module file)
  if(ASTERISM_INSTALL)
    configure_file(${file} ${PROJECT_BINARY_DIR} COPYONLY) # for users of the build tree
    install(FILES ${file} DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Asterism COMPONENT Asterism_dev)
  endif()
endfunction()

# asterism_install_tool(TARGET)
function(asterism_install_tool target)
  if(ASTERISM_INSTALL)
    file(RELATIVE_PATH libdir ${CMAKE_INSTALL_FULL_BINDIR} ${CMAKE_INSTALL_FULL_LIBDIR})
    set_target_properties(${target} PROPERTIES INSTALL_RPATH "$ORIGIN/${libdir}")
    install(TARGETS ${target} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT Asterism_tools)
    set_property(GLOBAL APPEND PROPERTY ASTERISM_TOOLS ${target})
  endif()
endfunction()

# asterism_missing(TARGET WHAT PACKAGE) prints one line for an optional dependency that was not found.
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
          DESTINATION ${dir} COMPONENT Asterism_dev)
endfunction()
