#include <Eigen/Dense>
#include <asterism/solver/ranges/path.hpp>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "path_chain.hpp"
#include "path_descent.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

const char* PathStreamOptions::problem() const {
  const auto positive = [](double v) { return v > 0 && std::isfinite(v); };
  if (window < 16) return "window has to be >= 16";
  if (!(cutoff > 0)) return "cutoff has to be > 0";
  if (!positive(turn_sigma)) return "turn_sigma has to be a finite number > 0";
  if (!positive(step_sigma)) return "step_sigma has to be a finite number > 0";
  if (!positive(shortest)) return "shortest has to be a finite number > 0";
  for (const double v : start)
    if (!std::isfinite(v)) return "start has to be finite";
  if (!positive(start_sigma[0]) || !positive(start_sigma[1]))
    return "start_sigma has to be finite numbers > 0";
  if (settle_every < 1) return "settle_every has to be >= 1";
  return nullptr;
}

using ranges::Complex;
using ranges::PathChain;
using ranges::PathCurvature;
using ranges::PathRange;
using Point = PathChain<2>::Point;
using Block = PathChain<2>::Block;

namespace {

constexpr double kLargest = 1e60;
constexpr std::size_t kLately = 64;   // positions that a single range may move
constexpr std::size_t kEarly = 1000;  // ranges before the first step
constexpr std::size_t kRangesANode = 8;

}  // namespace

class PathStream::Implementation {
 public:
  explicit Implementation(const PathStreamOptions& options)
      : options_(options),
        window_(static_cast<std::size_t>(options.window)),
        chunk_(std::max<std::size_t>(window_ / 10, 4)),
        bound_(options.cutoff * options.cutoff),
        chain_(terms_) {
    terms_.turn_sigma = options.turn_sigma;
    terms_.step_sigma = options.step_sigma;
    const std::size_t most = window_ + chunk_ + 2;
    chain_.reserve(most);
    delta_.reserve(most);
    forward_.reserve(most);
    terms_.turn.reserve(most);
    terms_.length.reserve(most);
  }

  Message move(double x, double y, double turn) {
    for (const double v : {x, y, turn})
      if (!(std::abs(v) <= kLargest)) return "a step has to be finite numbers";
    moved_ += std::polar(1.0, turned_) * Complex(x, y);
    turned_ = std::remainder(turned_ + turn, 2 * std::numbers::pi);
    if (std::abs(moved_) >= options_.shortest) append();
    return {};
  }

  Message range(double x, double y, double range, double sigma) {
    if (!(std::abs(x) <= kLargest && std::abs(y) <= kLargest)) return "a beacon has to be finite numbers";
    if (std::isnan(range)) return {};
    if (!(range >= 0)) return "a range has to be >= 0";
    if (!(range <= kLargest)) return "a range has to be finite";
    if (!(sigma > 1 / kLargest && sigma <= kLargest)) return "sigma has to be a finite number > 0";
    if (terms_.ranges.size() >= kRangesANode * window_) {
      if (chain_.nodes() < 2 * chunk_ + 4) return "too many ranges from one place";
      marginalise();
    }
    if (pending_.size() >= kEarly && chain_.nodes() < 2) return "too many ranges before the first step";
    pending_.push_back(moved_);
    PathRange added{0, -1, 0.0, Complex(x, y), range, 1 / (sigma * sigma), 0};
    if (chain_.nodes() >= 2) {
      added.node = static_cast<int>(chain_.nodes()) - 2;
      added.at = 1.0 + moved_ / last_;
      dirty_ = std::min(dirty_, chain_.nodes() - 2);
    }
    terms_.ranges.push_back(added);
    if (chain_.nodes() < 2) return {};
    if (++count_ >= options_.settle_every) {
      count_ = 0;
      settle();
    } else {
      update();
    }
    return {};
  }

  std::array<double, 3> pose() const {
    if (chain_.nodes() < 2) {
      const Complex p =
          Complex(options_.start[0], options_.start[1]) + std::polar(1.0, options_.start[2]) * moved_;
      return {p.real(), p.imag(), std::remainder(options_.start[2] + turned_, 2 * std::numbers::pi)};
    }
    const std::size_t n = chain_.nodes();
    const Point step = estimate(n - 1) - estimate(n - 2);
    const Complex turn = Complex(step[0], step[1]) / last_;
    const Point p = estimate(n - 1) + PathChain<2>::of(turn * moved_);
    return {p[0], p[1], std::arg(turn * std::polar(1.0, turned_))};
  }

