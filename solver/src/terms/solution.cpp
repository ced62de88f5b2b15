#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <asterism/solver/terms/solution.hpp>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "definite.hpp"
#include "matrix.hpp"
#include "prover.hpp"
#include "stopping_rule.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Finds nodes that coincide although a link pushes them apart. The energy has a peak there, which the Hessian
// does not show; what bounds it from below shows it.
class PeakFinder final : public CurvatureSink {
 public:
  explicit PeakFinder(const System& system) : system_(system) {}

  void add(const int* nodes, int count, const double* matrix, int rows) override {
    const auto is_fixed = [&](int node) { return system_.is_fixed(node); };
    if (problem.empty() && std::any_of(matrix, matrix + rows * rows, [](double m) { return m < -1e280; }) &&
        !std::all_of(nodes, nodes + count, is_fixed))
      problem = "a link pushes nodes " + std::to_string(nodes[0]) + " and " +
                std::to_string(nodes[count - 1]) + " apart, and has no length: x is not a local minimum";
  }

  std::string problem;  // empty if there is none

 private:
  const System& system_;
};

std::string peak(const System& system, const Eigen::MatrixXd& x) {
  PeakFinder finder(system);
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    if (dynamic_cast<const LengthTerm*>(&term) != nullptr)
      term.add_curvature(x, Curvature::Minorising, finder);
  }
  return finder.problem;
}

}  // namespace

struct Solution::Factored {
  Factored(const System& s, const Eigen::MatrixXd& at) : system(s), x(at) {}

  // Whether x is a stationary point, and the Hessian may owe it to a solver's tolerance that it is definite.
  bool is_free() const {
    constexpr double kStationary = 1e-6;  // as SensitivityOptions
    detail::SystemRule rule;
    Eigen::MatrixXd gradient;
    energy_and_gradient(system, x, gradient);
    return rule.set(system, x, kStationary) && rule.reached(gradient) &&
           !detail::is_surely_definite(system, x, gradient, rule, matrix, factor);
  }

  System system;
  Eigen::MatrixXd x;
  detail::SystemMatrix matrix{detail::SystemMatrix::Storage::Sparse};
  detail::SystemFactor factor;
};

Solution::Solution(const System& system, const Eigen::MatrixXd& x) {
  const auto prepare = [&] {
    problem_ = validate(system, x, false);
    if (problem_.empty()) problem_ = detail::missing_curvature(system, Curvature::True);
    if (problem_.empty()) problem_ = peak(system, x);
    if (!problem_.empty()) return;
    factored_ = std::make_unique<Factored>(system, x);
    factored_->matrix.assemble(system, x, Curvature::True);
    const detail::SystemMatrix& matrix = factored_->matrix;
    constexpr double kLeast = std::numeric_limits<double>::min() / std::numeric_limits<double>::epsilon();
    bool has_inverse = matrix.is_finite();  // which would overflow beside smaller entries
    for (int c = 0; c < matrix.rows(); ++c) {
      const double diagonal = matrix.diagonal(c);
      has_inverse = has_inverse && !(diagonal > 0 && diagonal < kLeast);
    }
    if (!has_inverse) {
      problem_ = "the Hessian leaves the range of a double";
    } else if (!factored_->factor.factorize(factored_->matrix)) {
      problem_ = "the Hessian is not positive definite to the digits of a double";
    } else if (factored_->is_free()) {
      problem_ =
          "the Hessian is not positive definite beyond what the forces that are left at x make of a free "
          "motion";
    }
  };
  detail::attempt<std::bad_alloc>(
      prepare, [&](const std::bad_alloc& error) { problem_ = detail::memory_message(error); });
}

Solution::Solution(Solution&&) noexcept = default;
Solution& Solution::operator=(Solution&&) noexcept = default;
Solution::~Solution() = default;

const Solution::Factored& Solution::factored() const {
  if (!problem_.empty()) detail::raise(std::logic_error("the solution has no covariance: " + problem_));
  return *factored_;
}

Eigen::MatrixXd Solution::covariance(int node) const {
  const Factored& f = factored();
  const int dim = f.system.dim();
  if (node < 0 || node >= f.system.nodes())
    detail::raise(std::out_of_range("there is no node " + std::to_string(node)));
  if (f.system.is_fixed(node)) return Eigen::MatrixXd::Zero(dim, dim);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(f.matrix.rows(), dim);
  right.middleRows(node * dim, dim).setIdentity();
  return f.factor.solve_all(right).middleRows(node * dim, dim);
}

Eigen::MatrixXd Solution::covariances() const {
  const Factored& f = factored();
  const int dim = f.system.dim(), n = f.system.nodes();
  const detail::MultifrontalInverse inverse(f.factor.sparse());
  Eigen::MatrixXd blocks = Eigen::MatrixXd::Zero(dim, dim * n);
  for (int i = 0; i < n; ++i) {
    if (f.system.is_fixed(i)) continue;
    for (int a = 0; a < dim; ++a) {
      for (int b = 0; b <= a; ++b) {
        blocks(a, dim * i + b) = blocks(b, dim * i + a) = inverse(dim * i + a, dim * i + b);
      }
    }
  }
  return blocks;
}

