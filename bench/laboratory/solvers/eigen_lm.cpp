// Levenberg-Marquardt of Eigen's unsupported modules, a C++ port of MINPACK's, on the springs as least
// squares.
#include <Eigen/Core>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <unsupported/Eigen/NonLinearOptimization>

#include "../laboratory.hpp"

namespace asterism::bench {
namespace {

/// Residuals sqrt(k_i) (x_i - a_i) and sqrt(k_ij) (r_ij - mu_ij), and their dense Jacobian.
class Residuals {
 public:
  using Scalar = double;
  enum { InputsAtCompileTime = Eigen::Dynamic, ValuesAtCompileTime = Eigen::Dynamic };
  using InputType = Eigen::VectorXd;
  using ValueType = Eigen::VectorXd;
  using JacobianType = Eigen::MatrixXd;

  explicit Residuals(const System& system) : system_(system) {}

  int inputs() const { return 2 * system_.nodes(); }
  int values() const { return inputs() + system_.link_count(); }

  int operator()(const Eigen::VectorXd& numbers, Eigen::VectorXd& residuals) const {
    const Eigen::Map<const Points> x(numbers.data(), 2, system_.nodes());
    for (int i = 0; i < system_.nodes(); ++i) {
      residuals.segment<2>(2 * i) =
          std::sqrt(system_.anchor_stiffness[i]) * (x.col(i) - system_.anchors.col(i));
    }
    for (int l = 0; const Link& link : system_.links()) {
      const double length = (x.col(link.i) - x.col(link.j)).norm();
      residuals[inputs() + l] = std::sqrt(system_.link_stiffness[l]) * (length - system_.rest_length[l]);
      ++l;
    }
    return 0;
  }

  int df(const Eigen::VectorXd& numbers, Eigen::MatrixXd& jacobian) const {
    const Eigen::Map<const Points> x(numbers.data(), 2, system_.nodes());
    jacobian.setZero();
    for (int i = 0; i < system_.nodes(); ++i) {
      jacobian.block<2, 2>(2 * i, 2 * i).diagonal().setConstant(std::sqrt(system_.anchor_stiffness[i]));
    }
    for (int l = 0; const Link& link : system_.links()) {
      const Eigen::Vector2d d = x.col(link.i) - x.col(link.j);
      const double length = d.norm();
      const Eigen::Vector2d along = length > 0 ? Eigen::Vector2d(d / length) : Eigen::Vector2d(1, 0);
      const double root = std::sqrt(system_.link_stiffness[l]);
      jacobian.block<1, 2>(inputs() + l, 2 * link.i) = root * along.transpose();
      jacobian.block<1, 2>(inputs() + l, 2 * link.j) = -root * along.transpose();
      ++l;
    }
    for (int i = 0; i < system_.nodes(); ++i) {
      if (system_.is_fixed(i)) jacobian.middleCols<2>(2 * i).setZero();
    }
    return 0;
  }

 private:
  const System& system_;
};

class EigenLm {
 public:
  SolverOptions options;

  static constexpr std::string_view name() { return "Eigen, Levenberg-Marquardt (unsupported module)"; }

  Summary solve(const System& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      if (session_.done(x, session_.gradient(), 0)) return Status::Converged;
      if (options.max_iterations == 0) return Status::MaxIterations;
      Residuals residuals(system);
      Eigen::LevenbergMarquardt<Residuals> lm(residuals);
      lm.parameters.ftol = lm.parameters.xtol = lm.parameters.gtol = 0;
      lm.parameters.maxfev = std::numeric_limits<int>::max();
      Eigen::VectorXd numbers = x.reshaped();
      auto status = lm.minimizeInit(numbers);
      while (status == Eigen::LevenbergMarquardtSpace::NotStarted ||
             status == Eigen::LevenbergMarquardtSpace::Running) {
        if (summary.iterations == options.max_iterations) break;
        status = lm.minimizeOneStep(numbers);
        ++summary.iterations;
        const Points at = numbers.reshaped(2, x.cols());
        session_.evaluate(system, at);
        if (session_.done(at, session_.gradient(), summary.iterations)) break;
      }
      x = numbers.reshaped(2, x.cols());
      summary.energy_evaluations = static_cast<int>(lm.nfev);
      summary.gradient_evaluations = static_cast<int>(lm.njev);
      summary.message.assign("Eigen's status ").append(static_cast<int>(status));
      if (session_.stationary(session_.gradient())) return Status::Converged;
      return summary.iterations == options.max_iterations ? Status::MaxIterations : Status::NoProgress;
    });
  }

 private:
  Session<System> session_;
};

const Registration kLm({"eigen-lm", std::string(EigenLm::name()),
                        format("Eigen %d.%d.%d", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION,
                               EIGEN_MINOR_VERSION),
                        36, 0, make_runner<EigenLm>});

}  // namespace
}  // namespace asterism::bench
