#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/matrix/diagonalise.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <cmath>
#include <limits>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "direction.hpp"
#include "matrix.hpp"
#include "methods.hpp"
#include "rotation.hpp"
#include "run.hpp"
#include "stopping_rule.hpp"

// Offsets that turn and scale with the constellation.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr int kMemory = 5;  // steps that the extrapolation uses
constexpr int kMostTurns = 1000;
constexpr double kRounding = 64 * std::numeric_limits<double>::epsilon();

auto numbers_of(const Term& term, std::string_view column, int element) {
  const Matrix& values = term.values(column);
  return values.col(values.cols() == 1 ? 0 : element);
}

// The greatest curvature of an element's energy.
double stiffness_of(const Term& term, int element) {
  const double k = numbers_of(term, "stiffness", element)[0];
  if (term.values("information").size() == 0) return k;
  return k * largest_eigenvalue(numbers_of(term, "information", element).reshaped(term.dim(), term.dim()));
}

bool is_link(const Term& term) { return term.kind() == "links" || term.kind() == "offsets"; }
bool has_offsets(const Term& term) { return is_link(term) && term.values("offset").size() > 0; }

class Turning {
 public:
  Turning(const System& system, const TurningOptions& options, Matrix& transform)
      : options_(options),
        solver_(options),
        system_(system),
        turned_(system),
        others_(system),
        separate_(0, system.dim()),
        transform_(transform) {
    solver_.tolerance = 1e-4 * options.tolerance;  // a step of T follows from the forces that are left
    transform_.setIdentity(dim(), dim());
    node_stiffness_.setZero(system.nodes());
    std::vector<const Term*> of_links;
    int links = 0;
    for (int t = 0; t < system.term_count(); ++t) {
      const Term& term = system.term(t);
      if (is_link(term)) {
        links += term.size();
        of_links.push_back(&others_.term(t));
      } else if (term.kind() == "anchors") {
        for (int e = 0; e < term.size(); ++e) node_stiffness_[term.nodes()(0, e)] += stiffness_of(term, e);
      }
    }
    for (const Term* term : of_links) others_.remove(*term);

    pairs_.resize(2, links);
    stiffness_.resize(links);
    offset_.setZero(dim(), links);
    separate_.add_nodes(2 * links);
    int l = 0;
    for (int t = 0; t < system.term_count(); ++t) {
      const Term& term = system.term(t);
      if (!is_link(term)) continue;
      pairs_.middleCols(l, term.size()) = term.nodes();
      Eigen::MatrixXi own(2, term.size());
      for (int e = 0; e < term.size(); ++e, ++l) {
        own.col(e) << 2 * l, 2 * l + 1;
        stiffness_[l] = stiffness_of(term, e);
        if (stiffness_[l] > 0 && has_offsets(term)) offset_.col(l) = numbers_of(term, "offset", e);
      }
      separate_.add(term.clone()).set_nodes(std::move(own));
    }
  }

  Summary run(Matrix& x) {
    // At first with x held, as the start is the user's.
    respond(false);
    set(step(x).to);
    const double initial = energy(turned_, x);
    respond(true);
    Summary result = SystemAuto{solver_}.solve(turned_, x);
    double least_shift = std::numeric_limits<double>::infinity();
    for (int turn = 0; turn < kMostTurns && result.usable() && result.status != Status::Interrupted; ++turn) {
      const Matrix next = step(x).to;
      const double shift = shift_to(next);
      rule_.set(turned_, x, options_.tolerance);
      const bool is_stationary = rule_.reached(gradient_at(x)) && shift <= rule_.tolerance() * rule_.length();
      result.status = is_stationary ? Status::Converged : Status::MaxIterations;
      result.message = is_stationary ? "stationary to the tolerance" : "not yet stationary";
      result.final_energy = energy(turned_, x);
      if (is_stationary || result.iterations >= options_.max_iterations) break;
      const double reached = result.final_energy;
      const bool moves =
          solve_with(extrapolated(next), reached, x, result) || solve_with(next, reached, x, result);
      if (!moves || !(result.final_energy < reached || shift < least_shift / 2)) {
        result.status = Status::NoProgress;
        result.message = "stopped short of the tolerance";
        break;
      }
      least_shift = std::min(least_shift, shift);
    }
    result.initial_energy = initial;
    if (result.usable()) judge(x, result);
    return result;
  }

