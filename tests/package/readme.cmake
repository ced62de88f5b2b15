# Takes the examples out of README.md: writes the blocks below ${dir} and sets readme_solver and readme_tracker to the
# programs' sources and readme_output to what the first one is to print.
set(readme ${PROJECT_SOURCE_DIR}/README.md)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${readme})
set(dir ${CMAKE_CURRENT_BINARY_DIR}/readme)
file(READ ${readme} rest)

# next_block(LANGUAGE FILE): moves the next fenced block of `rest` to FILE, as it stands.
function(next_block language file)
  string(FIND "${rest}" "\n```${language}\n" begin)
  if(begin EQUAL -1)
    message(FATAL_ERROR "README.md misses a ```${language} block (for ${file})")
  endif()
  string(LENGTH "\n```${language}\n" fence)
  math(EXPR begin "${begin} + ${fence}")
  string(SUBSTRING "${rest}" ${begin} -1 block)
  string(FIND "${block}" "\n```" end)
  math(EXPR end "${end} + 1")
  string(SUBSTRING "${block}" ${end} -1 after)
  string(SUBSTRING "${block}" 0 ${end} block)
  file(CONFIGURE OUTPUT ${file} CONTENT "${block}" @ONLY NEWLINE_STYLE UNIX) # touches the file only if it changes
  set(rest "${after}" PARENT_SCOPE)

  # An example is one screen: 12 lines beside blank ones and includes.
  if(language STREQUAL "cpp")
    string(REGEX REPLACE "[][;]" "," lines "${block}")
    string(REGEX REPLACE "\n+$" "" lines "${lines}")
    string(REPLACE "\n" ";" lines "${lines}")
    list(FILTER lines EXCLUDE REGEX "^[ \t]*(#include.*)?$")
    list(LENGTH lines length)
    if(length GREATER 12)
      message(FATAL_ERROR "README.md: the example of ${file} has ${length} lines, more than 12")
    endif()
  endif()
endfunction()

set(readme_solver ${dir}/solver.cpp)
set(readme_output ${dir}/solver.txt)
set(readme_tracker ${dir}/tracker.cpp)
next_block(cpp ${readme_solver})
next_block(text ${readme_output})
next_block(cpp ${readme_tracker})
