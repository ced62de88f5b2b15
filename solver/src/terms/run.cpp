#include "run.hpp"

#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/terms/solution.hpp>
#include <cmath>
#include <limits>
#include <new>
#include <string>
#include <vector>

#include "direction.hpp"
#include "matrix.hpp"
#include "rotation.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

bool shares_memory(const System& system, const Eigen::MatrixXd& x) {
  for (int t = 0; x.size() > 0 && t < system.term_count(); ++t) {
    for (const Column& column : system.term(t).columns()) {
      if (column.values.data() == x.data()) return true;
    }
  }
  return false;
}

Summary SystemRun::solve(std::string_view name, const AlignedOptions& options, const System& system,
                         Points& x, const Iterate& iterate) {
  const Stopwatch stopwatch;
  SystemRun run(options, x);
  run.summary_.solver = name;
  // If a user's function throws, x is as it was.
  struct Restore {
    SystemRun& run;
    bool is_needed = false;
    ~Restore() {
      if (is_needed) run.x_->swap(run.start_);
    }
  } restore{run};
  const auto work = [&] {
    if (const char* problem = options.problem()) {
      run.summary_.status = Status::InvalidInput;
      run.summary_.message = problem;
    } else if (run.start(system)) {
      restore.is_needed = true;
      run.judge(iterate(run));
      restore.is_needed = false;
    }
  };
  attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) {
    run.summary_.status = Status::OutOfMemory;
    run.summary_.message = memory_message(error);
  });
  run.summary_.seconds = stopwatch.seconds();
  return run.summary_;
}

bool SystemRun::start(const System& given) {
  summary_.status = Status::InvalidInput;
  system_ = &given;
  if (const std::string problem = validate(given, *x_, !options_.hold_floating); !problem.empty()) {
    summary_.message = std::string_view(problem);
    return false;
  }
  if (options_.hold_floating) {
    if (const std::vector<int> floating = floating_nodes(given); !floating.empty()) {
      grounded_ = given;
      for (const int node : floating) grounded_->fix(node);
      system_ = &*grounded_;
    }
  }
  if (shares_memory(given, *x_)) {
    summary_.message = kSharesMemory;
    return false;
  }
  start_ = *x_;
  energy_ = energy_and_gradient(*system_, *x_, gradient_);
  if (!is_finite(energy_) || !all_finite(gradient_) || !rule_.set(*system_, *x_, options_.tolerance)) {
    summary_.status = Status::NumericalFailure;
    summary_.message = "energy or gradient at the start leave the range of the scalar";
    return false;
  }
  start_energy_ = lowest_ = energy_;
  summary_.initial_energy = energy_;
  summary_.message.clear();
  summary_.iterations = summary_.energy_evaluations = summary_.gradient_evaluations = 0;
  summary_.linear_solves = summary_.factorizations = 0;
  last_tested_ = std::numeric_limits<double>::infinity();
  if (options_.align && options_.max_iterations > 0 && !rule_.reached(gradient_) && !options_.stopped())
    align(options_.allow_reflection);
  return true;
}

void SystemRun::align(bool allow_reflection) {
  const int dim = system_->dim();
  const auto position_of = [dim](const Scales::Place& place) {
    return Eigen::Map<const Eigen::VectorXd>(place.position, dim);
  };
  double total = 0;
  Eigen::VectorXd centre = Eigen::VectorXd::Zero(dim), place_centre = centre;
  for (const Scales::Place& place : rule_.places()) {
    total += place.stiffness;
    centre += place.stiffness * x_->col(place.node);
    place_centre += place.stiffness * position_of(place);
  }
  if (!(total > 0 && is_finite(total))) return;
  centre /= total;
  place_centre /= total;
  Eigen::MatrixXd moments = Eigen::MatrixXd::Zero(dim, dim);
  for (const Scales::Place& place : rule_.places())
    moments +=
        place.stiffness * (position_of(place) - place_centre) * (x_->col(place.node) - centre).transpose();
  if (!all_finite(moments)) return;
  const Eigen::MatrixXd rotation = nearest_rotation(moments, allow_reflection);
  const Points centred = x_->colwise() - centre;
  Points moved = rotation.lazyProduct(centred).colwise() + place_centre;
  for (int i = 0; i < system_->nodes(); ++i) {
    if (system_->is_fixed(i)) moved.col(i) = x_->col(i);
  }
  Points gradient;
  const double energy = energy_and_gradient(*system_, moved, gradient);
  if (!(energy < energy_ - rounding(energy_)) || !all_finite(gradient)) return;
  *x_ = moved;
  energy_ = lowest_ = energy;
  gradient_ = gradient;
}

bool SystemRun::pass_on(const Iteration& at) {
  is_stopped_ |= !options_.on_iteration(at);
  return !is_stopped_;
}

double SystemRun::rounding(double energy) const { return energy_rounding(*system_, *x_, energy); }

bool SystemRun::is_asked_to_stop() { return is_stopped_ |= options_.stopped(); }

bool SystemRun::report() {
  if (options_.gap > 0) {
    const Certificate certificate = certify(*system_, *x_, {options_.gap});
    if (certificate.proof != Proof::NotApplicable)
      lower_bound_ = std::max(lower_bound_, certificate.lower_bound);
    is_within_gap_ = Summary::is_within(options_.gap, energy_, lower_bound_);
  }
  if (options_.on_iteration) {
    is_stopped_ |= !options_.on_iteration(
        {summary_.iterations, energy_, gradient_.norm(), {x_->data(), x_->rows(), x_->cols()}});
  }
  is_stopped_ |= options_.stopped();
  return is_stopped_ || is_within_gap_;
}

