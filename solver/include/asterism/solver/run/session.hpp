#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/certifier_reference.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <cmath>
#include <limits>
#include <new>
#include <optional>
#include <string_view>
#include <type_traits>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// An upper bound of the rounding error in the energy at x, the sum of those of all springs and loads.
template <typename System>
typename System::Scalar rounding_of_energy(const System& system, const typename System::Points& x,
                                           typename System::Scalar energy) {
  using Scalar = typename System::Scalar;
  const auto terms = static_cast<Scalar>(system.nodes() + system.link_count());
  return terms * std::numeric_limits<Scalar>::epsilon() * rounding_scale(system, x, energy);
}

}  // namespace detail

/// The frame around the iterations of every solver, also of your own: it validates the input before them, and
/// judges the result after them, so that all methods follow the same rule and bad input leaves x unchanged.
/// A solver has a Session as a member, and solves by
///
///     return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
///       while (true) {
///         const Points g = gradient(system, x);
///         if (session_.done(x, g, summary.iterations)) return Status::Converged;
///         if (summary.iterations == options.max_iterations) return Status::MaxIterations;
///         x -= ...;
///         ++summary.iterations;
///       }
///     });
///
/// It keeps its memory between solves.
template <typename System>
class Session {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  /// Validates, aligns x if the options ask for it, runs iterate(system, summary), which improves x and
  /// returns why it stopped, and judges the result. The system that `iterate` gets is the given one, with
  /// floating components grounded if the options ask for it.
  template <typename Options, typename Iterate>
  Summary run(std::string_view name, const Options& options, const System& given, Points& x,
              Iterate&& iterate) {
    Task task{name, options.problem()};
    if constexpr (requires { options.align; }) {
      task.aligns = options.align;
      task.reflects = options.allow_reflection;
    }
    task.method = const_cast<void*>(static_cast<const void*>(&iterate));
    task.iterate = [](void* method, const System& system, Summary& summary) {
      return (*static_cast<std::remove_reference_t<Iterate>*>(method))(system, summary);
    };
    return run(task, options, given, x);
  }

  /// Whether the last solve, if any, had as many nodes and links.
  bool fits(const System& system) const {
    return !has_run_ || (nodes_ == system.nodes() && links_ == system.link_count());
  }

  /// To be called once at every iterate, also at the start (iteration 0). Reports the iterate to
  /// SolverOptions::on_iteration, and returns whether the method has to end there, because x is stationary or
  /// because the caller has asked to stop; the verdict tells which. A gradient with NaN counts as stationary:
  /// the verdict rejects it.
  bool done(const Points& x, const Points& gradient, int iteration) {
    report(x, gradient, iteration);
    return stationary(gradient) || stopped();
  }
  /// Only reports the iterate, for a method that calls `stationary` by itself. An iterate is reported once.
  void report(const Points& x, const Points& gradient, int iteration) {
    if (!watches_ || iteration == reported_) [[likely]]
      return;
    reported_ = iteration;
    if (gap_ > 0) {
      is_close_ = is_within_gap(x);
      if (!on_iteration_) return;
    }
    using View = Eigen::Map<const Eigen::MatrixXd>;
    const double norm = gradient.template cast<double>().norm();
    evaluate(*system_, x);
    const auto energy = static_cast<double>(energy_);
    if constexpr (std::is_same_v<Scalar, double>) {
      is_stopped_ |= !on_iteration_({iteration, energy, norm, View(x.data(), x.rows(), x.cols())});
    } else {
      const Eigen::MatrixXd copy = x.template cast<double>();
      is_stopped_ |= !on_iteration_({iteration, energy, norm, View(copy.data(), copy.rows(), copy.cols())});
    }
  }
  /// Whether someone looks at iterates, or may ask to stop.
  bool watches() const { return watches_ || stop_ != nullptr; }
  /// Whether iterates are reported.
  bool reports() const { return static_cast<bool>(on_iteration_); }
  /// Whether this gradient is that of a stationary point by the stopping rule.
  bool stationary(const Points& gradient) const { return rule_.reached(gradient); }
  /// Whether the caller has asked to stop, or x is proven to be within SolverOptions::gap.
  bool stopped() const {
    return is_close_ || is_stopped_ || (stop_ != nullptr && stop_->load(std::memory_order_relaxed));
  }
  /// Whether a method has to end before the tolerance is met, because its steps are only rounding errors. For
  /// methods that do not detect this themselves, to be called at every iterate. It tests the gradient every
  /// 16 iterations: one at the level of rounding must have halved since the last test.
  bool stalls(const Points& x, const Points& gradient, int iteration) {
    constexpr int kLook = 16;
    if (iteration % kLook != 0 || !rule_.is_rounding(x, gradient)) return false;
    const Scalar before = looked_at_;
    looked_at_ = gradient.squaredNorm();
    return !(looked_at_ < before / 4);
  }
  /// The tolerance of the options, or the least one that the scalar resolves, if that is larger.
  Scalar tolerance() const { return rule_.tolerance(); }
  /// The characteristic length of the system that is solved.
  Scalar length() const { return rule_.length(); }

