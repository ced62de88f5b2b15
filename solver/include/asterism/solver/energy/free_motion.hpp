#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <numeric>
#include <span>
#include <type_traits>
#include <utility>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A motion that changes no energy: nodes that turn as one rigid body, or slide.
struct FreeMotion {
  int node = -1;         ///< one that moves, -1 where there is no such motion
  int about = -1;        ///< a node that it turns about, -1 where no node is at rest
  int axis = -1;         ///< another such node, where the axis is the line through both
  bool slides = false;   ///< a translation
  bool is_part = false;  ///< of a part of a component, which hangs on node `about`, or on both, alone

  explicit operator bool() const { return node >= 0; }

  /// Its description, for a message.
  Message message() const {
    Message text;
    if (is_part && axis >= 0) {
      text.append("node ").append(node).append(" can rotate about the line through nodes ").append(about);
      return text.append(" and ").append(axis).append(", which alone connect it to what is held");
    }
    if (is_part) {
      text.append("node ").append(node).append(" can rotate about node ").append(about);
      return text.append(", which alone connects it to what is held");
    }
    text.append("the component of node ").append(node);
    if (slides) return text.append(" can slide: its anchors do not hold it");
    text.append(" can rotate");
    if (about < 0) return text.append(": its anchors do not hold it");
    if (axis < 0) return text.append(" about node ").append(about);
    return text.append(" about the line through nodes ").append(about).append(" and ").append(axis);
  }
};

/// Measures how clearly plain anchors of stiffness k(i) hold one rigid body: positive if they surely do. The
/// anchors' energy of a rotation exp(W) about the centroid that leaves the best translation has the second
/// derivative -tr(W^2 M), M = sum_i k_i (a_i - a) (x_i - c)^T, so tr(M) I - sym(M) is to be positive definite
/// in space, tr(M) to be positive in the plane. `Number` is a `Real`, or an array of them, one of each
/// of several systems.
template <int kDim, typename Number, typename Real, typename Anchor, typename Stiffness, typename Point>
Number hold_of_body(int nodes, Anchor&& a, Stiffness&& k, Point&& x) {
  static_assert(kDim == 2 || kDim == 3);
  constexpr Real kMargin = Real(1e-4);  // beyond any rounding; what is below is looked at closely
  const auto least = [](const Number& u, const Number& v) {
    if constexpr (std::is_arithmetic_v<Number>) {
      return std::min(u, v);
    } else {
      return Number(u.min(v));
    }
  };
  Number total = k(0);
  Number anchor_centre[kDim];
  Number centre[kDim];
  for (int c = 0; c < kDim; ++c) {
    anchor_centre[c] = k(0) * a(0, c);
    centre[c] = k(0) * x(0, c);
  }
  for (int i = 1; i < nodes; ++i) {
    total += k(i);
    for (int c = 0; c < kDim; ++c) {
      anchor_centre[c] += k(i) * a(i, c);
      centre[c] += k(i) * x(i, c);
    }
  }
  const Number inverse = Real(1) / total;
  for (int c = 0; c < kDim; ++c) {
    anchor_centre[c] *= inverse;
    centre[c] *= inverse;
  }
  const Number zero = k(0) * Real(0);
  Number M[kDim][kDim];
  for (auto& row : M) std::fill_n(row, kDim, zero);
  Number size = zero;  // no entry of M is above it
  for (int i = 0; i < nodes; ++i) {
    Number q[kDim];
    Number p[kDim];
    for (int c = 0; c < kDim; ++c) {
      q[c] = a(i, c) - anchor_centre[c];
      p[c] = x(i, c) - centre[c];
      size += k(i) * (q[c] * q[c] + p[c] * p[c]);
    }
    for (int r = 0; r < kDim; ++r) {
      const Number weighted = k(i) * q[r];
      for (int c = 0; c < kDim; ++c) {
        if (kDim == 3 || r == c) M[r][c] += weighted * p[c];
      }
    }
  }
  size *= Real(0.5);
  const Number margin = kMargin * size;
  if constexpr (kDim == 2) {
    return M[0][0] + M[1][1] - margin;
  } else {
    // The leading minors of tr(M) I - sym(M), in units of the size.
    const Number xy = Real(-0.5) * (M[0][1] + M[1][0]);
    const Number xz = Real(-0.5) * (M[0][2] + M[2][0]);
    const Number yz = Real(-0.5) * (M[1][2] + M[2][1]);
    const Number xx = M[1][1] + M[2][2];
    const Number yy = M[0][0] + M[2][2];
    const Number zz = M[0][0] + M[1][1];
    const Number two = xx * yy - xy * xy;
    const Number three = two * zz - xx * yz * yz - yy * xz * xz + Real(2) * xy * xz * yz;
    const Number of_two = least(xx - margin, two - margin * size);
    return least(of_two, three - margin * size * size);
  }
}

