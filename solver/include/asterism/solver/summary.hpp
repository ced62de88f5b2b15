#pragma once

#include <asterism/solver/config.hpp>
#include <asterism/solver/finite.hpp>
#include <asterism/solver/topology.hpp>
#include <atomic>
#include <charconv>
#include <concepts>
#include <cstddef>
#include <cstring>
#include <limits>
#include <ostream>
#include <string_view>

namespace asterism::inline ASTERISM_ABI {

/// Why a solver stopped, and what became of x.
enum class Status {
  NotRun,         ///< solve was not called
  Converged,      ///< x is a stationary point to the tolerance asked for
  MaxIterations,  ///< the iterations ran out; x is the last iterate, its energy no higher than the start's
  NoProgress,  ///< the solver could not go on; x is its best iterate, its energy no higher than the start's
  NumericalFailure,  ///< overflow, or stiffness ratios beyond the scalar's digits; x is as it was, bit for
                     ///< bit
  InvalidInput,      ///< the message names the offending value; x is as it was, bit for bit
  OutOfMemory,       ///< a workspace could not be allocated; x is as it was, bit for bit
  Interrupted,  ///< SolverOptions::stop was set; x is the last iterate, its energy no higher than the start's
};

constexpr std::string_view to_string(Status status) {
  switch (status) {
    case Status::NotRun:
      return "not run";
    case Status::Converged:
      return "converged";
    case Status::MaxIterations:
      return "maximum number of iterations";
    case Status::NoProgress:
      return "no progress";
    case Status::NumericalFailure:
      return "numerical failure";
    case Status::InvalidInput:
      return "invalid input";
    case Status::OutOfMemory:
      return "out of memory";
    case Status::Interrupted:
      return "interrupted";
  }
  return "unknown status";
}

inline std::ostream& operator<<(std::ostream& out, Status status) { return out << to_string(status); }

/// A short text without heap memory; what does not fit is cut off.
class Message {
 public:
  Message() = default;
  /// The text, as far as it fits.
  Message(std::string_view text) { append(text); }
  Message(const char* text) : Message(std::string_view(text)) {}

  /// "<subject> <index> <problem>", empty for no defect.
  Message(const Defect& defect) {
    if (!defect) return;
    append(defect.subject).append(" ");
    if (defect.index != -1) append(defect.index).append(" ");
    append(defect.problem);
  }

  /// In place, as a solve of a microsecond notices a copy.
  Message& assign(std::string_view text) {
    size_ = 0;
    return append(text);
  }
  /// No text.
  void clear() { size_ = 0; }

  /// Adds a text or a number, as far as it fits.
  Message& append(std::string_view text) {
    const std::size_t count = std::min(text.size(), sizeof text_ - size_);
    std::memcpy(text_ + size_, text.data(), count);
    size_ += count;
    return *this;
  }

  /// Adds a text or a number, as far as it fits.
  Message& append(int value) {
    char digits[16];
    return append({digits, static_cast<std::size_t>(std::to_chars(digits, digits + sizeof digits, value).ptr -
                                                    digits)});
  }

  /// The text; valid while the message lives.
  operator std::string_view() const { return {text_, size_}; }
  /// Whether there is no text.
  bool empty() const { return size_ == 0; }

  /// Whether it is this text.
  friend bool operator==(const Message& a, std::string_view b) { return std::string_view(a) == b; }
  friend std::ostream& operator<<(std::ostream& out, const Message& message) {
    return out << std::string_view(message);
  }

 private:
  std::size_t size_ = 0;
  char text_[168];
};

/// What every solver takes.
struct SolverOptions {
  /// Stop when stationarity(system, x), a ratio without units, is at most this. Invariant to translation,
  /// rotation and scale of the points and to the unit of stiffness. 1e-8 with nodes 30 px apart: no node
  /// would move by more than 3e-7 px if the others stood still. Judged at the x that is returned, wherever
  /// the start was. A tolerance below 64 epsilons of the scalar (1.4e-14, in float 8e-6) counts as that. One
  /// below the rounding of the coordinates, which are then far from the origin, may end at NoProgress, and
  /// the message says so; so may, below some 1e-7, methods that compare energies (Ceres).
  double tolerance = 1e-8;

