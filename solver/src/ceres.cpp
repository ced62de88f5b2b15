#include <ceres/ceres.h>
#include <ceres/version.h>
#include <glog/logging.h>

#include <algorithm>
#include <asterism/solver/reference/ceres.hpp>
#include <cmath>
#include <memory>
#include <mutex>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace reference {

const char* ceres_version() { return CERES_VERSION_STRING; }

namespace detail {

namespace {

// Ceres 2.1 warns through glog whatever its logging_type says. glog's level belongs to the process: the first
// of several concurrent solves raises it, and the last restores it.
class QuietGlog {
 public:
  QuietGlog() {
    const std::scoped_lock lock(mutex);
    if (users++ == 0)
      level = std::exchange(FLAGS_minloglevel, std::max(FLAGS_minloglevel, google::GLOG_FATAL));
  }
  ~QuietGlog() {
    const std::scoped_lock lock(mutex);
    if (--users == 0) FLAGS_minloglevel = level;
  }
  QuietGlog(const QuietGlog&) = delete;
  QuietGlog& operator=(const QuietGlog&) = delete;

 private:
  static inline std::mutex mutex;
  static inline int users = 0;
  static inline int level = 0;
};

// sqrt(k_i) (x_i - a_i)
class AnchorResidual final : public ceres::CostFunction {
 public:
  AnchorResidual(int dim, double stiffness, const double* anchor)
      : dim_(dim), weight_(std::sqrt(stiffness)), anchor_(anchor) {
    set_num_residuals(dim);
    mutable_parameter_block_sizes()->push_back(dim);
  }

  bool Evaluate(const double* const* x, double* residuals, double** jacobians) const override {
    for (int d = 0; d < dim_; ++d) residuals[d] = weight_ * (x[0][d] - anchor_[d]);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      std::fill_n(jacobians[0], dim_ * dim_, 0.0);
      for (int d = 0; d < dim_; ++d) jacobians[0][d * dim_ + d] = weight_;
    }
    return true;
  }

 private:
  int dim_;
  double weight_;
  const double* anchor_;
};

// sqrt(k_ij) (|x_i - x_j - m_ij| - mu_ij)
class LinkResidual final : public ceres::CostFunction {
 public:
  LinkResidual(const CeresProblem& problem, int link)
      : problem_(problem),
        link_(problem.links[static_cast<std::size_t>(link)]),
        weight_(std::sqrt(problem.link_stiffness[link])),
        rest_length_(problem.rest_length[link]),
        offset_(problem.rest_offset != nullptr
                    ? problem.rest_offset + static_cast<std::ptrdiff_t>(link) * problem.dim
                    : nullptr) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->assign(2, problem.dim);
  }

  bool Evaluate(const double* const* x, double* residuals, double** jacobians) const override {
    const int dim = problem_.dim;
    thread_local std::vector<double> direction;
    direction.resize(static_cast<std::size_t>(dim));
    std::transform(x[0], x[0] + dim, x[1], direction.begin(), std::minus<>());
    if (offset_ != nullptr) {
      std::transform(direction.begin(), direction.end(), offset_, direction.begin(), std::minus<>());
    }
    const double length = problem_.spring(link_, direction.data());
    residuals[0] = weight_ * (length - rest_length_);
    for (int end = 0; jacobians != nullptr && end < 2; ++end) {
      if (jacobians[end] == nullptr) continue;
      const double sign = end == 0 ? weight_ : -weight_;
      std::transform(direction.begin(), direction.end(), jacobians[end],
                     [sign](double u) { return sign * u; });
    }
    return true;
  }

 private:
  const CeresProblem& problem_;
  Link link_;
  double weight_;
  double rest_length_;
  const double* offset_;  // m_ij, or none
};

// sqrt(k_ij) (x_i - x_j - m_ij), of a link without rest length: as one length it would bend where that is 0.
class OffsetResidual final : public ceres::CostFunction {
 public:
  OffsetResidual(const CeresProblem& problem, int link)
      : dim_(problem.dim),
        weight_(std::sqrt(problem.link_stiffness[link])),
        offset_(problem.rest_offset + static_cast<std::ptrdiff_t>(link) * problem.dim) {
    set_num_residuals(dim_);
    mutable_parameter_block_sizes()->assign(2, dim_);
  }

