# Every public header in a source file of its own, with nothing but its target's include folders.
add_custom_target(asterism_headers ALL)
foreach(component IN LISTS components)
  get_target_property(headers asterism_${component} HEADER_SET)
  get_target_property(include asterism_${component} HEADER_DIRS)
  set(sources "")
  foreach(header IN LISTS headers)
    cmake_path(RELATIVE_PATH header BASE_DIRECTORY ${include})
    set(source ${CMAKE_CURRENT_BINARY_DIR}/headers/${header}.cpp)
    # Twice, so that its include guard is seen to work.
    file(CONFIGURE OUTPUT ${source} CONTENT "#include <${header}>\n#include <${header}>\n")
    list(APPEND sources ${source})
  endforeach()
  add_library(asterism_headers_${component} OBJECT ${sources})
  target_link_libraries(asterism_headers_${component} PRIVATE asterism::${component})
  asterism_private_options(asterism_headers_${component})
  target_precompile_headers(asterism_headers_${component} PRIVATE <Eigen/Core>) # which each includes by config.hpp
  add_dependencies(asterism_headers asterism_headers_${component})
endforeach()
