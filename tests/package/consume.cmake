# A consumer of the installed and moved package. NAME names the test, COMPONENTS what it asks for.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)
string(REPLACE "," ";" COMPONENTS ${COMPONENTS})
consume(${NAME} ${WORK}/moved/prefix ${COMPONENTS})