  /// A_ii of the system that is solved.
  const typename System::NodeVector& node_stiffness() const { return rule_.node_stiffness(); }

  /// Computes the library's energy and gradient at x. If the method ends at this x, the verdict uses these
  /// and does not compute them again; before the first call, they are those at the start.
  void evaluate(const System& system, const Points& x) {
    energy_ = energy_and_gradient(system, x, gradient_);
    evaluated_ = x;
    is_evaluated_ = true;
  }
  /// The same with the energy and gradient that the method has computed by the library's functions.
  void adopt(const Points& x, Scalar energy, const Points& gradient) {
    energy_ = energy;
    gradient_ = gradient;
    evaluated_ = x;
    is_evaluated_ = true;
  }
  Scalar energy() const { return energy_; }
  const Points& gradient() const { return gradient_; }

 private:
  // What differs from method to method, so that the frame is compiled once for all of them.
  struct Task {
    std::string_view name;
    const char* problem = nullptr;  // with the options
    bool aligns = false;
    bool reflects = false;
    void* method = nullptr;  // the callable, and how to call it
    Status (*iterate)(void* method, const System& system, Summary& summary) = nullptr;
  };

  Summary run(const Task& task, const SolverOptions& options, const System& given, Points& x) {
    const detail::Stopwatch stopwatch(options.measure_seconds);
    has_run_ = true;
    nodes_ = given.nodes();
    links_ = given.link_count();
    Summary summary;
    summary.solver = task.name;
    bool started = false;
    const auto solve = [&] {
      if (const System* system = start(task, options, given, x, summary)) {
        started = true;
        summary.iterations = summary.energy_evaluations = summary.gradient_evaluations = 0;
        summary.linear_solves = summary.factorizations = 0;
        summary.message.clear();
        if (task.aligns && options.max_iterations > 0 && !stationary(gradient_) && !stopped())
          detail::align(*system, x, task.reflects);
        judge(task.iterate(task.method, *system, summary), *system, x, summary);
      }
    };
    detail::attempt<std::bad_alloc>(solve, [&](const std::bad_alloc& error) {
      if (started) x = start_;
      summary.status = Status::OutOfMemory;
      summary.message = detail::memory_message(error);
    });
    summary.seconds = stopwatch.seconds();
    return summary;
  }

  // The system to solve, or nullptr and the reason in the summary.
  const System* start(const Task& task, const SolverOptions& options, const System& given, const Points& x,
                      Summary& summary) {
    summary.status = Status::InvalidInput;
    summary.message.clear();
    const System* system = &given;
    if (detail::shares_memory(given, x.data(), x.size())) {
      summary.message = detail::kSharesMemory;
    } else if (const Defect defect = detail::validate_values(given, x)) {
      summary.message = defect;
    } else if (task.problem != nullptr) {
      summary.message = task.problem;
    } else if (options.gap > 0 && given.has_loads()) {
      summary.message = "option gap: solvers know no lower bound of the energy of loads, see certify";
    } else if (options.gap > 0 && !options.certifier.template serves<System>()) {
      summary.message = "option gap: set the option certifier, too, to a Certifier of systems of this type";
    } else if (options.hold_floating) {
      if (const int i = detail::first_floating_load(given, scratch_); i >= 0) {
        summary.message = Defect{"node", i, "has a load and is in a connected component that nothing holds"};
      } else {
        if (detail::first_floating_node(given, scratch_) >= 0) system = grounded(given);
      }
    } else if (const Defect floating = detail::validate_components(given, scratch_)) {
      summary.message = floating;
    }
    if (!summary.message.empty()) return nullptr;
    is_evaluated_ = false;
    looked_at_ = std::numeric_limits<Scalar>::infinity();
    stop_ = options.stop;
    on_iteration_ = options.on_iteration;
    gap_ = options.gap;
    certifier_ = options.certifier;
    watches_ = on_iteration_ || gap_ > 0;
    is_stopped_ = is_close_ = false;
    lower_bound_ = -1;
    reported_ = -1;
    system_ = system;

    start_ = x;
    energy_ = energy_and_gradient(*system, x, gradient_);
    if (!detail::is_finite(energy_) || !detail::all_finite(gradient_) ||
        !rule_.set(*system, x, options.tolerance)) {
      summary.status = Status::NumericalFailure;
      summary.message = "energy or gradient at the start leave the range of the scalar";
      return nullptr;
    }
    start_energy_ = energy_;
    summary.initial_energy = static_cast<double>(energy_);
    return system;
  }

