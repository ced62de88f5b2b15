#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <chrono>
#include <concepts>
#include <new>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Graduated, in addition to those of its method.
template <typename Options>
struct GraduatedOptions : Options {
  /// From one solve to the next, the loss comes nearer to itself by this factor. > 1.
  double factor = 1.4;

  constexpr const char* problem() const {
    if (!(factor >= 1.001 && factor <= 1e6)) return "option factor is not between 1.001 and 1e6";
    return Options::problem();
  }
};

/// The names of these options, for an OptionVisitor.
template <typename Options>
void visit_options(OptionVisitor& visit, GraduatedOptions<Options>& options) {
  visit_options(visit, static_cast<Options&>(options));
  visit("factor", options.factor, {1.001, 1e6});
}

namespace detail {

/// Whether a loss, or a link's potential, has the functions that Graduated needs.
template <typename Function>
concept Graduable = requires(const Function& f, double mu) {
  { f.graduated(mu) } -> std::same_as<Function>;
  { f.unlimited() } -> std::same_as<Function>;
  { function_of(f, 0).graduation(mu) } -> std::convertible_to<double>;
};

/// Whether Graduated can solve systems of this type.
template <typename System>
constexpr bool is_graduable() {
  return Graduable<typename System::Model::AnchorLoss> || Graduable<typename System::Model::LinkPotential>;
}

}  // namespace detail

/// Graduated non-convexity (Blake and Zisserman 1987) around any solver, for robust anchors or links
/// (GemanMcClure, Truncated, RobustHooke): solves the system with plain springs first, then with losses that
/// come from a convex one to the given one, each from the last solution, as Yang et al. (2020) do. Where many
/// parts are outliers, it finds the placement that the others agree on, which a solve from the same start
/// often misses. Nothing is proven.
///
/// An object holds its workspace: reuse it to solve without allocation, one thread at a time.
template <typename System, typename Solver>
requires(detail::is_graduable<System>()) class Graduated {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  GraduatedOptions<std::decay_t<decltype(std::declval<Solver&>().options)>> options;

  static constexpr std::string_view name() { return "graduated non-convexity"; }

  /// Moves x (Dim x N) to a stationary point of the energy. SolverOptions::on_iteration sees all solves, each
  /// with the energy of its own losses. The Summary is that of the last solve, except
  /// that iterations, evaluations, linear solves, factorisations and time are totals, and the initial energy
  /// is that of the given x. Statuses are those of `Solver`. If the sequence fails or leads above the start,
  /// the result is that of `Solver` alone.
  Summary solve(const System& system, Points& x) {
    const auto begin = std::chrono::steady_clock::now();
    Summary result;
    result.solver = name();
    if (const char* problem = options.problem()) {
      result.status = Status::InvalidInput;
      result.message = problem;
      return result;
    }
    bool is_ready = false;
    const auto prepare = [&] {
      // Emptied first: Eigen 3.4 frees a matrix twice if memory runs out where it changes its size.
      if (given_.size() != x.size()) given_ = Points();
      given_ = x;
      if (relaxed_ && (relaxed_->nodes() != system.nodes() || relaxed_->link_count() != system.link_count()))
        relaxed_.reset();
      if (relaxed_) {
        *relaxed_ = system;
      } else {
        relaxed_.emplace(system);
      }
      is_ready = true;
    };
    detail::attempt<std::bad_alloc>(prepare, [&result](const std::bad_alloc& error) {
      result.status = Status::OutOfMemory;
      result.message = detail::memory_message(error);
    });
    if (!is_ready) return result;
    solver_.options = options;
    use(system.anchor_loss, system.link_potential, [](const auto& f) { return f.unlimited(); });
    result = solver_.solve(*relaxed_, x);
    double mu = result.usable() ? graduation(system, x) : 1;
    bool is_last = false;
    while (result.usable() && result.status != Status::Interrupted && !is_last) {
      is_last = mu == 1;
      use(system.anchor_loss, system.link_potential, [mu](const auto& f) { return f.graduated(mu); });
      const Summary done = std::exchange(result, solver_.solve(*relaxed_, x));
      result.add_work(done);
      mu = std::max(1.0, mu / options.factor);
    }
    if (result.status != Status::InvalidInput && result.status != Status::OutOfMemory) {
      result.initial_energy = static_cast<double>(energy(system, given_));
      if (!is_last || !(result.final_energy <= result.initial_energy)) start_again(system, x, result);
    }
    result.solver = name();
    result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return result;
  }

 private:
  static constexpr bool kAnchors = detail::Graduable<typename System::Model::AnchorLoss>;
  static constexpr bool kLinks = detail::Graduable<typename System::Model::LinkPotential>;

  template <typename Loss, typename Potential, typename Relax>
  void use(const Loss& loss, const Potential& potential, Relax&& relax) {
    if constexpr (kAnchors) relaxed_->anchor_loss = relax(loss);
    if constexpr (kLinks) relaxed_->link_potential = relax(potential);
  }

  // Where the sequence was stopped, failed, or led above the start: from the given x, by the given losses; if
  // it was stopped, x stays there.
  void start_again(const System& system, Points& x, Summary& result) {
    const bool is_stopped = result.status == Status::Interrupted;
    if (is_stopped) solver_.options.max_iterations = 0;
    use(system.anchor_loss, system.link_potential, [](const auto& f) { return f; });
    x = given_;
    const Summary done = std::exchange(result, solver_.solve(*relaxed_, x));
    result.add_work(done);
    if (!is_stopped) return;
    result.status = Status::Interrupted;
    result.message = "stopped on request before the last solve: x is as it was";
  }

  // The mu >= 1 for which the losses are convex at x.
  double graduation(const System& system, const Points& x) const {
    double mu = 1;
    detail::for_each_spring(
        system, x,
        [&](int i, const typename System::Point& offset) {
          if constexpr (kAnchors) {
            const auto square = offset.dot(detail::anchor_shaped(system, i, offset));
            mu = std::max(mu,
                          detail::function_of(system.anchor_loss, i).graduation(static_cast<double>(square)));
          }
        },
        [&](int l, const Link&, const auto&, const auto& spring) {
          if constexpr (kLinks) {
            if (!(system.link_stiffness[l] > 0)) return;
            const auto stretch = static_cast<double>(spring.length - system.rest_length[l]);
            mu = std::max(mu, detail::function_of(system.link_potential, l).graduation(stretch * stretch));
          }
        });
    constexpr double kMost = 1e12;  // some 80 solves
    return std::min(mu, kMost);
  }

  Solver solver_;
  std::optional<System> relaxed_;
  Points given_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
