#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <optional>
#include <ostream>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The result of every solver. Numbers are -1 until they are known. Energies, gradient norm and stationarity
/// are computed by this library from x, whatever the solver; their cost is not included in the counts.
struct Summary {
  Status status = Status::NotRun;            ///< why it stopped
  Message message = "solve was not called";  ///< what was wrong, or more on the status
  std::string_view solver;                   ///< name of the solver
  int iterations = -1;                       ///< updates of x
  int energy_evaluations = -1;               ///< made by the method
  int gradient_evaluations = -1;             ///< made by the method
  int linear_solves = -1;                    ///< with all dimensions as right-hand sides counting once
  int factorizations = -1;                   ///< of a matrix
  double initial_energy = -1;                ///< E at the x given
  double final_energy = -1;                  ///< E at the x returned
  double lower_bound = -1;                   ///< no x has less energy; only if SolverOptions::gap > 0
  double gradient_norm = -1;                 ///< |dE/dx| at the x returned [stiffness x px]
  double stationarity = -1;                  ///< at the x returned, see SolverOptions::tolerance
  std::optional<bool> positive_definite;  ///< true: the Hessian at the x returned is positive definite, so x
                                          ///< is a strict local minimum if stationary; false: it is not, or a
                                          ///< component or a part of one is free to turn or slide; empty: the
                                          ///< method did not test it
  double seconds = -1;                    ///< wall-clock time in solve; -1: not measured, which is an option,
                                          ///< SolverOptions::measure_seconds

  /// Whether lower_bound proves that the energy exceeds the least one by at most this share of itself.
  bool is_within(double gap) const { return usable() && is_within(gap, final_energy, lower_bound); }
  /// The same rule for an energy and a lower bound, -1 if unknown.
  static bool is_within(double gap, double energy, double lower_bound) {
    return lower_bound >= 0 && energy - lower_bound <= gap * energy;
  }

  /// Adds the counts of another solve, from iterations to factorisations.
  void add_work(const Summary& other) {
    const auto add = [](int& to, int more) { to = std::max(to, 0) + std::max(more, 0); };
    add(iterations, other.iterations);
    add(energy_evaluations, other.energy_evaluations);
    add(gradient_evaluations, other.gradient_evaluations);
    add(linear_solves, other.linear_solves);
    add(factorizations, other.factorizations);
  }

  /// x is finite and at least as good as the start.
  bool usable() const {
    return status == Status::Converged || status == Status::MaxIterations || status == Status::NoProgress ||
           status == Status::Interrupted;
  }
};

namespace detail {

/// The summary of a solve that was refused.
inline Summary refused(std::string_view solver, const Message& why) {
  Summary summary;
  summary.solver = solver;
  summary.status = Status::InvalidInput;
  summary.message = why;
  return summary;
}

}  // namespace detail

inline std::ostream& operator<<(std::ostream& out, const Summary& summary) {
  out << summary.solver << ": " << summary.status;
  if (summary.usable()) {
    out << " after " << detail::counted(summary.iterations, "iteration") << ", energy "
        << summary.initial_energy << " -> " << summary.final_energy << ", stationarity "
        << summary.stationarity;
    if (summary.seconds >= 0) out << ", " << summary.seconds << " s";
  }
  return out << " (" << summary.message << ")";
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
