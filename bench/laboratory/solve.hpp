#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {

/// For each system of a file (docs/system-json.md), prints a line per solver: its result and time. `solvers`
/// are names, separated by commas, or "all": for springs as for solvers_named, for systems of terms those of
/// system_solvers. Throws std::runtime_error for a file that cannot be read, std::invalid_argument for an
/// unknown name.
void solve_file(const std::filesystem::path& path, const std::string& solvers, const Limits& limits);

/// The same for one problem.
void solve_problem(const std::string& name, const Problem& problem, const std::vector<SolverEntry>& solvers,
                   const Limits& limits);

/// The two-dimensional systems in a file, as problems.
std::vector<Problem> read_problems(const std::filesystem::path& path);

}  // namespace asterism::bench