/// A rigid motion: the velocity of a point p is slide + turn (p - origin), turn antisymmetric.
template <int kDim>
struct RigidVelocity {
  using Vector = Eigen::Matrix<double, kDim, 1>;
  using Matrix = Eigen::Matrix<double, kDim, kDim, Eigen::ColMajor>;

  Vector origin = Vector::Zero();
  Vector slide = Vector::Zero();
  Matrix turn = Matrix::Zero();

  Vector at(const Vector& p) const { return slide + product(turn, Vector(p - origin)); }

  static Vector transposed_times(const Matrix& A, const Vector& v) {
    Vector result = Vector::Zero();
    for (int r = 0; r < kDim; ++r) {
      for (int c = 0; c < kDim; ++c) result[c] += A(r, c) * v[r];
    }
    return result;
  }
  /// A += scale u v^T.
  static void add_outer(Matrix& A, double scale, const Vector& u, const Vector& v) {
    for (int c = 0; c < kDim; ++c) {
      for (int r = 0; r < kDim; ++r) A(r, c) += scale * u[r] * v[c];
    }
  }

  /// The rotation about a point in the plane of two orthogonal directions.
  static RigidVelocity about(const Vector& point, const Vector& from, const Vector& to) {
    RigidVelocity motion;
    motion.origin = point;
    add_outer(motion.turn, 1, to, from);
    add_outer(motion.turn, -1, from, to);
    return motion;
  }
};

/// The nodes of a system at some x as the search for their rigid motions sees them: in double, whatever the
/// scalar, the storage and the models, so that this search is compiled once a dimension.
template <int kDim>
class RigidNodes {
 public:
  using Velocity = RigidVelocity<kDim>;
  using Vector = typename Velocity::Vector;
  using Matrix = typename Velocity::Matrix;

  virtual ~RigidNodes() = default;
  virtual Vector place(int i) const = 0;      ///< of node i in x
  virtual Vector anchor(int i) const = 0;     ///< where node i's anchor is
  virtual double stiffness(int i) const = 0;  ///< of node i's anchor
  virtual bool is_fixed(int i) const = 0;     ///< whether node i is
  virtual bool has_plain_anchors() const = 0;
  /// Curvature and gradient of the energy of node i's anchor.
  virtual void anchor_spring(int i, Matrix& curvature, Vector& gradient) const = 0;
  virtual bool has_loads() const = 0;
  virtual Vector load(int i) const = 0;  ///< on node i; 0 if none has one
  virtual double rounding() const = 0;   ///< the share of a coordinate that is rounding alone
  /// Whether the Hessian, links included, resists a motion of the nodes begin to end.
  virtual bool resist(const int* begin, const int* end, const Velocity& motion) const = 0;

  /// Whether an anchor holds a node, or it is fixed.
  bool is_held(int i) const { return is_fixed(i) || stiffness(i) > 0; }

  /// Whether the Hessian resists all rotations of the nodes begin to end about a point that leave the
  /// directions of a line or plane through it as they are; `resting` projects on these.
  bool resist_turns(const int* begin, const int* end, const Vector& point,
                    const Matrix& resting = Matrix::Zero()) const {
    Matrix share = resting;
    Matrix axes;
    diagonalise(share, axes);
    for (int b = 1; b < kDim; ++b) {
      for (int a = 0; a < b; ++a) {
        if (share(a, a) > 0.5 || share(b, b) > 0.5) continue;
        if (!resist(begin, end, Velocity::about(point, axes.col(a), axes.col(b)))) return false;
      }
    }
    return true;
  }
};

/// Looks for motions of one rigid body that neither anchors nor fixed nodes hold. What anchors seem to leave
/// free is free only if the Hessian does not resist it: nodes that are all but on a line or on a point turn
/// there without going anywhere.
template <int kDim>
class RigidMotion {
 public:
  /// One such motion of the nodes begin to end, or none; without `turns`, translations alone. The links'
  /// energy does not change along a rigid motion, so where x is stationary the second derivative of the
  /// anchors' and loads' energy along it is that of all: a matrix of the size of the motions.
  static FreeMotion find(const RigidNodes<kDim>& nodes, const int* begin, const int* end, bool turns);

 private:
  using Nodes = RigidNodes<kDim>;
  static constexpr int kModes = kDim * (kDim + 1) / 2;  // translations, then rotations
  using Vector = typename Nodes::Vector;
  using Matrix = typename Nodes::Matrix;
  using ModeMatrix = Eigen::Matrix<double, kModes, kModes, Eigen::ColMajor>;
  using ModeVector = Eigen::Matrix<double, kModes, 1>;
  struct Velocities {
    Vector& operator[](int mode) { return of[mode]; }
    const Vector& operator[](int mode) const { return of[mode]; }
    Vector of[kModes];
  };
  using Velocity = RigidVelocity<kDim>;

