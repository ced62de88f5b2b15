# What is compiled for wider instructions must not define anything that another object could define too: the linker would be
# free to give it to machines without them. OBJECTS, with commas between, are those of asterism::batch.
cmake_minimum_required(VERSION 3.25)
string(REPLACE "," ";" OBJECTS "${OBJECTS}")
list(FILTER OBJECTS INCLUDE REGEX "batch_avx")
foreach(object IN LISTS OBJECTS)
  execute_process(COMMAND ${NM} --defined-only ${object} OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "[^\n]* [uvVwW] [^\n]*" weak "${symbols}")
  if(weak)
    message(FATAL_ERROR "${object} defines\n${weak}")
  endif()
endforeach()
