// No interval of the least energy is false: random systems of every kind of term that has a certificate,
// alone and in mixtures, 500 of them, or ASTERISM_INTERVAL_SYSTEMS, from number ASTERISM_INTERVAL_FIRST on.
// The judge shares no code with the library: it evaluates the energy in long double, has a descent of its
// own, and knows of every placement that was found that no bound may be above its energy.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/system.hpp>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "environment.hpp"
#include "model_kits.hpp"
#include "random_values.hpp"
#include "test_systems.hpp"

namespace asterism {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::environment;
using testing::random_points;
using testing::random_shapes;
using testing::random_values;
using testing::Rng;

using Real = long double;
using RealPoints = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
using RealVector = Eigen::Matrix<Real, Eigen::Dynamic, 1>;

// A user's law, convex in the square p of the length: (p - mu^2)^2 / 8.
void squares(std::size_t count, const double* length, const double* rest, double* value, double* first,
             double* second) {
  for (std::size_t e = 0; e < count; ++e) {
    const double excess = (length[e] - rest[e]) * (length[e] + rest[e]);
    value[e] = excess * excess / 8;
    first[e] = excess * length[e] / 2;
    second[e] = excess / 2 + length[e] * length[e];
  }
}

// An energy, and what its rounding may be at most.
struct Judged {
  Real energy = 0, rounding = 0;
};

class Judge {
 public:
  explicit Judge(const System& system) : system_(system) {}

  Judged operator()(const RealPoints& x) const {
    Judged sum;
    Real sizes = 0;  // of which a share of 1e-18 is rounding
    for (int t = 0; t < system_.term_count(); ++t) {
      for (int e = 0; e < system_.term(t).size(); ++e) {
        Real size = 0;
        sum.energy += element(system_.term(t), e, x, size);
        sizes += size;
      }
    }
    sum.rounding = 1e-18L * (sizes + std::abs(sum.energy));
    return sum;
  }

 private:
  static Real number(const Term& term, const char* column, int e, int row = 0) {
    const MatrixXd& values = term.values(column);
    return values(row, values.cols() == 1 ? 0 : e);
  }
  static RealVector vector(const Term& term, const char* column, int e) {
    const MatrixXd& values = term.values(column);
    if (values.size() == 0) return RealVector::Zero(term.dim());
    return values.col(values.cols() == 1 ? 0 : e).cast<Real>();
  }
  static RealVector product(const Term& term, const char* column, int e, const RealVector& v) {
    const RealVector c = vector(term, column, e);
    if (term.values(column).size() == 0) return v;
    if (c.size() == 1 && std::string_view(column) != "information") return c[0] * v;
    RealVector result = RealVector::Zero(v.size());
    for (Eigen::Index i = 0; i < v.size(); ++i) {
      for (Eigen::Index j = 0; j < v.size(); ++j) result[i] += c[i + j * v.size()] * v[j];
    }
    return result;
  }

  static Real loss(const Term& term, int e, Real s) {
    const std::string_view name = term.chosen("loss");
    if (name == "quadratic") return s;
    const Real square = number(term, "scale", e) * number(term, "scale", e);
    if (name == "huber") return s <= square ? s : 2 * std::sqrt(square * s) - square;
    if (name == "geman-mcclure") return s * square / (s + square);
    const Real mu = number(term, "sharpness", e);
    if (s <= mu / (mu + 1) * square) return s;
    if (s >= (mu + 1) / mu * square) return square;
    return 2 * std::sqrt(square * mu * (mu + 1) * s) - mu * (square + s);
  }

  static Real stretch(const Term& term, int e, Real r) {
    const std::string_view law = term.chosen("law");
    const Real rest = number(term, "length", e);
    if (law == "rope") return std::max(r - rest, 0.0L);
    if (law == "repulsion") return std::min(r - rest, 0.0L);
    if (law == "interval" && r >= rest) return std::max(r - number(term, "upper", e), 0.0L);
    if (law == "own") return (r * r - rest * rest) / 2;
    EXPECT_TRUE(law == "hooke" || law == "interval") << law;
    return r - rest;
  }

