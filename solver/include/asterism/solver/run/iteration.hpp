#pragma once

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <concepts>
#include <memory>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A solver's iterate, as SolverOptions::on_iteration sees it.
struct Iteration {
  /// Updates of x so far: 0 at the start.
  int number = 0;
  /// E(x) and |dE/dx|, computed by this library, whatever the solver.
  double energy = 0, gradient_norm = 0;
  /// Dim x N, a node is a column; valid during the call, so copy it if you need it later.
  Eigen::Map<const Eigen::MatrixXd> x{nullptr, 0, 0};
};

/// A reference to a callable `bool(const Iteration&)` that lives as long as the solve, called after each
/// iteration; false ends the solve with Status::Interrupted. It must not throw.
///
///     std::vector<double> energies;
///     auto record = [&](const Iteration& at) { energies.push_back(at.energy); return true; };
///     solver.options.on_iteration = record;
class IterationCallback {
 public:
  /// None.
  constexpr IterationCallback() = default;
  constexpr IterationCallback(std::nullptr_t) {}
  /// Takes a named callable only: a reference to a temporary would dangle.
  template <typename F>
  requires(!std::same_as<std::remove_cv_t<F>, IterationCallback>) &&
      std::is_invocable_r_v<bool, F&, const Iteration&> constexpr IterationCallback(F& callable)
      : callable_(const_cast<std::remove_cv_t<F>*>(std::addressof(callable))),
  call_([](void* f, const Iteration& at) -> bool { return (*static_cast<F*>(f))(at); }) {}

  /// Whether there is one.
  constexpr explicit operator bool() const { return call_ != nullptr; }
  /// Calls it.
  bool operator()(const Iteration& at) const { return call_(callable_, at); }

 private:
  void* callable_ = nullptr;
  bool (*call_)(void*, const Iteration&) = nullptr;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
