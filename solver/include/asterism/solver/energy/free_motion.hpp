#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/numbers.hpp>
#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/matrix/diagonalise.hpp>
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
#include <vector>

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

/// A vector of few numbers, for what is rarely run: a compiler takes much longer for Eigen's expressions.
template <int kSize>
struct SmallVector {
  double& operator[](Eigen::Index c) { return of[c]; }
  double operator[](Eigen::Index c) const { return of[c]; }
  SmallVector& operator+=(const SmallVector& other) {
    for (int c = 0; c < kSize; ++c) of[c] += other[c];
    return *this;
  }
  friend SmallVector operator*(double factor, SmallVector v) {
    for (double& number : v.of) number *= factor;
    return v;
  }
  friend SmallVector operator+(SmallVector v, const SmallVector& w) { return v += w; }
  friend SmallVector operator-(SmallVector v, const SmallVector& w) { return v += -1.0 * w; }
  friend double dot(const SmallVector& v, const SmallVector& w) {
    double sum = 0;
    for (int c = 0; c < kSize; ++c) sum += v[c] * w[c];
    return sum;
  }
  double norm() const { return std::sqrt(dot(*this, *this)); }
  double largest() const {
    double most = 0;
    for (const double number : of) most = std::max(most, std::abs(number));
    return most;
  }
  bool is_zero() const { return !(largest() > 0); }

  double of[kSize];
};

/// The same for a square matrix, of columns.
template <int kSize>
struct SmallMatrix {
  using Vector = SmallVector<kSize>;

  double& operator()(Eigen::Index row, Eigen::Index column) { return columns[column][row]; }
  double operator()(Eigen::Index row, Eigen::Index column) const { return columns[column][row]; }
  static constexpr int rows() { return kSize; }
  void setIdentity(Eigen::Index, Eigen::Index) {  // as that of an Eigen::Matrix
    *this = {};
    for (int c = 0; c < kSize; ++c) columns[c][c] = 1;
  }
  /// A += scale u v^T.
  void add_outer(double scale, const Vector& u, const Vector& v) {
    for (int c = 0; c < kSize; ++c) columns[c] += (scale * v[c]) * u;
  }
  friend Vector operator*(const SmallMatrix& A, const Vector& v) {
    Vector result{};
    for (int c = 0; c < kSize; ++c) result += v[c] * A.columns[c];
    return result;
  }
  /// A^T v.
  Vector transposed_times(const Vector& v) const {
    Vector result;
    for (int c = 0; c < kSize; ++c) result[c] = dot(columns[c], v);
    return result;
  }
  double squared_norm() const {
    double sum = 0;
    for (const Vector& column : columns) sum += dot(column, column);
    return sum;
  }

  Vector columns[kSize];
};

/// A rigid motion: the velocity of a point p is slide + turn (p - origin), turn antisymmetric.
template <int kDim>
struct RigidVelocity {
  using Vector = SmallVector<kDim>;

  Vector at(const Vector& p) const { return slide + turn * (p - origin); }

  Vector origin{};
  Vector slide{};
  SmallMatrix<kDim> turn{};
};

/// A node as the search for free motions sees it.
template <int kDim>
struct MotionNode {
  using Vector = SmallVector<kDim>;

  /// Whether an anchor holds it, or it is fixed.
  bool is_held() const { return is_fixed || stiffness > 0; }
  /// Whether something beside plain links acts on it.
  bool is_held_itself() const { return is_held() || has_offset || !load.is_zero(); }

  Vector place;      ///< in x
  Vector anchor;     ///< where its anchor is
  Vector load;       ///< 0 if it has none
  double stiffness;  ///< of the anchor
  bool is_fixed;     ///< whether it never moves
  bool has_offset;   ///< whether a link of it has one, which does not turn with it

  // Of the search.
  Vector velocity;    // of a motion, 0 between uses
  Vector inward;      // of the velocity along the path
  int first, last;    // of its links in `incident`
  int body;           // the first node of the component that it was last found in
  int up, time, low;  // depth first: its parent, when it was seen, the earliest time that it is linked to
  int next;           // the link to follow next
  bool holds;         // whether something beside plain links acts on what was seen from it on
};

