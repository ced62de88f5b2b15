# Extracts the code blocks of README.md and docs/ that are not programs, unchanged, to ${blocks}: PAGE_N.inc
# is the N-th ```cpp fragment of a page, which fragments_test.cpp includes; PAGE_N.cmake the N-th ```cmake.
# Sets docs_fragments to the names of the fragments.
set(docs_fragments "")

# write_blocks(PAGE TEXT FENCE ENDING LIST): writes all blocks of one kind and appends their names to LIST.
function(write_blocks page text fence ending list)
  set(number 0)
  string(LENGTH "\n```${fence}\n" length)
  while(TRUE)
    string(FIND "${text}" "\n```${fence}\n" begin)
    if(begin EQUAL -1)
      break()
    endif()
    math(EXPR number "${number} + 1")
    math(EXPR begin "${begin} + ${length}")
    string(SUBSTRING "${text}" ${begin} -1 text)
    string(FIND "${text}" "\n```" end)
    math(EXPR end "${end} + 1")
    string(SUBSTRING "${text}" 0 ${end} block)
    string(SUBSTRING "${text}" ${end} -1 text)
    set(name ${page}_${number})
    file(CONFIGURE OUTPUT ${blocks}/${name}.${ending} CONTENT "${block}" @ONLY NEWLINE_STYLE UNIX) # touched only if it changes
    list(APPEND ${list} ${name})
  endwhile()
  set(${list} ${${list}} PARENT_SCOPE)
endfunction()

file(GLOB pages CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/docs/*.md ${PROJECT_SOURCE_DIR}/docs/results/*.md)
foreach(page IN LISTS pages ITEMS ${PROJECT_SOURCE_DIR}/README.md)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${page})
  cmake_path(RELATIVE_PATH page BASE_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE name)
  string(REGEX REPLACE "[.]md$" "" name "${name}")
  string(REPLACE "/" "_" name "${name}")
  file(READ ${page} text)
  write_blocks(${name} "${text}" "cpp fragment" inc docs_fragments)
  write_blocks(${name} "${text}" "cmake" cmake docs_cmake)
endforeach()