  static Real element(const Term& term, int e, const RealPoints& x, Real& size) {
    const std::string_view kind = term.kind();
    const auto at = [&](int a) -> RealVector { return x.col(term.nodes()(a, e)); };
    if (kind == "loads") {
      const RealVector f = vector(term, "force", e), place = at(0);
      size = f.cwiseAbs().dot(place.cwiseAbs());
      return -f.dot(place);
    }
    const Real k = number(term, "stiffness", e);
    if (k == 0) return 0;
    RealVector d = -vector(term,
                           kind == "anchors"       ? "position"
                           : kind == "differences" ? "target"
                                                   : "offset",
                           e);
    Real parts = d.norm();
    const char* const of_difference[] = {"a", "b", "c"};
    for (int a = 0; a < term.arity(); ++a) {
      const RealVector part = kind == "differences"          ? product(term, of_difference[a], e, at(a))
                              : kind == "bendings" && a == 1 ? RealVector(-2 * at(a))
                              : term.arity() == 2 && a == 1  ? RealVector(-at(a))
                                                             : at(a);
      d += part;
      parts += part.norm();
    }
    const Real square = std::max(d.dot(product(term, "information", e, d)), 0.0L);
    const RealVector shape = vector(term, "information", e);
    const Real most = std::max(shape.norm(), Real(term.values("information").size() == 0 ? 1 : 0));
    if (kind != "links" && kind != "bendings") {
      const Real sharp = term.chosen("loss") == "truncated" ? 1 + number(term, "sharpness", e) : 1;
      size = k * most * sharp * parts * (d.norm() + 1e-18L * parts);
      return k * loss(term, e, square) / 2;
    }
    const Real r = std::sqrt(square), s = stretch(term, e, r);
    const Real by_r = term.chosen("law") == "own" ? r : 1;
    // Rounding of v^T S v is a share of |S| |v|^2, which for matrices of lower rank is more than of r^2.
    const Real of_square = most * d.norm() * parts;
    const Real rounding = std::min(1e-18L * of_square / std::max(r, 1e-300L), std::sqrt(1e-18L * of_square));
    size = k * std::abs(s) * by_r * (rounding / 1e-18L + number(term, "length", e)) +
           k * by_r * by_r * rounding * rounding / 1e-18L;
    return k * s * s / 2;
  }

  const System& system_;
};

// What was found of a system: no true bound is above the energy of any placement.
class Found {
 public:
  Found(const System& system, const char* of, std::uint64_t number)
      : system_(system), judge_(system), of_(of), number_(number) {}

  void add(const MatrixXd& x) { add(RealPoints(x.cast<Real>())); }

  // By steps of one coordinate, ever shorter ones: a descent without derivatives.
  void descend(double length) {
    if (places_.empty()) return;
    RealPoints x = lowest_place_;
    Real energy = judge_(x).energy;
    for (Real step = length; step > 1e-4L * length; step /= 8) {
      for (Eigen::Index c = 0; c < x.size(); ++c) {
        if (system_.is_fixed(static_cast<int>(c / system_.dim()))) continue;
        for (const Real by : {step, -step}) {
          const Real before = x.data()[c];
          x.data()[c] += by;
          const Real there = judge_(x).energy;
          if (there < energy) {
            energy = there;
            break;
          }
          x.data()[c] = before;
        }
      }
    }
    add(x);
  }

  Real lowest() const { return lowest_; }
  bool any() const { return !places_.empty(); }

  // `bound` claims that no energy is lower.
  void expect_below(double bound, const char* by) const {
    EXPECT_FALSE(std::isnan(bound)) << by << name();
    EXPECT_LE(static_cast<Real>(bound) - highest_bound_, 0) << by << ": a false bound" << name();
  }

