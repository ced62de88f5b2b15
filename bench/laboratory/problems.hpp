#pragma once

// The problem set of bench/problems: small systems, each with its least energy as far as it is proven.

#include <filesystem>
#include <string>
#include <vector>

#include "laboratory.hpp"

namespace asterism::bench {

/// A system whose least energy lies between two known values.
struct KnownProblem {
  std::string family;
  std::string name;
  Problem problem;
  Points minimiser;     ///< the best x known
  double minimum;       ///< its energy
  double lower_bound;   ///< proven
  bool proven() const;  ///< whether they agree within 1e-6
};

/// The problems of all files FAMILY.jsonl in a folder, in the order of the files' names. Throws
/// std::runtime_error that names the file: if there are no files, if a file cannot be read, and if the energy
/// of a minimiser is not the minimum that is stored with it.
std::vector<KnownProblem> read_problem_set(const std::filesystem::path& folder);

/// Prints for each family and solver how many problems it solves to the least energy known, how far above it
/// ends elsewhere, and its time. Says where a solver finds less than was known.
void score_problem_set(const std::filesystem::path& folder, const std::vector<SolverEntry>& entries,
                       const Limits& limits);

/// Makes the problem set: `count` systems a family, and those of the files `recorded` as the family "video".
/// It takes some seconds a problem, for the proofs.
void write_problem_set(const std::filesystem::path& folder, int count,
                       const std::vector<std::filesystem::path>& recorded);

}  // namespace asterism::bench
