#pragma once

// The energy of a path from ranges, and the block band of width two with a border that its minimum needs.

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <vector>

#include "../terms/kernels.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace ranges {

using Complex = std::complex<double>;

/// A range to a beacon from (1 - at) p_node + at p_(node + 1).
struct PathRange {
  int node;
  int beacon;  ///< an unknown one's index, or -1
  Complex at;
  Complex place;       ///< of a known beacon [m]
  double length;       ///< [m]
  double information;  ///< 1 / sigma^2 [1 / m^2]
  int index;           ///< the user's
};

/// A quadratic function of the first two positions: 1/2 (z - z0)^T H (z - z0) + g^T (z - z0).
struct PathPrior {
  Eigen::Matrix4d hessian = Eigen::Matrix4d::Zero();
  Eigen::Vector4d gradient = Eigen::Vector4d::Zero(), place = Eigen::Vector4d::Zero();
};

/// The terms. Positions are the nodes of a chain in which step k + 1 is step k times turn_k.
struct PathTerms {
  std::vector<Complex> turn;      ///< (n - 2)
  std::vector<double> length;     ///< of the steps (n - 1) [m]
  std::vector<PathRange> ranges;  ///< by rising node
  int unknown = 0;                ///< beacons
  PathPrior prior;
  /// 1/2 start_weight |p_0 - start|^2 + 1/2 heading_weight |p_1 - p_0 - first_step|^2
  Complex start, first_step;
  double start_weight = 0, heading_weight = 0;
  double turn_sigma = 0.03, step_sigma = 0.1;              ///< of a step, relative to its length
  double scale_weight = 0;                                 ///< 1 / variance of the scale; 0: it is held
  double bound = std::numeric_limits<double>::infinity();  ///< cutoff^2

  double chain_weight(std::size_t k) const {
    const double sigma = turn_sigma * length[k + 1];
    return 1 / (sigma * sigma);
  }
  double step_weight(std::size_t k) const {
    const double sigma = step_sigma * length[k];
    return 1 / (sigma * sigma);
  }
};

/// The slope and curvature of a range's energy as a function of the distance.
struct RangeSlope {
  double first, second, weight;
};

/// Geman and McClure's loss 1/2 C s / (C + s) of the squared residual s, C = bound; infinite: least squares.
inline double range_energy(double error, double information, double bound) {
  const double s = information * error * error;
  return bound == std::numeric_limits<double>::infinity() ? 0.5 * s : 0.5 * s / (1 + s / bound);
}
inline RangeSlope range_slope(double error, double information, double bound) {
  if (bound == std::numeric_limits<double>::infinity()) return {information * error, information, 1};
  const double s = information * error * error / bound, w = 1 / ((1 + s) * (1 + s));
  return {information * w * error, information * w * (1 - 3 * s) / (1 + s), w};
}

/// Which curvature a range has: the true one, or that of the Gauss-Newton method, which is never negative.
enum class PathCurvature { True, Convex };

/// Positions as K real numbers, K / 2 complex ones: 2 in the plane, 4 where the problem is relaxed.
template <int K>
class PathChain {
 public:
  using Point = Eigen::Matrix<double, K, 1>;
  using Block = Eigen::Matrix<double, K, K>;
  template <typename T>
  using List = std::vector<T>;

  explicit PathChain(const PathTerms& terms) : terms_(terms) {}

  List<Point> x, beacons;        ///< of nodes and of unknown beacons
  double scale = 1;              ///< steps are so many times as long as the odometry says
  const double* held = nullptr;  ///< weights of the ranges, which replace the loss

  static Point times(Complex c, const Point& v) {
    Point r;
    for (int i = 0; i < K; i += 2) {
      r[i] = c.real() * v[i] - c.imag() * v[i + 1];
      r[i + 1] = c.imag() * v[i] + c.real() * v[i + 1];
    }
    return r;
  }
  static Point of(Complex c) {
    Point r = Point::Zero();
    r[0] = c.real();
    r[1] = c.imag();
    return r;
  }
  static Block block(Complex c) {
    Block b = Block::Zero();
    add(b, c);
    return b;
  }