  // Fixes one node of each component that no anchor holds: the energy of such a component does not change as
  // it moves, and this keeps it where the start has it.
  [[gnu::cold]] const System* grounded(const System& given) {
    grounded_ = given;
    detail::for_each_floating_component(given, scratch_, [this](int i) { grounded_->fix(i); });
    return &*grounded_;
  }

  // Whether x is proven to be within the gap; keeps the highest lower bound so far.
  bool is_within_gap(const Points& x) {
    const std::optional<EnergyBounds> bounds = certifier_(*system_, x, gap_);
    if (!bounds) return false;
    lower_bound_ = std::max(lower_bound_, bounds->least);
    return Summary::is_within(gap_, bounds->energy, lower_bound_);
  }

  // `reason` is the method's own; energy and gradient at x may overrule it.
  void judge(Status reason, const System& system, Points& x, Summary& summary) {
    if (!(is_evaluated_ && detail::is_equal(x, evaluated_)))
      energy_ = energy_and_gradient(system, x, gradient_);
    const bool is_close = gap_ > 0 && is_within_gap(x);
    is_close_ = false;
    if (!detail::is_finite(energy_) || !detail::all_finite(gradient_)) reason = Status::NumericalFailure;
    if (reason == Status::NumericalFailure ||
        energy_ > start_energy_ + detail::rounding_of_energy(system, start_, start_energy_)) {
      x = start_;
      energy_ = energy_and_gradient(system, x, gradient_);
      if (summary.message.empty()) summary.message = "no step lowered the energy";
      if (reason != Status::NumericalFailure) reason = Status::NoProgress;
    } else if (rule_.reached(gradient_)) {
      reason = Status::Converged;
    } else if (is_close) {
      reason = Status::Converged;
      summary.message = "within the gap of the global minimum";
    } else if (stopped()) {
      reason = Status::Interrupted;
    } else if (reason == Status::Converged) {
      reason = Status::NoProgress;
    }
    summary.status = reason;
    if (summary.message.empty() && reason == Status::NoProgress && rule_.is_rounding(x, gradient_)) {
      summary.message.assign(
          "the rounding of the coordinates is above the tolerance: loosen it, or move the origin near the "
          "nodes");
    }
    if (summary.message.empty()) {
      summary.message.assign(reason == Status::Converged       ? "stationary to the tolerance"
                             : reason == Status::MaxIterations ? "not yet stationary"
                             : reason == Status::Interrupted   ? "asked to stop, not yet stationary"
                                                               : "stopped short of the tolerance");
    }
    summary.lower_bound = lower_bound_;
    summary.final_energy = static_cast<double>(energy_);
    summary.gradient_norm = gradient_.template cast<double>().norm();
    summary.stationarity = static_cast<double>(rule_.stationarity(gradient_));
  }

  bool has_run_ = false;
  int nodes_ = 0;  // of the last system
  int links_ = 0;
  detail::StoppingRule<System> rule_;
  const std::atomic<bool>* stop_ = nullptr;
  IterationCallback on_iteration_;
  bool watches_ = false;     // whether iterates are looked at
  bool is_stopped_ = false;  // by on_iteration
  int reported_ = -1;        // the last iteration that was looked at
  double gap_ = 0;
  CertifierReference certifier_;
  bool is_close_ = false;           // as close as gap_
  double lower_bound_ = -1;         // of all iterates
  const System* system_ = nullptr;  // that is solved
  std::optional<System> grounded_;
  detail::ComponentScratch<System> scratch_;
  Points start_;
  Points gradient_;
  Points evaluated_;  // where energy_ and gradient_ are from, if is_evaluated_
  bool is_evaluated_ = false;
  Scalar energy_ = 0;
  Scalar start_energy_ = 0;
  Scalar looked_at_ = 0;  // the gradient squared, by stalls()
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
