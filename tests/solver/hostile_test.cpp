// Solves hostile systems of 28 kinds with every solver: 20 of each, or ASTERISM_HOSTILE_SYSTEMS, from number
// ASTERISM_HOSTILE_FIRST on. The judge shares no code with the library: it implements energy, forces and
// curvature independently, in long double, and has its own descent.
#include "hostile.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numeric>
#include <optional>

#include "environment.hpp"

namespace asterism::hostile {

std::vector<Attempt> solve_by_all(const Problem& problem) {
  std::vector<Attempt> attempts;
  switch (problem.type) {
    case Type::Line:
      solve_line(problem, attempts);
      break;
    case Type::Plane:
      solve_plane(problem, attempts);
      break;
    case Type::Space:
      solve_space(problem, attempts);
      break;
    case Type::PlaneInFloat:
      solve_float(problem, attempts);
      break;
    case Type::RobustPlane:
      solve_robust(problem, attempts);
      break;
  }
  return attempts;
}

namespace {

using testing::environment;

using Real = long double;
using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
using Vector = Eigen::Matrix<Real, Eigen::Dynamic, 1>;

/// The problem in long double. Springs without stiffness are left out.
class Judge {
 public:
  explicit Judge(const Problem& problem)
      : problem_(problem),
        anchors_(problem.anchors.cast<Real>()),
        node_stiffness_(problem.anchor_stiffness.cast<Real>()),
        fixed_(static_cast<std::size_t>(problem.nodes()), false) {
    for (const int i : problem.fixed) fixed_[static_cast<std::size_t>(i)] = true;
    for_each_link([&](int l, Link link) {
      node_stiffness_[link.i] += problem_.link_stiffness[l];
      node_stiffness_[link.j] += problem_.link_stiffness[l];
    });
    find_components();
    if (problem.hold_floating) ground();
    set_lengths();
  }

  bool is_fixed(int i) const { return fixed_[static_cast<std::size_t>(i)]; }
  Real node_stiffness(int i) const { return node_stiffness_[i]; }

  Real energy(const Matrix& x) const { return evaluate(x, nullptr, nullptr); }

  /// The reference for relative errors of the energy: the springs' energy, and the absolute values of the
  /// loads'.
  Real size(const Matrix& x, Real energy) const {
    for (int i = 0; i < problem_.nodes() && has_loads(); ++i)
      energy += load(i).dot(x.col(i)) + load(i).cwiseAbs().dot(x.col(i).cwiseAbs());
    return energy;
  }

  /// Energy; optionally its gradient (Dim x N) and its Hessian, with negative curvature clamped on request.
  Real evaluate(const Matrix& x, Matrix* gradient, Matrix* hessian, bool clamp = false) const {
    const int dim = problem_.dim(), n = problem_.nodes();
    if (gradient != nullptr) gradient->setZero(dim, n);
    if (hessian != nullptr) hessian->setZero(dim * n, dim * n);
    Real energy = 0;
    for (int i = 0; i < n; ++i) {
      const Real k = problem_.anchor_stiffness[i];
      if (has_loads()) {
        energy -= load(i).dot(x.col(i));
        if (gradient != nullptr) gradient->col(i) -= load(i);
      }
      if (!(k > 0)) continue;
      const Vector d = x.col(i) - anchors_.col(i);
      Matrix shape = Matrix::Identity(dim, dim);
      Real value = d.squaredNorm(), first = 1, second = 0;
      if (problem_.type == Type::RobustPlane) {
        shape = problem_.shapes.middleCols(2 * i, 2).cast<Real>();
        const Real square = Real(problem_.scale) * problem_.scale, s = d.dot(shape * d);
        const Real share = square / (square + s);
        value = s * share, first = share * share, second = -2 * share * share * share / square;
      }
      energy += k * value / 2;
      const Vector shaped = shape * d;
      if (gradient != nullptr) gradient->col(i) += k * first * shaped;
      if (hessian != nullptr) {
        auto block = hessian->block(dim * i, dim * i, dim, dim);
        block += k * first * shape;
        if (!clamp) block += 2 * k * second * shaped * shaped.transpose();
      }
    }
    for_each_link([&](int l, Link link) {
      const Real k = problem_.link_stiffness[l], mu = problem_.rest_length[l];
      const Vector d = x.col(link.i) - x.col(link.j) - offset(l);
      const Real length = d.norm();
      energy += k * (length - mu) * (length - mu) / 2;
      if (!(length > 0)) {
        if (hessian != nullptr && mu == 0) add_link(*hessian, link, k * Matrix::Identity(dim, dim));
        return;
      }
      const Vector u = d / length;
      if (gradient != nullptr) {
        gradient->col(link.i) += k * (length - mu) * u;
        gradient->col(link.j) -= k * (length - mu) * u;
      }
      if (hessian != nullptr) {
        Real across = (length - mu) / length;
        if (clamp) across = std::max(across, Real(0));
        const Matrix along = u * u.transpose();
        add_link(*hessian, link, k * (along + across * (Matrix::Identity(dim, dim) - along)));
      }
    });
    for (int i = 0; i < n; ++i) {
      if (!is_fixed(i)) continue;
      if (gradient != nullptr) gradient->col(i).setZero();
      if (hessian == nullptr) continue;
      hessian->middleCols(dim * i, dim).setZero();
      hessian->middleRows(dim * i, dim).setZero();
      for (int d = 0; d < dim; ++d)
        (*hessian)(dim * i + d, dim * i + d) = node_stiffness_[i] > 0 ? node_stiffness_[i] : 1;
    }
    return energy;
  }