/// A system at some x as that search sees it, which is compiled once a dimension: in double, whatever the
/// scalar, the storage and the models.
template <int kDim>
struct MotionView {
  using Vector = SmallVector<kDim>;
  using Matrix = SmallMatrix<kDim>;
  struct LinkSpring {
    Vector direction;
    double along, across;  ///< curvatures
    double inverse;        ///< of the length
  };

  /// Whether link l resists anything: one of zero stiffness, or a slack cable, does not.
  virtual bool connects(int l) const = 0;
  virtual LinkSpring link_spring(int l) const = 0;
  /// Of node i's anchor, which has stiffness.
  virtual void anchor_spring(int i, Matrix& curvature, Vector& gradient) const = 0;

  std::span<MotionNode<kDim>> nodes;
  std::span<const Link> links;
  int* incident = nullptr;  ///< space for two numbers a link: the links of each node that connect
  int* members = nullptr;   ///< space for one number a node
  bool has_plain_anchors = false;
  bool has_loads = false;
  double rounding = 0;  ///< the share of a coordinate that is rounding alone

 protected:
  ~MotionView() = default;
};

/// The search for motions of rigid bodies that neither anchors nor fixed nodes hold. What anchors seem to
/// leave free is free only if the Hessian does not resist it: nodes that are all but on a line or on a point
/// turn there without going anywhere. It is rarely needed, and cold, which compiles in less time.
template <int kDim>
class MotionSearch {
 public:
  /// One such motion, or none.
  static FreeMotion find(const MotionView<kDim>& view);

 private:
  static constexpr int kModes = kDim * (kDim + 1) / 2;  // translations, then rotations
  static constexpr int kUnseen = -1;
  using Vector = SmallVector<kDim>;
  using Matrix = SmallMatrix<kDim>;
  using ModeVector = SmallVector<kModes>;
  using Velocity = RigidVelocity<kDim>;
  using Node = MotionNode<kDim>;
  using Body = std::span<const int>;  // nodes
  struct Velocities {
    Vector& operator[](int mode) { return of[mode]; }
    const Vector& operator[](int mode) const { return of[mode]; }
    Vector of[kModes];
  };

  explicit MotionSearch(const MotionView<kDim>& view)
      : view_(view), links_(view.links), members_(view.members), rounding_(view.rounding) {}

  int size() const { return static_cast<int>(view_.nodes.size()); }
  Node& node(int i) const { return view_.nodes[static_cast<std::size_t>(i)]; }
  Body links_of(int i) const { return {view_.incident + node(i).first, view_.incident + node(i).last}; }
  int other_end(int l, int i) const {
    const Link& link = links_[static_cast<std::size_t>(l)];
    return link.i == i ? link.j : link.i;
  }

  void list_links() const {
    const auto for_each_end = [this](auto&& visit) {
      for (int l = 0; l < static_cast<int>(links_.size()); ++l) {
        if (!view_.connects(l)) continue;
        visit(node(links_[static_cast<std::size_t>(l)].i), l);
        visit(node(links_[static_cast<std::size_t>(l)].j), l);
      }
    };
    for (Node& each : view_.nodes) each.last = 0;
    for_each_end([](Node& end, int) { ++end.last; });
    int sum = 0;
    for (Node& each : view_.nodes) {
      each.first = sum;
      sum += std::exchange(each.last, sum);
    }
    for_each_end([this](Node& end, int l) { view_.incident[end.last++] = l; });
  }

  // Of each connected component, with the fixed nodes that it is linked to, which hold each on its own.
  [[gnu::cold]] FreeMotion of_components() const {
    for (Node& each : view_.nodes) each.body = kUnseen;
    for (int start = 0; start < size(); ++start) {
      if (node(start).is_fixed || node(start).body != kUnseen) continue;
      int count = 0;
      bool turns = true;
      const auto add = [&](int i) {
        if (node(i).body == start) return;
        node(i).body = start;
        members_[count++] = i;
        turns = turns && (node(i).is_fixed || !node(i).has_offset);
      };
      add(start);
      for (int k = 0; k < count; ++k) {
        const int i = members_[k];
        if (node(i).is_fixed) continue;
        for (const int l : links_of(i)) add(other_end(l, i));
      }
      std::sort(members_, members_ + count);
      if (const FreeMotion motion = of_body({members_, members_ + count}, turns)) return motion;
    }
    return {};
  }