  // No energy is lower than that of x, to this tolerance and the rounding of a double.
  void expect_least(const MatrixXd& x, double tolerance) const {
    const Judged here = judge_(x.cast<Real>());
    EXPECT_LE(here.energy - lowest_, tolerance + 2e5L * here.rounding + std::numeric_limits<double>::min())
        << "not the least energy" << name();
  }

  // `scale` is what `gap` is a share of.
  void expect_certificate(const Certificate& certificate, const MatrixXd& x, double gap, double scale) const {
    if (certificate.proof == Proof::NotApplicable) return;
    expect_below(certificate.lower_bound, "certificate");
    const Judged here = judge_(x.cast<Real>());
    if (certificate.certified()) expect_least(x, gap * scale);
    // A global minimum is at most as high as the lowest place, so that all places as low as x would do.
    if (!(certificate.distance < std::numeric_limits<double>::infinity())) return;
    for (const auto& [place, judged] : places_) {
      if (judged.energy + judged.rounding > here.energy - here.rounding) continue;
      const Real moved = (place - x.cast<Real>()).colwise().norm().maxCoeff();
      EXPECT_LE(moved, certificate.distance * (1 + 1e-12L)) << "a false distance" << name();
    }
  }

  std::string name() const {
    return std::string(" of ") + of_ +
           ", ASTERISM_INTERVAL_SYSTEMS=1 ASTERISM_INTERVAL_FIRST=" + std::to_string(number_);
  }

 private:
  void add(const RealPoints& x) {
    const Judged judged = judge_(x);
    if (!(std::abs(judged.energy) <= std::numeric_limits<Real>::max())) return;
    if (places_.empty() || judged.energy < lowest_) {
      lowest_ = judged.energy;
      lowest_place_ = x;
    }
    highest_bound_ = std::min(highest_bound_, judged.energy + judged.rounding);
    places_.emplace_back(x, judged);
  }

  const System& system_;
  Judge judge_;
  const char* of_;
  std::uint64_t number_;
  std::vector<std::pair<RealPoints, Judged>> places_;
  RealPoints lowest_place_;
  Real lowest_ = 0, highest_bound_ = std::numeric_limits<Real>::infinity();
};

// How much was proven, so that the test is not of nothing.
struct Count {
  long intervals = 0, certified = 0, within_percent = 0;
  void add(double bound, double upper, bool is_certified) {
    ++intervals;
    certified += is_certified ? 1 : 0;
    within_percent += upper - bound <= 0.01 * std::abs(upper) ? 1 : 0;
  }
};

// Numbers and places of the terms of a system, on a scale of its own.
class Draw {
 public:
  explicit Draw(std::uint64_t number) : rng(number) {
    nodes = 1 + pick(1 + pick(6));
    const int dims[] = {1, 2, 2, 2, 3, 3, 5};
    dim = dims[pick(7)];
    if (happens(0.2)) size = std::pow(10, rng.uniform(-6, 6));
    if (happens(0.2)) stiffness = std::pow(10, rng.uniform(-6, 6));
    origin = VectorXd::Zero(dim);
    if (happens(0.15)) origin = points(1) * std::pow(10, rng.uniform(0, 5));
  }

  Rng rng;
  int nodes, dim;
  double size = 1, stiffness = 1;
  VectorXd origin;

  bool happens(double share) { return rng.uniform(0, 1) < share; }
  int pick(int count) { return static_cast<int>(rng.uniform(0, count - 1e-9)); }
  MatrixXd points(int count) { return random_points(rng, dim, count, size); }
  MatrixXd places(int count) { return points(count).colwise() + origin; }
  // Of all elements, or one for all; some far weaker than others, some none.
  VectorXd strengths(int count) {
    VectorXd k = random_values(rng, happens(0.3) ? 1 : count, 0.05, 2);
    const double weakness = happens(0.3) ? std::pow(10, rng.uniform(-6, 0)) : 1;
    if (happens(0.1)) k[pick(static_cast<int>(k.size()))] = 0;
    if (happens(0.1)) k[pick(static_cast<int>(k.size()))] *= 1e4;
    return k * stiffness * weakness;
  }
  VectorXd lengths(int count) {
    VectorXd r = random_values(rng, happens(0.2) ? 1 : count, 0, 3 * size);
    if (happens(0.1)) r[pick(static_cast<int>(r.size()))] = 0;
    return r;
  }
  Eigen::MatrixXi elements(int arity, int count) {
    Eigen::MatrixXi result(arity, count);
    for (int e = 0; e < count; ++e) {
      const int first = pick(nodes), step = 1 + pick((nodes - 1) / (arity - 1));
      for (int a = 0; a < arity; ++a) result(a, e) = (first + a * step) % nodes;
    }
    return result;
  }
  int some() { return 1 + pick(nodes + 1); }

