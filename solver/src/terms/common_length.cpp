#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <cmath>
#include <limits>

#include "direction.hpp"
#include "loss.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

constexpr std::size_t kEachLength = 0, kEachStiffness = 1, kPrior = 2, kPriorStiffness = 3;

std::vector<Column> common_length_columns() {
  return {{"length"},
          {"stiffness", 1, Column::Range::NotNegative},
          {.name = "prior", .is_common = true},
          {.name = "prior_stiffness", .range = Column::Range::NotNegative, .is_common = true}};
}

}  // namespace

CommonLength::CommonLength(int dim) : TermOf("common_length", dim, 2, common_length_columns(), {}) {
  add_loss();
}

std::string CommonLength::defect(int node_count) const {
  if (std::string problem = Term::defect(node_count); !problem.empty()) return problem;
  if (std::string problem = loss_defect(); !problem.empty()) return problem;
  if (loss() != Loss::Quadratic && loss() != Loss::Huber)
    return "common_length: the loss must be quadratic or huber, as the others leave several estimates";
  if (size() > 0 && !(*numbers(kPriorStiffness)[0] > 0)) {
    const Numbers stiffness = numbers(kEachStiffness);
    for (int e = 0; e < size(); ++e) {
      if (*stiffness[e] > 0) return {};
    }
    return "common_length: neither an element nor the prior has stiffness";
  }
  return {};
}

Eigen::VectorXd CommonLength::ranges(const Points& x) const {
  const Numbers length = numbers(kEachLength), stiffness = numbers(kEachStiffness);
  Eigen::VectorXd result = Eigen::VectorXd::Zero(size());  // of what has no stiffness, any number will do
  for (int e = 0; e < size(); ++e) {
    if (!(*stiffness[e] > 0)) continue;
    const detail::PointOf<Eigen::Dynamic> offset = x.col(nodes()(0, e)) - x.col(nodes()(1, e));
    result[e] = detail::stable_norm(offset) - *length[e];
  }
  return result;
}

double CommonLength::curvature_of_estimate(const Eigen::VectorXd& ranges, double b, bool clamp) const {
  const Numbers stiffness = numbers(kEachStiffness), scale = this->scale();
  double sum = size() > 0 ? *numbers(kPriorStiffness)[0] : 0.0;
  for (int e = 0; e < size(); ++e) {
    if (!(*stiffness[e] > 0)) continue;
    const double s = ranges[e] - b;
    const double bend = detail::of_residual(detail::loss_at(loss(), scale[e], nullptr, s * s), s).second;
    sum += *stiffness[e] * (clamp ? std::max(bend, 0.0) : bend);
  }
  return sum;
}

// The energy is convex in b: for springs the weighted mean; for Huber's loss the fixed point of weighted
// means, which lower the energy at every step (Huber 1981, 7.8).
double CommonLength::estimate(const Eigen::VectorXd& ranges) const {
  if (size() == 0) return 0;
  const Numbers stiffness = numbers(kEachStiffness), scale = this->scale();
  const double prior = *numbers(kPrior)[0], prior_stiffness = *numbers(kPriorStiffness)[0];
  const auto mean = [&](auto&& weight_of) {
    double total = prior_stiffness, sum = prior_stiffness * prior;
    for (int e = 0; e < size(); ++e) {
      const double weight = *stiffness[e] * weight_of(e);
      total += weight;
      sum += weight * ranges[e];
    }
    return sum / total;
  };
  double b = mean([](int) { return 1.0; });
  if (loss() == Loss::Quadratic) return b;
  // Newton's step where it lands on the same pieces of the loss is exact; a bisection of the slope, which
  // never decreases with b, holds it.
  const auto slope = [&](double at) {
    double sum = prior_stiffness * (at - prior);
    for (int e = 0; e < size(); ++e) {
      const double s = ranges[e] - at;
      sum -= *stiffness[e] * std::clamp(s, -*scale[e], *scale[e]);
    }
    return sum;
  };
  double low = prior_stiffness > 0 ? std::min(prior, ranges.minCoeff()) : ranges.minCoeff();
  double high = prior_stiffness > 0 ? std::max(prior, ranges.maxCoeff()) : ranges.maxCoeff();
  constexpr int kMaxSteps = 200;
  for (int step = 0; step < kMaxSteps && high > low; ++step) {
    const double g = slope(b);
    if (g == 0) return b;
    (g > 0 ? high : low) = b;
    const double bend = curvature_of_estimate(ranges, b, true);
    double next = bend > 0 ? b - g / bend : (low + high) / 2;
    if (!(next > low && next < high)) next = (low + high) / 2;
    if (next == b || !(std::abs(next - b) > 4 * std::numeric_limits<double>::epsilon() * std::abs(b)))
      return next;
    b = next;
  }
  return b;
}

double CommonLength::estimate(const Points& x) const { return estimate(ranges(x)); }

double CommonLength::energy(const Points& x, Points* gradient) const {
  if (size() == 0) return 0;
  const Numbers stiffness = numbers(kEachStiffness), scale = this->scale();
  const Eigen::VectorXd ranges = this->ranges(x);
  const double b = estimate(ranges), off = b - *numbers(kPrior)[0];
  double energy = *numbers(kPriorStiffness)[0] * off * off / 2;
  Eigen::VectorXd direction(dim());
  for (int e = 0; e < size(); ++e) {
    const double s = ranges[e] - b, k = *stiffness[e];
    if (!(k > 0)) continue;  // its length means nothing then, and may be so far off that its square overflows
    const auto phi = detail::of_residual(detail::loss_at(loss(), scale[e], nullptr, s * s), s);
    energy += k * phi.value;
    if (gradient == nullptr) continue;
    const int i = nodes()(0, e), j = nodes()(1, e);
    detail::length_and_direction(i, j, Eigen::VectorXd(x.col(i) - x.col(j)), direction);
    gradient->col(i) += k * phi.first * direction;
    gradient->col(j) -= k * phi.first * direction;
  }
  return energy;
}

