# Defines PETSC::PETSC, with MPI. Serves the build and the installed package, as PETSc has no CMake files.
find_package(PkgConfig QUIET)
if(PkgConfig_FOUND)
  pkg_check_modules(PC_PETSC QUIET PETSc)
endif()
find_path(PETSC_INCLUDE_DIR petsctao.h HINTS ${PC_PETSC_INCLUDE_DIRS} PATH_SUFFIXES petsc)
find_library(PETSC_LIBRARY NAMES ${PC_PETSC_LIBRARIES} petsc HINTS ${PC_PETSC_LIBRARY_DIRS})
mark_as_advanced(PETSC_INCLUDE_DIR PETSC_LIBRARY)
find_package(MPI QUIET COMPONENTS CXX)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(PETSc REQUIRED_VARS PETSC_LIBRARY PETSC_INCLUDE_DIR MPI_CXX_FOUND)

if(PETSc_FOUND AND NOT TARGET PETSC::PETSC)
  add_library(PETSC::PETSC UNKNOWN IMPORTED)
  set_target_properties(PETSC::PETSC PROPERTIES IMPORTED_LOCATION "${PETSC_LIBRARY}"
                                                INTERFACE_INCLUDE_DIRECTORIES "${PETSC_INCLUDE_DIR}"
                                                INTERFACE_COMPILE_DEFINITIONS "OMPI_SKIP_MPICXX;MPICH_SKIP_MPICXX"
                                                INTERFACE_LINK_LIBRARIES MPI::MPI_CXX)
endif()