Eigen::MatrixXd Solution::joint_covariance() const {
  const Factored& f = factored();
  const int size = f.system.dim() * f.system.nodes();
  detail::require_memory(3.0 * size * size * sizeof(double));
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(f.matrix.rows(), size);
  right.topRows(size).setIdentity();
  for (int i = 0; i < f.system.nodes(); ++i) {
    if (f.system.is_fixed(i)) right.middleCols(f.system.dim() * i, f.system.dim()).setZero();
  }
  const Eigen::MatrixXd inverse = f.factor.solve_all(right).topRows(size);
  return (inverse + inverse.transpose()) / 2;
}

double Solution::log_determinant() const { return factored().factor.log_determinant(); }

std::vector<std::vector<Eigen::MatrixXd>> Solution::gradients(const Eigen::MatrixXd& by_x) const {
  const Factored& f = factored();
  if (by_x.rows() != f.x.rows() || by_x.cols() != f.x.cols() || !detail::all_finite(by_x))
    detail::raise(std::invalid_argument("the derivatives by x must be finite and have the size of x"));
  for (int t = 0; t < f.system.term_count(); ++t) {
    const Term& term = f.system.term(t);
    if (const char* why = term.size() > 0 ? term.why_not_differentiable() : nullptr)
      detail::raise(std::invalid_argument(std::string(term.kind()) + ": " + why));
  }
  Eigen::MatrixXd right = -by_x;
  for (int i = 0; i < f.system.nodes(); ++i) {
    if (f.system.is_fixed(i)) right.col(i).setZero();
  }
  const Eigen::MatrixXd w = f.factor.solve(right);
  std::vector<std::vector<Eigen::MatrixXd>> result;
  for (int t = 0; t < f.system.term_count(); ++t) {
    const Term& term = f.system.term(t);
    std::vector<Eigen::MatrixXd> by;
    for (const Column& column : term.columns())
      by.push_back(Eigen::MatrixXd::Zero(column.values.rows(), column.values.cols()));
    if (term.size() > 0) term.add_mixed(f.x, w, by);
    result.push_back(std::move(by));
  }
  return result;
}

Eigen::MatrixXd hessian(const System& system, const Eigen::MatrixXd& x, Curvature curvature) {
  if (const std::string problem = detail::missing_curvature(system, curvature); !problem.empty())
    detail::raise(std::invalid_argument(problem));
  detail::SystemMatrix matrix(detail::SystemMatrix::Storage::Sparse);
  matrix.assemble(system, x, curvature);
  const Eigen::MatrixXd all = Eigen::MatrixXd(matrix.sparse()).selfadjointView<Eigen::Lower>();
  const Eigen::Index points = x.size(), hidden = all.rows() - points;
  Eigen::MatrixXd result = all.topLeftCorner(points, points);
  // As the energy is the least one over the hidden unknowns, which are not coupled to each other.
  for (Eigen::Index h = 0; h < hidden; ++h) {
    const auto border = all.col(points + h).head(points);
    result -= border * border.transpose() / all(points + h, points + h);
  }
  return result;
}