// The matrix over the points and b, whose Schur complement is that of the energy minimised over b.
void CommonLength::add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const {
  if (size() == 0) return;
  const Numbers stiffness = numbers(kEachStiffness), scale = this->scale();
  const Eigen::VectorXd ranges = this->ranges(x);
  const double b = estimate(ranges);
  const int d = dim(), rows = 2 * d + 1;
  Eigen::MatrixXd matrix(rows, rows);
  Eigen::VectorXd u(d);
  const auto link = [&](double along, double across) {
    Eigen::MatrixXd block = (along - across) * u * u.transpose();
    block.diagonal().array() += across;
    matrix.topLeftCorner(d, d) = matrix.block(d, d, d, d) = block;
    matrix.block(0, d, d, d) = matrix.block(d, 0, d, d) = -block;
  };
  for (int e = 0; e < size(); ++e) {
    const double s = ranges[e] - b, k = *stiffness[e];
    if (!(k > 0)) continue;
    const int i = nodes()(0, e), j = nodes()(1, e);
    const double r = detail::length_and_direction(i, j, Eigen::VectorXd(x.col(i) - x.col(j)), u);
    const auto phi = detail::of_residual(detail::loss_at(loss(), scale[e], nullptr, s * s), s);
    double along = k * phi.second, across = k * phi.first / r;
    if (!detail::is_finite(across)) across = phi.first < 0 ? 0.0 : along;
    if (d == 1) across = along;  // on a line nothing is across
    matrix.setZero();
    if (curvature == Curvature::Majorising) {
      link(k, k);  // b as it is
    } else {
      link(along, curvature == Curvature::Clamped ? std::max(across, 0.0) : across);
      matrix.block(0, 2 * d, d, 1) = -along * u;
      matrix.block(d, 2 * d, d, 1) = along * u;
      matrix.row(2 * d) = matrix.col(2 * d).transpose();
      matrix(2 * d, 2 * d) = along;
    }
    const int with_hidden[] = {i, j, sink.hidden_node()};
    sink.add(with_hidden, 3, matrix.data(), rows);
  }
  // Where all are in the linear part of Huber's loss, b is free; it then counts as held by the least
  // stiffness that tells.
  double prior = *numbers(kPriorStiffness)[0];
  if (curvature == Curvature::Majorising) {
    prior = 1;
  } else if (!(curvature_of_estimate(ranges, b, true) > 0)) {
    for (int e = 0; e < size(); ++e) prior += *stiffness[e] * 1e-9;
  }
  const int hidden = sink.hidden_node();
  sink.add(&hidden, 1, &prior, 1);
}

const char* CommonLength::problem_with(Curvature curvature) const {
  return curvature == Curvature::Minorising
             ? "no bound of the curvature of an estimated length from below is known"
             : nullptr;
}

void CommonLength::add_scales(const Points& x, Scales& scales) const {
  const double b = estimate(x);
  const Numbers stiffness = numbers(kEachStiffness), length = numbers(kEachLength);
  for (int e = 0; e < size(); ++e) {
    const double rest = *length[e] + b;
    scales.lengths.emplace_back(*stiffness[e], rest * rest);
    for (int a = 0; a < 2; ++a) scales.hold(nodes()(a, e), *stiffness[e]);
  }
}

// w . g depends on the numbers also by b, with db/dn = -(d2E/db dn) / (d2E/db2).
void CommonLength::add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const {
  if (size() == 0) return;
  const Numbers stiffness = numbers(kEachStiffness), scale = this->scale();
  const Eigen::VectorXd ranges = this->ranges(x);
  const double b = estimate(ranges), bend = curvature_of_estimate(ranges, b, false);
  Eigen::VectorXd along(size()), u(dim());
  double by_estimate = 0;  // of w . g
  const auto phi_of = [&](int e) {
    const double s = ranges[e] - b;
    return detail::of_residual(detail::loss_at(loss(), scale[e], nullptr, s * s), s);
  };
  for (int e = 0; e < size(); ++e) {
    if (!(*stiffness[e] > 0)) continue;
    const int i = nodes()(0, e), j = nodes()(1, e);
    detail::length_and_direction(i, j, Eigen::VectorXd(x.col(i) - x.col(j)), u);
    along[e] = u.dot(w.col(i) - w.col(j));
    by_estimate -= *stiffness[e] * phi_of(e).second * along[e];
  }
  const double share = bend > 0 ? by_estimate / bend : 0.0;
  const auto number = [&](std::size_t i, int e) -> double& { return by[i](0, by[i].cols() == 1 ? 0 : e); };
  for (int e = 0; e < size(); ++e) {
    const double k = *stiffness[e];
    if (!(k > 0)) continue;
    const auto phi = phi_of(e);
    number(kEachLength, e) -= k * phi.second * (along[e] + share);
    number(kEachStiffness, e) += phi.first * (along[e] + share);
    const double s = ranges[e] - b;
    detail::add_by_loss(loss(), scale[e], nullptr, s * s, detail::loss_at(loss(), scale[e], nullptr, s * s),
                        k * s * (along[e] + share), e, by);
  }
  number(kPrior, 0) += share * *numbers(kPriorStiffness)[0];
  number(kPriorStiffness, 0) -= share * (b - *numbers(kPrior)[0]);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