 private:
  // A step of T.
  struct Step {
    Matrix to;        // the T it leads to
    Matrix target;    // M: among all T, that nearest to it minimises the quadratic
    double rounding;  // of M
  };

  int dim() const { return system_.dim(); }

  Matrix gradient_at(const Matrix& x) const {
    Matrix gradient;
    energy_and_gradient(turned_, x, gradient);
    return gradient;
  }

  void judge(const Matrix& x, Summary& result) {
    const Matrix slope = gradient_at(x);
    const Step last = step(x);
    rule_.set(turned_, x, options_.tolerance);
    const double length = rule_.length(), turn = length > 0 ? shift_to(last.to) / length : 0;
    result.final_energy = energy(turned_, x);
    result.gradient_norm = slope.norm();
    result.stationarity = std::max(rule_.stationarity(slope), turn);
    if (result.positive_definite == true)
      result.positive_definite = is_quadratic() ? std::optional(is_strict(last)) : std::nullopt;
  }

  // Whether the energy is quadratic in x and T.
  bool is_quadratic() const {
    for (int t = 0; t < system_.term_count(); ++t) {
      const Term& term = system_.term(t);
      if (term.kind() == "loads") continue;
      if (term.values("information").size() > 0 || term.chosen("loss") != "quadratic") return false;
      for (int e = 0; term.kind() == "links" && e < term.size(); ++e) {
        const bool is_long = numbers_of(term, "length", e)[0] > 0 && numbers_of(term, "stiffness", e)[0] > 0;
        if (is_long || term.chosen("law") != "hooke") return false;
      }
    }
    return true;
  }

  // Whether the quadratic rises wherever T = s R turns: by s trace(W^T W P) for a rotation by exp(W), where
  // P = R^T M is symmetric; and, with `scale`, by trace(S) for a change of s.
  bool is_strict(const Step& last) const {
    if (!(curvature_.trace() > (options_.scale ? last.rounding : 0.0))) return false;
    if (dim() == 1) return true;
    const double scale = last.to.col(0).norm();
    Matrix P = last.to.transpose().lazyProduct(last.target), modes;
    P = (P + P.transpose()).eval() / 2;
    diagonalise(P, modes);
    Vector values = P.diagonal();
    std::sort(values.begin(), values.end());
    return values[0] + values[1] > scale * last.rounding;
  }

  // One more solve with T, from x as T moves it. False, with x and T as they were, if its energy is not below
  // `reached`.
  bool solve_with(const Matrix& T, double reached, Matrix& x, Summary& result) {
    const Matrix before = transform_, start = x;
    x += (T - before).lazyProduct(response_);
    set(T);
    solver_.max_iterations = std::max(1, options_.max_iterations - result.iterations);
    const Summary done = std::exchange(result, SystemAuto{solver_}.solve(turned_, x));
    result.add_work(done);
    if (result.usable() && result.final_energy <= reached) return true;
    x = start;
    set(before);
    return false;
  }

  void set(const Matrix& T) {
    transform_ = T;
    for (int t = 0, s = 0; t < system_.term_count(); ++t) {
      const Term& term = system_.term(t);
      if (!is_link(term)) continue;
      if (has_offsets(term)) {
        const Matrix offsets = T.lazyProduct(term.values("offset"));
        turned_.term(t).values("offset") = offsets;
        separate_.term(s).values("offset") = offsets;
      }
      ++s;
    }
  }

  // How far nodes move, or offsets change, as T goes to `next`.
  double shift_to(const Matrix& next) const {
    const Matrix change = next - transform_;
    const auto farthest = [&](const Matrix& points) {
      return points.cols() == 0 ? 0.0 : change.lazyProduct(points).colwise().norm().maxCoeff();
    };
    return std::max(farthest(response_), farthest(offset_));
  }

