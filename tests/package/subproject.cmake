# Asterism as a subproject of another project; parent/CMakeLists.txt looks at what it does to its parent.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)

set(dir ${WORK}/parent)
fresh(${dir})
file(REMOVE_RECURSE ${WORK}/parent-prefix)
must(${configure} -S ${scripts}/parent -B ${dir} -DASTERISM_SOURCE=${SOURCE_DIR} -DBUILD_TESTING=ON
     -DCMAKE_BUILD_TYPE=) # none, which must stay so
if(NOT err STREQUAL "")
  fail("the subproject wrote to standard error")
endif()
must_match("${out}" "-- subproject begins\n(-- Asterism: [^\n]* not found [^\n]*\n)*-- subproject ended\n"
           "the subproject prints more than what is missing")

must(${CMAKE_COMMAND} --build ${dir} --config ${CONFIG} --target run)
must_match("${out}" "the parent is content" "the parent's program did not run")

# Its install rules are the parent's own.
must(${CMAKE_COMMAND} --install ${dir} --config ${CONFIG} --prefix ${WORK}/parent-prefix)
file(GLOB_RECURSE installed RELATIVE ${WORK}/parent-prefix ${WORK}/parent-prefix/*)
if(NOT installed MATCHES "^bin/parent_app[.a-z]*$")
  fail("installed from the parent: ${installed}")
endif()
