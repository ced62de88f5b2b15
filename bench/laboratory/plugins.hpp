#pragma once

#include <filesystem>

namespace asterism::bench {

/// Registers the solver of a shared library (solver_plugin.h), which stays loaded. Throws std::runtime_error
/// if there is none, or if it is made for another version of the interface, and std::logic_error if its name
/// is taken.
void load_plugin(const std::filesystem::path& library);

}  // namespace asterism::bench
