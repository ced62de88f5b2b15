# The Debian packages of a build with Eigen alone (package.eigen_only): their names, what they hold and need, and that they
# work together once unpacked.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)

fresh(${WORK}/debs)
must(${CPACK} --config ${WORK}/eigen-only/CPackConfig.cmake -G DEB -B ${WORK}/debs)
file(GLOB debs RELATIVE ${WORK}/debs ${WORK}/debs/*.deb)
string(REGEX MATCH "^[0-9]+[.][0-9]+" minor ${VERSION})
must_match("${debs}" "^libasterism-dev_${VERSION}-1_[a-z0-9]+[.]deb;libasterism${minor}_${VERSION}-1_[a-z0-9]+[.]deb$"
           "these are the packages")

# look(NAME DEPENDS EXPECTED...): what the package needs, and files that it must hold (expressions); all others, too.
function(look name depends)
  file(GLOB deb ${WORK}/debs/${name}_*.deb)
  must(${DPKG_DEB} --field ${deb} Depends)
  must_match("${out}" "^${depends}\n$" "${name} depends on something else")
  must(${DPKG_DEB} --fsys-tarfile ${deb} OUTPUT_FILE ${WORK}/debs/${name}.tar)
  must(${CMAKE_COMMAND} -E tar tf ${WORK}/debs/${name}.tar)
  string(REGEX MATCHALL "[^\n]*[^/\n]\n" files "${out}")
  foreach(expected IN LISTS ARGN)
    set(rest ${files})
    list(FILTER files EXCLUDE REGEX "^[.]/usr/${expected}\n$")
    if(rest STREQUAL files)
      fail("${name} lacks ${expected}")
    endif()
  endforeach()
  if(files)
    fail("${name} also holds ${files}")
  endif()
  must(${CMAKE_COMMAND} -E chdir ${WORK}/debs ${CMAKE_COMMAND} -E tar xf ${name}.tar)
endfunction()
string(REPLACE "." "[.]" v ${VERSION})
string(REPLACE "." "[.]" m ${minor})
look(libasterism${minor} "libc6 [^\n]*" "${LIBDIR}/libasterism_(batch|solver_compiled|system)[.]so[.]${v}"
     "${LIBDIR}/libasterism_(batch|solver_compiled|system)[.]so[.]${m}"     share/doc/libasterism${m}/copyright)
look(libasterism-dev "libeigen3-dev, libasterism${m} [(]= ${v}-1[)]" "${LIBDIR}/libasterism_(batch|solver_compiled|system)[.]so"
     "${INCLUDEDIR}/asterism/(solver|system)[.]hpp" "${INCLUDEDIR}/asterism/(solver/[a-z_]+|testing)/[a-z_]+[.]hpp" ${LIBDIR}/cmake/Asterism/AsterismConfig[.]cmake
     ${LIBDIR}/cmake/Asterism/AsterismConfigVersion[.]cmake
     "${LIBDIR}/cmake/Asterism/Asterism_(solver|system|solver_compiled|batch|testing)(-[a-z]+)?[.]cmake" "${LIBDIR}/pkgconfig/asterism-(solver|system|solver_compiled|batch|testing)[.]pc"
     share/doc/libasterism-dev/copyright)

# A program of what was unpacked needs the libraries by their sonames.
set(ENV{PKG_CONFIG_PATH} ${WORK}/debs/usr/${LIBDIR}/pkgconfig)
must(${PKG_CONFIG} --cflags --libs asterism-batch asterism-solver_compiled)
separate_arguments(flags UNIX_COMMAND "${out}")
must(${CXX} -std=c++20 -DHAVE_BATCH -DHAVE_SOLVER_COMPILED ${scripts}/compiled.cpp -o ${WORK}/debs/program ${flags}
     -Wl,-rpath,${WORK}/debs/usr/${LIBDIR})
must(ldd ${WORK}/debs/program)
foreach(library IN ITEMS batch solver_compiled)
  must_match("${out}" "libasterism_${library}[.]so[.]${m} => ${WORK}/debs/usr" "the program does not use the shared library")
endforeach()
must(${WORK}/debs/program)
