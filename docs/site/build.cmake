# cmake -DPROJECT_SOURCE_DIR=.. -DPROJECT_VERSION=.. -DPROJECT_DESCRIPTION=.. -DBINARY_DIR=.. -P build.cmake:
# makes the documentation site BINARY_DIR/site: the pages of docs/ by Sphinx and, below reference/, every
# public symbol by Doxygen. Warnings are errors, including those for symbols without a docstring.
cmake_minimum_required(VERSION 3.21)
set(docs ${PROJECT_SOURCE_DIR}/docs)
set(site ${BINARY_DIR}/site)

foreach(program sphinx-build doxygen python3)
  find_program(${program} ${program} NO_CACHE)
  if(NOT ${program})
    message(FATAL_ERROR "The documentation site needs ${program}: `bash .ci/install-packages docs` installs it")
  endif()
endforeach()
# The real interpreter: a wrapper that searches for it, run for some hundred headers, takes minutes.
execute_process(COMMAND ${python3} -c "import sys; print(sys.executable)" OUTPUT_VARIABLE python3
                OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
# A theme for the reference, if it is installed; Debian's package puts it below /usr/share.
find_file(doxygen_style doxygen-awesome.css PATHS /usr/share /usr/local/share PATH_SUFFIXES doxygen-awesome-css NO_CACHE)
if(NOT doxygen_style)
  message("the reference has Doxygen's own look: doxygen-awesome-css is not installed")
  set(doxygen_style "")
endif()

# The reference is built first: the search of the pages finds its symbols through the tags that Doxygen
# writes.
file(MAKE_DIRECTORY ${site} ${BINARY_DIR}/doxygen)
configure_file(${docs}/site/Doxyfile.in ${BINARY_DIR}/Doxyfile @ONLY)
execute_process(COMMAND ${doxygen} -w html ${BINARY_DIR}/doxygen/header.html ${BINARY_DIR}/doxygen/footer.html
                        ${BINARY_DIR}/doxygen/doxygen.css ${BINARY_DIR}/Doxyfile OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(READ ${BINARY_DIR}/doxygen/header.html header)
file(READ ${docs}/site/templates/doxygen_head.html head)
string(REPLACE "</head>" "${head}</head>" header "${header}")
string(REPLACE ">$projectname<" "><a href=\"$relpath^../index.html\">$projectname</a><" header "${header}")
file(WRITE ${BINARY_DIR}/doxygen/header.html "${header}")
execute_process(COMMAND ${doxygen} ${BINARY_DIR}/Doxyfile COMMAND_ERROR_IS_FATAL ANY)
file(GLOB references ${site}/reference/class*.html ${site}/reference/struct*.html)
foreach(page IN LISTS references) # Doxygen links to a list of nested classes even if all are private
  file(READ ${page} text)
  if(text MATCHES "href=\"#nested-classes\"" AND NOT text MATCHES "id=\"nested-classes\"")
    string(REPLACE "<a href=\"#nested-classes\">Classes</a> &#124;\n" "" text "${text}")
    file(WRITE ${page} "${text}")
  endif()
endforeach()

# Sphinx reads one folder: docs/, and the pages of the project's root, whose README is the first page. It starts
# from scratch, as it does not notice changes of the reference.
set(pages ${BINARY_DIR}/pages)
file(REMOVE_RECURSE ${pages})
file(COPY ${docs}/ DESTINATION ${pages} PATTERN site EXCLUDE)
file(COPY ${PROJECT_SOURCE_DIR}/CHANGELOG.md ${PROJECT_SOURCE_DIR}/CONTRIBUTING.md DESTINATION ${pages})
file(COPY_FILE ${PROJECT_SOURCE_DIR}/README.md ${pages}/index.md)
execute_process(
  COMMAND ${sphinx-build} -q -E -a -W --keep-going -d ${BINARY_DIR}/doctrees -c ${docs}/site
          -D reference_tags=${BINARY_DIR}/doxygen/tags.xml -D "html_title=Asterism ${PROJECT_VERSION}" ${pages} ${site}
  COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} -DPROJECT_SOURCE_DIR=${PROJECT_SOURCE_DIR} -DFOLDER=${BINARY_DIR}/playground
                        -DWITH_SOLVER=${WITH_SOLVER}
                        -P ${docs}/playground/build.cmake COMMAND_ERROR_IS_FATAL ANY)
file(COPY ${BINARY_DIR}/playground DESTINATION ${site})
set(left_out "")
if(NOT EXISTS ${BINARY_DIR}/playground/solver.js)
  set(left_out playground/solver.js)
endif()
execute_process(COMMAND ${python3} ${PROJECT_SOURCE_DIR}/tests/docs/check_site.py ${site} ${left_out} RESULT_VARIABLE problems)
if(problems)
  message(FATAL_ERROR "The site is not whole: see the lines above")
endif()
message("the site is ${site}/index.html")