  // Sets the response y of x to T, in the quadratic above the energy, and the quadratic's curvature S; with
  // x held, y = 0. It is IDA's solution for the offsets as they are and all anchors at the origin. One that
  // is not exact only makes the quadratic steeper.
  void respond(bool moves) {
    const int n = system_.nodes();
    response_.setZero(dim(), n);
    if (moves) {
      System plain(n, dim());
      plain.add_anchors(Matrix::Zero(dim(), n), node_stiffness_);
      plain.add_offsets(pairs_, offset_, stiffness_);
      for (int i = 0; i < n; ++i) {
        if (system_.is_fixed(i)) plain.fix(i);
      }
      for (const int node : floating_nodes(plain)) plain.fix(node);
      SystemMatrix matrix(SystemMatrix::Storage::Best);
      SystemFactor factor;
      matrix.assemble(plain, response_, Curvature::Majorising);
      const int steps = factor.factorize(matrix) ? 3 : 0;  // the second one corrects rounding
      for (int step = 0; step < steps; ++step) {
        Matrix gradient;
        energy_and_gradient(plain, response_, gradient);
        response_ -= factor.solve(gradient);
      }
    }
    curvature_.setZero(dim(), dim());
    for (int i = 0; i < n; ++i)
      curvature_ += node_stiffness_[i] * response_.col(i) * response_.col(i).transpose();
    double size = 0;
    left_.resize(dim(), pairs_.cols());
    for (Eigen::Index l = 0; l < pairs_.cols(); ++l) {
      const auto yi = response_.col(pairs_(0, l)), yj = response_.col(pairs_(1, l));
      left_.col(l) = offset_.col(l) - (yi - yj);
      curvature_ += stiffness_[l] * left_.col(l) * left_.col(l).transpose();
      const double terms = offset_.col(l).norm() + yi.norm() + yj.norm();
      size += stiffness_[l] * terms * terms;
    }
    // Where nothing but links resists T, S is what the rounding of y leaves.
    if (!(curvature_.trace() > kRounding * kRounding * size)) curvature_.setZero();
  }

  // To the T that minimises, with the x best for it, the quadratic that touches the energy at x and the
  // present T.
  Step step(const Matrix& x) {
    Matrix M = transform_.lazyProduct(curvature_), pulls;
    double size = M.norm();
    energy_and_gradient(others_, x, pulls);  // 0 for fixed nodes
    for (int i = 0; i < system_.nodes(); ++i) {
      if (system_.is_fixed(i)) continue;
      M -= pulls.col(i) * response_.col(i).transpose();
      size += (pulls.col(i).norm() + node_stiffness_[i] * x.col(i).norm()) * response_.col(i).norm();
    }
    // Each link with nodes of its own, which have its force alone.
    ends_.resize(dim(), 2 * pairs_.cols());
    for (Eigen::Index l = 0; l < pairs_.cols(); ++l) {
      ends_.col(2 * l) = x.col(pairs_(0, l));
      ends_.col(2 * l + 1) = x.col(pairs_(1, l));
    }
    energy_and_gradient(separate_, ends_, forces_);
    for (Eigen::Index l = 0; l < pairs_.cols(); ++l) {
      M += forces_.col(2 * l) * left_.col(l).transpose();
      size += forces_.col(2 * l).norm() * left_.col(l).norm();
    }
    const double rounding = kRounding * size, stiffness = curvature_.trace();
    if (!(stiffness > 0 && M.allFinite())) return {transform_, M, rounding};
    // Where no turn is better than another, T keeps its own.
    const bool turns = M.norm() > rounding;
    return {nearest(turns ? M : transform_, M, stiffness), M, rounding};
  }

  // The similarity or rotation T = s R with the R nearest to `turn` and the s that minimises |M / size - T|.
  Matrix nearest(const Matrix& turn, const Matrix& M, double size) const {
    const Matrix R = nearest_rotation(turn, false);
    if (!options_.scale) return R;
    return std::max(R.cwiseProduct(M).sum() / size, 0.0) * R;
  }

