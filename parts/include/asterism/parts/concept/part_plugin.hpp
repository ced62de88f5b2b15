#pragma once

#include <Eigen/Core>
#include <asterism/parts/concept/part_registry.hpp>
#include <opencv2/core/version.hpp>

#define ASTERISM_STRING_IMPL(x) #x
#define ASTERISM_STRING(x) ASTERISM_STRING_IMPL(x)

/// The properties in which a program and its plugins must agree, because they exchange C++ objects.
#define ASTERISM_PART_PLUGIN_ABI \
  "Asterism " ASTERISM_STRING(ASTERISM_ABI) ", Eigen " ASTERISM_STRING(EIGEN_WORLD_VERSION) "." ASTERISM_STRING( \
      EIGEN_MAJOR_VERSION) ", OpenCV " ASTERISM_STRING(CV_VERSION_MAJOR) "." ASTERISM_STRING(CV_VERSION_MINOR) \
      ", C++ ABI " ASTERISM_STRING(__GXX_ABI_VERSION)

/// Makes a shared library of part models, for PartRegistry::load, from a source file. A section of the file
/// says what it was built for, and is read before the library is loaded. The parameter is the name of the
/// registry that the models are added to:
///
///     ASTERISM_PART_PLUGIN(models) { models.add<MyPart, MyOptions>("mine"); }
// NOLINTBEGIN(bugprone-macro-parentheses): a parameter has none
#define ASTERISM_PART_PLUGIN(models)                                                  \
  extern "C" __attribute__((visibility("default"), section(".asterism_part_plugin"))) \
  const char asterism_part_plugin_abi[];                                              \
  const char asterism_part_plugin_abi[] = ASTERISM_PART_PLUGIN_ABI;                   \
  extern "C" __attribute__((visibility("default"))) void asterism_part_plugin_add(    \
      ::asterism::PartRegistry&);                                                     \
  void asterism_part_plugin_add(::asterism::PartRegistry& models)
// NOLINTEND(bugprone-macro-parentheses)