  // Of one body, or none; without `turns`, translations alone. The links' energy does not change along a
  // rigid motion, so where x is stationary the second derivative of the anchors' and loads' energy along it
  // is that of all: a matrix of the size of the motions.
  [[gnu::cold]] FreeMotion of_body(Body body, bool turns) const {
    double extent = 0;  // of coordinates, whose rounding is a share of it
    double total = 0;
    int fixed = kUnseen;  // the first one
    Vector centre{};
    for (const int m : body) {
      const Node& at = node(m);
      extent = std::max(extent, at.place.largest());
      if (at.is_fixed) {
        if (fixed == kUnseen) fixed = m;
      } else if (at.stiffness > 0) {
        total += at.stiffness;
        centre += at.stiffness * at.place;
        extent = std::max(extent, at.anchor.largest());
      }
    }
    if (!(extent > 0)) extent = 1;
    if constexpr (kDim == 2 || kDim == 3) {
      const auto member = [&](int m) -> const Node& { return node(body[static_cast<std::size_t>(m)]); };
      if (fixed == kUnseen && view_.has_plain_anchors && !view_.has_loads &&
          hold_of_body<kDim, double, double>(
              static_cast<int>(body.size()), [&](int m, int c) { return member(m).anchor[c]; },
              [&](int m) { return member(m).stiffness; },
              [&](int m, int c) { return member(m).place[c]; }) > 0)
        return {};
    }
    if (turns && !view_.has_loads) {
      if (const FreeMotion motion = about_hull(body, extent)) return motion;
    }
    if (fixed != kUnseen) {
      centre = node(fixed).place;
    } else if (total > 0) {
      centre = (1 / total) * centre;
    }

    // Axes along which rotations stand out that move no node, as those about the line that all are on, or
    // that move no fixed node.
    const auto spread_of = [&](bool of_fixed) {
      Matrix spread{};
      for (const int m : body) {
        const Vector d = node(m).place - centre;
        if (!of_fixed || node(m).is_fixed) spread.add_outer(1, d, d);
      }
      return spread;
    };
    Matrix spread = spread_of(true);
    double trace = 0;
    for (int c = 0; c < kDim; ++c) trace += spread(c, c);
    if (!(std::sqrt(trace) > rounding_ * extent)) spread = spread_of(false);
    Matrix axes;
    diagonalise(spread, axes);
    const auto place = [&](int i) { return axes.transposed_times(node(i).place - centre); };

    SmallMatrix<kModes> curvature{};
    ModeVector slope{}, scale{}, speed{}, speed_of_fixed{};
    for (const int m : body) {
      const Node& at = node(m);
      const Velocities v = velocities(place(m), extent);
      ModeVector& fastest = at.is_fixed ? speed_of_fixed : speed;
      for (int a = 0; a < kModes; ++a) fastest[a] = std::max(fastest[a], v[a].norm());
      if (at.is_fixed) continue;
      const double k = at.stiffness;
      if (!(k > 0) && at.load.is_zero()) continue;
      Matrix block{};
      Vector force{};
      if (k > 0) view_.anchor_spring(m, block, force);
      Velocities bent;  // what the block makes of the velocities, both in the axes of the modes
      for (int a = 0; a < kModes; ++a) bent[a] = axes.transposed_times(block * (axes * v[a]));
      force = axes.transposed_times(force - at.load);
      for (int a = 0; a < kModes; ++a) {
        slope[a] += dot(force, v[a]);
        scale[a] += k * dot(v[a], v[a]) + force.norm() * turned(a, v[a]).norm();
        for (int b = 0; b <= a; ++b) {
          curvature(a, b) +=
              dot(v[a], bent[b]) + (dot(force, turned(a, v[b])) + dot(force, turned(b, v[a]))) / 2;
        }
      }
    }

    if (!turns) {
      for (int a = kDim; a < kModes; ++a) speed[a] = slope[a] = 0;
    }

    // Each slope is divided by the magnitude that its rounding is relative to.
    double imbalance = 0;
    for (int a = 0; a < kModes; ++a) {
      scale[a] += extent * std::sqrt(total * scale[a]) + rounding_ * total * extent * extent;
      if (scale[a] > 0) imbalance += slope[a] * slope[a] / (scale[a] * scale[a]);
    }
    for (int a = 0; a < kModes; ++a) {
      // One that moves no node, or is not wanted, or moves a fixed node.
      if (!(speed[a] > rounding_ * extent) || speed_of_fixed[a] > rounding_ * extent) {
        for (int b = 0; b < kModes; ++b) curvature(std::max(a, b), std::min(a, b)) = 0;
        curvature(a, a) = 1;
        scale[a] = 0;
        continue;
      }
      for (int b = 0; b <= a; ++b) {
        curvature(a, b) = scale[a] > 0 && scale[b] > 0 ? curvature(a, b) / std::sqrt(scale[a] * scale[b]) : 0;
      }
    }
    SmallMatrix<kModes> motions;
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
      if (!(flatness(a) <= rounding_ + coupled)) return {};
      ModeVector motion;
      for (int b = 0; b < kModes; ++b)
        motion[b] = scale[b] > 0 ? motions(b, a) / std::sqrt(scale[b]) : motions(b, a);
      if (resists(body, velocity(axes, centre, extent, motion))) continue;
      const auto speed_of = [&](int i) {
        const Velocities v = velocities(place(i), extent);
        Vector sum{};
        for (int b = 0; b < kModes; ++b) sum += motion[b] * v[b];
        return sum.norm();
      };
      FreeMotion result = described(body, extent, -1, speed_of);
      const auto norm = [&](int first, int last) {
        double square = 0;
        for (int b = first; b < last; ++b) square += motion[b] * motion[b];
        return std::sqrt(square);
      };
      result.slides = result.about < 0 && norm(kDim, kModes) <= 1e-5 * norm(0, kDim);
      return result;
    }
    return {};
  }

  // The rotation about the held nodes of a body, where these are on one point in the plane, or on one line in
  // space, and another node is not. None of their anchors notices, wherever x is.
  [[gnu::cold]] FreeMotion about_hull(Body body, double extent) const {
    const auto first = std::find_if(body.begin(), body.end(), [this](int i) { return node(i).is_held(); });
    if (first == body.end()) return {};
    // An orthonormal basis of what they span, from the farthest points on (Gram & Schmidt).
    const Vector origin = node(*first).place;
    const double rounding = rounding_ * extent;
    Vector basis[kDim];
    int rank = 0;
    const auto outside = [&](int i) {
      Vector d = node(i).place - origin;
      for (int a = 0; a < rank; ++a) d += -dot(basis[a], d) * basis[a];
      return d;
    };
    while (true) {
      Vector farthest{};
      for (const int m : body) {
        if (node(m).is_held() && outside(m).norm() > farthest.norm()) farthest = outside(m);
      }
      if (!(farthest.norm() > rounding)) break;
      if (rank >= kDim - 2) return {};
      basis[rank++] = (1 / farthest.norm()) * farthest;
    }
    if (rank > kDim - 2) return {};  // on a line, where there is no rotation
    const FreeMotion result = described(body, extent, rounding, [&](int i) { return outside(i).norm(); });
    if (!result) return {};
    Matrix hull{};
    for (int a = 0; a < rank; ++a) hull.add_outer(1, basis[a], basis[a]);
    if (resists_turns(body, origin, hull)) return {};
    return result;
  }

  // The node that a motion moves fastest, above `least`, and the held ones that it hardly moves.
  template <typename Speed>
  FreeMotion described(Body body, double extent, double least, Speed&& speed) const {
    constexpr double kRest = 1e-2;
    FreeMotion result;
    double fastest = least;
    for (const int m : body) {
      if (node(m).is_fixed || !(speed(m) > fastest)) continue;
      fastest = speed(m);
      result.node = m;
    }
    for (const int m : body) {
      if (!result || !node(m).is_held() || !(speed(m) <= kRest * fastest)) continue;
      if (result.about < 0) {
        result.about = m;
      } else if (kDim > 2 && result.axis < 0 &&
                 (node(m).place - node(result.about).place).norm() > rounding_ * extent) {
        result.axis = m;
      }
    }
    return result;
  }

  // The velocities of a point p for each motion of unit speed: translations by `unit`, rotations by one
  // radian in the plane of two axes.
  static Velocities velocities(const Vector& p, double unit) {
    Velocities v{};
    for (int c = 0; c < kDim; ++c) v[c][c] = unit;
    for (int mode = kDim; mode < kModes; ++mode) v[mode] = turned(mode, p);
    return v;
  }

  // W v for the rotation of a mode, whose velocity at p is W p; zero for translations.
  static Vector turned(int wanted, const Vector& v) {
    Vector result{};
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
    for (int a = 0; a < kDim; ++a) result.slide += (extent * motion[a]) * axes.columns[a];
    for (int a = 0, mode = kDim; a < kDim; ++a) {
      for (int b = a + 1; b < kDim; ++b, ++mode)
        add_rotation(result, motion[mode], axes.columns[a], axes.columns[b]);
    }
    return result;
  }

  // In the plane of two orthogonal directions.
  static void add_rotation(Velocity& motion, double rate, const Vector& from, const Vector& to) {
    motion.turn.add_outer(rate, to, from);
    motion.turn.add_outer(-rate, from, to);
  }

  // Whether the Hessian resists all rotations of a body about a point that leave the directions of a line or
  // plane through it as they are; `resting` projects on these.
  [[gnu::cold]] bool resists_turns(Body body, const Vector& point, Matrix resting) const {
    Matrix axes;
    diagonalise(resting, axes);
    for (int b = 1; b < kDim; ++b) {
      for (int a = 0; a < b; ++a) {
        if (resting(a, a) > 0.5 || resting(b, b) > 0.5) continue;
        Velocity motion;
        motion.origin = point;
        add_rotation(motion, 1, axes.columns[a], axes.columns[b]);
        if (!resists(body, motion)) return false;
      }
    }
    return true;
  }

  // Whether the Hessian resists the motion v of a body, of which anchors seem to know nothing. Along the path
  // of a motion that changes no energy E, with velocity v = W (x - c) and acceleration W v,
  //   0 = E'' = v^T H v + g . W v:
  // H resists by what is left of the gradient g alone, which shrinks or widens the circles of the path, whose
  // radii are -W v / w^2 for the angular velocity w. E is an even function of the share s of these that is
  // left. By the first terms of its series, a s^2 + b s^4, the nodes belong onto the axis (a > 0), where they
  // do not go anywhere, if
  //   v^T H v > (W v)^T H (W v) / (3 w^2).
  [[gnu::cold]] bool resists(Body body, const Velocity& motion) const {
    const double spin = motion.turn.squared_norm() / 2;  // w^2
    if (!(spin > 0)) return false;
    bool moves = false;
    double extent = 0;
    double path = 0;  // E'' along it, of anchors and loads
    double resistance = 0;
    double inward = 0;
    double size = 0;  // that the rounding of the resistance is a share of
    for (const int m : body) {
      Node& at = node(m);
      extent = std::max(extent, at.place.largest());
      if (at.is_fixed) continue;
      const Vector v = at.velocity = motion.at(at.place);
      const Vector w = at.inward = motion.turn * v;
      moves = moves || !v.is_zero();
      Matrix block{};
      Vector force{};
      if (at.stiffness > 0) view_.anchor_spring(m, block, force);
      const double bent = dot(v, block * v);
      resistance += bent;
      inward += dot(w, block * w);
      size += std::sqrt(block.squared_norm()) * dot(v, v);
      path += bent + dot(w, force - at.load);
    }
    for (const int m : body) {
      const Node& at = node(m);
      if (at.velocity.is_zero()) continue;
      for (const int l : links_of(m)) {
        const int other = other_end(l, m);
        if (other < m && !node(other).velocity.is_zero()) continue;  // counted there
        const Vector v = at.velocity - node(other).velocity;
        const Vector w = at.inward - node(other).inward;
        const auto spring = view_.link_spring(l);
        const double bend = spring.along - spring.across;
        const auto bent = [&](const Vector& d) {
          const double along = dot(spring.direction, d);
          return spring.across * dot(d, d) + bend * along * along;
        };
        resistance += bent(v);
        inward += bent(w);
        if (bend != 0) size += std::abs(bend) * extent * spring.inverse * dot(v, v);  // the length's rounding
        size += std::abs(spring.along) * dot(v, v);
      }
    }
    for (const int m : body) node(m).velocity = node(m).inward = {};
    if (!moves) return true;  // it is no motion
    return resistance > rounding_ * size &&
           (2 * std::abs(path) > resistance || 3 * spin * resistance > inward);
  }

  // In space, of a single node that has two neighbours alone, about the line through these.
  FreeMotion of_hinges() const {
    for (int i = 0; i < size(); ++i) {
      if (node(i).is_held_itself()) continue;
      FreeMotion motion;
      bool has_more = false;
      for (const int l : links_of(i)) {
        const int j = other_end(l, i);
        if (j == motion.about || j == motion.axis) continue;
        has_more = motion.axis >= 0;
        if (has_more) break;
        (motion.about < 0 ? motion.about : motion.axis) = j;
      }
      if (has_more || motion.axis < 0) continue;
      const Vector line = node(motion.axis).place - node(motion.about).place;
      Matrix along{};
      if (!line.is_zero()) along.add_outer(1 / dot(line, line), line, line);
      if (resists_turns({&i, 1}, node(motion.about).place, along)) continue;
      motion.node = i;
      motion.is_part = true;
      return motion;
    }
    return {};
  }

  // Of a part that is attached at a single node and has neither anchor nor load: it can turn about that node,
  // whatever the node does. These parts are subtrees of a depth first search whose nodes are linked to none
  // before their parent (Hopcroft & Tarjan 1973).
  [[gnu::cold]] FreeMotion of_parts() const {
    int* const seen = members_;
    int count = 0;
    const auto enter = [&](int i, int from) {
      Node& at = node(i);
      at.up = from;
      at.time = at.low = count;
      at.next = at.first;
      at.holds = at.is_held_itself();
      seen[count++] = i;
    };
    for (Node& each : view_.nodes) each.time = kUnseen;
    for (int start = 0; start < size(); ++start) {
      if (!node(start).is_held_itself() || node(start).time != kUnseen) continue;
      enter(start, kUnseen);
      for (int i = start; i >= 0;) {
        Node& at = node(i);
        if (at.next < at.last) {
          const int j = other_end(view_.incident[at.next++], i);
          if (node(j).time == kUnseen) {
            enter(j, i);
            i = j;
          } else if (j != at.up) {
            at.low = std::min(at.low, node(j).time);
          }
          continue;
        }
        const int parent = i = at.up;
        if (parent < 0) break;
        Node& above = node(parent);
        const Body part(seen + at.time, seen + count);
        if (at.low >= above.time && !at.holds && !resists_turns(part, above.place, {})) {
          for (const int m : part) {
            if ((node(m).place - above.place).is_zero()) continue;
            FreeMotion motion;
            motion.node = m;
            motion.about = parent;
            motion.is_part = true;
            return motion;
          }
        }
        above.low = std::min(above.low, at.low);
        above.holds = above.holds || at.holds;
      }
    }
    return {};
  }

  const MotionView<kDim>& view_;
  const std::span<const Link> links_;
  int* const members_;
  const double rounding_;
};

