# A user of asterism::solver_compiled must take each solver from that library. If the compiler inlines or
# instantiates a solver anyway, the symbol is not undefined here, and the user's source takes many times as
# long to compile.
cmake_minimum_required(VERSION 3.25)
execute_process(COMMAND ${NM} --undefined-only ${OBJECT} OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "8Compiled5solve" solvers "${symbols}")
list(LENGTH solvers taken)
if(NOT taken EQUAL COUNT)
  message(FATAL_ERROR "${taken} solvers are taken from the library, not ${COUNT}")
endif()
