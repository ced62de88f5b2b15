# What the driver scripts share. Run as: cmake -DSETTINGS=<file written by CMakeLists.txt> -P <script>
cmake_minimum_required(VERSION 3.25)
include(${SETTINGS})
set(scripts ${CMAKE_CURRENT_LIST_DIR})

# run(COMMAND ...): sets `result`, `out` (standard output) and `err` (standard error).
macro(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE out ERROR_VARIABLE err)
endmacro()

# must(COMMAND ...): run, and fail where the command does.
macro(must)
  run(${ARGN})
  if(NOT result EQUAL 0)
    fail("failed (${result}): ${ARGN}")
  endif()
endmacro()

# fail(WHY): ends the test, with the output of the last command.
function(fail why)
  message(NOTICE "--- output:\n${out}\n--- errors:\n${err}\n---") # FATAL_ERROR would wrap it
  message(FATAL_ERROR "${why}")
endfunction()

# must_match(TEXT REGEX WHY)
function(must_match text regex why)
  if(NOT text MATCHES "${regex}")
    fail("${why}\n--- expected: ${regex}\n--- in: ${text}")
  endif()
endfunction()

# count(TEXT REGEX RESULT): how often the expression matches.
function(count text regex result)
  string(REPLACE ";" "," text "${text}")
  string(REGEX MATCHALL "${regex}" matches "${text}")
  list(LENGTH matches length)
  set(${result} ${length} PARENT_SCOPE)
endfunction()

set(configure ${CMAKE_COMMAND} -G ${GENERATOR} -DCMAKE_MAKE_PROGRAM=${MAKE_PROGRAM} -DCMAKE_CXX_COMPILER=${CXX}
              -DCMAKE_CXX_FLAGS=${CXX_FLAGS} -DCMAKE_BUILD_TYPE=${CONFIG})

# As `configure`, with clang where it is there: it builds what is not timed in a third of gcc's time, and what either compiler
# builds must link with what the other built.
set(configure_soon ${configure})
set(clang ${COMPILERS})
list(FILTER clang INCLUDE REGEX "clang")
if(clang AND NOT CXX MATCHES "clang")
  set(configure_soon ${CMAKE_COMMAND} -G ${GENERATOR} -DCMAKE_MAKE_PROGRAM=${MAKE_PROGRAM} -DCMAKE_CXX_COMPILER=${clang}
                     -DCMAKE_BUILD_TYPE=${CONFIG})
endif()

# fresh(DIR): an empty folder.
function(fresh dir)
  file(REMOVE_RECURSE ${dir})
  file(MAKE_DIRECTORY ${dir})
endfunction()

# consume(NAME PREFIX SOURCE COMPONENT...): configures, builds and runs the consumer of the installed components.
function(consume name prefix source)
  set(dir ${WORK}/consume-${name})
  fresh(${dir})
  list(JOIN ARGN "," components)
  must(${configure} -S ${scripts}/consumer -B ${dir} -DCMAKE_PREFIX_PATH=${prefix} -DCOMPONENTS=${components}
       -DVERSION=${VERSION} -DSOURCE=${scripts}/${source})
  if(NOT err STREQUAL "")
    fail("find_package(Asterism) wrote to standard error")
  endif()
  must_match("${out}" "-- find_package begins\n-- find_package ended\n" "find_package(Asterism) printed something")
  must(${CMAKE_COMMAND} --build ${dir} --config ${CONFIG} --target run)
  must_match("${out}" "the consumer is content" "the consumer did not run")
endfunction()
