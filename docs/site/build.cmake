# cmake -DPROJECT_SOURCE_DIR=.. -DPROJECT_VERSION=.. -DPROJECT_DESCRIPTION=.. -DBINARY_DIR=.. -P build.cmake: makes the
# documentation site BINARY_DIR/site, the pages of docs/ by Sphinx and, below reference/, every public symbol by Doxygen.
# Warnings are errors, of a symbol without a docstring, too.
cmake_minimum_required(VERSION 3.21)
set(docs ${PROJECT_SOURCE_DIR}/docs)
set(site ${BINARY_DIR}/site)

foreach(program sphinx-build doxygen python3)
  find_program(${program} ${program} NO_CACHE)
  if(NOT ${program})
    message(FATAL_ERROR "The documentation site needs ${program}: `bash .ci/install-packages docs` installs it")
  endif()
endforeach()
find_file(doxygen_style doxygen-awesome-css/doxygen-awesome.css NO_CACHE) # a nicer look, where it is installed
if(NOT doxygen_style)
  set(doxygen_style "")
endif()

file(MAKE_DIRECTORY ${site} ${BINARY_DIR}/doxygen)
configure_file(${docs}/site/Doxyfile.in ${BINARY_DIR}/Doxyfile @ONLY)
execute_process(
  COMMAND ${sphinx-build} -q -W --keep-going -d ${BINARY_DIR}/doctrees -c ${docs}/site ${docs} ${site}
  COMMAND_ERROR_IS_FATAL ANY)
file(COPY_FILE ${site}/README.html ${site}/index.html)
execute_process(
  COMMAND ${CMAKE_COMMAND} -DPROJECT_SOURCE_DIR=${PROJECT_SOURCE_DIR} -DFOLDER=${site}/playground
          -P ${docs}/playground/build.cmake
  COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${doxygen} ${BINARY_DIR}/Doxyfile COMMAND_ERROR_IS_FATAL ANY)
message("the site is ${site}/index.html")
