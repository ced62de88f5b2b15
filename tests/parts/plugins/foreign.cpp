// A library of part models from another version.
extern "C" __attribute__((visibility("default"))) const char* asterism_part_plugin_abi() {
  return "Asterism v0_0_align16, Eigen 3.4, OpenCV 4.6, C++ ABI 1017";
}
extern "C" __attribute__((visibility("default"))) void asterism_part_plugin_add(void*) { __builtin_trap(); }