template <int kDim>
FreeMotion MotionSearch<kDim>::find(const MotionView<kDim>& view) {
  const MotionSearch search(view);
  search.list_links();
  if (const FreeMotion motion = search.of_components()) return motion;
  if constexpr (kDim > 1) {
    if (const FreeMotion motion = search.of_parts()) return motion;
  }
  if constexpr (kDim > 2) return search.of_hinges();
  return {};
}

#ifdef ASTERISM_SOLVER_COMPILED
extern template ASTERISM_API FreeMotion MotionSearch<2>::find(const MotionView<2>&);
extern template ASTERISM_API FreeMotion MotionSearch<3>::find(const MotionView<3>&);
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
    return search(system, x);
  }

 private:
  static constexpr int kDim = System::kDim;
  static constexpr bool kBounded = System::kMaxNodes != Eigen::Dynamic;
  static constexpr bool kSprings = std::is_same_v<typename System::Model::LinkPotential, Hooke>;
  using Node = MotionNode<kDim>;
  template <typename T, int kMax>
  using Storage = std::conditional_t<kBounded, std::array<T, static_cast<std::size_t>(kBounded ? kMax : 1)>,
                                     std::vector<T>>;

  class View final : public MotionView<kDim> {
   public:
    using Base = MotionView<kDim>;

    View(const System& system, const Points& x) : system_(system), x_(x) {}

    bool connects(int l) const override {
      if (!(system_.link_stiffness[l] > 0)) return false;
      if constexpr (kSprings) return true;
      const auto force = link_force(system_, l, spring(l));
      return force.along != 0 || force.across != 0 || force.tension != 0;
    }
    typename Base::LinkSpring link_spring(int l) const override {
      const Spring<System> here = spring(l);
      const auto force = link_force(system_, l, here);
      typename Base::LinkSpring result;
      for (int c = 0; c < kDim; ++c) result.direction[c] = static_cast<double>(here.direction[c]);
      result.along = static_cast<double>(force.along);
      result.across = static_cast<double>(force.across);
      result.inverse = static_cast<double>(here.inverse);
      return result;
    }
    void anchor_spring(int i, typename Base::Matrix& curvature,
                       typename Base::Vector& gradient) const override {
      const typename System::Point d = anchor_offset(system_, i, x_);
      const auto block = anchor_curvature(system_, i, d, false);
      const auto force = anchor_force(system_, i, d).gradient;
      for (int c = 0; c < kDim; ++c) {
        for (int r = 0; r < kDim; ++r) curvature(r, c) = static_cast<double>(block(r, c));
        gradient[c] = static_cast<double>(force[c]);
      }
    }

   private:
    Spring<System> spring(int l) const {
      const Link& link = system_.links()[static_cast<std::size_t>(l)];
      return detail::spring(system_, link, link_difference(system_, l, link, x_));
    }

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
      if (!system.topology().is_full() && !is_connected(system.nodes(), system.links(), members_))
        return false;
      return hold_of_body<kDim, Scalar, Scalar>(
                 system.nodes(), [&](int i, int c) { return system.anchors(c, i); },
                 [&](int i) { return system.anchor_stiffness[i]; },
                 [&](int i, int c) { return x(c, i); }) > 0;
    }
    return false;
  }

  FreeMotion search(const System& system, const Points& x) {
    const int n = system.nodes();
    members_.resize(n);
    if constexpr (!kBounded) {
      nodes_.resize(static_cast<std::size_t>(n));
      incident_.resize(2 * system.links().size());
    }
    View view(system, x);
    view.nodes = {nodes_.data(), static_cast<std::size_t>(n)};
    view.links = system.links();
    view.incident = incident_.data();
    view.members = members_.data();
    view.has_plain_anchors = System::kPlainAnchors;
    view.has_loads = system.has_loads();
    view.rounding = 64 * static_cast<double>(std::numeric_limits<Scalar>::epsilon());
    for (int i = 0; i < n; ++i) {
      Node& node = view.nodes[static_cast<std::size_t>(i)] = {};
      node.stiffness = static_cast<double>(system.anchor_stiffness[i]);
      node.is_fixed = system.is_fixed(i);
      for (int c = 0; c < kDim; ++c) {
        node.place[c] = static_cast<double>(x(c, i));
        node.anchor[c] = static_cast<double>(system.anchors(c, i));
        if (view.has_loads) node.load[c] = static_cast<double>(system.loads(c, i));
      }
    }
    for (int l = 0; system.has_offsets() && l < system.link_count(); ++l) {
      if (is_zero(system.rest_offset.col(l)) || !view.connects(l)) continue;
      const Link& link = view.links[static_cast<std::size_t>(l)];
      for (const int end : {link.i, link.j}) view.nodes[static_cast<std::size_t>(end)].has_offset = true;
    }
    return MotionSearch<kDim>::find(view);
  }

  ComponentScratch<System> members_;
  Storage<Node, System::kMaxNodes> nodes_;
  Storage<int, 2 * System::TopologyType::kMaxLinks> incident_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
