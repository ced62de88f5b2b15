// Ceres's TinySolver: Levenberg-Marquardt for small dense problems, header-only, without allocation where the
// sizes are compiled in. The springs are the same least squares as those of asterism::ceres.
#include <ceres/tiny_solver.h>
#include <ceres/version.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <limits>
#include <memory>
#include <string_view>
#include <type_traits>
#include <utility>

#include "../laboratory.hpp"

namespace asterism::bench {
namespace {

template <typename SpringSystem>
class CeresTiny {
 public:
  using Points = typename SpringSystem::Points;

  SolverOptions options;

  static constexpr std::string_view name() { return "Ceres, TinySolver"; }

  Summary solve(const SpringSystem& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const SpringSystem& system, Summary& summary) {
      if (session_.done(x, session_.gradient(), 0)) return Status::Converged;
      if (options.max_iterations == 0) return Status::MaxIterations;
      const double stiffest = session_.node_stiffness().maxCoeff();
      const double unit = stiffest > 0 ? stiffest : 1;
      anchor_roots_ = (system.anchor_stiffness / unit).cwiseSqrt();
      link_roots_ = (system.link_stiffness / unit).cwiseSqrt();
      x_ = gradient_ = x;
      numbers_ = x.reshaped();

      // Its own rules are off, but for the one that sees steps below the rounding of the coordinates.
      solver_.options.max_num_iterations =
          std::min(options.max_iterations, std::numeric_limits<int>::max() - 1) + 1;
      solver_.options.gradient_tolerance = 0;
      solver_.options.function_tolerance = 0;
      solver_.options.cost_threshold = 0;
      solver_.options.parameter_tolerance = std::numeric_limits<double>::epsilon();
      solver_.Solve(Springs{*this, system, summary}, &numbers_);

      x = numbers_.reshaped(x.rows(), x.cols());
      const bool is_at_limit = solver_.summary.status == Solver::HIT_MAX_ITERATIONS;
      summary.iterations = is_at_limit ? options.max_iterations : solver_.summary.iterations;
      summary.linear_solves = summary.factorizations = summary.iterations;
      if (solver_.summary.status == Solver::GRADIENT_TOO_SMALL) return Status::Converged;  // see Springs
      return is_at_limit ? Status::MaxIterations : Status::NoProgress;
    });
  }

 private:
  /// Residuals sqrt(k_i) (x_i - a_i) and sqrt(k_ij) (r_ij - mu_ij), as TinySolver wants them, in units of the
  /// largest stiffness, for TinySolver's least diagonal of 1e-6 to fit; its other constants have no units.
  struct Springs {
    using Scalar = double;
    static constexpr int kDim = SpringSystem::kDim;
    static constexpr bool kIsFixed = SpringSystem::kNodes != Eigen::Dynamic;
    enum {
      NUM_PARAMETERS = kIsFixed ? kDim * SpringSystem::kNodes : Eigen::Dynamic,
      NUM_RESIDUALS =
          kIsFixed ? kDim * SpringSystem::kNodes + SpringSystem::TopologyType::kMaxLinks : Eigen::Dynamic
    };

    CeresTiny& solver;
    const SpringSystem& system;
    Summary& summary;

    int NumParameters() const { return kDim * system.nodes(); }
    int NumResiduals() const {
      return kIsFixed ? static_cast<int>(NUM_RESIDUALS) : NumParameters() + system.link_count();
    }

    /// TinySolver asks for the Jacobian at its iterates alone, and tests its gradient tolerance right
    /// afterwards: that is where the library's stopping rule ends it.
    bool operator()(const double* numbers, double* residuals, double* jacobian) const {
      solver.x_ = Eigen::Map<const Points>(numbers, kDim, system.nodes());
      ++summary.energy_evaluations;
      if (jacobian == nullptr) {
        evaluate<false>(residuals, nullptr);
        return true;
      }
      ++summary.gradient_evaluations;
      evaluate<true>(residuals, jacobian);
      const int iteration = solver.solver_.summary.iterations;
      if (iteration > 0 && solver.session_.done(solver.x_, solver.gradient_, iteration))
        solver.solver_.options.gradient_tolerance = std::numeric_limits<double>::infinity();
      return true;
    }