  bool Evaluate(const double* const* x, double* residuals, double** jacobians) const override {
    for (int d = 0; d < dim_; ++d) residuals[d] = weight_ * (x[0][d] - x[1][d] - offset_[d]);
    for (int end = 0; jacobians != nullptr && end < 2; ++end) {
      if (jacobians[end] == nullptr) continue;
      std::fill_n(jacobians[end], dim_ * dim_, 0.0);
      for (int d = 0; d < dim_; ++d) jacobians[end][d * dim_ + d] = end == 0 ? weight_ : -weight_;
    }
    return true;
  }

 private:
  int dim_;
  double weight_;
  const double* offset_;
};

// Stops Ceres by the library's rule.
class StopWhenDone final : public ceres::IterationCallback {
 public:
  StopWhenDone(const CeresProblem& problem, const double* x) : problem_(problem), x_(x) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& at) override {
    return problem_.done(x_, at.iteration) ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }

 private:
  const CeresProblem& problem_;
  const double* x_;
};

ceres::Solver::Options options_of(CeresMethod method) {
  ceres::Solver::Options options;
  switch (method) {
    case CeresMethod::LevenbergMarquardtDense:
      options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
      break;
    case CeresMethod::LevenbergMarquardtSparse:
      options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
      break;
    case CeresMethod::Lbfgs:
      options.minimizer_type = ceres::LINE_SEARCH;
      options.line_search_direction_type = ceres::LBFGS;
      break;
    case CeresMethod::NonlinearCg:
      options.minimizer_type = ceres::LINE_SEARCH;
      options.line_search_direction_type = ceres::NONLINEAR_CONJUGATE_GRADIENT;
      options.nonlinear_conjugate_gradient_type = ceres::POLAK_RIBIERE;
      break;
  }
  options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0;
  options.logging_type = ceres::SILENT;
  options.minimizer_progress_to_stdout = false;
  options.update_state_every_iteration = true;
  options.num_threads = 1;
  return options;
}

}  // namespace

Status minimise(const CeresProblem& problem, CeresMethod method, int max_iterations, double* x,
                Summary& summary) {
  const QuietGlog quiet;
  ceres::Problem ceres_problem;
  const auto node = [&](int i) { return x + static_cast<std::ptrdiff_t>(i) * problem.dim; };
  for (int i = 0; i < problem.nodes; ++i) {
    ceres_problem.AddParameterBlock(node(i), problem.dim);
    if (problem.is_fixed(i)) ceres_problem.SetParameterBlockConstant(node(i));
    if (!(problem.anchor_stiffness[i] > 0)) continue;
    const double* anchor = problem.anchors + static_cast<std::ptrdiff_t>(i) * problem.dim;
    ceres_problem.AddResidualBlock(new AnchorResidual(problem.dim, problem.anchor_stiffness[i], anchor),
                                   nullptr, node(i));
  }
  int l = 0;
  for (const Link& link : problem.links) {
    if (problem.link_stiffness[l] > 0) {
      const bool is_vector = problem.rest_offset != nullptr && problem.rest_length[l] == 0;
      ceres::CostFunction* residual = nullptr;
      if (is_vector) {
        residual = new OffsetResidual(problem, l);
      } else {
        residual = new LinkResidual(problem, l);
      }
      ceres_problem.AddResidualBlock(residual, nullptr, node(link.i), node(link.j));
    }
    ++l;
  }

  ceres::Solver::Options options = options_of(method);
  options.max_num_iterations = max_iterations;
  StopWhenDone stop(problem, x);
  options.callbacks.push_back(&stop);
  ceres::Solver::Summary result;
  ceres::Solve(options, &ceres_problem, &result);

  summary.message = std::string_view(result.message);
  summary.iterations =
      std::max(0, static_cast<int>(result.iterations.size()) - 1);  // the start is in the list
  summary.energy_evaluations = result.num_residual_evaluations;
  summary.gradient_evaluations = result.num_jacobian_evaluations;
  summary.linear_solves = summary.factorizations = std::max(0, result.num_linear_solves);
  switch (result.termination_type) {
    case ceres::CONVERGENCE:
    case ceres::USER_SUCCESS:
      return Status::Converged;
    case ceres::NO_CONVERGENCE:
      return Status::MaxIterations;
    case ceres::FAILURE:
    case ceres::USER_FAILURE:
      break;
  }
  return result.IsSolutionUsable() ? Status::NoProgress : Status::NumericalFailure;
}

}  // namespace detail

}  // namespace reference
}  // namespace ASTERISM_ABI
}  // namespace asterism
