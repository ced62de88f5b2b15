# Defines LIBLBFGS::LIBLBFGS. Serves the build and the installed package, as liblbfgs has no CMake files.
find_path(LIBLBFGS_INCLUDE_DIR lbfgs.h)
find_library(LIBLBFGS_LIBRARY lbfgs)
mark_as_advanced(LIBLBFGS_INCLUDE_DIR LIBLBFGS_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(LIBLBFGS REQUIRED_VARS LIBLBFGS_LIBRARY LIBLBFGS_INCLUDE_DIR)

if(LIBLBFGS_FOUND AND NOT TARGET LIBLBFGS::LIBLBFGS)
  add_library(LIBLBFGS::LIBLBFGS UNKNOWN IMPORTED)
  set_target_properties(LIBLBFGS::LIBLBFGS PROPERTIES IMPORTED_LOCATION "${LIBLBFGS_LIBRARY}"
                                                      INTERFACE_INCLUDE_DIRECTORIES "${LIBLBFGS_INCLUDE_DIR}")
endif()
