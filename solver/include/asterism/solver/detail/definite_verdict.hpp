#pragma once

#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/free_motion.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/run/summary.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// For methods that factor the Hessian: takes their verdict that it is positive definite at x back where it
/// is so only by rounding, or where x is no minimum although it is: a component or a part of one is free to
/// move, or a link that pushes its ends apart has them in one place.
template <typename System>
class DefiniteVerdict {
 public:
  void check(const System& system, const typename System::Points& x, Summary& summary) {
    if (summary.positive_definite == 1 && (peaked_link(system, x) >= 0 || free_motions_.find(system, x)))
      summary.positive_definite = 0;
  }

 private:
  FreeMotions<System> free_motions_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