  // The rotation about the held nodes of a body, where these are on one point in the plane, or on one line in
  // space, and another node is not. None of their anchors notices, wherever x is.
  static FreeMotion about_hull(const Nodes& nodes, const int* begin, const int* end, double extent) {
    const auto place = [&](int i) { return nodes.place(i); };
    const auto is_held = [&](int i) { return nodes.is_held(i); };
    const int* const first = std::find_if(begin, end, is_held);
    if (first == end) return {};
    // An orthonormal basis of what they span, from the farthest points on (Gram & Schmidt).
    const Vector origin = place(*first);
    const double rounding = nodes.rounding() * extent;
    Vector basis[kDim];
    int rank = 0;
    const auto outside = [&](const Vector& point) {
      Vector d = point - origin;
      for (int a = 0; a < rank; ++a) d -= basis[a].dot(d) * basis[a];
      return d;
    };
    while (true) {
      Vector farthest_out = Vector::Zero();
      for (const int* m = begin; m != end; ++m) {
        if (!is_held(*m)) continue;
        const Vector d = outside(place(*m));
        if (d.squaredNorm() > farthest_out.squaredNorm()) farthest_out = d;
      }
      if (!(farthest_out.norm() > rounding)) break;
      if (rank >= kDim - 2) return {};
      basis[rank++] = farthest_out / farthest_out.norm();
    }
    if (rank > kDim - 2) return {};  // on a line, where there is no rotation

    const auto distance = [&](int i) { return outside(place(i)).norm(); };
    FreeMotion result;
    double farthest = rounding;
    for (const int* m = begin; m != end; ++m) {
      if (nodes.is_fixed(*m) || !(distance(*m) > farthest)) continue;
      farthest = distance(*m);
      result.node = *m;
    }
    if (!result) return {};
    Matrix hull = Matrix::Zero();
    for (int a = 0; a < rank; ++a) Velocity::add_outer(hull, 1, basis[a], basis[a]);
    if (nodes.resist_turns(begin, end, origin, hull)) return {};
    name_rest(nodes, begin, end, rounding, farthest, distance, place, result);
    return result;
  }

  // The held nodes that a motion hardly moves, beside the fastest.
  template <typename Speed, typename Place>
  static void name_rest(const Nodes& nodes, const int* begin, const int* end, double rounding, double fastest,
                        Speed&& speed, Place&& place, FreeMotion& result) {
    constexpr double kRest = 1e-2;
    for (const int* m = begin; m != end; ++m) {
      if (!nodes.is_held(*m) || !(speed(*m) <= kRest * fastest)) continue;
      if (result.about < 0) {
        result.about = *m;
      } else if (kDim > 2 && result.axis < 0 && (place(*m) - place(result.about)).norm() > rounding) {
        result.axis = *m;
      }
    }
    if (result.axis >= 0 && result.axis < result.about) std::swap(result.about, result.axis);
  }

  // The velocities of a point p for each motion of unit speed: translations by `unit`, rotations by one
  // radian in the plane of two axes.
  static Velocities velocities(const Vector& p, double unit) {
    Velocities v;
    for (Vector& each : v.of) each.setZero();
    for (int c = 0; c < kDim; ++c) v[c][c] = unit;
    for (int a = 0, mode = kDim; a < kDim; ++a) {
      for (int b = a + 1; b < kDim; ++b, ++mode) {
        v[mode][b] = p[a];
        v[mode][a] = -p[b];
      }
    }
    return v;
  }

  // W v for the rotation of a mode, whose velocity at p is W p; zero for translations.
  static Vector turned(int wanted, const Vector& v) {
    Vector result = Vector::Zero();
    for (int a = 0, mode = kDim; a < kDim; ++a) {
      for (int b = a + 1; b < kDim; ++b, ++mode) {
        if (mode != wanted) continue;
        result[b] = v[a];
        result[a] = -v[b];
      }
    }
    return result;
  }

  // A motion in the axes of the modes, in those of the nodes.
  static Velocity velocity(const Matrix& axes, const Vector& centre, double extent,
                           const ModeVector& motion) {
    Velocity result;
    result.origin = centre;
    for (int a = 0; a < kDim; ++a) result.slide += (extent * motion[a]) * Vector(axes.col(a));
    for (int a = 0, mode = kDim; a < kDim; ++a) {
      for (int b = a + 1; b < kDim; ++b, ++mode) {
        Velocity::add_outer(result.turn, motion[mode], axes.col(b), axes.col(a));
        Velocity::add_outer(result.turn, -motion[mode], axes.col(a), axes.col(b));
      }
    }
    return result;
  }

  // The length of its part in the modes first to last - 1.
  static double norm_of(const ModeVector& motion, int first, int last) {
    double square = 0;
    for (int a = first; a < last; ++a) square += motion[a] * motion[a];
    return std::sqrt(square);
  }

