# Code compiled for wider instructions must not define symbols that other object files may define too: the
# linker could keep the wide version for machines without these instructions. OBJECTS, separated by commas,
# are those of the libraries that have such code.
cmake_minimum_required(VERSION 3.25)
string(REPLACE "," ";" OBJECTS "${OBJECTS}")
list(FILTER OBJECTS INCLUDE REGEX "_avx(2|512)")
foreach(object IN LISTS OBJECTS)
  execute_process(COMMAND ${NM} --defined-only ${object} OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "[^\n]* [uvVwW] [^\n]*" weak "${symbols}")
  if(weak)
    message(FATAL_ERROR "${object} defines\n${weak}")
  endif()
endforeach()