// By the stiffness and length at x: those of some terms have changed since the start.
bool SystemRun::is_stationary() {
  if (!rule_.reached(gradient_)) return false;
  rule_.renew(*system_, *x_);
  return rule_.reached(gradient_);
}

bool SystemRun::is_over() {
  constexpr int kLook = 16;  // iterations between tests whether the gradient is only rounding
  end_ = Status::Converged;
  if (report() || is_stationary()) return true;
  end_ = Status::MaxIterations;
  if (summary_.iterations >= options_.max_iterations) return true;
  end_ = Status::NoProgress;
  if (summary_.iterations % kLook != 0 || !rule_.is_rounding(*x_, gradient_)) return false;
  const double before = last_tested_;
  last_tested_ = gradient_.squaredNorm();
  return !(last_tested_ < before / 4);
}

bool SystemRun::search(const Points& direction, double& step) {
  constexpr double kDecrease = 1e-4, kFlatter = 0.8;
  constexpr int kMaxTrials = 60;
  const double slope = gradient_.cwiseProduct(direction).sum();
  if (!(slope < 0) || !is_finite(slope)) return false;
  const double rounding = this->rounding(lowest_);
  for (int trial = 0; trial < kMaxTrials; ++trial) {
    other_x_ = *x_ + step * direction;
    const double energy = energy_and_gradient(*system_, other_x_, other_gradient_);
    ++summary_.energy_evaluations, ++summary_.gradient_evaluations;
    const double slope_there = other_gradient_.cwiseProduct(direction).sum();
    const bool is_lower = energy <= energy_ + kDecrease * step * slope;
    if (is_finite(energy) && is_finite(slope_there) &&
        (is_lower || (energy <= lowest_ + rounding && slope_there <= -kFlatter * slope))) {
      x_->swap(other_x_);
      gradient_.swap(other_gradient_);
      energy_ = energy;
      lowest_ = std::min(lowest_, energy);
      return true;
    }
    // The minimum of the parabola through the energies and the slope at the start.
    double shorter = -slope * step * step / (2 * (energy - energy_ - slope * step));
    shorter = is_finite(shorter) ? std::clamp(shorter, step / 10, step / 2) : step / 10;
    if (!((shorter * direction).cwiseAbs().maxCoeff() >
          std::numeric_limits<double>::epsilon() * x_->cwiseAbs().maxCoeff() / 16))
      return false;
    step = shorter;
  }
  return false;
}

void SystemRun::move_to(const Points& x) {
  *x_ = x;
  evaluate_after_move();
}

void SystemRun::move_by(double factor, const Points& step) {
  *x_ += factor * step;
  evaluate_after_move();
}

void SystemRun::evaluate_after_move() {
  other_gradient_.swap(gradient_);
  energy_ = energy_and_gradient(*system_, *x_, gradient_);
  lowest_ = std::min(lowest_, energy_);
  ++summary_.energy_evaluations, ++summary_.gradient_evaluations;
}

double SystemRun::trusted_step(const Points& direction) const {
  constexpr double kTrusted = 4;
  const double reach = rule_.stationarity(gradient_) * rule_.length();
  return std::min(1.0, kTrusted * std::max(rule_.length(), reach) / direction.colwise().norm().maxCoeff());
}

bool SystemRun::lacks_hessian() {
  const std::string missing = missing_curvature(*system_, Curvature::True);
  if (missing.empty()) return false;
  summary_.message = std::string_view("the method needs second derivatives: " + missing);
  return true;
}

// `reason` is the method's own; energy and gradient at x may overrule it.
void SystemRun::judge(Status reason) {
  const bool is_rounding = rule_.is_rounding(*x_, gradient_);
  if (!is_finite(energy_) || !all_finite(gradient_)) reason = Status::NumericalFailure;
  if (reason == Status::NumericalFailure || energy_ > start_energy_ + rounding(start_energy_)) {
    *x_ = start_;
    energy_ = energy_and_gradient(*system_, *x_, gradient_);
    summary_.positive_definite.reset();
    if (summary_.message.empty()) summary_.message = "no step lowered the energy";
    if (reason != Status::NumericalFailure) reason = Status::NoProgress;
  } else if (reason == Status::InvalidInput) {
    *x_ = start_;
  } else if (is_stationary()) {
    reason = Status::Converged;
  } else if (is_within_gap_) {
    reason = Status::Converged;
    summary_.message = "within the gap of the global minimum";
  } else if (is_stopped_) {
    reason = Status::Interrupted;
  } else if (reason == Status::Converged) {
    reason = Status::NoProgress;
  }
  summary_.status = reason;
  if (summary_.message.empty()) {
    summary_.message.assign(
        reason == Status::Converged       ? "stationary to the tolerance"
        : reason == Status::MaxIterations ? "not yet stationary"
        : reason == Status::Interrupted   ? "asked to stop, not yet stationary"
        : is_rounding
            ? "the rounding of the coordinates is above the tolerance: loosen it, or move the origin "
              "near the nodes"
            : "stopped short of the tolerance");
  }
  summary_.lower_bound = lower_bound_;
  summary_.final_energy = energy_;
  summary_.gradient_norm = stable_norm(gradient_);
  summary_.stationarity = rule_.stationarity(gradient_);
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