  // The nodes that a motion moves, and those it turns about.
  template <typename Place>
  static FreeMotion described(const Nodes& nodes, const int* begin, const int* end, double extent,
                              const ModeVector& motion, Place&& place) {
    const auto speed = [&](int i) {
      const Velocities v = velocities(place(i), extent);
      Vector sum = Vector::Zero();
      for (int a = 0; a < kModes; ++a) sum += motion[a] * v[a];
      return sum.norm();
    };
    FreeMotion result;
    double fastest = -1;
    for (const int* m = begin; m != end; ++m) {
      if (!nodes.is_fixed(*m) && speed(*m) > fastest) {
        fastest = speed(*m);
        result.node = *m;
      }
    }
    name_rest(nodes, begin, end, nodes.rounding() * extent, fastest, speed, place, result);
    result.slides = result.about < 0 &&
                    norm_of(motion, kDim, kModes) * extent <= 1e-5 * norm_of(motion, 0, kDim) * extent;
    return result;
  }
};

template <int kDim>
FreeMotion RigidMotion<kDim>::find(const RigidNodes<kDim>& nodes, const int* begin, const int* end,
                                   bool turns) {
  const auto at = [&](int i) { return nodes.place(i); };
  const double rounding = nodes.rounding();
  double extent = 0;  // of coordinates, whose rounding is a share of it
  double total = 0;
  const int* fixed = end;  // the first one
  Vector centre = Vector::Zero();
  for (const int* m = begin; m != end; ++m) {
    extent = std::max(extent, largest_size(at(*m)));
    if (nodes.is_fixed(*m)) {
      if (fixed == end) fixed = m;
      continue;
    }
    const double k = nodes.stiffness(*m);
    if (!(k > 0)) continue;
    total += k;
    centre += k * at(*m);
    extent = std::max(extent, largest_size(nodes.anchor(*m)));
  }
  if (!(extent > 0)) extent = 1;
  if constexpr (kDim == 2 || kDim == 3) {
    if (fixed == end && nodes.has_plain_anchors() && !nodes.has_loads() &&
        hold_of_body<kDim, double, double>(
            static_cast<int>(end - begin), [&](int m, int c) { return nodes.anchor(begin[m])[c]; },
            [&](int m) { return nodes.stiffness(begin[m]); },
            [&](int m, int c) { return nodes.place(begin[m])[c]; }) > 0)
      return {};
  }
  if (turns && !nodes.has_loads()) {
    if (const FreeMotion motion = about_hull(nodes, begin, end, extent)) return motion;
  }
  if (fixed != end) {
    centre = at(*fixed);
  } else if (total > 0) {
    centre /= total;
  }

  // Axes along which rotations stand out that move no node, as those about the line that all are on, or that
  // move no fixed node.
  const auto spread_of = [&](bool of_fixed) {
    Matrix spread = Matrix::Zero();
    for (const int* m = begin; m != end; ++m) {
      const Vector d = at(*m) - centre;
      if (!of_fixed || nodes.is_fixed(*m)) RigidVelocity<kDim>::add_outer(spread, 1, d, d);
    }
    return spread;
  };
  Matrix spread = spread_of(true);
  double trace = 0;
  for (int c = 0; c < kDim; ++c) trace += spread(c, c);
  if (!(std::sqrt(trace) > rounding * extent)) spread = spread_of(false);
  Matrix axes;
  diagonalise(spread, axes);

  ModeMatrix curvature = ModeMatrix::Zero();
  ModeVector slope = ModeVector::Zero();
  ModeVector scale = ModeVector::Zero();
  ModeVector speed = ModeVector::Zero();
  ModeVector speed_of_fixed = ModeVector::Zero();
  for (const int* m = begin; m != end; ++m) {
    const Velocities v = velocities(Velocity::transposed_times(axes, at(*m) - centre), extent);
    ModeVector& fastest = nodes.is_fixed(*m) ? speed_of_fixed : speed;
    for (int a = 0; a < kModes; ++a) fastest[a] = std::max(fastest[a], v[a].norm());
    if (nodes.is_fixed(*m)) continue;
    const double k = nodes.stiffness(*m);
    const Vector load = nodes.load(*m);
    if (!(k > 0) && is_zero(load)) continue;
    Matrix block = Matrix::Zero();
    Vector force = Vector::Zero();
    if (k > 0) nodes.anchor_spring(*m, block, force);
    const Velocities bent = [&] {  // what the block makes of the velocities, both in the axes of the modes
      Velocities result;
      for (int a = 0; a < kModes; ++a) {
        result[a] = Velocity::transposed_times(axes, product(block, product(axes, v[a])));
      }
      return result;
    }();
    force = Velocity::transposed_times(axes, force - load);
    for (int a = 0; a < kModes; ++a) {
      slope[a] += force.dot(v[a]);
      scale[a] += k * v[a].squaredNorm() + force.norm() * turned(a, v[a]).norm();
      for (int b = 0; b <= a; ++b) {
        curvature(a, b) += v[a].dot(bent[b]) + (force.dot(turned(a, v[b])) + force.dot(turned(b, v[a]))) / 2;
      }
    }
  }

  if (!turns) {
    for (int a = kDim; a < kModes; ++a) speed[a] = slope[a] = 0;
  }

  // Each slope is divided by the magnitude that its rounding is relative to.
  double imbalance = 0;
  for (int a = 0; a < kModes; ++a) {
    scale[a] += extent * std::sqrt(total * scale[a]) + rounding * total * extent * extent;
    if (scale[a] > 0) imbalance += slope[a] * slope[a] / (scale[a] * scale[a]);
  }
  for (int a = 0; a < kModes; ++a) {
    // One that moves no node, or is not wanted, or moves a fixed node.
    if (!(speed[a] > rounding * extent) || speed_of_fixed[a] > rounding * extent) {
      for (int b = 0; b < kModes; ++b) curvature(std::max(a, b), std::min(a, b)) = 0;
      curvature(a, a) = 1;
      scale[a] = 0;
      continue;
    }
    for (int b = 0; b <= a; ++b) {
      curvature(a, b) = scale[a] > 0 && scale[b] > 0 ? curvature(a, b) / std::sqrt(scale[a] * scale[b]) : 0;
    }
  }
  ModeMatrix motions;
  diagonalise(curvature, motions);
  int order[kModes];
  std::iota(std::begin(order), std::end(order), 0);
  const auto flatness = [&](int a) { return std::abs(curvature(a, a)); };
  std::sort(std::begin(order), std::end(order), [&](int a, int b) { return flatness(a) < flatness(b); });
  // What is left of the gradient couples motions that do not commute: by s, which takes the curvature of a
  // free motion beside one of curvature c to s^2 / c.
  const double next = kModes > 1 ? std::min(1.0, flatness(order[std::min(1, kModes - 1)])) : 1.0;
  const double coupled = std::min(imbalance, 1e-8) / std::max(next, 0.01);
  for (const int a : order) {
    if (!(flatness(a) <= rounding + coupled)) return {};
    ModeVector motion;
    for (int b = 0; b < kModes; ++b) {
      motion[b] = scale[b] > 0 ? motions(b, a) / std::sqrt(scale[b]) : motions(b, a);
    }
    if (nodes.resist(begin, end, velocity(axes, centre, extent, motion))) continue;
    return described(nodes, begin, end, extent, motion,
                     [&](int i) { return Velocity::transposed_times(axes, at(i) - centre); });
  }
  return {};
}

