#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/terms/term.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// The terms that come with the library. Each constructor makes a term without elements for points of `dim`
// coordinates; System::add_anchors and its like make and fill them. Columns are listed with their rows; D is
// the number of coordinates.

namespace asterism {
inline namespace ASTERISM_ABI {

/// A residual that is linear in its points, d = sum_a C_a x_a - t, with the energy 1/2 k rho(d^T S d).
class ASTERISM_API LinearTerm : public Term {
 public:
  std::string defect(int node_count) const override;
  double energy(const Points& x, Points* gradient) const override;
  Magnitude magnitude(const Points& x) const override;
  void add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const override;
  bool is_quadratic() const override { return loss() == Loss::Quadratic; }
  const char* why_not_liftable() const override { return nullptr; }
  void add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const override;

 protected:
  /// The columns are: `target` (t), "stiffness" (k), "information" (S), the coefficients, and the loss's.
  LinearTerm(std::string_view kind, int dim, int arity, std::string_view target,
             std::vector<Column> coefficients);

  Numbers target() const { return numbers(0); }       ///< t
  Numbers stiffness() const { return numbers(1); }    ///< k
  Numbers information() const { return numbers(2); }  ///< S
  /// The greatest eigenvalue of S, 1 without.
  double size_of_information(int element) const;

 private:
  template <int D, typename Visit>
  void for_each(const Points& x, Visit&& visit) const;
  template <int D, int kArity>
  double plain_sum(const Points& x, Points* gradient) const;
  template <int D>
  double sum(const Points& x, Points* gradient) const;
  void add_plain_curvature(CurvatureSink& sink) const;
};

/// Points that are pulled to a place: "position" (D) and "stiffness" (1), with "information" (D x D,
/// optional), S, also of lower rank: a ray or a plane. A node may have any number of them.
class ASTERISM_API Anchors final : public TermOf<Anchors, LinearTerm> {
 public:
  /// Without elements.
  explicit Anchors(int dim);
  void add_scales(const Points& x, Scales& scales) const override;
};

/// Pairs with a displacement at rest, d = x_i - x_j - m: "offset" (D), "stiffness" (1), "information".
class ASTERISM_API Offsets final : public TermOf<Offsets, LinearTerm> {
 public:
  /// Without elements.
  explicit Offsets(int dim);
  void add_scales(const Points& x, Scales& scales) const override;
};

/// Triples with a linear relation, d = A x_i + B x_j + C x_k - t: "target" (D), "stiffness" (1),
/// "information", "a", "b" and "c" (1: a factor, or D x D, by columns). Second differences have 1, -2, 1; a
/// chain that turns by a known angle and scale has the matrices of that similarity.
class ASTERISM_API Differences final : public TermOf<Differences, LinearTerm> {
 public:
  /// Without elements.
  explicit Differences(int dim);
  /// Whether its coefficients add up to 0: else a translation changes the energy.
  Role role(int element) const override;
  const char* why_not_liftable() const override;
  void add_scales(const Points& x, Scales& scales) const override;
};

/// The law by which a link's stretch s depends on its length r and its rest length mu.
enum class LinkLaw {
  Hooke,      ///< s = r - mu
  Rope,       ///< as Hooke's where it is longer than mu, else 0
  Repulsion,  ///< as Hooke's where it is shorter than mu, else 0
  Interval,   ///< 0 from mu to `upper`, the distance to the nearer of both elsewhere
  Logarithm,  ///< s = log(r / mu), such as for the strength of a radio signal
  Own         ///< a function of the user's, see LinkFunction; those of add_link_law come after it
};

/// A user's energy phi(r, mu) of links of unit stiffness, with the conditions of LinkPotential: for `count`
/// links, from lengths and rest lengths the values and the first and second derivatives by r.
using LinkFunction = std::function<void(std::size_t count, const double* length, const double* rest_length,
                                        double* value, double* first, double* second)>;

/// Gives a function a name, by which Term::choose, Python and files know it from then on as a law of links.
/// `is_convex_in_square`: whether phi is convex as a function of r^2, which certificates need. Throws
/// std::invalid_argument for a name that is taken, std::length_error beyond 64 of them. It may be called from
/// any thread.
ASTERISM_API void add_link_law(std::string_view name, LinkFunction function,
                               bool is_convex_in_square = false);

/// A residual that is a length, r = |v|_S = (v^T S v)^(1/2) with v = sum_a c_a x_a - m. The energy is
/// 1/2 k rho(s^2) with s the law's stretch. Where v = 0 its direction is a fixed one of the node numbers.
class ASTERISM_API LengthTerm : public Term {
 public:
  std::string defect(int node_count) const override;
  double energy(const Points& x, Points* gradient) const override;
  Magnitude magnitude(const Points& x) const override;
  void add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const override;
  const char* problem_with(Curvature) const override;
  const char* why_not_liftable() const override { return nullptr; }
  void add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const override;
  const char* why_not_differentiable() const override;
  void add_scales(const Points& x, Scales& scales) const override;

  /// The law of all elements.
  LinkLaw law() const { return static_cast<LinkLaw>(choice(0)); }
  /// See law().
  void set_law(LinkLaw law);
  /// The user's law without a name, see add_link_law.
  void set_function(LinkFunction function, bool is_convex_in_square = false);

 protected:
  /// Without elements, with a coefficient c for each node of an element.
  LengthTerm(std::string_view kind, int dim, std::vector<double> coefficients);

 private:
  struct Force;
  struct Potential;
  template <int D, int kArity>
  struct Lanes;
  Potential potential() const;
  template <int D, typename Visit>
  void for_each(const Points& x, int begin, int end, Visit&& visit) const;
  template <int D>
  double sum(const Points& x, int begin, int end, Points* gradient) const;
  template <int D, int kArity>
  double plain_sum(const Points& x, Points* gradient) const;
  template <int D, int kArity>
  double hooke_sum(const Points& x, Points* gradient) const;
  template <int D>
  Magnitude magnitude(const Points& x, int begin, int end) const;
  template <int D>
  Magnitude plain_magnitude(const Points& x) const;
  template <int D>
  void add_curvature(const Points& x, int begin, int end, Curvature curvature, CurvatureSink& sink) const;
  void add_stiffness(CurvatureSink& sink) const;
  template <int D, int kArity>
  void add_plain_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const;
  template <int D>
  double sum_of_rows(const Points& x, Points* gradient) const;
  // The user's function as a law, with a name or without; else null.
  const LinkFunction* function(bool* is_convex = nullptr) const;

  std::vector<double> coefficients_;
  LinkFunction function_;
  bool is_convex_in_square_ = false;
};

/// Pairs with a length at rest: "length" (1), "upper" (1, for intervals), "stiffness" (1), "offset" (D,
/// optional: m), "information" (D x D, optional: S).
class ASTERISM_API Links final : public TermOf<Links, LengthTerm> {
 public:
  /// Without elements.
  explicit Links(int dim);
};

/// Triples with a length of the second difference at rest, v = x_i - 2 x_j + x_k: columns as of Links.
class ASTERISM_API Bendings final : public TermOf<Bendings, LengthTerm> {
 public:
  /// Without elements.
  explicit Bendings(int dim);
};

/// A constant force on a node, E = -f . x: "force" (D).
class ASTERISM_API Loads final : public TermOf<Loads> {
 public:
  /// Without elements.
  explicit Loads(int dim);
  double energy(const Points& x, Points* gradient) const override;
  Magnitude magnitude(const Points& x) const override;
  void add_curvature(const Points&, Curvature, CurvatureSink&) const override {}
  bool is_quadratic() const override { return true; }
  const char* why_not_liftable() const override { return "their energy has no lower bound"; }
  void add_scales(const Points& x, Scales& scales) const override;
  Role role(int) const override { return Role::Pulls; }
  void add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const override;
};

/// A residual that is a function of a triangle, s = f(x_i, x_j, x_k) - rest, with the energy 1/2 k rho(s^2):
/// "rest" (1) and "stiffness" (1).
class ASTERISM_API TriangleTerm : public Term {
 public:
  std::string defect(int node_count) const override;
  double energy(const Points& x, Points* gradient) const override;
  void add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const override;
  const char* problem_with(Curvature) const override;
  void add_scales(const Points& x, Scales& scales) const override;
  void add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const override;

 protected:
  /// Without elements.
  TriangleTerm(std::string_view kind, int dim);

 private:
  // f, its gradient over the three nodes and, if not null, its second derivatives.
  virtual double value(const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
                       Eigen::MatrixXd* second) const = 0;
  template <typename Visit>
  void for_each(const Points& x, bool second, Visit&& visit) const;
};

/// The angle at node j between i and k, in [0, pi] radians, not differentiable where they are on a line: its
/// derivatives count as 0 there. Stiffness in energy per square of a radian.
class ASTERISM_API Angles final : public TermOf<Angles, TriangleTerm> {
 public:
  /// Without elements.
  explicit Angles(int dim);
  const char* why_not_liftable() const override { return nullptr; }

 private:
  double value(const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
               Eigen::MatrixXd* second) const override;
};

/// The area of the triangle. In the plane it has a sign, positive where i, j, k turn from the x axis to the y
/// axis; elsewhere it has none, and its derivatives count as 0 where the corners are on a line. Stiffness in
/// energy per px^4.
class ASTERISM_API Areas final : public TermOf<Areas, TriangleTerm> {
 public:
  /// Without elements.
  explicit Areas(int dim);
  const char* why_not_liftable() const override {
    return dim() == 2 ? "an area has a sign only in the plane" : nullptr;
  }

 private:
  double value(const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
               Eigen::MatrixXd* second) const override;
};

/// Pairs that share one unknown length b, which is estimated with the points: the energy is the least over b
/// of sum 1/2 k rho((r - mu - b)^2) + 1/2 p (b - q)^2. "length" (1, mu: 0 for limbs, a measured distance for
/// ranges with a common bias), "stiffness" (1, k), "prior" (1, q) and "prior_stiffness" (1, p), which are the
/// same for all. The loss is quadratic or Huber's.
class ASTERISM_API CommonLength final : public TermOf<CommonLength> {
 public:
  /// Without elements.
  explicit CommonLength(int dim);
  std::string defect(int node_count) const override;
  double energy(const Points& x, Points* gradient) const override;
  void add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const override;
  const char* problem_with(Curvature) const override;
  void add_scales(const Points& x, Scales& scales) const override;
  const char* why_not_liftable() const override { return nullptr; }
  bool has_hidden() const override { return true; }
  void add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const override;

  /// The estimate b at x.
  double estimate(const Points& x) const;

 private:
  Eigen::VectorXd ranges(const Points& x) const;  // r - mu
  double estimate(const Eigen::VectorXd& ranges) const;
  double curvature_of_estimate(const Eigen::VectorXd& ranges, double estimate, bool clamp) const;
};

/// The results of a user's function for `count` elements.
struct ElementValues {
  Eigen::VectorXd energy;    ///< count
  Eigen::MatrixXd gradient;  ///< (D arity) x count
  Eigen::MatrixXd second;    ///< if it was asked for, (D arity)^2 x count: each column a matrix by columns
};

/// A user's function of elements: from their points, (D arity) x count, and their numbers, rows x count.
using ElementFunction = std::function<void(const Eigen::MatrixXd& points, const Eigen::MatrixXd& numbers,
                                           bool second, ElementValues& values)>;

/// Elements of the user's: any function of the points of `arity` nodes, and of `rows` "numbers" of each.
class ASTERISM_API Elements final : public TermOf<Elements> {
 public:
  /// `has_second`: whether the function has second derivatives; without, only methods that need none take it.
  /// Throws std::invalid_argument for less than one node of an element, or a negative number of rows.
  Elements(int dim, int arity, int rows, ElementFunction function, bool has_second);
  double energy(const Points& x, Points* gradient) const override;
  void add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const override;
  const char* problem_with(Curvature) const override;
  void add_scales(const Points& x, Scales& scales) const override;
  Role role(int) const override { return Role::Holds; }
  bool is_stiff(int) const override { return true; }
  const char* why_not_differentiable() const override;

 private:
  void evaluate(const Points& x, bool second, ElementValues& values) const;

  ElementFunction function_;
  bool has_second_;
};

/// A term without elements by its kind, as files and pickles name it. Throws std::invalid_argument for an
/// unknown one, and for "elements", whose function cannot be stored.
ASTERISM_API std::unique_ptr<Term> make_term(std::string_view kind, int dim);

}  // namespace ASTERISM_ABI
}  // namespace asterism