  /// The largest coordinate that matters.
  Real extent(const Matrix& x) const {
    Real largest = x.cwiseAbs().maxCoeff();
    for (int i = 0; i < problem_.nodes(); ++i)
      if (problem_.anchor_stiffness[i] > 0)
        largest = std::max(largest, anchors_.col(i).cwiseAbs().maxCoeff());
    for_each_link([&](int l, Link) { largest = std::max(largest, offset(l).cwiseAbs().maxCoeff()); });
    return largest;
  }

  /// The accuracy of the energy at x if coordinates are rounded relative to the largest one.
  Real rounding(const Matrix& x, Real energy) const {
    const Real eps = epsilon(problem_.type), step = eps * extent(x);
    const Real stiffness = node_stiffness_.sum();
    energy = size(x, energy);
    const auto terms = static_cast<Real>(problem_.nodes()) + static_cast<Real>(problem_.links.size());
    if (problem_.type == Type::RobustPlane) {  // information matrices are rounded too
      for (int i = 0; i < problem_.nodes(); ++i)
        energy += problem_.anchor_stiffness[i] * (x.col(i) - anchors_.col(i)).squaredNorm();
    }
    return terms * 16 * (eps * energy + step * std::sqrt(2 * stiffness * energy) + stiffness * step * step) +
           std::numeric_limits<double>::min() * (1 + stiffness);
  }

  /// How far the energy may be above the minimum if forces are within the tolerance and anchors are not weak.
  Real allowed(const Matrix& x, Real energy) const {
    Real sum = rounding(x, energy);
    for (int i = 0; i < problem_.nodes(); ++i) {
      const Real by = 10 * kTolerance * length(i);
      sum += node_stiffness_[i] * by * by;
    }
    return sum;
  }

  /// The largest ratio of a node's force to what the tolerance and rounding allow: at most 1 if x is
  /// stationary.
  Real excess(const Matrix& x) const {
    Matrix gradient;
    evaluate(x, &gradient, nullptr);
    const Real rounded = 32 * epsilon(problem_.type) * extent(x);
    // Smaller tolerances count as this one.
    const Real tolerance = std::max<Real>(kTolerance, 64 * epsilon(problem_.type));
    Real worst = 0;
    for (int i = 0; i < problem_.nodes(); ++i) {
      if (is_fixed(i) || !(node_stiffness_[i] > 0)) continue;
      worst = std::max(
          worst, gradient.col(i).norm() / (node_stiffness_[i] * (10 * tolerance * length(i) + rounded)));
    }
    return worst;
  }

  /// Whether the Hessian, scaled by the nodes' stiffness, has no eigenvalue below -slack.
  bool is_convex(const Matrix& x, Real slack) const {
    Matrix hessian;
    evaluate(x, nullptr, &hessian);
    scale(hessian);
    return factorize(hessian, slack);
  }