  void shape(Term& term) {
    if (happens(0.25)) term.values("information") = random_shapes(rng, dim, term.size(), happens(0.6));
  }
  void robust(Term& term) {
    if (!happens(0.3)) return;
    const Loss losses[] = {Loss::Huber, Loss::GemanMcClure, Loss::Truncated};
    const double scale = size * std::pow(10, rng.uniform(-1, 0.5)), sharpness = rng.uniform(0.5, 8);
    term.set_loss(losses[pick(3)], scale, sharpness);
  }
  void law(LengthTerm& term) {
    if (happens(0.3)) term.values("offset") = points(term.size()) / 3;
    shape(term);
    const LinkLaw laws[] = {LinkLaw::Rope, LinkLaw::Repulsion, LinkLaw::Interval};
    const int which = pick(8);
    if (which == 0) {
      term.set_function(squares, true);
      term.values("stiffness") /= size * size;
    } else if (which < 4) {
      term.set_law(laws[which - 1]);
      term.values("upper") = term.values("length").array() + rng.uniform(0, size);
    }
  }

  System system() {
    System result(nodes, dim);
    const int kinds = 1 + pick(4);
    if (happens(0.85)) shape(result.add_anchors(places(nodes), strengths(nodes)));
    if (nodes > 1 && happens(0.6)) {
      const int pairs = nodes * (nodes - 1) / 2;
      law(result.add_links(all_pairs(nodes), lengths(pairs), strengths(pairs)));
    }
    for (int kind = 0; kind < kinds; ++kind) add(result);
    if (nodes > 1 && happens(0.2)) result.fix(pick(nodes));
    return result;
  }

 private:
  void add(System& result) {
    const int n = some();
    switch (pick(8)) {
      case 0: {
        Eigen::RowVectorXi of(n);
        for (int& node : of) node = pick(nodes);
        Anchors& anchors = result.add_anchors(of, places(n), strengths(n));
        shape(anchors);
        return robust(anchors);
      }
      case 1:
      case 2:
        if (nodes > 1) law(result.add_links(elements(2, n), lengths(n), strengths(n)));
        return;
      case 3:
        if (nodes > 2) law(result.add_bendings(elements(3, n), lengths(n), strengths(n)));
        return;
      case 4: {
        if (nodes < 2) return;
        Offsets& offsets = result.add_offsets(elements(2, n), points(n), strengths(n));
        shape(offsets);
        return robust(offsets);
      }
      case 5: {
        if (nodes < 3) return;
        Differences& differences = result.add_differences(elements(3, n), strengths(n));
        if (happens(0.3)) {
          for (const char* const factor : {"a", "b", "c"})
            differences.values(factor) = random_points(rng, happens(0.3) ? dim * dim : 1, n, 1);
        }
        if (happens(0.5)) differences.values("target") = points(n);
        shape(differences);
        return robust(differences);
      }
      case 6:
        if (happens(0.3)) {
          Eigen::RowVectorXi of(n);
          for (int& node : of) node = pick(nodes);
          result.add_loads(of, points(n) * stiffness);
        }
        return;
      default:
        if (result.term_count() > 0 && result.term(0).kind() == "anchors") robust(result.term(0));
    }
  }
};

bool has_loads(const System& system) {
  for (int t = 0; t < system.term_count(); ++t) {
    if (system.term(t).kind() == "loads" && system.term(t).size() > 0) return true;
  }
  return false;
}

std::vector<std::string> kinds_of(const System& system) {
  std::vector<std::string> kinds;
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    std::string kind(term.kind());
    for (const Choice& choice : term.choices()) {
      const std::string_view chosen = term.chosen(choice.name);
      if (chosen != "quadratic") kind.append(", ").append(chosen);
    }
    if (term.size() > 0 && std::find(kinds.begin(), kinds.end(), kind) == kinds.end()) kinds.push_back(kind);
  }
  return kinds;
}

