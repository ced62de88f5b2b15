# Toolchain of tests/arm.sh: Debian's cross compiler for 64-bit ARM, whose programs run under qemu. Nothing of the
# host is found but programs: its libraries are another processor's.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
get_filename_component(arm_folder ${CMAKE_CURRENT_LIST_DIR}/../build/arm ABSOLUTE)
# Debian's alternatives, such as which BLAS is taken, are links that only an installation makes.
set(arm_libraries /usr/lib/aarch64-linux-gnu)
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64-static -L ${arm_folder}/debian -E LD_LIBRARY_PATH=${arm_libraries}/blas:${arm_libraries}/lapack)
# Some of what OpenCV's image files need is not in the processor's own folder.
set(arm_debian ${arm_folder}/debian)
set(CMAKE_EXE_LINKER_FLAGS_INIT
    "-Wl,-rpath-link,${arm_debian}/lib/aarch64-linux-gnu:${arm_debian}${arm_libraries}:${arm_debian}${arm_libraries}/blas:${arm_debian}${arm_libraries}/lapack:${arm_debian}/usr/lib")
set(CMAKE_SHARED_LINKER_FLAGS_INIT "${CMAKE_EXE_LINKER_FLAGS_INIT}")
set(CMAKE_FIND_ROOT_PATH ${arm_folder}/root ${arm_folder}/debian)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