  /// Newton's method with a Hessian that is clamped, or shifted if it is not positive definite. Moves x to
  /// its end and returns the energy there.
  Real descend(Matrix& x) const {
    Matrix gradient, trial;
    Real energy = evaluate(x, &gradient, nullptr);
    for (int iteration = 0; iteration < 200; ++iteration) {
      Matrix hessian;
      evaluate(x, &gradient, &hessian);
      scale(hessian);
      Matrix factor = hessian;
      if (!factorize(factor, 0)) {
        evaluate(x, nullptr, &hessian, true);
        scale(hessian);
        for (Real shift = 1e-15L; factor = hessian, !factorize(factor, shift); shift *= 100)
          if (!(shift < 1e6L)) return energy;
      }
      Vector step = gradient.reshaped();
      for (Eigen::Index c = 0; c < step.size(); ++c) step[c] /= root(c);
      factor.triangularView<Eigen::Lower>().solveInPlace(step);
      factor.triangularView<Eigen::Lower>().transpose().solveInPlace(step);
      for (Eigen::Index c = 0; c < step.size(); ++c) step[c] /= root(c);
      const Real slope = step.dot(Vector(gradient.reshaped()));
      if (!(slope > 1e-17L * size(x, energy))) return energy;
      Real t = 1;
      while (true) {
        trial = x - t * step.reshaped(x.rows(), x.cols());
        const Real next = this->energy(trial);
        if (next <= energy - Real(1e-4) * t * slope) {
          x = trial, energy = next;
          break;
        }
        t /= 4;
        if (!(t > 1e-12L)) return energy;
      }
    }
    return energy;
  }

 private:
  Vector offset(int l) const {
    if (problem_.rest_offset.size() == 0) return Vector::Zero(problem_.dim());
    return problem_.rest_offset.col(l).cast<Real>();
  }

  bool has_loads() const { return problem_.loads.size() > 0; }
  Vector load(int i) const { return problem_.loads.col(i).cast<Real>(); }

  template <typename Visit>
  void for_each_link(const Visit& visit) const {
    for (std::size_t l = 0; l < problem_.links.size(); ++l)
      if (problem_.link_stiffness[static_cast<int>(l)] > 0) visit(static_cast<int>(l), problem_.links[l]);
  }

  void add_link(Matrix& hessian, Link link, const Matrix& block) const {
    const int dim = problem_.dim(), i = dim * link.i, j = dim * link.j;
    hessian.block(i, i, dim, dim) += block;
    hessian.block(j, j, dim, dim) += block;
    hessian.block(i, j, dim, dim) -= block;
    hessian.block(j, i, dim, dim) -= block;
  }

  Real root(Eigen::Index c) const {
    const Real k = node_stiffness_[c / problem_.dim()];
    return k > 0 ? std::sqrt(k) : 1;
  }
  void scale(Matrix& hessian) const {
    for (Eigen::Index c = 0; c < hessian.cols(); ++c)
      for (Eigen::Index r = 0; r < hessian.rows(); ++r) hessian(r, c) /= root(r) * root(c);
  }

  // Cholesky factor of matrix + shift I in its lower triangle; false if that is not positive definite.
  static bool factorize(Matrix& matrix, Real shift) {
    const Eigen::Index n = matrix.rows();
    for (Eigen::Index c = 0; c < n; ++c) {
      Real pivot = matrix(c, c) + shift;
      for (Eigen::Index k = 0; k < c; ++k) pivot -= matrix(c, k) * matrix(c, k);
      if (!(pivot > 0)) return false;
      matrix(c, c) = std::sqrt(pivot);
      for (Eigen::Index r = c + 1; r < n; ++r) {
        Real sum = matrix(r, c);
        for (Eigen::Index k = 0; k < c; ++k) sum -= matrix(r, k) * matrix(c, k);
        matrix(r, c) = sum / matrix(c, c);
      }
    }
    return true;
  }

  void find_components() {
    component_.resize(static_cast<std::size_t>(problem_.nodes()));
    std::iota(component_.begin(), component_.end(), 0);
    for_each_link([&](int, Link link) {
      const int from = component_[static_cast<std::size_t>(link.j)];
      const int to = component_[static_cast<std::size_t>(link.i)];
      for (int& c : component_)
        if (c == from) c = to;
    });
  }

  // Fixes the first node of each component that nothing holds.
  void ground() {
    std::vector<bool> is_held(component_.size(), false);  // indexed by component
    const auto held = [&](int i) -> std::vector<bool>::reference {
      return is_held[static_cast<std::size_t>(component_[static_cast<std::size_t>(i)])];
    };
    for (int i = 0; i < problem_.nodes(); ++i)
      if (is_fixed(i) || problem_.anchor_stiffness[i] > 0) held(i) = true;
    for (int i = 0; i < problem_.nodes(); ++i) {
      if (held(i)) continue;
      fixed_[static_cast<std::size_t>(i)] = held(i) = true;
    }
  }