// What a certificate's tolerance is a share of.
double scale_at(const System& system, const MatrixXd& x) {
  if (has_loads(system)) return std::numeric_limits<double>::max();
  const double length = characteristic_length(system, x);
  return std::max(energy(system, x), 1e-10 * node_stiffness(system, x).sum() * length * length / 2);
}

void expect_true_intervals(std::uint64_t number, std::map<std::string, Count>& counts) {
  Draw draw(number);
  const System system = draw.system();
  MatrixXd start = draw.places(draw.nodes);
  if (!validate(system, start, false).empty()) return;
  Found found(system, "terms", number);
  const std::vector<std::string> kinds = kinds_of(system);
  const auto count = [&](const char* by, double bound, double upper, bool is_certified) {
    counts[by].add(bound, upper, is_certified);
    for (const std::string& kind : kinds) counts["of " + kind].add(bound, upper, is_certified);
  };
  AlignedOptions options;
  options.hold_floating = true;
  options.tolerance = 1e-9;
  options.max_iterations = 40;  // what is not a minimum then is a placement all the same
  constexpr int kStarts = 5;
  std::vector<MatrixXd> minima;
  for (int i = 0; i < kStarts; ++i) {
    MatrixXd x = i == 0 ? start : draw.places(draw.nodes) * draw.rng.uniform(0.3, 1.5);
    for (int node = 0; node < system.nodes(); ++node) {
      if (system.is_fixed(node)) x.col(node) = start.col(node);
    }
    found.add(x);
    if (!solve(system, x, options).usable()) continue;
    found.add(x);
    minima.push_back(x);
  }
  StaircaseOptions staircase;
  staircase.hold_floating = true;
  staircase.max_iterations = 100;
  const double gaps[] = {0, 1e-6, 1e-3};
  staircase.gap = gaps[draw.pick(3)];
  MatrixXd x = start;
  const Summary summary = solve_staircase(system, x, staircase);
  if (summary.usable()) {
    found.add(x);
    minima.push_back(x);
  }
  if (number % 4 == 0) found.descend(draw.size / 3);  // takes as long as all else
  if (summary.usable()) {
    found.expect_below(summary.lower_bound, "staircase");
    if (summary.message == "within the gap of the global minimum")
      found.expect_least(x, std::max(staircase.gap, 1e-6) * scale_at(system, x));
    count("staircase", summary.lower_bound, summary.final_energy, summary.is_within(1e-6));
  }
  for (std::size_t i = 0; i < minima.size(); i += 2) {
    for (const bool is_moved : {false, true}) {
      MatrixXd y = minima[minima.size() - 1 - i];
      if (is_moved) y += draw.points(draw.nodes) * std::pow(10, draw.rng.uniform(-8, 0));
      for (int node = 0; node < system.nodes(); ++node) {
        if (system.is_fixed(node)) y.col(node) = start.col(node);
      }
      const double gap = gaps[draw.pick(3)];
      const Certificate certificate = certify(system, y, {gap});
      if (certificate.proof == Proof::NotApplicable) break;
      found.expect_certificate(certificate, y, gap, scale_at(system, y));
      count("certificate", certificate.lower_bound, certificate.energy, certificate.certified());
    }
  }
}

