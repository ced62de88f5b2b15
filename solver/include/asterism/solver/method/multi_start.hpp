#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <chrono>
#include <cstdint>
#include <new>
#include <string_view>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of MultiStart, in addition to those of its method.
template <typename Options>
struct MultiStartOptions : Options {
  /// Number of starts: the given x, the anchors (for nodes whose anchor has stiffness; without any such node,
  /// a random displacement of x), and then, alternately, random displacements of these two.
  int starts = 8;

  /// Each coordinate is displaced by up to this many times the characteristic_length.
  double spread = 0.5;

  /// Seed of the displacements: the same seed gives the same starts on every machine.
  std::uint64_t seed = 1;

  constexpr const char* problem() const {
    if (starts < 1) return "option starts is not positive";
    if (!(spread >= 0 && spread <= 1e6)) return "option spread is not between 0 and 1e6";
    return Options::problem();
  }
};

/// The names of these options, for an OptionVisitor.
template <typename Options>
void visit_options(OptionVisitor& visit, MultiStartOptions<Options>& options) {
  visit_options(visit, static_cast<Options&>(options));
  visit("starts", options.starts, {1, 1e9});
  visit("spread", options.spread, {0, 1e6});
  visit("seed", options.seed);
}

/// Runs any solver from many starts and keeps the lowest minimum found, because the energy may have several.
/// The given x is the first start, so the result is never worse than that of `Solver` alone. Of equal minima,
/// the one of the earlier start is kept. With SolverOptions::gap, a minimum that is proven to be the lowest
/// ends the search.
///
/// An object holds its workspace: reuse it to solve without allocation, one thread at a time.
template <typename System, typename Solver>
class MultiStart {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  MultiStartOptions<std::decay_t<decltype(std::declval<Solver&>().options)>> options;

  static constexpr std::string_view name() { return "multi-start"; }

  /// Moves x (Dim x N) to the lowest minimum found. The Summary is that of the solve that found it, except
  /// that iterations, evaluations, linear solves, factorisations and time are totals, and the initial energy
  /// is that of the given x. Statuses are those of `Solver`; bad input is refused before the first start.
  Summary solve(const System& system, Points& x) {
    const auto begin = std::chrono::steady_clock::now();
    if (const char* problem = options.problem()) return detail::refused(name(), problem);
    solver_.options = options;
    Summary best;
    best.solver = name();
    const auto allocate = [&] {
      // Emptied first: Eigen 3.4 frees a matrix twice if memory runs out where it changes its size.
      if (given_.size() != x.size()) given_ = trial_ = Points(), scratch_ = {}, stiffness_ = {};
      trial_ = given_ = x;
      stiffness_.resize(x.cols());
      scratch_.resize(x.cols() + 1);
    };
    detail::attempt<std::bad_alloc>(allocate, [&best](const std::bad_alloc& error) {
      best.status = Status::OutOfMemory;
      best.message = detail::memory_message(error);
    });
    if (best.status == Status::OutOfMemory) return best;
    best = solver_.solve(system, x);
    if (best.status == Status::InvalidInput || best.status == Status::OutOfMemory ||
        best.status == Status::Interrupted)
      return best;

    std::uint64_t state = options.seed;
    std::uint64_t first_state = ~options.seed;
    const bool is_anchored = (system.anchor_stiffness.array() > 0).any();
    detail::node_stiffness(system, stiffness_);
    const Scalar reach =
        static_cast<Scalar>(options.spread) * detail::characteristic_length(system, given_, stiffness_);
    for (int start = 1; start < options.starts && !(options.gap > 0 && best.is_within(options.gap));
         ++start) {
      trial_ = given_;
      for (int i = 0; start % 2 == 1 && i < system.nodes(); ++i) {
        if (system.anchor_stiffness[i] > 0) trial_.col(i) = system.anchors.col(i);
      }
      if (start > 1) {
        displace(trial_, reach, state);
      } else if (!is_anchored) {  // not the given x once more
        displace(trial_, reach, first_state);
      }
      hold(system);
      const Summary summary = solver_.solve(system, trial_);
      const bool lower = summary.usable() && (!best.usable() || summary.final_energy < best.final_energy);
      Summary total = lower ? summary : best;
      total.add_work(lower ? best : summary);
      total.initial_energy = best.initial_energy;
      total.lower_bound = std::max(best.lower_bound, summary.lower_bound);
      best = total;
      if (lower) x = trial_;
      if (summary.status == Status::Interrupted) {
        best.status = Status::Interrupted;
        best.message = "stopped on request: not all starts were tried";
        break;
      }
    }
    best.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return best;
  }

 private:
  // splitmix64 (Steele, Lea & Flood 2014): portable, and all the randomness that this needs.
  static double uniform(std::uint64_t& state) {
    std::uint64_t z = state += 0x9e3779b97f4a7c15ULL;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }

  static void displace(Points& points, Scalar reach, std::uint64_t& state) {
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      for (int d = 0; d < System::kDim; ++d) {
        points(d, i) += reach * static_cast<Scalar>(2 * uniform(state) - 1);
      }
    }
  }

  // No start moves the nodes that are fixed, or that ground_components holds.
  void hold(const System& system) {
    if (system.fixed_count() > 0) {
      for (int i = 0; i < system.nodes(); ++i) {
        if (system.is_fixed(i)) trial_.col(i) = given_.col(i);
      }
    }
    if (options.ground_components)
      detail::for_each_floating_component(system, scratch_, [this](int i) { trial_.col(i) = given_.col(i); });
  }

  Solver solver_;
  detail::ComponentScratch<System> scratch_;
  typename System::NodeVector stiffness_;
  Points given_;
  Points trial_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