  std::size_t nodes() const { return x.size(); }
  bool has_scale() const { return terms_.scale_weight > 0; }
  /// Of the border, where the unknown beacons' coordinates are before it.
  Eigen::Index scale_row() const { return static_cast<Eigen::Index>(beacons.size()) * K; }
  Eigen::Index border_rows() const { return scale_row() + (has_scale() ? 1 : 0); }
  /// Of the ranges, those that the nodes have.
  std::size_t range_count() const {
    std::size_t count = terms_.ranges.size();
    while (count > 0 && terms_.ranges[count - 1].node + 2 > static_cast<int>(nodes())) --count;
    return count;
  }

  Point chain_residual(std::size_t k) const {
    const Point next = x[k + 2] - x[k + 1];
    return next - times(terms_.turn[k], x[k + 1] - x[k]);
  }
  /// From the beacon to the place from which a range was measured.
  Point difference(const PathRange& range) const {
    const auto o = static_cast<std::size_t>(range.node);
    Point y = x[o];
    if (range.at != Complex(0)) y += times(range.at, x[o + 1] - x[o]);
    return y - (range.beacon < 0 ? of(range.place) : beacons[static_cast<std::size_t>(range.beacon)]);
  }

  double energy(double bound) const {
    const std::size_t n = nodes(), count = range_count();
    double sum = 0;
    for (std::size_t k = 0; k + 2 < n; ++k)
      sum += 0.5 * terms_.chain_weight(k) * chain_residual(k).squaredNorm();
    for (std::size_t k = 0; k + 1 < n; ++k) {
      const double e = (x[k + 1] - x[k]).norm() - scale * terms_.length[k];
      sum += 0.5 * terms_.step_weight(k) * e * e;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const PathRange& range = terms_.ranges[i];
      const double e = difference(range).norm() - range.length;
      sum += held ? held[i] * range_energy(e, range.information, std::numeric_limits<double>::infinity())
                  : range_energy(e, range.information, bound);
    }
    sum += start_energy() + 0.5 * terms_.scale_weight * (scale - 1) * (scale - 1);
    if constexpr (K == 2) {
      const Eigen::Vector4d z = ends() - terms_.prior.place;
      sum += 0.5 * z.dot(terms_.prior.hessian * z) + terms_.prior.gradient.dot(z);
    }
    return sum;
  }

  /// Gradient and curvature at x: the columns from `first` on; those before are then of no use.
  void assemble(PathCurvature curvature, double bound, std::size_t first = 0) {
    const std::size_t n = nodes();
    clear(first);
    assemble_chain(first);
    for (std::size_t k = first < 1 ? 0 : first - 1; k + 1 < n; ++k) {
      const double w = terms_.step_weight(k), rest = terms_.length[k];
      const Point y = x[k + 1] - x[k];
      const double l = std::max(y.norm(), 1e-9 * rest), e = l - scale * rest;
      const Point u = y / l, slope = w * e * u;
      const Block h = curvature_of(u, w, w * e / l, curvature);
      gradient[k] -= slope;
      gradient[k + 1] += slope;
      diagonal_[k] += h;
      diagonal_[k + 1] += h;
      next_[k] -= h;
      if (has_scale()) add_scale(k, w * rest * u, -w * e * rest, w * rest * rest);
    }
    const std::size_t count = range_count();
    for (std::size_t i = first < 1 ? 0 : range_from(static_cast<int>(first) - 1); i < count; ++i) {
      const PathRange& range = terms_.ranges[i];
      const auto o = static_cast<std::size_t>(range.node);
      const Point y = difference(range);
      const double l = std::max(y.norm(), 1e-9 * (range.length + 1e-3)), e = l - range.length;
      RangeSlope slope;
      if (held)
        slope = {held[i] * range.information * e, held[i] * range.information, 1};
      else
        slope = range_slope(e, range.information, bound);
      const Point u = y / l, g = slope.first * u;
      const Block h =
          curvature_of(u,
                       curvature == PathCurvature::True ? slope.second
                                                        : (held ? held[i] : slope.weight) * range.information,
                       slope.first / l, curvature);
      if (range.at == Complex(0)) {
        gradient[o] += g;
        diagonal_[o] += h;
      } else {
        const Block a = block(1.0 - range.at), b = block(range.at);
        const Block ha = h * a, hb = h * b;
        gradient[o] += a.transpose() * g;
        gradient[o + 1] += b.transpose() * g;
        diagonal_[o] += a.transpose() * ha;
        diagonal_[o + 1] += b.transpose() * hb;
        next_[o] += b.transpose() * ha;
      }
      if (range.beacon >= 0) {
        const auto j = static_cast<Eigen::Index>(range.beacon) * K;
        subtract_from_border(j, o, h * block(1.0 - range.at));
        if (range.at != Complex(0)) subtract_from_border(j, o + 1, h * block(range.at));
        corner_.template block<K, K>(j, j) += h;
        border_gradient.template segment<K>(j) -= g;
      }
    }
    if (first < 2) assemble_start();
    if (has_scale()) add_to_corner(terms_.scale_weight * (scale - 1), terms_.scale_weight);
    if constexpr (K == 2) {
      if (first < 2) {
        const PathPrior& prior = terms_.prior;
        const Eigen::Vector4d g = prior.gradient + prior.hessian * (ends() - prior.place);
        gradient[0] += g.template head<2>();
        gradient[1] += g.template tail<2>();
        diagonal_[0] += prior.hessian.template topLeftCorner<2, 2>();
        diagonal_[1] += prior.hessian.template bottomRightCorner<2, 2>();
        next_[0] += prior.hessian.template bottomLeftCorner<2, 2>();
      }
    }
  }

