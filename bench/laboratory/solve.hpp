#pragma once

#include <filesystem>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {

/// Prints a line a solver for each system of a file (docs/system-json.md): what it reached and how soon.
/// Throws std::runtime_error for a file that cannot be read.
void solve_file(const std::filesystem::path& path, const std::vector<SolverEntry>& solvers,
                const Limits& limits);

/// The systems of the plane in a file, as problems.
std::vector<Problem> read_problems(const std::filesystem::path& path);

}  // namespace asterism::bench
