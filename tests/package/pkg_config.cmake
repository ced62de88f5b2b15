# The installed and moved package by pkg-config: programs made with the compiler alone.
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

# compile(SOURCE MODULE...): and run.
function(compile source)
  must(${PKG_CONFIG} --cflags --libs ${ARGN})
  separate_arguments(flags UNIX_COMMAND "${CXX_FLAGS} ${out}")
  string(REPLACE "asterism-" "-DHAVE_" defines "${ARGN}")
  string(TOUPPER "${defines}" defines)
  must(${CXX} -std=c++20 ${defines} ${scripts}/${source} -o ${WORK}/pkg-config/program ${flags})
  must(${WORK}/pkg-config/program)
  must_match("${out}" "is content" "the program did not run")
endfunction()
fresh(${WORK}/pkg-config)

# The solver's users hear of Eigen alone.
must(${PKG_CONFIG} --cflags --libs asterism-solver)
must_match("${out}" "^-I[^ ]*/include -I[^ ]*eigen3 *\n$" "asterism-solver asks for more than Eigen")
compile(parent/app.cpp asterism-solver)

compile(compiled.cpp ${modules})
