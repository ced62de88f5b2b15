#pragma once

#include <Eigen/Core>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <string_view>

#include "../laboratory.hpp"

namespace asterism::bench {

/// The energy of a system in the form that other packages take: a function of 2 N numbers, scaled to unit
/// stiffness and length to suit their constants, with the laboratory's stopping rule.
class Objective {
 public:
  /// Unit stiffness and length, or the numbers of the system.
  enum class Units { Scaled, OfTheSystem };

  Objective(const System& system, const Points& start, Session<System>& session, Summary& summary,
            Units units = Units::Scaled)
      : system_(system), session_(session), summary_(summary), x_(start), gradient_(start) {
    if (units == Units::Scaled) {
      const double length = characteristic_length(system, start);
      const double stiffness = node_stiffness(system).maxCoeff();
      if (length > 0) length_ = length;
      if (stiffness > 0) stiffness_ = stiffness;
    }
    best_energy_ = summary.initial_energy;
    best_ = start;
  }

  int size() const { return static_cast<int>(x_.size()); }
  void write(const Points& x, double* numbers) const {
    Eigen::Map<Points>(numbers, 2, x.cols()) = x / length_;
  }

  /// Energy at `numbers`, and its gradient if that is not null.
  double operator()(const double* numbers, double* gradient) {
    x_ = length_ * Eigen::Map<const Points>(numbers, 2, x_.cols());
    const bool wants_gradient = gradient != nullptr;
    const double energy =
        wants_gradient ? energy_and_gradient(system_, x_, gradient_) : asterism::energy(system_, x_);
    ++summary_.energy_evaluations;
    summary_.gradient_evaluations += wants_gradient;
    if (energy <= best_energy_) {
      best_energy_ = energy;
      best_ = x_;
      done_ = wants_gradient && (session_.stationary(gradient_) || session_.stopped());
    }
    const double unit = stiffness_ * length_;
    if (wants_gradient) Eigen::Map<Points>(gradient, 2, x_.cols()) = gradient_ / unit;
    return energy / (unit * length_);
  }

  /// Writes the second derivatives at `numbers`, a symmetric matrix of size() x size().
  void hessian(const double* numbers, double* matrix) {
    x_ = length_ * Eigen::Map<const Points>(numbers, 2, x_.cols());
    Eigen::Map<Eigen::MatrixXd>(matrix, size(), size()) = asterism::hessian(system_, x_) / stiffness_;
  }

  /// Whether the lowest point seen is stationary by the stopping rule, or the caller has asked to stop.
  bool done() const { return done_; }
  /// To be called by a method after each of its iterations: reports it, and returns whether to stop.
  bool iterated() {
    ++summary_.iterations;
    if (session_.reports()) {
      session_.report(best_, gradient(system_, best_), summary_.iterations);
      done_ |= session_.stopped();
    }
    return done_;
  }
  /// The lowest point seen.
  const Points& best() const { return best_; }

 private:
  const System& system_;
  Session<System>& session_;
  Summary& summary_;
  Points x_;
  Points gradient_;
  Points best_;
  double best_energy_ = 0;
  double length_ = 1;
  double stiffness_ = 1;
  bool done_ = false;
};

/// A minimiser of another package as a solver. `Method` has a static name() and
/// static Status minimise(Objective&, const Points& start, int max_iterations, Summary&), which calls the
/// objective's iterated() after each iteration and stops once it is done.
template <typename Method>
class PeerSolver {
 public:
  SolverOptions options;

  static constexpr std::string_view name() { return Method::name(); }

  Summary solve(const System& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      if (session_.done(x, session_.gradient(), 0)) return Status::Converged;
      if (options.max_iterations == 0) return Status::MaxIterations;
      Objective objective(system, x, session_, summary);
      const Status status = Method::minimise(objective, x, options.max_iterations, summary);
      x = objective.best();
      return objective.done() ? Status::Converged : status;
    });
  }

 private:
  Session<System> session_;
};

}  // namespace asterism::bench
