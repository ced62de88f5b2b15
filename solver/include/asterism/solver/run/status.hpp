#pragma once

#include <asterism/solver/base/config.hpp>
#include <ostream>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Why a solver stopped, and what x is then.
enum class Status {
  NotRun,         ///< solve was not called
  Converged,      ///< x is a stationary point to the tolerance asked for, or within SolverOptions::gap
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

}  // namespace ASTERISM_ABI
}  // namespace asterism
