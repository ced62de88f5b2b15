# The tracker example of README.md (PROGRAM) must follow the object of the video that GENERATOR makes in DIR.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/near.cmake)
file(MAKE_DIRECTORY ${DIR})
execute_process(COMMAND ${GENERATOR} ${DIR}/video.avi OUTPUT_VARIABLE truth RESULT_VARIABLE result)
if(NOT result EQUAL 0 OR NOT truth MATCHES "^frames ([0-9]+), last box at ([0-9]+) ([0-9]+)\n$")
  message(FATAL_ERROR "no video was made (${result}): ${truth}")
endif()
math(EXPR updates "${CMAKE_MATCH_1} - 1")
set(truth_x ${CMAKE_MATCH_2})
set(truth_y ${CMAKE_MATCH_3})

execute_process(COMMAND ${PROGRAM} ${DIR}/video.avi OUTPUT_VARIABLE out ERROR_VARIABLE err RESULT_VARIABLE result)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "the example ended with ${result}\n${out}\n${err}")
endif()

# Without a video it must print its usage.
execute_process(COMMAND ${PROGRAM} OUTPUT_VARIABLE nothing ERROR_VARIABLE err RESULT_VARIABLE result)
if(NOT result EQUAL 1 OR NOT nothing STREQUAL "" OR NOT err MATCHES "^usage: [^\n]+\n$")
  message(FATAL_ERROR "without an argument the example ended with ${result}\n${nothing}\n${err}")
endif()

# One line per frame, with the box as OpenCV prints it: [width x height from (x, y)] confidence
string(REGEX REPLACE "[][]" "|" text "${out}")
string(REGEX MATCHALL "[^\n]+\n" lines "${text}")
list(LENGTH lines count)
if(NOT count EQUAL updates)
  message(FATAL_ERROR "${count} lines for ${updates} updates\n${out}")
endif()
list(GET lines -1 last)
if(NOT last MATCHES "^[|]([0-9]+)[.0-9]* x ([0-9]+)[.0-9]* from [(](-?[0-9]+)[.0-9]*, (-?[0-9]+)[.0-9]*[)][|] [.0-9]+\n$")
  message(FATAL_ERROR "not a box with a confidence, or lost: ${last}")
endif()
near("the last box, width height x y," "${CMAKE_MATCH_1};${CMAKE_MATCH_2};${CMAKE_MATCH_3};${CMAKE_MATCH_4}"
     "48;64;${truth_x};${truth_y}")