  std::array<double, 4> covariance() {
    if (chain_.nodes() < 2) {
      constexpr double kInfinity = std::numeric_limits<double>::infinity();
      return {kInfinity, 0, 0, kInfinity};
    }
    if (dirty_ < chain_.nodes()) update();
    Block before, last, cross;
    chain_.invert_last(before, last, cross);
    const Complex a = 1.0 + moved_ / last_;
    const Block b = PathChain<2>::block(1.0 - a), c = PathChain<2>::block(a);
    const Block mixed = c * cross * b.transpose();
    const Block s = b * before * b.transpose() + c * last * c.transpose() + mixed + mixed.transpose();
    const double off = 0.5 * (s(0, 1) + s(1, 0));
    return {s(0, 0), off, off, s(1, 1)};
  }

  void settle() {
    const std::size_t n = chain_.nodes();
    if (n < 2) return;
    const double small = 1e-6 * options_.shortest;
    PathCurvature curvature = PathCurvature::True;
    double before = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 60; ++i) {
      std::size_t first = relinearise(small, 0);
      first = std::min(first, dirty_);
      const double largest = solve(first, curvature, 0);
      if (largest < small) return;
      // Newton's method may leave the basin, or come no nearer.
      curvature = i > 3 && largest > before / 2 ? PathCurvature::Convex : PathCurvature::True;
      before = largest;
    }
  }

  std::vector<double> positions() const {
    std::vector<double> list;
    for (std::size_t k = 0; k < chain_.nodes(); ++k) {
      const Point p = estimate(k);
      list.insert(list.end(), {p[0], p[1]});
    }
    return list;
  }

  std::vector<double> batch() const {
    PathChain<2> chain(terms_);
    for (std::size_t k = 0; k < chain_.nodes(); ++k) {
      const double t = static_cast<double>(k), size = 1e-2 * options_.shortest;
      chain.x.push_back(estimate(k) + size * Point(std::sin(t / 50), std::cos(t / 70)));
    }
    std::vector<double> list;
    if (chain.nodes() < 2) return list;
    ranges::PathDescent<2> descent;
    descent.run(chain, bound_, 200);
    for (const Point& p : chain.x) list.insert(list.end(), {p[0], p[1]});
    return list;
  }

  double energy() const {
    if (chain_.nodes() < 2) return 0;
    PathChain<2> chain(terms_);
    for (std::size_t k = 0; k < chain_.nodes(); ++k) chain.x.push_back(estimate(k));
    return chain.energy(bound_);
  }

 private:
  Point estimate(std::size_t k) const { return chain_.x[k] + delta_[k]; }

  void add_node(const Point& x) {
    chain_.x.push_back(x);
    delta_.push_back(Point::Zero());
    forward_.push_back(Point::Zero());
  }

  void append() {
    const std::size_t n = chain_.nodes();
    if (n == 0) {
      const Complex start(options_.start[0], options_.start[1]),
          step = std::polar(1.0, options_.start[2]) * moved_;
      const double length = std::abs(moved_);
      terms_.start = start;
      terms_.first_step = step;
      terms_.start_weight = std::pow(options_.start_sigma[0], -2);
      terms_.heading_weight = std::pow(options_.start_sigma[1] * length, -2);
      add_node(PathChain<2>::of(start));
      add_node(PathChain<2>::of(start + step));
      dirty_ = 0;
    } else {
      const Complex turn = moved_ / last_;
      terms_.turn.push_back(turn);
      const Point p = estimate(n - 1);
      add_node(p + PathChain<2>::times(turn, p - estimate(n - 2)));
      dirty_ = std::min(dirty_, n - 2);
    }
    terms_.length.push_back(std::abs(moved_));
    // What was heard since the last node was on the way to this one.
    for (std::size_t i = 0; i < pending_.size(); ++i) {
      PathRange& range = terms_.ranges[terms_.ranges.size() - pending_.size() + i];
      range.node = static_cast<int>(chain_.nodes()) - 2;
      range.at = pending_[i] / moved_;
    }
    pending_.clear();
    last_ = moved_;
    moved_ = 0;
    if (chain_.nodes() >= window_ + chunk_) marginalise();
  }

  void update() {
    const std::size_t n = chain_.nodes();
    const std::size_t lately = n > kLately ? n - kLately : 0;
    const std::size_t first = relinearise(1e-3 * options_.shortest, lately);
    solve(std::min(first, dirty_), PathCurvature::Convex, 1e-4 * options_.shortest);
  }

  /// The linearisation moves to the estimate, from the first position on that is away from it by more than
  /// `small`, of those from `from` on. Returns that position, or the number of positions.
  std::size_t relinearise(double small, std::size_t from) {
    const std::size_t n = chain_.nodes();
    std::size_t first = from;
    while (first < n && delta_[first].squaredNorm() <= small * small) ++first;
    for (std::size_t k = first; k < n; ++k) {
      chain_.x[k] += delta_[k];
      delta_[k].setZero();
    }
    return first;
  }

  /// Solves for the distances from the linearisation, where the positions from `changed` on, or their terms,
  /// have changed. From where on the solution changes by less than `quiet`, earlier ones are kept. Returns
  /// the largest distance.
  double solve(std::size_t changed, PathCurvature curvature, double quiet) {
    const std::size_t n = chain_.nodes(), first = changed < 2 ? 0 : changed - 2;
    if (first < n) {
      chain_.assemble(curvature, bound_, first);
      if (!chain_.factorize(first)) {
        chain_.assemble(PathCurvature::Convex, bound_, first);
        if (!chain_.factorize(first)) {
          // Columns before have another linearisation; all are renewed.
          for (std::size_t k = 0; k < n; ++k) {
            chain_.x[k] += delta_[k];
            delta_[k].setZero();
          }
          dirty_ = 0;
          chain_.assemble(PathCurvature::Convex, bound_);
          if (!chain_.factorize()) return 0;
          return back(0, quiet);
        }
      }
    }
    return back(first, quiet);
  }
  double back(std::size_t first, double quiet) {
    const std::size_t n = chain_.nodes();
    for (std::size_t k = first; k < n; ++k) forward_[k] = -chain_.gradient[k];
    chain_.forward(forward_, first);
    dirty_ = n;
    double largest = 0;
    int still = 0;
    const Point zero = Point::Zero();
    for (std::size_t k = n; k-- > 0;) {
      const Point d =
          chain_.backward(forward_[k], k, k + 1 < n ? delta_[k + 1] : zero, k + 2 < n ? delta_[k + 2] : zero);
      still = (d - delta_[k]).squaredNorm() < quiet * quiet ? still + 1 : 0;
      delta_[k] = d;
      largest = std::max(largest, d.squaredNorm());
      if (k < first && still >= 2) break;
    }
    return std::sqrt(largest);
  }

  /// The oldest positions become a quadratic function of the next two.
  void marginalise() {
    settle();
    for (std::size_t k = 0; k < chain_.nodes(); ++k) {
      chain_.x[k] += delta_[k];
      delta_[k].setZero();
    }
    std::size_t range = 0;
    for (std::size_t k = 0; k < chunk_; ++k) eliminate(k, range);
    const auto drop = [](auto& list, std::size_t count) {
      list.erase(list.begin(), list.begin() + static_cast<std::ptrdiff_t>(count));
    };
    for (auto* list : {&chain_.x, &delta_, &forward_}) drop(*list, chunk_);
    drop(terms_.turn, chunk_);
    drop(terms_.length, chunk_);
    drop(terms_.ranges, range);
    for (PathRange& left : terms_.ranges) left.node -= static_cast<int>(chunk_);
    dirty_ = 0;
    settle();
  }

  /// Node k, which is the first: its prior and terms, without it. `range`: the first of its ranges.
  void eliminate(std::size_t k, std::size_t& range) {
    using Matrix = Eigen::Matrix<double, 6, 6>;
    Matrix h = Matrix::Zero();
    Eigen::Matrix<double, 6, 1> g = Eigen::Matrix<double, 6, 1>::Zero();
    ranges::PathPrior& prior = terms_.prior;
    Eigen::Vector4d z;
    z << chain_.x[k], chain_.x[k + 1];
    h.topLeftCorner<4, 4>() = prior.hessian;
    g.head<4>() = prior.gradient + prior.hessian * (z - prior.place);
    // A term with curvature c and slope s in the difference sum of block(a_i) x_i.
    const auto add = [&](std::array<Complex, 3> a, const Block& c, const Point& s) {
      for (int i = 0; i < 3; ++i) {
        const Block left = PathChain<2>::block(a[static_cast<std::size_t>(i)]).transpose();
        g.segment<2>(2 * i) += left * s;
        for (int j = 0; j < 3; ++j)
          h.block<2, 2>(2 * i, 2 * j) += left * c * PathChain<2>::block(a[static_cast<std::size_t>(j)]);
      }
    };
    if (k == 0 && terms_.start_weight > 0) {
      add({1.0, 0.0, 0.0}, terms_.start_weight * Block::Identity(),
          terms_.start_weight * (chain_.x[0] - PathChain<2>::of(terms_.start)));
      add({-1.0, 1.0, 0.0}, terms_.heading_weight * Block::Identity(),
          terms_.heading_weight * (chain_.x[1] - chain_.x[0] - PathChain<2>::of(terms_.first_step)));
      terms_.start_weight = terms_.heading_weight = 0;
    }
    const double w = terms_.chain_weight(k);
    add({terms_.turn[k], -1.0 - terms_.turn[k], 1.0}, w * Block::Identity(), w * chain_.chain_residual(k));
    const auto radial = [](const Point& y, double rest, double first, double second) {
      const double l = std::max(y.norm(), 1e-9 * (rest + 1e-3));
      const Point u = y / l;
      const double across = std::max(first / l, 0.0);
      return std::pair<Block, Point>((second - across) * u * u.transpose() + across * Block::Identity(),
                                     first * u);
    };
    const Point step = chain_.x[k + 1] - chain_.x[k];
    const double v = terms_.step_weight(k), rest = terms_.length[k];
    const auto [c, s] = radial(step, rest, v * (step.norm() - rest), v);
    add({-1.0, 1.0, 0.0}, c, s);
    for (; range < terms_.ranges.size() && terms_.ranges[range].node == static_cast<int>(k); ++range) {
      const PathRange& of = terms_.ranges[range];
      const Point y = chain_.difference(of);
      const ranges::RangeSlope slope = ranges::range_slope(y.norm() - of.length, of.information, bound_);
      const auto [curvature, first] = radial(y, of.length, slope.first, slope.weight * of.information);
      add({1.0 - of.at, of.at, 0.0}, curvature, first);
    }
    const Block inverse = h.topLeftCorner<2, 2>().inverse();
    const Eigen::Matrix<double, 4, 2> gain = h.bottomLeftCorner<4, 2>() * inverse;
    prior.hessian = h.bottomRightCorner<4, 4>() - gain * h.topRightCorner<2, 4>();
    prior.hessian = (0.5 * (prior.hessian + prior.hessian.transpose())).eval();
    prior.gradient = g.tail<4>() - gain * g.head<2>();
    prior.place << chain_.x[k + 1], chain_.x[k + 2];
  }

  PathStreamOptions options_;
  std::size_t window_, chunk_;
  double bound_;
  ranges::PathTerms terms_;
  PathChain<2> chain_;  ///< at the linearisation
  std::vector<Point> delta_, forward_;
  std::vector<Complex> pending_;  ///< of the last ranges: how far from the last node they were measured
  Complex moved_ = 0, last_ = 0;  ///< since the last node, and from the one before to it
  double turned_ = 0;
  std::size_t dirty_ = 0;  ///< the first node with new terms
  int count_ = 0;
};

PathStream::PathStream(const PathStreamOptions& options) {
  if (const char* problem = options.problem()) throw std::invalid_argument(problem);
  implementation_ = std::make_unique<Implementation>(options);
}
PathStream::PathStream(PathStream&&) noexcept = default;
PathStream& PathStream::operator=(PathStream&&) noexcept = default;
PathStream::~PathStream() = default;
Message PathStream::move(double x, double y, double turn) { return implementation_->move(x, y, turn); }
Message PathStream::range(double x, double y, double range, double sigma) {
  return implementation_->range(x, y, range, sigma);
}
std::array<double, 3> PathStream::pose() const { return implementation_->pose(); }
std::array<double, 4> PathStream::covariance() { return implementation_->covariance(); }
void PathStream::settle() { implementation_->settle(); }
std::vector<double> PathStream::positions() const { return implementation_->positions(); }
std::vector<double> PathStream::batch() const { return implementation_->batch(); }
double PathStream::energy() const { return implementation_->energy(); }

}  // namespace ASTERISM_ABI
}  // namespace asterism
