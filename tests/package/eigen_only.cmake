# The project on a machine that has Eigen and nothing else: find_* sees an empty root, and Eigen is named.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)

fresh(${WORK}/empty-root)
set(bare -DCMAKE_FIND_ROOT_PATH=${WORK}/empty-root -DCMAKE_FIND_ROOT_PATH_MODE_LIBRARY=ONLY
         -DCMAKE_FIND_ROOT_PATH_MODE_INCLUDE=ONLY -DCMAKE_FIND_ROOT_PATH_MODE_PACKAGE=ONLY)

# Not even Eigen.
fresh(${WORK}/no-eigen)
run(${configure} ${bare} -S ${SOURCE_DIR} -B ${WORK}/no-eigen -DASTERISM_BUILD_TESTS=OFF)
if(result EQUAL 0)
  fail("configured without Eigen")
endif()
must_match("${err}" "libeigen3-dev" "the error does not name Eigen's Debian package")

# Eigen alone: one line for each package that is not there. The tests are off, as they need GoogleTest. With shared
# libraries, as all other tests have static ones; as on a processor whose instructions the batch has no kernels for; in few
# units and -O0, as nothing here is timed.
fresh(${WORK}/eigen-only)
must(${configure_soon} ${bare} -S ${SOURCE_DIR} -B ${WORK}/eigen-only -DEigen3_DIR=${EIGEN3_DIR} -DASTERISM_BUILD_TESTS=OFF
     -DASTERISM_WITH_PETSC=ON -DBUILD_SHARED_LIBS=ON -DCMAKE_CXX_FLAGS_RELEASE=-O0 -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=other
     -DCMAKE_UNITY_BUILD=ON)
if(NOT err STREQUAL "")
  fail("configuring with Eigen alone wrote to standard error")
endif()
foreach(expected IN ITEMS "cholmod is off: CHOLMOD;libsuitesparse-dev" "ceres is off: Ceres;libceres-dev"
                          "lbfgs is off: liblbfgs;liblbfgs-dev" "petsc is off: PETSc;petsc-dev" "json is off: nlohmann-json;nlohmann-json3-dev"
                          "parts,[^\n]*asterism::trackers,[^\n]* off: OpenCV[^\n]*;libopencv-dev")
  list(GET expected 0 what)
  list(GET expected 1 debian)
  count("${out}" "-- Asterism: asterism::${what} not found [(]Debian package ${debian}[)]\n" lines)
  if(NOT lines EQUAL 1)
    fail("${lines} lines for ${what}, not 1")
  endif()
endforeach()
count("${out}" "-- Asterism: asterism::" lines)
if(NOT lines EQUAL 6)
  fail("${lines} lines about missing targets, not 6")
endif()
if(out MATCHES "Could NOT find|Looking for")
  fail("a find module prints: ${CMAKE_MATCH_0}")
endif()

# The solver installs and serves.
file(REMOVE_RECURSE ${WORK}/solver-only)
must(${CMAKE_COMMAND} --build ${WORK}/eigen-only --config ${CONFIG})
must(${CMAKE_COMMAND} --install ${WORK}/eigen-only --config ${CONFIG} --prefix ${WORK}/solver-only)
file(GLOB rooms RELATIVE ${WORK}/solver-only/${INCLUDEDIR}/asterism ${WORK}/solver-only/${INCLUDEDIR}/asterism/*)
if(NOT rooms STREQUAL "solver;solver.hpp;system.hpp;testing")
  fail("installed with Eigen alone: ${rooms}")
endif()
foreach(adapter IN ITEMS linear/cholmod reference/ceres reference/liblbfgs distributed/petsc io/json)
  if(EXISTS ${WORK}/solver-only/${INCLUDEDIR}/asterism/solver/${adapter}.hpp)
    fail("the header ${adapter}.hpp is installed without its library")
  endif()
endforeach()
consume(eigen-only ${WORK}/solver-only consumer/main.cpp system solver_compiled batch)

# Every option off, nothing to say.
fresh(${WORK}/all-off)
must(${configure} ${bare} -S ${SOURCE_DIR} -B ${WORK}/all-off -DEigen3_DIR=${EIGEN3_DIR} -DASTERISM_WITH_CHOLMOD=OFF
     -DASTERISM_WITH_CERES=OFF -DASTERISM_WITH_LIBLBFGS=OFF -DASTERISM_WITH_PETSC=OFF -DASTERISM_WITH_JSON=OFF -DASTERISM_WITH_PARTS=OFF
     -DASTERISM_BUILD_PYTHON=OFF -DASTERISM_BUILD_DOCS=OFF -DASTERISM_BUILD_TESTS=OFF -DASTERISM_BUILD_BENCH=OFF)
if(out MATCHES "Asterism:")
  fail("says what is missing though it was not asked for")
endif()