    /// At x_; with derivatives also the gradient of the energy, in the system's own units.
    template <bool kDerivatives>
    void evaluate(double* residuals, double* jacobian) const {
      using Residuals = Eigen::Matrix<double, NUM_RESIDUALS, 1>;
      using Jacobian = Eigen::Matrix<double, NUM_RESIDUALS, NUM_PARAMETERS>;
      Eigen::Map<Residuals> r(residuals, NumResiduals());
      Eigen::Map<Jacobian> j(jacobian, NumResiduals(), NumParameters());
      Points& gradient = solver.gradient_;
      if constexpr (kDerivatives) j.setZero();
      const auto on_anchor = [&](int i, const auto& offset) {
        const double root = solver.anchor_roots_[i];
        r.template segment<kDim>(kDim * i) = root * offset;
        if constexpr (kDerivatives) {
          j.template block<kDim, kDim>(kDim * i, kDim * i).diagonal().setConstant(root);
          gradient.col(i) = system.anchor_stiffness[i] * offset;
        }
      };
      const auto on_link = [&](int l, const Link& link, const auto& force, const auto& spring) {
        const double root = solver.link_roots_[l];
        const int row = NumParameters() + l;
        r[row] = root * asterism::detail::link_potential(system, l, spring.length).first;
        if constexpr (kDerivatives) {
          const auto slope = (root * spring.direction).transpose().eval();
          j.template block<1, kDim>(row, kDim * link.i) = slope;
          j.template block<1, kDim>(row, kDim * link.j) = -slope;
          const auto pull = (force.tension * spring.direction).eval();
          gradient.col(link.i) += pull;
          gradient.col(link.j) -= pull;
        }
      };
      asterism::detail::for_each_spring(system, solver.x_, on_anchor, on_link);
      for (int row = NumParameters() + system.link_count(); row < NumResiduals(); ++row) r[row] = 0;
      if constexpr (kDerivatives) {
        asterism::detail::clear_fixed(system, gradient);
        for (int i = 0; system.fixed_count() > 0 && i < system.nodes(); ++i) {
          if (system.is_fixed(i)) j.template middleCols<kDim>(kDim * i).setZero();
        }
      }
    }
  };

  // TinySolver has one trust region, and takes any factorisation of Eigen. For eight numbers PartialPivLU was
  // the fastest: systems of four nodes took about 15 % less time than with the default LDLT, and with LLT
  // about 5 % more. From 9 to 16 nodes the three did not differ.
  using Square = Eigen::Matrix<double, Springs::NUM_PARAMETERS, Springs::NUM_PARAMETERS>;
  using Solver = ceres::TinySolver<
      Springs, std::conditional_t<Springs::kIsFixed, Eigen::PartialPivLU<Square>, Eigen::LDLT<Square>>>;

  Session<SpringSystem> session_;
  Solver solver_;
  typename Solver::Parameters numbers_;
  typename SpringSystem::NodeVector anchor_roots_;  // sqrt(k_i), scaled
  typename SpringSystem::LinkVector link_roots_;    // sqrt(k_ij), scaled
  Points x_;
  Points gradient_;
};

std::unique_ptr<Runner> make_tiny(int nodes) {
  if (nodes == FourNodes::kNodes)
    return std::make_unique<RunnerOf<FourNodes>>(
        AnySolver<FourNodes>(std::in_place_type<CeresTiny<FourNodes>>));
  return make_runner<CeresTiny<System>>(nodes);
}

const Registration kTiny({"ceres-tiny", std::string(CeresTiny<System>::name()), "Ceres " CERES_VERSION_STRING,
                          36, 0, make_tiny});

}  // namespace
}  // namespace asterism::bench