  // Lengths that scale the nodes' forces: the root mean square of rest lengths and of anchors about their
  // centroid, either in the node's component or of all weighted by stiffness, whichever is larger.
  void set_lengths() {
    const auto of = [&](const auto& weight_of_anchor, const auto& weight_of_link) {
      Vector centroid = Vector::Zero(problem_.dim());
      Real weight = 0, sum = 0;
      for (int i = 0; i < problem_.nodes(); ++i) {
        const Real w = weight_of_anchor(i);
        if (w > 0) weight += w, centroid += w * anchors_.col(i);
      }
      if (weight > 0) centroid /= weight;
      for (int i = 0; i < problem_.nodes(); ++i) {
        const Real w = weight_of_anchor(i);
        if (w > 0) sum += w * (anchors_.col(i) - centroid).squaredNorm();
      }
      for_each_link([&](int l, Link link) {
        const Real w = weight_of_link(l, link), mu = problem_.rest_length[l];
        weight += w, sum += w * (mu * mu + offset(l).squaredNorm());
      });
      return weight > 0 ? std::sqrt(sum / weight) : Real(0);
    };
    const Real all = of([&](int i) { return Real(problem_.anchor_stiffness[i]); },
                        [&](int l, Link) { return Real(problem_.link_stiffness[l]); });
    // For a single node or coincident anchors: the distance that the start has to move.
    Real way = (problem_.start.cast<Real>() - anchors_).norm();
    for (int i = 0; i < problem_.nodes() && has_loads(); ++i) {
      if (node_stiffness_[i] > 0) way = std::max(way, load(i).norm() / node_stiffness_[i]);
    }
    const Real rounded = 1e-12L * extent(problem_.start.cast<Real>());
    for (int i = 0; i < problem_.nodes(); ++i) {
      const int c = component_[static_cast<std::size_t>(i)];
      const auto is_in = [&](int node) { return component_[static_cast<std::size_t>(node)] == c; };
      const Real own = of([&](int j) { return Real(is_in(j) && problem_.anchor_stiffness[j] > 0 ? 1 : 0); },
                          [&](int, Link link) { return Real(is_in(link.i) ? 1 : 0); });
      lengths_.push_back(std::max(all, own > rounded ? own : way));
    }
  }
  Real length(int i) const { return lengths_[static_cast<std::size_t>(i)]; }

  const Problem& problem_;
  Matrix anchors_;
  Vector node_stiffness_;
  std::vector<bool> fixed_;
  std::vector<int> component_;
  std::vector<Real> lengths_;
};

/// Results of descents from several starts.
struct Reference {
  Real lowest = std::numeric_limits<Real>::infinity();
  Real size = 0;          ///< Judge::size there
  bool is_unique = true;  ///< all ended in the same minimum
};

Reference reference_of(const Judge& judge, const Problem& problem, std::uint64_t seed) {
  testing::Rng rng(seed + 0x5eed);
  Reference result;
  std::vector<Real> ends;
  const Matrix start = problem.start.cast<Real>();
  const auto from = [&](Matrix x) {
    for (int i = 0; i < problem.nodes(); ++i)
      if (judge.is_fixed(i)) x.col(i) = start.col(i);
    ends.push_back(judge.descend(x));
    if (ends.back() < result.lowest) {
      result.lowest = ends.back();
      result.size = judge.size(x, result.lowest);
    }
  };
  Matrix at_anchors = problem.anchors.cast<Real>();
  for (int i = 0; i < problem.nodes(); ++i)
    if (!(problem.anchor_stiffness[i] > 0)) at_anchors.col(i) = start.col(i);
  from(start);
  from(at_anchors);
  Matrix mirrored = at_anchors;
  mirrored.row(0).array() = 2 * at_anchors.row(0).mean() - at_anchors.row(0).array();
  from(mirrored);
  Matrix other = at_anchors;
  const Real size = std::max<Real>(1e-300L, (at_anchors.colwise() - at_anchors.rowwise().mean()).norm());
  for (Real& coordinate : other.reshaped()) coordinate += Real(rng.uniform(-0.5, 0.5)) * size;
  from(other);
  for (const Real end : ends) result.is_unique &= end <= result.lowest + 1e-9L * result.size;
  return result;
}

/// Per solver: solves, converged ones, and those that ended at the lowest energy known.
struct Count {
  long solves = 0, converged = 0, lowest = 0;
};

class Hostile : public ::testing::TestWithParam<std::size_t> {
 protected:
  void judge(int index) {
    const Kind& kind = kinds()[GetParam()];
    const auto seed = static_cast<std::uint64_t>(index) * 64 + GetParam() + 1;
    const Problem problem = kind.make(seed);
    const std::vector<Attempt> attempts = solve_by_all(problem);
    std::optional<Judge> judge;  // only for a valid system
    if (!problem.refused) judge.emplace(problem);
    std::optional<Reference> reference;
    constexpr int kSoon = 36;  // most coordinates that are fast to descend
    if (judge && !problem.may_overflow && problem.anchors.size() <= kSoon)
      reference = reference_of(*judge, problem, seed);
    for (const Attempt& attempt : attempts) {
      SCOPED_TRACE(attempt.solver + " (" + std::string(to_string(attempt.summary.status)) + ": " +
                   std::string(std::string_view(attempt.summary.message)) + ")");
      check(problem, attempt, judge ? &*judge : nullptr, reference ? &*reference : nullptr);
    }
  }

