# A consumer of the package as installed and moved. NAME names the test, COMPONENTS what it asks for.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/common.cmake)
string(REPLACE "," ";" COMPONENTS ${COMPONENTS})
consume(${NAME} ${WORK}/moved/prefix consumer/main.cpp ${COMPONENTS})