  double start_energy() const {
    return 0.5 * terms_.start_weight * (x[0] - of(terms_.start)).squaredNorm() +
           0.5 * terms_.heading_weight * (x[1] - x[0] - scale * of(terms_.first_step)).squaredNorm();
  }
  void assemble_start() {
    const Point step = of(terms_.first_step), weighted = terms_.heading_weight * step;
    const Point slope = terms_.heading_weight * (x[1] - x[0] - scale * step);
    gradient[0] += terms_.start_weight * (x[0] - of(terms_.start)) - slope;
    gradient[1] += slope;
    add(diagonal_[0], terms_.start_weight + terms_.heading_weight);
    add(diagonal_[1], terms_.heading_weight);
    add(next_[0], -terms_.heading_weight);
    if (has_scale()) add_scale(0, weighted, -slope.dot(step), weighted.dot(step));
  }

  /// For the lower bound: the quadratic function in which each step and range counts weight / 2 |y|^2.
  void assemble_quadratic(const std::vector<double>& steps, const std::vector<double>& of_ranges) {
    const std::size_t n = nodes();
    clear(0);
    assemble_chain(0);
    for (std::size_t k = 0; k + 1 < n; ++k) {
      const Point g = steps[k] * (x[k + 1] - x[k]);
      gradient[k] -= g;
      gradient[k + 1] += g;
      add(diagonal_[k], steps[k]);
      add(diagonal_[k + 1], steps[k]);
      add(next_[k], -steps[k]);
    }
    for (std::size_t i = 0; i < terms_.ranges.size(); ++i) {
      const PathRange& range = terms_.ranges[i];
      const auto o = static_cast<std::size_t>(range.node);
      const double w = of_ranges[i];
      const Point g = w * difference(range);
      const Complex a = 1.0 - range.at, b = range.at;
      gradient[o] += times(std::conj(a), g);
      gradient[o + 1] += times(std::conj(b), g);
      add(diagonal_[o], w * std::norm(a));
      add(diagonal_[o + 1], w * std::norm(b));
      add(next_[o], w * std::conj(b) * a);
      if (range.beacon >= 0) {
        const auto j = static_cast<Eigen::Index>(range.beacon) * K;
        subtract_from_border(j, o, block(w * a));
        subtract_from_border(j, o + 1, block(w * b));
        corner_.template block<K, K>(j, j) += block(w);
        border_gradient.template segment<K>(j) -= g;
      }
    }
    assemble_start();
  }
  double quadratic_energy(const std::vector<double>& steps, const std::vector<double>& of_ranges) const {
    double sum = 0;
    for (std::size_t k = 0; k + 2 < nodes(); ++k)
      sum += 0.5 * terms_.chain_weight(k) * chain_residual(k).squaredNorm();
    for (std::size_t k = 0; k + 1 < nodes(); ++k) sum += 0.5 * steps[k] * (x[k + 1] - x[k]).squaredNorm();
    for (std::size_t i = 0; i < terms_.ranges.size(); ++i)
      sum += 0.5 * of_ranges[i] * difference(terms_.ranges[i]).squaredNorm();
    return sum + start_energy();
  }
  /// No term but this one sees a shift of everything.
  void hold_first_node() { diagonal_[0] += terms_.step_weight(0) * Block::Identity(); }