  /// Iterations at most; 0 evaluates the start.
  int max_iterations = 10000;

  /// What to do with a connected component that no anchor holds (links of zero stiffness do not connect): its
  /// energy does not change as it moves. False: InvalidInput, naming a node of it. True: its first node is
  /// held where the start has it, which costs no energy.
  bool ground_components = false;

  /// Looked at in every iteration where it is given: once it is true, set by another thread, a signal handler
  /// or a custom model, the solve ends with Status::Interrupted. What a solver cannot leave in the middle,
  /// such as a factorisation, it ends first.
  const std::atomic<bool>* stop = nullptr;

  /// Whether `stop` was set.
  bool stopped() const { return stop != nullptr && stop->load(std::memory_order_relaxed); }

  /// What is wrong with the options, nullptr for nothing. Solvers with more options hide it by their own.
  constexpr const char* problem() const {
    if (!(tolerance >= 0) || !detail::is_finite(tolerance))
      return "option tolerance is negative or not finite";
    if (max_iterations < 0) return "option max_iterations is negative";
    return nullptr;
  }
};

/// What solvers take that can start with rigid_alignment of x (unless x is stationary, or max_iterations 0):
/// it is not counted as an iteration, cannot raise the energy, and removes the modes that are slowest where
/// anchors are weak.
struct AlignedOptions : SolverOptions {
  /// Start with rigid_alignment of x.
  bool align = true;

  /// The alignment may also mirror x: for constellations whose mirror image is as good.
  bool allow_reflection = false;

  constexpr AlignedOptions() = default;
  constexpr AlignedOptions(const SolverOptions& options) : SolverOptions(options) {}
};

/// What every solver returns. Numbers are -1 until they are known. Energies, gradient norm and stationarity
/// are computed by this library from x, whatever the solver, and their cost is in `seconds` but not in the
/// counts.
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
  double gradient_norm = -1;                 ///< |dE/dx| at the x returned [stiffness x px]
  double stationarity = -1;                  ///< at the x returned, see SolverOptions::tolerance
  int positive_definite = -1;  ///< 1: the Hessian at the x returned is, x is a strict local minimum if
                               ///< stationary; 0: it is not, or nothing holds a component, or a part of
                               ///< one, against turning or sliding; -1: the method did not look
  double seconds = -1;         ///< wall-clock time in solve

  /// x is finite and at least as good as the start.
  bool usable() const {
    return status == Status::Converged || status == Status::MaxIterations || status == Status::NoProgress ||
           status == Status::Interrupted;
  }
};

inline std::ostream& operator<<(std::ostream& out, const Summary& summary) {
  out << summary.solver << ": " << summary.status;
  if (summary.usable()) {
    out << " after " << summary.iterations << " iterations, energy " << summary.initial_energy << " -> "
        << summary.final_energy << ", stationarity " << summary.stationarity << ", " << summary.seconds
        << " s";
  }
  return out << " (" << summary.message << ")";
}

/// A minimiser of a spring system's energy. `solve` starts at x, which is not to lie in the memory of the
/// system (InvalidInput else), leaves its result there, and never throws, prints or exits. The energy has
/// many stationary points and the start chooses among them: it is part of the problem.
template <typename S, typename System>
concept Solver = requires(S solver, const System& system, typename System::Points& x) {
  { solver.solve(system, x) } -> std::same_as<Summary>;
  { solver.options } -> std::convertible_to<SolverOptions>;
  { S::name() } -> std::convertible_to<std::string_view>;
};

}  // namespace asterism::inline ASTERISM_ABI
