# With the plugin of docs/opencv.md (PLUGIN), asterism-track (TRACK) must follow the object of the video that
# VIDEO makes in DIR.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/near.cmake)
file(MAKE_DIRECTORY ${DIR})
execute_process(COMMAND ${VIDEO} ${DIR}/video.avi OUTPUT_VARIABLE truth COMMAND_ERROR_IS_FATAL ANY)
if(NOT truth MATCHES "last box at ([0-9]+) ([0-9]+)\n$")
  message(FATAL_ERROR "no video was made: ${truth}")
endif()
set(truth ${CMAKE_MATCH_1} ${CMAKE_MATCH_2})
execute_process(COMMAND ${TRACK} ${DIR}/video.avi --box 100,80,48,64 --tracker "dpt+${PLUGIN}:csrt" --out ${DIR}/boxes.csv
                COMMAND_ERROR_IS_FATAL ANY)
file(STRINGS ${DIR}/boxes.csv boxes)
list(GET boxes -1 last)
if(NOT last MATCHES "^[0-9]+,([0-9]+)[.0-9]*,([0-9]+)")
  message(FATAL_ERROR "no box: ${last}")
endif()
near("the last box's x y" "${CMAKE_MATCH_1};${CMAKE_MATCH_2}" "${truth}")
