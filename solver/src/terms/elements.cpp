#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/matrix/diagonalise.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "direction.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

namespace {

Eigen::VectorXd eigenvalues(Eigen::MatrixXd matrix) {
  Eigen::MatrixXd vectors;
  diagonalise(matrix, vectors);
  return matrix.diagonal();
}

}  // namespace

double norm_out_of_range(const double* v, Eigen::Index size) {
  double largest = 0;
  for (Eigen::Index i = 0; i < size; ++i) {
    if (is_nan(v[i])) return v[i];
    largest = std::max(largest, std::abs(v[i]));
  }
  if (!(largest > 0 && is_finite(largest))) return largest;
  double scaled = 0;
  for (Eigen::Index i = 0; i < size; ++i) scaled += (v[i] / largest) * (v[i] / largest);
  return largest * std::sqrt(scaled);
}

bool is_semidefinite(const Eigen::Ref<const Eigen::MatrixXd>& matrix) {
  constexpr double kRounding = 64 * std::numeric_limits<double>::epsilon();
  const double largest = matrix.cwiseAbs().maxCoeff();
  if (!((matrix - matrix.transpose()).cwiseAbs().array() <= kRounding * largest).all()) return false;
  return eigenvalues(matrix).minCoeff() >= -kRounding * largest;
}

double largest_eigenvalue(const Eigen::Ref<const Eigen::MatrixXd>& matrix) {
  if (matrix.rows() == 2) {
    const double difference = (matrix(0, 0) - matrix(1, 1)) / 2;
    return (matrix(0, 0) + matrix(1, 1)) / 2 + std::hypot(difference, matrix(1, 0));
  }
  return eigenvalues(matrix).maxCoeff();
}

}  // namespace detail

Loads::Loads(int dim) : TermOf("loads", dim, 1, {{"force", dim}}, {}) {}

double Loads::energy(const Points& x, Points* gradient) const {
  const Numbers force = numbers(0);
  double energy = 0;
  for (int e = 0; e < size(); ++e) {
    const Eigen::Map<const Eigen::VectorXd> f(force[e], dim());
    const int node = nodes()(0, e);
    energy -= f.dot(x.col(node));
    if (gradient != nullptr) gradient->col(node) -= f;
  }
  return energy;
}

Term::Magnitude Loads::magnitude(const Points& x) const {
  double sum = 0;
  for (int e = 0; e < size(); ++e) {
    const Eigen::Map<const Eigen::VectorXd> f(numbers(0)[e], dim());
    sum += f.cwiseAbs().dot(x.col(nodes()(0, e)).cwiseAbs());
  }
  return {sum, 0};
}

void Loads::add_scales(const Points&, Scales& scales) const {
  for (int e = 0; e < size(); ++e)
    scales.loads[nodes()(0, e)] += Eigen::Map<const Eigen::VectorXd>(numbers(0)[e], dim()).norm();
}

void Loads::add_mixed(const Points&, const Points& w, std::span<Eigen::MatrixXd> by) const {
  for (int e = 0; e < size(); ++e) by[0].col(by[0].cols() == 1 ? 0 : e) -= w.col(nodes()(0, e));
}

namespace {

int required(int number, int least, const char* what) {
  if (number < least)
    detail::raise(std::invalid_argument("elements: " + std::to_string(number) + " is no number of " + what));
  return number;
}

}  // namespace

Elements::Elements(int dim, int arity, int rows, ElementFunction function, bool has_second)
    : TermOf("elements", dim, required(arity, 1, "nodes of an element"),
             {{.name = "numbers", .rows = required(rows, 0, "rows"), .is_optional = rows == 0}}, {}),
      function_(std::move(function)),
      has_second_(has_second) {}

