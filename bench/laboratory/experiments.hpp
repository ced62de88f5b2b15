#pragma once

// The experiments of the laboratory: what each measures and stores, and how the paper's claims compare.

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "laboratory.hpp"
#include "store.hpp"

namespace asterism::bench {

/// The problems and solvers of an experiment.
struct Selection {
  std::vector<testing::Kind> kinds;
  std::vector<int> sizes;  ///< nodes, fully connected
  std::vector<int> sparse_sizes;
  std::vector<SolverEntry> solvers;
  int systems = 0;  ///< of each kind and size
  /// The systems of the kind "real", of their own sizes.
  std::shared_ptr<const std::vector<Problem>> recorded = std::make_shared<std::vector<Problem>>();
  std::string recorded_digest;  ///< of the file that they come from
};

struct Experiment {
  std::string name;
  std::vector<Cell> cells;
  /// Prints the tables, and which of the paper's claims they confirm.
  std::function<void(const Results&)> report;
};

/// Energy that remains after each iteration (the paper's Figure 7).
Experiment convergence(const Selection& selection);
/// Iterations and time against the number of parts (Figure 9).
Experiment scaling(const Selection& selection);
/// Near-coincident pairs, weak anchors, stiff pairs and saddles (Figure 8).
Experiment hard(const Selection& selection);
/// A way to make systems of four nodes hard, and how far it is taken.
struct HardCase {
  std::string name;
  std::vector<double> levels;
  std::function<Problem(int index, double level)> problem;
};
const std::vector<HardCase>& hard_cases();
/// How often solvers and starts end in different minima.
Experiment minima(const Selection& selection);
/// How often each start ends above the lowest minimum, without and with MultiStart.
Experiment starts(const Selection& selection);
/// How often a solution is proven to be the global minimum, and what that costs.
Experiment proof(const Selection& selection);
/// Accuracy against time.
Experiment pareto(const Selection& selection);

/// Systems of a group that an experiment measures together, as one cell.
struct Chunk {
  std::string group;  ///< "lit/4", "sparse/10000", "real/4"
  int nodes = 0;
  bool is_sparse = false;
  int first = 0;
  int count = 0;
  std::function<Problem(int index)> problem;
  std::string digest = {};  ///< of the problems' source, if group and index do not determine it
};

/// The chunks of a selection, a chunk of each group in turn, so that slow drifts of the machine's speed
/// affect all groups alike.
std::vector<Chunk> chunks(const Selection& selection);

/// For each chunk and each solver that reaches it, a cell "group[/digest]/first+count/solver" that stores
/// measure(runner, chunk).
std::vector<Cell> cells_of(const Selection& selection,
                           const std::function<Json(Runner&, const Chunk&)>& measure);

/// The same once for each factor on the anchors' stiffness, which is passed to `measure` too.
std::vector<Cell> cells_by_weakness(const Selection& selection, const std::vector<double>& weaknesses,
                                    const std::function<Json(Runner&, const Chunk&, double)>& measure);

/// The results of a group and solver, for reports.
std::vector<const Json*> cells_with(const Results& results, const std::string& group,
                                    const std::string& solver);
/// The groups of a selection, in order.
std::vector<std::string> groups(const Selection& selection);

/// The points as [[x, y], ...].
Json coordinates(const Points& x);

/// Prints a line on one of the paper's claims.
void claim(const char* text, bool reproduced, const std::string& evidence);

}  // namespace asterism::bench
