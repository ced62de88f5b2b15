#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {

/// Names of PETSc's methods and preconditioners, for the command line.
const std::vector<std::string>& distributed_methods();
const std::vector<std::string>& distributed_preconditioners();

/// A solve on the processes of mpirun.
struct DistributedRun {
  std::filesystem::path file;  ///< JSON, which the first process reads, or PETSc's binary format
  std::filesystem::path save;  ///< where to write the solved system, in PETSc's format; may be empty
  std::string method;
  std::string preconditioner;
  bool schwarz_first = true;
  Limits limits;
};

/// Solves the system of a file and prints, on the first process, how it went, the time of each step, and
/// memory and arithmetic a node. Returns the exit code: errors are printed once.
int solve_distributed(const DistributedRun& run);

/// Whether a file is not JSON, and so may be in PETSc's format.
bool is_petsc_file(const std::filesystem::path& file);

/// Runs solvers of one process on the system of a file in PETSc's format, of points in the plane, and prints
/// their table. Returns the exit code.
int solve_petsc_file(const std::filesystem::path& file, const std::vector<SolverEntry>& solvers,
                     const Limits& limits);

/// Writes a file in PETSc's format: the first system of a JSON file, or, if `json` is empty, a random one of
/// `nodes` nodes with local links.
int write_distributed(const std::filesystem::path& file, const std::filesystem::path& json, int nodes,
                      int dim, std::uint64_t seed);

}  // namespace asterism::bench