  void check(const Problem& problem, const Attempt& attempt, const Judge* judge_of_system,
             const Reference* reference) {
    const Summary& summary = attempt.summary;
    Count& count = counts_[attempt.solver];
    ++count.solves;
    EXPECT_FALSE(summary.message.empty());
    EXPECT_NE(summary.status, Status::NotRun);
    if (!summary.usable()) {
      EXPECT_TRUE(attempt.is_untouched);
      EXPECT_TRUE(problem.refused || problem.may_overflow);
      EXPECT_EQ(summary.status == Status::InvalidInput, problem.refused);
      return;
    }
    ASSERT_FALSE(problem.refused);
    const Judge& judge = *judge_of_system;
    ASSERT_TRUE(attempt.x.allFinite());
    const Matrix x = attempt.x.cast<Real>(), start = problem.start.cast<Real>();
    const Real before = judge.energy(start), after = judge.energy(x);
    EXPECT_LE(after, before + judge.rounding(start, before) + judge.rounding(x, before)) << "the energy rose";
    EXPECT_LE(std::abs(after - static_cast<Real>(summary.final_energy)), judge.rounding(x, after))
        << "energy " << after << ", and not " << summary.final_energy;
    for (int i = 0; i < problem.nodes(); ++i) {
      if (judge.is_fixed(i)) {
        EXPECT_EQ(attempt.x.col(i), problem.start.col(i)) << "node " << i;
      }
    }
    if (problem.moves_freely) {
      EXPECT_NE(summary.positive_definite, true) << "the system moves freely";
    }
    if (summary.positive_definite == true) {
      const Real slack = 1e-9L + 1e4L * epsilon(problem.type);
      EXPECT_TRUE(judge.is_convex(x, slack)) << "positive_definite, but the Hessian is not";
    }
    if (reference != nullptr)
      count.lowest += after <= reference->lowest + 1e-6L * reference->size + judge.rounding(x, after);
    if (summary.status != Status::Converged) return;
    ++count.converged;
    EXPECT_LE(judge.excess(x), 1) << "converged, but not stationary: " << summary;
    if (reference != nullptr && reference->is_unique && problem.agrees) {
      EXPECT_LE(after, reference->lowest + 1e-6L * reference->size + judge.allowed(x, after))
          << "not the minimum";
    }
  }

  std::map<std::string, Count> counts_;
};

TEST_P(Hostile, EverySolverTellsTheTruth) {
  const int first = environment("ASTERISM_HOSTILE_FIRST", 0);
  const int count = environment("ASTERISM_HOSTILE_SYSTEMS", 20);
  for (int index = first; index < first + count; ++index) {
    SCOPED_TRACE("ASTERISM_HOSTILE_SYSTEMS=1 ASTERISM_HOSTILE_FIRST=" + std::to_string(index));
    judge(index);
    if (HasFailure() && std::getenv("ASTERISM_HOSTILE_ALL") == nullptr) break;
  }
  for (const auto& [solver, c] : counts_)
    std::printf("  %-42s %7ld solves, %5.1f %% converged, %5.1f %% at the lowest energy known\n",
                solver.c_str(), c.solves,
                100.0 * static_cast<double>(c.converged) / static_cast<double>(c.solves),
                100.0 * static_cast<double>(c.lowest) / static_cast<double>(c.solves));
}

INSTANTIATE_TEST_SUITE_P(Kinds, Hostile, ::testing::Range(std::size_t{0}, kinds().size()),
                         [](const auto& kind) { return kinds()[kind.param].name; });

}  // namespace
}  // namespace asterism::hostile
