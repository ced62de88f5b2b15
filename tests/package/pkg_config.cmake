# The installed and moved package by pkg-config: a program of every component that was built, with the compiler alone.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)

set(ENV{PKG_CONFIG_PATH} ${WORK}/moved/prefix/${LIBDIR}/pkgconfig)
set(modules ${BUILT})
list(TRANSFORM modules PREPEND asterism-)
must(${PKG_CONFIG} --validate ${modules})
foreach(module IN LISTS modules)
  must(${PKG_CONFIG} --modversion ${module})
  must_match("${out}" "^${VERSION}\n$" "wrong version of ${module}")
endforeach()

# The solver's users hear of Eigen alone.
must(${PKG_CONFIG} --cflags --libs asterism-solver)
must_match("${out}" "^-I[^ ]*/include -I[^ ]*eigen3 *\n$" "asterism-solver asks for more than Eigen")

must(${PKG_CONFIG} --cflags --libs ${modules})
separate_arguments(flags UNIX_COMMAND "${CXX_FLAGS} ${out}")
list(TRANSFORM BUILT PREPEND -DHAVE_ OUTPUT_VARIABLE defines)
string(TOUPPER "${defines}" defines)
fresh(${WORK}/pkg-config)
must(${CXX} -std=c++20 ${defines} ${scripts}/compiled.cpp -o ${WORK}/pkg-config/program ${flags})
if(NOT err STREQUAL "")
  fail("headers of others warn")
endif()
must(${WORK}/pkg-config/program)
must_match("${out}" "is content" "the program did not run")