  /// Adds to the diagonal, relative to it and absolutely.
  void damp(double relative) {
    for (std::size_t k = 0; k < nodes(); ++k)
      for (int i = 0; i < K; ++i) diagonal_[k](i, i) *= 1 + relative;
    for (Eigen::Index i = 0; i < corner_.rows(); ++i) corner_(i, i) *= 1 + relative;
  }

  /// Cholesky's factors of the columns from `first` on, after assemble(). False if it is not positive
  /// definite.
  bool factorize(std::size_t first = 0) {
    const std::size_t n = nodes();
    for (std::size_t k = first; k < n; ++k) {
      Block a = diagonal_[k];
      if (k >= 1) a.noalias() -= l1_[k - 1] * l1_[k - 1].transpose();
      if (k >= 2) a.noalias() -= l2_[k - 2] * l2_[k - 2].transpose();
      if (!cholesky(a, diagonal_[k])) return false;
      l0_[k] = a;
      if (k + 1 < n) {
        Block b = next_[k];
        if (k >= 1) b.noalias() -= l2_[k - 1] * l1_[k - 1].transpose();
        l1_[k] = divided(b, a);
      }
      if (k + 2 < n) l2_[k] = divided(second_[k], a);
    }
    return corner_.rows() == 0 || factorize_border();
  }

  /// y = L^-1 right_side from `first` on, where right_side is overwritten.
  void forward(List<Point>& y, std::size_t first = 0) const {
    for (std::size_t k = first; k < nodes(); ++k) {
      if (k >= 1) y[k].noalias() -= l1_[k - 1] * y[k - 1];
      if (k >= 2) y[k].noalias() -= l2_[k - 2] * y[k - 2];
      for (int i = 0; i < K; ++i) {
        for (int j = 0; j < i; ++j) y[k][i] -= l0_[k](i, j) * y[k][j];
        y[k][i] /= l0_[k](i, i);
      }
    }
  }
  /// Node k of L^-T y, where those after it are known.
  Point backward(const Point& y, std::size_t k, const Point& one, const Point& two) const {
    Point s = y;
    if (k + 1 < nodes()) s.noalias() -= l1_[k].transpose() * one;
    if (k + 2 < nodes()) s.noalias() -= l2_[k].transpose() * two;
    for (int i = K - 1; i >= 0; --i) {
      for (int j = i + 1; j < K; ++j) s[i] -= l0_[k](j, i) * s[j];
      s[i] /= l0_[k](i, i);
    }
    return s;
  }
  /// The matrix's inverse times right_side and border, in place.
  void solve(List<Point>& right_side, Eigen::VectorXd& of_border) const {
    const std::size_t n = nodes();
    forward(right_side);
    const Eigen::Index m = corner_.rows();
    if (m > 0) {
      for (std::size_t k = 0; k < n; ++k) {
        const double* const b = columns(factor_border_, k);
        for (int i = 0; i < K; ++i) {
          for (Eigen::Index r = 0; r < m; ++r) of_border[r] -= right_side[k][i] * b[i * m + r];
        }
      }
      lanes_v0_1::solve({corner_factor_.data(), inverse_pivots_.data(), m, of_border.data(), 1});
    }
    const Point zero = Point::Zero();
    for (std::size_t k = n; k-- > 0;) {
      const double* const b = columns(factor_border_, k);
      for (int i = 0; i < K; ++i) {
        for (Eigen::Index r = 0; r < m; ++r) right_side[k][i] -= of_border[r] * b[i * m + r];
      }
      right_side[k] = backward(right_side[k], k, k + 1 < n ? right_side[k + 1] : zero,
                               k + 2 < n ? right_side[k + 2] : zero);
    }
  }
  double log_determinant() const {
    double sum = 0;
    for (std::size_t k = 0; k < nodes(); ++k)
      for (int i = 0; i < K; ++i) sum += std::log(l0_[k](i, i));
    for (Eigen::Index i = 0; i < corner_.rows(); ++i) sum += std::log(corner_factor_(i, i));
    return 2 * sum;
  }