  // Where the sequence of T leads, as the next step is to `next`: Anderson's extrapolation.
  Matrix extrapolated(const Matrix& next) {
    targets_.push_back(next.reshaped());
    changes_.push_back(next.reshaped() - transform_.reshaped());
    if (changes_.size() > kMemory) {
      targets_.erase(targets_.begin());
      changes_.erase(changes_.begin());
    }
    const auto count = static_cast<Eigen::Index>(changes_.size()) - 1;
    if (count == 0) return next;
    // The differences of the steps, of unit length, and what they lead to.
    Matrix steps(next.size(), count), leads(next.size(), count);
    for (Eigen::Index c = 0; c < count; ++c) {
      const auto at = static_cast<std::size_t>(c);
      steps.col(c) = changes_[at + 1] - changes_[at];
      leads.col(c) = targets_[at + 1] - targets_[at];
      const double norm = steps.col(c).norm();
      if (!(norm > 0)) return next;
      steps.col(c) /= norm;
      leads.col(c) /= norm;
    }
    // Least squares, without directions that the differences hardly have.
    Matrix squares = steps.transpose().lazyProduct(steps), modes;
    diagonalise(squares, modes);
    Vector weights = modes.transpose().lazyProduct(steps.transpose().lazyProduct(changes_.back()));
    constexpr double kLeast = 1e-13;
    for (Eigen::Index c = 0; c < count; ++c)
      weights[c] = squares(c, c) > kLeast ? weights[c] / squares(c, c) : 0.0;
    const Vector at = targets_.back() - leads.lazyProduct(modes.lazyProduct(weights));
    if (!at.allFinite()) return next;
    const Matrix M = at.reshaped(dim(), dim());
    return nearest(M, M, dim());
  }

  const TurningOptions& options_;
  ThreadedOptions solver_;
  const System& system_;
  System turned_;    // with the offsets T m
  System others_;    // without links
  System separate_;  // the links, each with nodes of its own
  Matrix& transform_;
  SystemRule rule_;
  Eigen::Matrix2Xi pairs_;  // of all links
  Vector stiffness_;        // theirs, the greatest of their curvature
  Matrix offset_;           // m, 0 where there is no stiffness
  Vector node_stiffness_;   // of the anchors
  Matrix response_;         // y
  Matrix left_;             // m_ij - (y_i - y_j), the part of an offset that y leaves to the link
  Matrix curvature_;        // S, of the energy by T with x that follows it
  Matrix ends_, forces_;
  std::vector<Vector> targets_, changes_;  // T's of the last steps, and the changes that led to them
};

// Why the offsets cannot turn; empty if they can.
std::string why_not(const System& system) {
  bool any = false;
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    const std::string kind(term.kind());
    if (!is_link(term) && kind != "anchors" && kind != "loads")
      return kind + ": only anchors, loads and links can be beside offsets that turn";
    if (const char* why = term.problem_with(Curvature::Majorising)) return kind + ": " + why;
    any |= has_offsets(term) && term.size() > 0;
  }
  return any ? std::string() : "no link has an offset";
}

}  // namespace

}  // namespace detail

Summary solve_turning(const System& system, Eigen::MatrixXd& x, Eigen::MatrixXd& transform,
                      const TurningOptions& options) {
  constexpr std::string_view kName = "turning offsets";
  const detail::Stopwatch stopwatch;
  if (const char* problem = options.problem()) return detail::refused(kName, problem);
  if (options.gap > 0)
    return detail::refused(kName, "option gap: no lower bound is known for offsets that turn");
  if (detail::shares_memory(system, x)) return detail::refused(kName, detail::kSharesMemory);
  if (const std::string problem = validate(system, x, !options.hold_floating); !problem.empty())
    return detail::refused(kName, std::string_view(problem));
  if (const std::string problem = detail::why_not(system); !problem.empty())
    return detail::refused(kName, std::string_view(problem));
  Summary result;
  Eigen::MatrixXd points = x;  // x stays if a function of the user's throws
  const auto work = [&] { result = detail::Turning(system, options, transform).run(points); };
  detail::attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) {
    result.status = Status::OutOfMemory;
    result.message = detail::memory_message(error);
  });
  if (result.usable()) x = points;
  result.solver = kName;
  result.seconds = stopwatch.seconds();
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
