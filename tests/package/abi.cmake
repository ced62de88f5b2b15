# Eigen aligns for the SIMD width that is compiled for. A program compiled for AVX may use the headers; with the installed
# library, compiled for another alignment, it does not link, nor where only the way differs how memory is freed. By all of
# COMPILERS, whichever built the library.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)

set(ENV{PKG_CONFIG_PATH} ${WORK}/moved/prefix/${LIBDIR}/pkgconfig)
must(${PKG_CONFIG} --cflags asterism-solver)
separate_arguments(solver UNIX_COMMAND "${out}")
must(${PKG_CONFIG} --cflags --libs asterism-parts)
separate_arguments(parts UNIX_COMMAND "-DHAVE_PARTS ${scripts}/compiled.cpp ${out}")
fresh(${WORK}/abi)
set(program ${WORK}/abi/program)
file(STRINGS /proc/cpuinfo has_avx REGEX "^flags.* avx " LIMIT_COUNT 1)

foreach(compiler IN LISTS COMPILERS)
  set(compile ${compiler} -std=c++20 -o ${program})

  must(${compile} -mavx ${scripts}/parent/app.cpp ${solver})
  if(has_avx)
    must(${program})
    must_match("${out}" "is content" "header-only use with AVX is wrong")
  endif()

  must(${compile} ${parts})
  must(${program})
  must_match("${out}" "is content" "use of the compiled library is wrong")

  foreach(flags IN ITEMS "-mavx" "-mavx;-DEIGEN_MAX_STATIC_ALIGN_BYTES=16")
    run(${compile} ${flags} ${parts})
    if(result EQUAL 0)
      fail("a program compiled with ${flags} links with a library that is not")
    endif()
    must_match("${err}" "undefined reference to `asterism::v[0-9_]+_align(32|16)_malloc0::evidence_of" "another error was expected")
  endforeach()
endforeach()
