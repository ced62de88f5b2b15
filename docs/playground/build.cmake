# cmake -DPROJECT_SOURCE_DIR=.. -DFOLDER=.. -DWITH_SOLVER=ON -P build.cmake: puts the playground into FOLDER. If
# emcc (Debian package emscripten) is found, the solver is compiled to FOLDER/solver.js whenever its source has
# changed; if not, or WITH_SOLVER is OFF, the page says that it is missing. With -DSYNTAX_ONLY=ON and without a
# FOLDER, emcc only reads the sources, which takes 20 s.
cmake_minimum_required(VERSION 3.21)
set(here ${PROJECT_SOURCE_DIR}/docs/playground)
find_program(emxx em++ NO_CACHE)
find_path(eigen Eigen/Core PATHS /usr/include /usr/local/include PATH_SUFFIXES eigen3 NO_CACHE)
file(GLOB terms ${PROJECT_SOURCE_DIR}/solver/src/terms/*.cpp)
list(FILTER terms EXCLUDE REGEX "/json\\.cpp|_avx")
set(compile
    ${CMAKE_COMMAND} -E env NODE_PATH=/usr/share/nodejs # lets any node find Debian's modules
    ${emxx} -std=c++20 -O3 -fno-exceptions -Wall -Wextra -include ${here}/emscripten_library.hpp
    -I${PROJECT_SOURCE_DIR}/solver/include -isystem ${eigen} ${here}/playground.cpp)
if(SYNTAX_ONLY) # all as one source
  list(TRANSFORM terms PREPEND "-include;")
  execute_process(COMMAND ${compile} ${terms} -fsyntax-only COMMAND_ERROR_IS_FATAL ANY)
  return()
endif()

file(MAKE_DIRECTORY ${FOLDER})
foreach(file playground.html playground.css theme.js playground.js presets.js trackers.html trackers.js trackers-data.js
             pedestrian-data.js)
  file(COPY ${here}/${file} DESTINATION ${FOLDER})
endforeach()
if(NOT WITH_SOLVER)
  file(REMOVE ${FOLDER}/solver.js)
  return()
endif()
if(NOT emxx OR NOT eigen)
  file(REMOVE ${FOLDER}/solver.js)
  message(STATUS "The playground is without its solver: that needs em++ (Debian package emscripten) and Eigen")
  return()
endif()

file(GLOB_RECURSE sources ${PROJECT_SOURCE_DIR}/solver/include/*.hpp ${PROJECT_SOURCE_DIR}/solver/src/terms/*pp
     ${here}/*.cpp ${here}/*.h ${here}/*.hpp ${here}/build.cmake)
set(is_old FALSE)
foreach(source IN LISTS sources)
  if(${source} IS_NEWER_THAN ${FOLDER}/solver.js) # also if there is none
    set(is_old TRUE)
  endif()
endforeach()
if(NOT is_old)
  return()
endif()
# Export each function of playground.h.
file(STRINGS ${here}/playground.h declarations REGEX "^[a-z].*asterism_playground_[a-z]+\\(")
list(TRANSFORM declarations REPLACE ".*(asterism_playground_[a-z]+)\\(.*" "_\\1")
list(JOIN declarations "," functions)
message(STATUS "Compiling the playground's solver")
execute_process(
  COMMAND
    ${compile} ${terms} -o ${FOLDER}/solver.js
    -sSINGLE_FILE=1 # so that the page works from a folder
    -sMODULARIZE=1 -sEXPORT_NAME=createPlayground -sENVIRONMENT=web,node -sFILESYSTEM=0 -sALLOW_MEMORY_GROWTH=1
    -sEXPORTED_RUNTIME_METHODS=UTF8ToString -sEXPORTED_FUNCTIONS=_malloc,_free,${functions}
  COMMAND_ERROR_IS_FATAL ANY)