void Elements::evaluate(const Points& x, bool second, ElementValues& values) const {
  const int d = dim();
  Eigen::MatrixXd points(d * arity(), size());
  for (int e = 0; e < size(); ++e) {
    for (int a = 0; a < arity(); ++a) points.col(e).segment(a * d, d) = x.col(nodes()(a, e));
  }
  const Eigen::MatrixXd& numbers = columns()[0].values;
  function_(points, numbers.cols() == 1 && size() > 1 ? numbers.replicate(1, size()).eval() : numbers, second,
            values);
  const auto fits = [&](const Eigen::MatrixXd& m, Eigen::Index rows) {
    return m.rows() == rows && m.cols() == size();
  };
  const Eigen::Index rows = points.rows();
  if (values.energy.size() != size() || !fits(values.gradient, rows) ||
      (second && !fits(values.second, rows * rows)))
    detail::raise(std::length_error("elements: the function returned values of another size"));
}

double Elements::energy(const Points& x, Points* gradient) const {
  if (size() == 0) return 0;
  ElementValues values;
  evaluate(x, false, values);
  for (int e = 0; gradient != nullptr && e < size(); ++e) {
    for (int a = 0; a < arity(); ++a)
      gradient->col(nodes()(a, e)) += values.gradient.col(e).segment(a * dim(), dim());
  }
  return values.energy.sum();
}

void Elements::add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const {
  if (size() == 0) return;
  ElementValues values;
  evaluate(x, true, values);
  const int rows = dim() * arity();
  Eigen::MatrixXd modes;
  for (int e = 0; e < size(); ++e) {
    Eigen::MatrixXd matrix = Eigen::Map<const Eigen::MatrixXd>(values.second.col(e).data(), rows, rows);
    matrix = (matrix + matrix.transpose()).eval() / 2;
    if (curvature == Curvature::Clamped && matrix.allFinite()) {
      detail::diagonalise(matrix, modes);
      const Eigen::MatrixXd scaled = modes * matrix.diagonal().cwiseMax(0.0).asDiagonal();
      matrix = scaled.lazyProduct(modes.transpose());
    }
    sink.add(nodes().col(e).data(), arity(), matrix.data(), rows);
  }
}

const char* Elements::problem_with(Curvature curvature) const {
  if (curvature == Curvature::Majorising) return "no bound of the curvature of the user's function is known";
  if (curvature == Curvature::Minorising) return "no bound of the curvature of the user's function is known";
  return has_second_ ? nullptr : "the user's function gives no second derivatives";
}

// The curvature at x, where it is known; without, the gradient tells the scale by the stopping rule's length.
void Elements::add_scales(const Points& x, Scales& scales) const {
  if (!has_second_ || size() == 0) return;
  ElementValues values;
  evaluate(x, true, values);
  const int d = dim(), rows = d * arity();
  for (int e = 0; e < size(); ++e) {
    const Eigen::Map<const Eigen::MatrixXd> matrix(values.second.col(e).data(), rows, rows);
    for (int a = 0; a < arity(); ++a)
      scales.hold(nodes()(a, e), matrix.diagonal().segment(a * d, d).cwiseAbs().maxCoeff());
  }
}

const char* Elements::why_not_differentiable() const {
  return "the user's function gives no derivatives by its numbers";
}

std::unique_ptr<Term> make_term(std::string_view kind, int dim) {
  std::unique_ptr<Term> known[] = {std::make_unique<Anchors>(dim),     std::make_unique<Links>(dim),
                                   std::make_unique<Offsets>(dim),     std::make_unique<Loads>(dim),
                                   std::make_unique<Differences>(dim), std::make_unique<Bendings>(dim),
                                   std::make_unique<Angles>(dim),      std::make_unique<Areas>(dim),
                                   std::make_unique<CommonLength>(dim)};
  for (std::unique_ptr<Term>& term : known) {
    if (term->kind() == kind) return std::move(term);
  }
  std::string message = "unknown kind of term '" + std::string(kind) + "' (known:";
  for (const std::unique_ptr<Term>& term : known) (message += ' ') += term->kind();
  detail::raise(std::invalid_argument(message + ")"));
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