#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API FreeMotion RigidMotion<2>::find(const RigidNodes<2>&, const int*, const int*,
                                                             bool);
extern template ASTERISM_API FreeMotion RigidMotion<3>::find(const RigidNodes<3>&, const int*, const int*,
                                                             bool);
#endif

/// Looks for rigid motions that neither anchors nor fixed nodes hold: of a connected component, and of what
/// hangs on the rest by a single node. The energy is the same all along such a motion, so x is not a
/// strict minimum, even if rounding, or the tension that a solver's tolerance leaves in the links, makes the
/// Hessian positive definite. Keeps its memory.
template <typename System>
class FreeMotions {
 public:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  /// One such motion of a valid system at x, if there is one.
  FreeMotion find(const System& system, const Points& x) {
    if (is_clearly_held(system, x)) [[likely]]
      return {};
    mark_offsets(system, x);
    are_neighbours_listed_ = false;
    Nodes nodes(*this, system, x);
    if (const FreeMotion motion = of_components(system, x, nodes)) return motion;
    if (const FreeMotion motion = of_parts(system, x, nodes)) return motion;
    if constexpr (kDim > 2) return of_hinges(system, x, nodes);
    return {};
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr int kMaxNodes = System::kMaxNodes;
  static constexpr int kMaxLinks = System::TopologyType::kMaxLinks;
  template <int kMax>
  using Indices = Eigen::Matrix<int, Eigen::Dynamic, 1, Eigen::ColMajor, kMax, 1>;
  using NodeIndices = Indices<kMaxNodes == Eigen::Dynamic ? Eigen::Dynamic : kMaxNodes + 1>;
  using Velocity = RigidVelocity<kDim>;
  using Coordinates = typename RigidNodes<kDim>::Vector;
  using Block = typename RigidNodes<kDim>::Matrix;
  using Field = Eigen::Matrix<double, kDim, Eigen::Dynamic, kDim == 1 ? Eigen::RowMajor : Eigen::ColMajor,
                              kDim, kMaxNodes>;
  static constexpr bool kSprings = std::is_same_v<typename System::Model::LinkPotential, Hooke>;

  // The system's nodes in double.
  class Nodes final : public RigidNodes<kDim> {
   public:
    using Vector = typename RigidNodes<kDim>::Vector;
    using Matrix = typename RigidNodes<kDim>::Matrix;

    Nodes(FreeMotions& search, const System& system, const Points& x)
        : search_(search), system_(system), x_(x) {}
    Vector place(int i) const override { return x_.col(i).template cast<double>(); }
    Vector anchor(int i) const override { return system_.anchors.col(i).template cast<double>(); }
    double stiffness(int i) const override { return static_cast<double>(system_.anchor_stiffness[i]); }
    bool is_fixed(int i) const override { return system_.is_fixed(i); }
    bool has_plain_anchors() const override { return System::kPlainAnchors; }
    void anchor_spring(int i, Matrix& curvature, Vector& gradient) const override {
      const typename System::Point d = x_.col(i) - system_.anchors.col(i);
      curvature = anchor_curvature(system_, i, d, false).template cast<double>();
      gradient = anchor_force(system_, i, d).gradient.template cast<double>();
    }
    bool has_loads() const override { return system_.has_loads(); }
    Vector load(int i) const override {
      if (!has_loads()) return Vector::Zero();
      return system_.loads.col(i).template cast<double>();
    }
    double rounding() const override { return 64 * double(std::numeric_limits<Scalar>::epsilon()); }
    bool resist(const int* begin, const int* end, const RigidVelocity<kDim>& motion) const override {
      return search_.resists(system_, x_, *this, begin, end, motion);
    }

   private:
    FreeMotions& search_;
    const System& system_;
    const Points& x_;
  };

  // The common case, in nanoseconds: one body, all of whose nodes hang on anchors.
  bool is_clearly_held(const System& system, const Points& x) {
    if constexpr (System::kPlainAnchors && (kDim == 2 || kDim == 3) && kSprings) {
      if (system.fixed_count() != 0 || system.has_loads()) return false;
      for (int i = 0; i < system.nodes(); ++i) {
        if (!(system.anchor_stiffness[i] > 0)) return false;
      }
      for (int l = 0; l < system.link_count(); ++l) {
        if (!(system.link_stiffness[l] > 0)) return false;
      }
      if (!system.topology().is_full() && !is_connected(system.nodes(), system.links(), up_)) return false;
      return hold_of_body<kDim, Scalar, Scalar>(
                 system.nodes(), [&](int i, int c) { return system.anchors(c, i); },
                 [&](int i) { return system.anchor_stiffness[i]; },
                 [&](int i, int c) { return x(c, i); }) > 0;
    }
    return false;
  }

  // Whether link l resists anything at x: one of zero stiffness, or a slack cable, does not.
  static bool connects(const System& system, const Points& x, int l, const Link& link) {
    if (!(system.link_stiffness[l] > 0)) return false;
    if constexpr (!kSprings) {
      const auto force = link_force(system, l, spring(system, link, link_difference(system, l, link, x)));
      return force.along != 0 || force.across != 0 || force.tension != 0;
    }
    return true;
  }

  template <typename Visit>
  static void for_each_connection(const System& system, const Points& x, Visit&& visit) {
    int l = 0;
    for (const Link& link : system.links()) {
      if (connects(system, x, l, link)) visit(link, l);
      ++l;
    }
  }

  // The links of each node that connect, by number.
  void list_neighbours(const System& system, const Points& x) {
    if (are_neighbours_listed_) return;
    are_neighbours_listed_ = true;
    links_.group(system.nodes(), [&](auto&& visit) {
      for_each_connection(system, x, [&](const Link& link, int l) {
        visit(link.i, l);
        visit(link.j, l);
      });
    });
    velocity_.setZero(kDim, system.nodes());
    inward_.setZero(kDim, system.nodes());
  }

  // Whether the Hessian resists the motion v of the nodes begin to end, of which anchors seem to know
  // nothing. Along the path of a motion that changes no energy E, with velocity v = W (x - c) and
  // acceleration W v,
  //   0 = E'' = v^T H v + g . W v:
  // H resists by what is left of the gradient g alone, which shrinks or widens the circles of the path, whose
  // radii are -W v / w^2 for the angular velocity w. E is an even function of the share s of these that is
  // left. By the first terms of its series, a s^2 + b s^4, the nodes belong onto the axis (a > 0), where they
  // do not go anywhere, if
  //   v^T H v > (W v)^T H (W v) / (3 w^2).
  bool resists(const System& system, const Points& x, const RigidNodes<kDim>& nodes, const int* begin,
               const int* end, const RigidVelocity<kDim>& motion) {
    if (is_zero(motion.turn)) return false;
    list_neighbours(system, x);
    const auto reset = [&] {
      for (const int* m = begin; m != end; ++m) {
        velocity_.col(*m).setZero();
        inward_.col(*m).setZero();
      }
    };
    bool moves = false;
    double extent = 0;
    double path = 0;  // E'' along it, of anchors and loads
    double resistance = 0;
    double inward = 0;
    double size = 0;  // that the rounding of the resistance is a share of
    for (const int* m = begin; m != end; ++m) {
      extent = std::max(extent, largest_size(nodes.place(*m)));
      if (system.is_fixed(*m)) continue;
      const Coordinates v = motion.at(nodes.place(*m));
      const Coordinates w = product(motion.turn, v);
      moves |= !is_zero(v);
      velocity_.col(*m) = v;
      inward_.col(*m) = w;
      Block block = Block::Zero();
      Coordinates force = Coordinates::Zero();
      if (system.anchor_stiffness[*m] > 0) nodes.anchor_spring(*m, block, force);
      const double bent = v.dot(product(block, v));
      resistance += bent;
      inward += w.dot(product(block, w));
      size += block.norm() * v.squaredNorm();
      path += bent + w.dot(force - nodes.load(*m));
    }
    for (const int* m = begin; m != end; ++m) {
      if (is_zero(velocity_.col(*m))) continue;
      for (const int l : links_.of(*m)) {
        const Link& link = system.links()[static_cast<std::size_t>(l)];
        const int other = link.i == *m ? link.j : link.i;
        if (other < *m && !is_zero(velocity_.col(other))) continue;  // counted there
        const Coordinates v = velocity_.col(*m) - velocity_.col(other);
        const Coordinates w = inward_.col(*m) - inward_.col(other);
        const auto spring = detail::spring(system, link, link_difference(system, l, link, x));
        const auto force = link_force(system, l, spring);
        const Block block = link_curvature(force, spring).template cast<double>();
        resistance += v.dot(product(block, v));
        inward += w.dot(product(block, w));
        const auto along = static_cast<double>(force.along);
        const double ratio = extent * static_cast<double>(spring.inverse);
        const double bend = std::abs(along - static_cast<double>(force.across));
        if (bend > 0) size += bend * ratio * v.squaredNorm();  // the length's rounding
        size += std::abs(along) * v.squaredNorm();
      }
    }
    reset();
    if (!moves) return true;                            // it is no motion
    const double spin = motion.turn.squaredNorm() / 2;  // w^2
    return resistance > nodes.rounding() * size &&
           (2 * std::abs(path) > resistance || 3 * spin * resistance > inward);
  }

  // The nodes whose links have an offset, which does not turn with them.
  void mark_offsets(const System& system, const Points& x) {
    has_offset_.setZero(system.has_offsets() ? system.nodes() : 0);
    if (!system.has_offsets()) return;
    int l = 0;
    for (const Link& link : system.links()) {
      if (!is_zero(system.rest_offset.col(l)) && connects(system, x, l, link))
        has_offset_[link.i] = has_offset_[link.j] = 1;
      ++l;
    }
  }
  bool has_offset(int i) const { return has_offset_.size() > 0 && has_offset_[i] != 0; }

  // The nodes that move in each connected component, and the fixed ones that they are linked to, which hold
  // each component on its own.
  FreeMotion of_components(const System& system, const Points& x, const Nodes& nodes) {
    const int n = system.nodes();
    up_.setLinSpaced(n, 0, n - 1);
    for_each_connection(system, x, [&](const Link& link, int) {
      if (!system.is_fixed(link.i) && !system.is_fixed(link.j)) up_[root(up_, link.i)] = root(up_, link.j);
    });
    const auto for_each_member = [&](auto&& visit) {
      for (int i = 0; i < n; ++i) {
        if (!system.is_fixed(i)) visit(root(up_, i), i);
      }
      if (system.fixed_count() == 0) return;
      for_each_connection(system, x, [&](const Link& link, int) {
        if (system.is_fixed(link.i) == system.is_fixed(link.j)) return;
        const bool first = system.is_fixed(link.i);
        visit(root(up_, first ? link.j : link.i), first ? link.i : link.j);
      });
    };
    members_.group(n, for_each_member);
    for (int r = 0; r < n; ++r) {
      const std::span<const int> members = members_.of(r);
      if (members.empty()) continue;
      const int* const begin = members.data();
      const int* const end = begin + members.size();
      const bool turns =
          std::none_of(begin, end, [&](int i) { return !system.is_fixed(i) && has_offset(i); });
      if (const FreeMotion motion = RigidMotion<kDim>::find(nodes, begin, end, turns)) return motion;
    }
    return {};
  }

  // Whether something beside plain links acts on node i.
  bool is_held_itself(const System& system, int i) const {
    return system.anchor_stiffness[i] > 0 || system.is_fixed(i) || has_offset(i) ||
           (system.has_loads() && !is_zero(system.loads.col(i)));
  }

  // In space, of a single node that has two neighbours alone, about the line through these.
  FreeMotion of_hinges(const System& system, const Points& x, const Nodes& nodes) {
    for (int i = 0; i < system.nodes(); ++i) {
      if (is_held_itself(system, i)) continue;
      list_neighbours(system, x);
      FreeMotion motion;
      bool has_more = false;
      for (const int l : links_.of(i)) {
        const Link& link = system.links()[static_cast<std::size_t>(l)];
        const int j = link.i == i ? link.j : link.i;
        if (j == motion.about || j == motion.axis) continue;
        has_more = motion.axis >= 0;
        if (has_more) break;
        (motion.about < 0 ? motion.about : motion.axis) = j;
      }
      if (has_more || motion.axis < 0) continue;
      const Coordinates line = nodes.place(motion.axis) - nodes.place(motion.about);
      const double square = line.squaredNorm();
      Block along = Block::Zero();
      if (square > 0) Velocity::add_outer(along, 1 / square, line, line);
      if (nodes.resist_turns(&i, &i + 1, nodes.place(motion.about), along)) continue;
      motion.node = i;
      motion.is_part = true;
      return motion;
    }
    return {};
  }

  // Finds a part that is attached at a single node and has neither anchor nor load: it can turn about that
  // node, whatever the node does. These parts are subtrees of a depth first search whose nodes are linked to
  // none before their parent (Hopcroft & Tarjan 1973).
  FreeMotion of_parts(const System& system, const Points& x, const Nodes& nodes) {
    const int n = system.nodes();
    const auto is_held = [&](int i) { return is_held_itself(system, i); };
    bool all_held = kDim == 1;
    if (kDim > 1) {
      all_held = true;
      for (int i = 0; all_held && i < n; ++i) all_held = is_held(i);
    }
    if (all_held) return {};
    list_neighbours(system, x);
    constexpr int kUnseen = -1;
    time_.setConstant(n, kUnseen);
    low_.resize(n);
    next_.resize(n);
    holds_.resize(n);
    up_.resize(n);
    seen_.resize(n);
    int count = 0;
    const auto enter = [&](int i, int from) {
      up_[i] = from;
      time_[i] = low_[i] = count;
      next_[i] = 0;
      holds_[i] = is_held(i);
      seen_[count++] = i;
    };
    for (int start = 0; start < n; ++start) {
      if (!is_held(start) || time_[start] != kUnseen) continue;
      enter(start, kUnseen);
      for (int i = start; i >= 0;) {
        const std::span<const int> links = links_.of(i);
        if (next_[i] < static_cast<int>(links.size())) {
          const Link& link =
              system.links()[static_cast<std::size_t>(links[static_cast<std::size_t>(next_[i]++)])];
          const int j = link.i == i ? link.j : link.i;
          if (time_[j] == kUnseen) {
            enter(j, i);
            i = j;
          } else if (j != up_[i]) {
            low_[i] = std::min(low_[i], time_[j]);
          }
          continue;
        }
        const int parent = up_[i];
        if (parent >= 0) {
          if (low_[i] >= time_[parent] && holds_[i] == 0 &&
              !nodes.resist_turns(&seen_[time_[i]], &seen_[count - 1] + 1, nodes.place(parent))) {
            for (int t = time_[i]; t < count; ++t) {
              if (is_equal(x.col(seen_[t]), x.col(parent))) continue;
              FreeMotion motion;
              motion.node = seen_[t];
              motion.about = parent;
              motion.is_part = true;
              return motion;
            }
          }
          low_[parent] = std::min(low_[parent], low_[i]);
          holds_[parent] |= holds_[i];
        }
        i = parent;
      }
    }
    return {};
  }

  // Numbers by key, of 0 to keys - 1.
  struct Groups {
    NodeIndices first;  // of a key
    Indices<kMaxLinks == Eigen::Dynamic ? Eigen::Dynamic : kMaxNodes + 2 * kMaxLinks> entries;

    std::span<const int> of(int key) const {
      return {entries.data() + first[key], entries.data() + first[key + 1]};
    }

    // Those that for_each(visit) calls visit(key, value) with.
    template <typename ForEach>
    void group(int keys, ForEach&& for_each) {
      first.setZero(keys + 1);
      for_each([this](int key, int) { ++first[key]; });
      int sum = 0;
      for (int& f : first) sum += std::exchange(f, sum);
      entries.resize(std::max(1, sum));
      for_each([this](int key, int value) { entries[first[key]++] = value; });
      for (int k = keys; k > 0; --k) first[k] = first[k - 1];
      first[0] = 0;
    }
  };

  NodeIndices up_;  // towards the root
  Groups members_;  // of the components
  Groups links_;    // of the nodes, if are_neighbours_listed_
  bool are_neighbours_listed_ = false;
  Field velocity_;  // of nodes that may move, 0 between uses
  Field inward_;
  NodeIndices time_, low_, next_, holds_, seen_;  // of the search
  NodeIndices has_offset_;                        // empty where no link has one
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