namespace detail {

bool SystemProver::is_of_fixed(Eigen::Index row) const {
  const int per_node = matrix_.is_shared() ? 1 : system_.dim();
  return row < system_.nodes() * per_node && system_.is_fixed(static_cast<int>(row) / per_node);
}

Eigen::VectorXd SystemProver::diagonal_of_inverse() const {
  if (matrix_.is_dense()) return factor_.diagonal_of_inverse();
  const MultifrontalInverse inverse(factor_.sparse());
  Eigen::VectorXd result(matrix_.rows());
  for (int r = 0; r < matrix_.rows(); ++r) result[r] = inverse(r, r);
  return result;
}

SystemProver::Bound SystemProver::bound(const Eigen::MatrixXd& x) {
  Bound result;
  Eigen::MatrixXd gradient;
  result.energy = energy_and_gradient(system_, x, gradient);
  matrix_.assemble(system_, x, Curvature::Minorising);
  if (!is_finite(result.energy) || !matrix_.is_finite()) return result;
  // The rounding of the matrix and of its factor, less than this share of its norm, is taken off first. Rows
  // of fixed nodes have no unit; no entry is larger than those of the diagonal unless it is indefinite.
  double norm = 0;
  for (int r = 0; r < matrix_.rows(); ++r) {
    if (!is_of_fixed(r)) norm = std::max(norm, std::abs(matrix_.diagonal(r)));
  }
  margin_ = 64 * std::numeric_limits<double>::epsilon() * static_cast<double>(matrix_.rows()) * norm;
  matrix_.shift(Eigen::VectorXd::Constant(system_.nodes(), margin_), -1);
  // The rounding of the energy, and of the gradient in the norm of M^-1.
  Term::Magnitude magnitude;
  double count = 16 * system_.dim() + system_.nodes();
  bool has_loads = false;
  for (int t = 0; t < system_.term_count(); ++t) {
    const Term& term = system_.term(t);
    const Term::Magnitude one = term.magnitude(x);
    magnitude.energy += one.energy;
    magnitude.gradient += one.gradient;
    count += term.size();
    has_loads = has_loads || (term.size() > 0 && term.role(0) == Term::Role::Pulls);
  }
  const double share = count * std::numeric_limits<double>::epsilon();
  // Squares of what is much smaller are 0.
  result.rounding =
      share * (std::abs(result.energy) + magnitude.energy) + count * std::numeric_limits<double>::min();
  // The least possible energy of springs is 0, but loads have none.
  result.lower_bound = has_loads ? -std::numeric_limits<double>::infinity() : 0;
  result.has_minimum = factor_.factorize(matrix_);
  if (result.has_minimum) {
    const Eigen::VectorXd inverse = diagonal_of_inverse();
    for (int r = 0; r < matrix_.rows(); ++r) {
      if (!is_of_fixed(r)) result.trace_of_inverse += inverse[r] * (1 + 1e-6);
    }
    const double square = gradient.cwiseProduct(factor_.solve(gradient)).sum() / 2;
    // The trace bounds the largest eigenvalue of the inverse.
    const double root = std::sqrt(std::max(square, 0.0)) * (1 + 1e-6) +
                        share * magnitude.gradient * std::sqrt(result.trace_of_inverse / 2);
    result.decrease = root * root;
    if (!is_finite(result.decrease) || !is_finite(result.rounding) || !is_finite(result.trace_of_inverse))
      return result;
    result.lower_bound = std::max(result.lower_bound, result.energy - result.decrease - result.rounding);
  }
  result.in_range = true;
  return result;
}

Certificate SystemProver::certify(const Eigen::MatrixXd& x, double gap) {
  Certificate result;
  const Bound bound = this->bound(x);
  result.energy = bound.energy;
  result.lower_bound = bound.lower_bound;
  if (!bound.in_range) {
    result.proof = Proof::NotApplicable;
    result.reason = "energy or curvature leave the range of a double";
    return result;
  }
  result.proof = Proof::NotCertified;
  if (bound.has_minimum) {
    // All minima y have (y - x)^T M (y - x) / 2 <= -g . (y - x), so that |y - x - M^-1 g| in M's norm is at
    // most that of M^-1 g.
    result.least_eigenvalue = 1 / bound.trace_of_inverse;
    result.distance = 2 * std::sqrt(2 * (bound.decrease + bound.rounding) * bound.trace_of_inverse);
  } else {
    const Eigen::VectorXd v = factor_.negative_direction(matrix_);
    if (v.size() > 0) result.least_eigenvalue = v.dot(matrix_ * v) / v.squaredNorm() + 2 * margin_;
  }
  // A placement without strain has next to no energy that a share could be taken of.
  SystemRule rule;
  rule.set(system_, x, 0);
  const double least_scale = 1e-10 * rule.node_stiffness().sum() * rule.length() * rule.length() / 2;
  const double scale = energy_scale(system_, x, result.energy);
  if (result.energy - result.lower_bound <= gap * std::max(scale, least_scale) + bound.rounding) {
    result.proof = bound.has_minimum ? Proof::UniqueGlobalMinimum : Proof::GlobalMinimum;
  } else {
    result.reason = bound.has_minimum ? "x is not near enough to the minimum: solve with a smaller tolerance"
                                      : "the lower bound of the curvature is not positive definite at x";
  }
  return result;
}

}  // namespace detail

Certificate certify(const System& system, const Eigen::MatrixXd& x, const CertifyOptions& options) {
  Certificate result;
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);  // the least energy of all others is 0
    if (term.size() > 0 && (term.role(0) == Term::Role::Pulls || dynamic_cast<const Elements*>(&term)))
      result.lower_bound = -std::numeric_limits<double>::infinity();
  }
  const auto refuse = [&result](std::string_view why) {
    result.proof = Proof::NotApplicable;
    result.reason = why;
    return result;
  };
  if (const char* problem = options.problem()) return refuse(problem);
  if (const std::string problem = validate(system, x); !problem.empty()) return refuse(problem);
  if (const std::string problem = detail::missing_curvature(system, Curvature::Minorising); !problem.empty())
    return refuse(problem);
  detail::attempt<std::bad_alloc>(
      [&] { result = detail::SystemProver(system).certify(x, options.gap); },
      [&](const std::bad_alloc& error) { refuse(detail::memory_message(error)); });
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
