# Tests that configure, build and install in folders of their own.

# The drivers build consumers with this build's compiler and flags, so that they link with what it built.
file(GENERATE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/settings-$<CONFIG>.cmake CONTENT "\
set(SOURCE_DIR [[${PROJECT_SOURCE_DIR}]])
set(BINARY_DIR [[${PROJECT_BINARY_DIR}]])
set(WORK [[${CMAKE_CURRENT_BINARY_DIR}/work]])
set(VERSION [[${PROJECT_VERSION}]])
set(CONFIG [[$<CONFIG>]])
set(GENERATOR [[${CMAKE_GENERATOR}]])
set(MAKE_PROGRAM [[${CMAKE_MAKE_PROGRAM}]])
set(CXX [[${CMAKE_CXX_COMPILER}]])
set(CXX_FLAGS [[${CMAKE_CXX_FLAGS}]])
set(EIGEN3_DIR [[${Eigen3_DIR}]])
set(INCLUDEDIR [[${CMAKE_INSTALL_INCLUDEDIR}]])
set(LIBDIR [[${CMAKE_INSTALL_LIBDIR}]])
set(BUILT [[${components}]])
")

# package_test(NAME SCRIPT [OPTION...]).
function(package_test name script)
  add_test(NAME package.${name}
           COMMAND ${CMAKE_COMMAND} -DSETTINGS=${CMAKE_CURRENT_BINARY_DIR}/settings-$<CONFIG>.cmake ${ARGN}
                   -P ${CMAKE_CURRENT_SOURCE_DIR}/${script}.cmake)
  set_tests_properties(package.${name} PROPERTIES LABELS package TIMEOUT 600)
endfunction()

package_test(subproject subproject)
package_test(eigen_only eigen_only)
if(ASTERISM_INSTALL)
  package_test(install install)
  package_test(components components)
  package_test(solver consume -DNAME=solver -DCOMPONENTS=solver)
  set_tests_properties(package.install PROPERTIES FIXTURES_SETUP asterism_installed)
  set_tests_properties(package.eigen_only PROPERTIES FIXTURES_SETUP asterism_solver_installed)
  set_tests_properties(package.components PROPERTIES FIXTURES_REQUIRED "asterism_installed;asterism_solver_installed")
  set_tests_properties(package.solver PROPERTIES FIXTURES_REQUIRED asterism_installed)
  if(TARGET asterism_trackers)
    package_test(trackers consume -DNAME=trackers -DCOMPONENTS=trackers,parts) # parts last: trackers must bring it
    set_tests_properties(package.trackers PROPERTIES FIXTURES_REQUIRED asterism_installed)
  endif()
  set(adapters ${components})
  list(FILTER adapters INCLUDE REGEX "^(cholmod|ceres|lbfgs|json)$")
  if(adapters)
    list(JOIN adapters "," adapters)
    package_test(adapters consume -DNAME=adapters -DCOMPONENTS=${adapters})
    set_tests_properties(package.adapters PROPERTIES FIXTURES_REQUIRED asterism_installed)
  endif()
endif()