  /// The blocks of the inverse that belong to neighbours: Takahashi's recursion.
  struct Inverse {
    List<Block> own, next, second;  ///< (k, k), (k + 1, k), (k + 2, k)
    Eigen::MatrixXd border, corner;
  };
  void invert(Inverse& z) const {
    const std::size_t n = nodes();
    const Eigen::Index m = corner_.rows();
    z.own.resize(n);
    z.next.resize(n);
    z.second.resize(n);
    z.corner.resize(m, m);
    z.border.setZero(m, m > 0 ? static_cast<Eigen::Index>(n) * K : 0);
    if (m > 0) {
      std::vector<double> room(static_cast<std::size_t>(m) * lanes_v0_1::kMostBytes / sizeof(double));
      lanes_v0_1::invert(lanes_v0_1::Inverse<double>{corner_factor_.data(), m, z.corner.data(), room.data()});
    }
    Eigen::Matrix<double, Eigen::Dynamic, K> ub(m, K);
    for (std::size_t k = n; k-- > 0;) {
      const bool one = k + 1 < n, two = k + 2 < n;
      const Block zero = Block::Zero();
      const Block u1 = one ? over(l1_[k], l0_[k]) : zero, u2 = two ? over(l2_[k], l0_[k]) : zero;
      Block first = zero, second = zero;
      double* const zb = columns(z.border, k);
      if (m > 0) {
        std::copy_n(columns(factor_border_, k), m * K, ub.data());
        for (int i = K - 1; i >= 0; --i) {  // times L^-1
          for (int j = i + 1; j < K; ++j) subtract(ub.data() + i * m, ub.data() + j * m, l0_[k](j, i), m);
          ub.col(i) /= l0_[k](i, i);
        }
        for (int i = 0; i < K; ++i) {
          for (Eigen::Index c = 0; c < m; ++c) subtract(zb + i * m, &z.corner(0, c), ub(c, i), m);
        }
      }
      if (one) first.noalias() -= z.own[k + 1] * u1;
      if (two) {
        first.noalias() -= z.next[k + 1].transpose() * u2;
        second.noalias() -= z.next[k + 1] * u1;
        second.noalias() -= z.own[k + 2] * u2;
      }
      if (m > 0 && one) {
        subtract_inner(first, columns(z.border, k + 1), ub.data(), m);
        subtract_product(zb, columns(z.border, k + 1), u1.transpose(), m);
      }
      if (m > 0 && two) {
        subtract_inner(second, columns(z.border, k + 2), ub.data(), m);
        subtract_product(zb, columns(z.border, k + 2), u2.transpose(), m);
      }
      Block own = inverse_of(l0_[k]);
      if (one) own.noalias() -= u1.transpose() * first;
      if (two) own.noalias() -= u2.transpose() * second;
      subtract_inner(own, ub.data(), zb, m);
      z.own[k] = 0.5 * (own + own.transpose());
      z.next[k] = first;
      z.second[k] = second;
    }
  }

  /// The inverse's blocks of the last two nodes, where there are no unknown beacons.
  void invert_last(Block& before, Block& last, Block& cross) const {
    const std::size_t n = nodes();
    last = inverse_of(l0_[n - 1]);
    const Block u = over(l1_[n - 2], l0_[n - 2]);
    cross = -last * u;  // (n - 1, n - 2)
    before = inverse_of(l0_[n - 2]) - u.transpose() * cross;
  }

  void move(const List<Point>& step, const Eigen::VectorXd& of_border) {
    for (std::size_t k = 0; k < nodes(); ++k) x[k] -= step[k];
    for (std::size_t j = 0; j < beacons.size(); ++j)
      beacons[j] -= of_border.template segment<K>(static_cast<Eigen::Index>(j) * K);
    if (has_scale()) scale -= of_border[scale_row()];
  }