// The same of SpringSystem, whose certificates are of another code, in templates.
template <typename Springs>
double scale_of_springs(const Springs& springs, const System& system, const MatrixXd& x) {
  if (has_loads(system)) return std::numeric_limits<double>::max();
  double stored = 0;
  for (int l = 0; const Link& link : springs.links()) {
    double length = (x.col(link.i) - x.col(link.j)).norm() + springs.rest_length[l];
    if (springs.has_offsets()) length += 3.0 * springs.rest_offset.col(l).norm();
    stored += springs.link_stiffness[l++] * length * length / 2;
  }
  return std::max(energy(system, x), 1e-10 * stored);
}

template <typename Springs>
void expect_true_springs(const char* of, std::uint64_t number, std::map<std::string, Count>& counts) {
  Rng rng(number);
  const auto pick = [&rng](int count) { return static_cast<int>(rng.uniform(0, count - 1e-9)); };
  const int nodes = Springs::kNodes == Eigen::Dynamic ? 2 + pick(5) : Springs::kNodes;
  auto drawn = testing::random_system<Springs>(rng, Springs::TopologyType::full(nodes),
                                               testing::kKinds[static_cast<std::size_t>(pick(4))]);
  Springs& springs = drawn.system;
  const typename Springs::Points& start = drawn.start;
  using Scalar = typename Springs::Scalar;
  if (pick(2) == 0) springs.anchor_stiffness *= static_cast<Scalar>(std::pow(10, rng.uniform(-4, 1)));
  if (pick(6) == 0) springs.fix(pick(nodes));
  if constexpr (Springs::kAnisotropic) {
    for (int i = 0; i < nodes; ++i) {
      const MatrixXd shape =
          random_shapes(rng, Springs::kDim, 1, pick(2) == 0).reshaped(Springs::kDim, Springs::kDim);
      springs.set_anchor_information(i, springs.anchor_stiffness[i] * shape);
    }
  }
  if constexpr (requires { springs.anchor_loss.scale; })
    springs.anchor_loss.scale = characteristic_length(to_system(springs), start.template cast<double>()) / 3;
  const auto size =
      static_cast<Scalar>(characteristic_length(to_system(springs), start.template cast<double>()));
  if (pick(6) == 0)
    springs.loads = random_points(rng, Springs::kDim, nodes, 1).template cast<Scalar>() * size *
                    springs.anchor_stiffness.mean();
  if (pick(6) == 0) springs.set_rest_offsets(start);
  const System system = to_system(springs);
  if (!validate(system, start.template cast<double>()).empty()) return;
  Found found(system, of, number);
  AlignedOptions options;
  options.tolerance = 1e-9;
  std::vector<typename Springs::Points> minima;
  for (int i = 0; i < 6; ++i) {
    MatrixXd x = start.template cast<double>();
    if (i > 0) x += random_points(rng, Springs::kDim, nodes, static_cast<double>(size));
    for (int node = 0; node < nodes; ++node) {
      if (springs.is_fixed(node)) x.col(node) = start.col(node).template cast<double>();
    }
    found.add(x);
    solve(system, x, options);
    found.add(x);
    minima.push_back(x.template cast<Scalar>());
  }
  if (pick(4) == 0) found.descend(static_cast<double>(size) / 3);
  Certifier<Springs> certifier;
  const double gaps[] = {0, 1e-6, 1e-3};
  for (auto& x : minima) {
    if (pick(2) == 0)
      x += random_points(rng, Springs::kDim, nodes, 1).template cast<Scalar>() * size *
           static_cast<Scalar>(std::pow(10, rng.uniform(-8, 0)));
    for (int node = 0; node < nodes; ++node) {
      if (springs.is_fixed(node)) x.col(node) = start.col(node);
    }
    certifier.options.gap = gaps[pick(3)];
    const Certificate certificate = certifier.certify(springs, x);
    if (certificate.proof == Proof::NotApplicable) continue;
    const MatrixXd exact = x.template cast<double>();
    found.expect_certificate(certificate, exact, certifier.options.gap,
                             scale_of_springs(springs, system, exact));
    counts[of].add(certificate.lower_bound, certificate.energy, certificate.certified());
  }
  if constexpr (std::is_same_v<Springs, testing::Plane>) {
    if (pick(10) > 0) return;
    AnySolver<Springs> search = make_solver<Springs>("branch-and-bound", {{"max_nodes", 100}, {"gap", 1e-6}});
    typename Springs::Points x = start;
    const Summary summary = search.solve(springs, x);
    if (!summary.usable()) return;
    found.add(MatrixXd(x.template cast<double>()));
    found.expect_below(summary.lower_bound, "branch and bound");
    counts["branch and bound, 100 nodes"].add(summary.lower_bound, summary.final_energy,
                                              summary.is_within(1e-6));
  }
}

