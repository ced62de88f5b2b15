# A consumer of every component that was built, from the build tree.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)
consume(build-tree ${BINARY_DIR} compiled.cpp ${BUILT})