  void reserve(std::size_t count) {
    for (auto* list : {&diagonal_, &next_, &second_, &l0_, &l1_, &l2_}) list->reserve(count);
    gradient.reserve(count);
    x.reserve(count);
  }
  std::size_t range_from(int node) const {
    const auto at = std::lower_bound(terms_.ranges.begin(), terms_.ranges.end(), node,
                                     [](const PathRange& range, int k) { return range.node < k; });
    return static_cast<std::size_t>(at - terms_.ranges.begin());
  }

  List<Point> gradient;
  Eigen::VectorXd border_gradient;

 private:
  static void add(Block& b, Complex c) {
    for (int i = 0; i < K; i += 2) {
      b(i, i) += c.real();
      b(i + 1, i + 1) += c.real();
      b(i, i + 1) -= c.imag();
      b(i + 1, i) += c.imag();
    }
  }
  static void add(Block& b, double a) {
    for (int i = 0; i < K; ++i) b(i, i) += a;
  }
  static Block curvature_of(const Point& u, double radial, double tangential, PathCurvature curvature) {
    if (curvature == PathCurvature::Convex) tangential = std::max(tangential, 0.0);
    const Point scaled = (radial - tangential) * u;
    Block h = scaled * u.transpose();
    add(h, tangential);
    return h;
  }
  Eigen::Vector4d ends() const {
    Eigen::Vector4d z;
    z << x[0][0], x[0][1], x[1][0], x[1][1];
    return z;
  }
  /// In place, the lower triangle; the upper one becomes zero. False unless its pivots are well above
  /// rounding.
  static bool cholesky(Block& a, const Block& before) {
    for (int j = 0; j < K; ++j) {
      double pivot = a(j, j);
      for (int i = 0; i < j; ++i) pivot -= a(j, i) * a(j, i);
      if (!(pivot > 1e-14 * before(j, j) && pivot < std::numeric_limits<double>::infinity())) return false;
      a(j, j) = std::sqrt(pivot);
      for (int r = j + 1; r < K; ++r) {
        double s = a(r, j);
        for (int i = 0; i < j; ++i) s -= a(r, i) * a(j, i);
        a(r, j) = s / a(j, j);
        a(j, r) = 0;
      }
    }
    return true;
  }
  /// b L^-T.
  static Block divided(Block b, const Block& l) {
    for (int i = 0; i < K; ++i) {
      for (int j = 0; j < i; ++j) b.col(i) -= l(i, j) * b.col(j);
      b.col(i) /= l(i, i);
    }
    return b;
  }
  /// b L^-1.
  static Block over(Block b, const Block& l) {
    for (int i = K - 1; i >= 0; --i) {
      for (int j = i + 1; j < K; ++j) b.col(i) -= l(j, i) * b.col(j);
      b.col(i) /= l(i, i);
    }
    return b;
  }
  /// (L L^T)^-1.
  static Block inverse_of(const Block& l) {
    const Block root = divided(Block::Identity(), l);  // L^-T
    return root * root.transpose();
  }

  /// Of a matrix of the border's rows, the columns of node k, one after the other.
  static double* columns(Eigen::MatrixXd& matrix, std::size_t k) {
    return matrix.data() + matrix.rows() * K * static_cast<Eigen::Index>(k);
  }
  static const double* columns(const Eigen::MatrixXd& matrix, std::size_t k) {
    return matrix.data() + matrix.rows() * K * static_cast<Eigen::Index>(k);
  }
  static void subtract(double* to, const double* from, double factor, Eigen::Index m) {
    for (Eigen::Index r = 0; r < m; ++r) to[r] -= factor * from[r];
  }
  /// to -= from B^T, of m x K matrices.
  static void subtract_product(double* to, const double* from, const Block& b, Eigen::Index m) {
    for (int i = 0; i < K; ++i) {
      for (int j = 0; j < K; ++j) subtract(to + i * m, from + j * m, b(i, j), m);
    }
  }
  /// to -= a^T b.
  static void subtract_inner(Block& to, const double* a, const double* b, Eigen::Index m) {
    for (int i = 0; i < K; ++i) {
      for (int j = 0; j < K; ++j) {
        for (Eigen::Index r = 0; r < m; ++r) to(i, j) -= a[i * m + r] * b[j * m + r];
      }
    }
  }