template <typename Check>
void of_systems(Check&& check) {
  const int first = environment("ASTERISM_INTERVAL_FIRST", 0);
  const int count = environment("ASTERISM_INTERVAL_SYSTEMS", 500);
  std::map<std::string, Count> counts;
  for (int number = first; number < first + count && !::testing::Test::HasFailure(); ++number)
    check(static_cast<std::uint64_t>(number), counts);
  for (const auto& [name, c] : counts) {
    const auto percent = [of = static_cast<double>(c.intervals)](long n) {
      return 100.0 * static_cast<double>(n) / of;
    };
    std::printf("  %-32s %9ld intervals, %5.1f %% certified, %5.1f %% within 1 %%\n", name.c_str(),
                c.intervals, percent(c.certified), percent(c.within_percent));
  }
}

TEST(Intervals, OfTermsAreTrue) { of_systems(expect_true_intervals); }

TEST(Intervals, OfSpringsAreTrue) {
  of_systems([](std::uint64_t number, std::map<std::string, Count>& counts) {
    switch (number % 10) {
      case 0:
        return expect_true_springs<testing::Fixed2>("four nodes", number, counts);
      case 1:
        return expect_true_springs<testing::Fixed2f>("four nodes in float", number, counts);
      case 2:
        return expect_true_springs<testing::Plane>("springs", number, counts);
      case 3:
        return expect_true_springs<testing::Space>("springs in space", number, counts);
      case 4:
        return expect_true_springs<testing::Line>("springs on a line", number, counts);
      case 5:
        return expect_true_springs<testing::Spacef>("springs in space in float", number, counts);
      case 6:
        return expect_true_springs<testing::Ropes::System>("ropes", number, counts);
      case 7:
        return expect_true_springs<testing::Spacers::System>("repulsion", number, counts);
      case 8:
        return expect_true_springs<testing::Ellipses::System>("anchors with information", number, counts);
      default:
        return expect_true_springs<testing::Hubers::System>("robust anchors", number, counts);
    }
  });
}

// Anchors whose information nearly takes the distance to 0: the energy is rounded by more than its value.
TEST(Intervals, AccountForTheRoundingOfInformation) {
  std::map<std::string, Count> counts;
  expect_true_springs<testing::Ellipses::System>("anchors with information", 900308, counts);
  EXPECT_GT(counts.begin()->second.intervals, 0);
}

// The energy is 0 because its square is no double.
TEST(Intervals, AccountForUnderflow) {
  constexpr double kFar = 1e-163;
  const MatrixXd x{{kFar}, {0}};
  System system(1, 2);
  system.add_anchors(MatrixXd::Zero(2, 1), System::all(1));
  const Certificate certificate = certify(system, x);
  EXPECT_TRUE(certificate.certified());
  EXPECT_GE(certificate.distance, kFar);
  testing::Plane springs(Topology<>::full(1));
  springs.anchors.setZero();
  springs.anchor_stiffness.setOnes();
  const Certificate same = certify(springs, testing::Plane::Points(x));
  EXPECT_TRUE(same.certified());
  EXPECT_GE(same.distance, kFar);
}

}  // namespace
}  // namespace asterism
