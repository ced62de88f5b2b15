#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <atomic>
#include <limits>
#include <new>
#include <ostream>

namespace asterism {
inline namespace ASTERISM_ABI {

/// An edge of a tree of parts: what it costs that the child is at x_child while its parent is at x_parent,
/// cost(x_child - x_parent).
struct Joint {
  int parent = 0;         ///< a part, from 0
  int child = 0;          ///< another part
  DisplacementCost cost;  ///< of the child's position less the parent's
};

/// A place for each part.
struct PartPlacement {
  double energy = std::numeric_limits<double>::infinity();  ///< E of the placement
  Eigen::Matrix2Xi positions;                               ///< 2 x parts, (x, y) in the part's map [px]
};

/// The result of a solve of a pictorial structure.
struct PictorialSummary {
  Status status = Status::NotRun;  ///< Converged, InvalidInput, OutOfMemory or Interrupted
  Message message;                 ///< what is wrong
  double energy = std::numeric_limits<double>::quiet_NaN();  ///< of the placement; NaN if there is none

  /// Whether there is a placement.
  bool usable() const { return status == Status::Converged; }
};

inline std::ostream& operator<<(std::ostream& out, const PictorialSummary& summary) {
  out << summary.status;
  if (summary.usable()) out << ", energy " << summary.energy;
  if (!summary.message.empty()) out << ": " << summary.message;
  return out;
}

namespace detail {

/// Whether a solver that has this flag, which may be none, is to stop.
inline bool is_set(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

/// The problem of a joint of so many parts, or nullptr if there is none.
inline const char* joint_problem(const Joint& joint, int parts) {
  const auto is_part = [parts](int index) { return 0 <= index && index < parts; };
  if (!is_part(joint.parent) || !is_part(joint.child)) return "has an end that is out of range";
  return joint.parent == joint.child ? "joins a part to itself" : joint.cost.problem();
}

/// A summary without a placement.
template <typename Summary>
Summary without_placement(Status status, const Message& why) {
  Summary summary;
  summary.status = status;
  summary.message = why;
  return summary;
}
template <typename Summary>
Summary stopped() {
  return without_placement<Summary>(Status::Interrupted, "stopped on request");
}

/// What work() returns; OutOfMemory if memory runs out there.
template <typename Summary, typename Work>
Summary within_memory(Work&& work) {
  Summary summary;
  attempt<std::bad_alloc>([&] { summary = work(); },
                          [&](const std::bad_alloc& error) {
                            summary = without_placement<Summary>(Status::OutOfMemory, memory_message(error));
                          });
  return summary;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