  /// The border's rows of the factor, and the factor of what is left of the corner.
  bool factorize_border() {
    const std::size_t n = nodes();
    const Eigen::Index m = corner_.rows();
    factor_border_.resize(m, static_cast<Eigen::Index>(n) * K);
    corner_factor_ = corner_;
    for (std::size_t k = 0; k < n; ++k) {
      double* const b = columns(factor_border_, k);
      std::copy_n(columns(border_, k), m * K, b);
      if (k >= 1) subtract_product(b, columns(factor_border_, k - 1), l1_[k - 1], m);
      if (k >= 2) subtract_product(b, columns(factor_border_, k - 2), l2_[k - 2], m);
      for (int i = 0; i < K; ++i) {  // times L^-T
        double* const column = b + i * m;
        for (int j = 0; j < i; ++j) subtract(column, b + j * m, l0_[k](i, j), m);
        for (Eigen::Index r = 0; r < m; ++r) column[r] /= l0_[k](i, i);
        for (Eigen::Index c = 0; c < m; ++c) subtract(&corner_factor_(c, c), column + c, column[c], m - c);
      }
    }
    if (lanes_v0_1::factorize(lanes_v0_1::SymmetricMatrix<double>{corner_factor_.data(), m, m}) < m)
      return false;
    inverse_pivots_ = corner_factor_.diagonal().cwiseInverse();
    for (Eigen::Index i = 0; i < m; ++i) {
      const double pivot = corner_factor_(i, i);
      if (!(pivot * pivot > 1e-13 * corner_(i, i))) return false;
    }
    return true;
  }

  void clear(std::size_t first) {
    resize();
    for (std::size_t k = first; k < nodes(); ++k) {
      diagonal_[k].setZero();
      next_[k].setZero();
      second_[k].setZero();
      gradient[k].setZero();
    }
    if (border_rows() == 0) return;
    border_.setZero();
    corner_.setZero();
    border_gradient.setZero();
  }

  void subtract_from_border(Eigen::Index row, std::size_t node, const Block& b) {
    border_.template block<K, K>(row, static_cast<Eigen::Index>(node) * K) -= b;
  }
  void add_to_corner(double slope, double curvature) {
    border_gradient[scale_row()] += slope;
    corner_(scale_row(), scale_row()) += curvature;
  }
  /// What a term of step k and the scale adds besides what belongs to the step alone.
  void add_scale(std::size_t k, const Point& both, double slope, double curvature) {
    const Eigen::Index c = static_cast<Eigen::Index>(k) * K;
    for (int i = 0; i < K; ++i) {
      border_(scale_row(), c + i) += both[i];
      border_(scale_row(), c + K + i) -= both[i];
    }
    add_to_corner(slope, curvature);
  }

  /// The differences of steps that reach column `first` or one after it.
  void assemble_chain(std::size_t first) {
    for (std::size_t k = first < 2 ? 0 : first - 2; k + 2 < nodes(); ++k) {
      const double w = terms_.chain_weight(k);
      const Complex q = terms_.turn[k], c[3] = {q, -1.0 - q, 1.0};
      const Point r = w * chain_residual(k);
      for (std::size_t i = 0; i < 3; ++i) {
        gradient[k + i] += times(std::conj(c[i]), r);
        add(diagonal_[k + i], w * std::norm(c[i]));
      }
      add(next_[k], w * std::conj(c[1]) * c[0]);
      add(next_[k + 1], w * c[1]);
      add(second_[k], w * c[0]);
    }
  }

  void resize() {
    const std::size_t n = nodes();
    if (diagonal_.size() != n) {
      for (auto* list : {&diagonal_, &next_, &second_, &l0_, &l1_, &l2_}) list->resize(n);
      gradient.resize(n);
    }
    const Eigen::Index m = border_rows();
    if (corner_.rows() != m || border_.cols() != static_cast<Eigen::Index>(n) * K) {
      corner_.resize(m, m);
      border_.resize(m, m > 0 ? static_cast<Eigen::Index>(n) * K : 0);
      border_gradient.resize(m);
    }
  }

  const PathTerms& terms_;
  List<Block> diagonal_, next_, second_, l0_, l1_, l2_;
  Eigen::MatrixXd border_, corner_, factor_border_, corner_factor_;
  Eigen::VectorXd inverse_pivots_;
};

}  // namespace ranges
}  // namespace ASTERISM_ABI
}  // namespace asterism
