#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {

/// For each system of a file (docs/system-json.md), prints a line per solver: its result and time.
/// Throws std::runtime_error for a file that cannot be read.
void solve_file(const std::filesystem::path& path, const std::vector<SolverEntry>& solvers,
                const Limits& limits);

/// The same for one problem.
void solve_problem(const std::string& name, const Problem& problem, const std::vector<SolverEntry>& solvers,
                   const Limits& limits);

/// The two-dimensional systems in a file, as problems.
std::vector<Problem> read_problems(const std::filesystem::path& path);

}  // namespace asterism::bench
