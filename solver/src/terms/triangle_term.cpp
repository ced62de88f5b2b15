#include <algorithm>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <cmath>

#include "direction.hpp"
#include "loss.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

constexpr std::size_t kAtRest = 0, kTriangleStiffness = 1;

std::vector<Column> triangle_columns() { return {{"rest"}, {"stiffness", 1, Column::Range::NotNegative}}; }

// Two edges in the plane that they span: lengths and unit vectors of a and of b, and the unit vectors at
// right angles to them, turned from a to b. The sine is that of the angle between them, positive except for
// edges on a line, which span no plane.
struct Plane {
  double a, b, cosine, sine;
  Eigen::VectorXd along_a, along_b, across_a, across_b;

  Plane(const Eigen::VectorXd& edge_a, const Eigen::VectorXd& edge_b)
      : a(detail::stable_norm(edge_a)), b(detail::stable_norm(edge_b)), cosine(0), sine(0) {
    if (!(a > 0 && b > 0)) return;
    along_a = edge_a / a;
    along_b = edge_b / b;
    cosine = along_a.dot(along_b);
    across_a = along_b - cosine * along_a;
    across_a -= along_a.dot(across_a) * along_a;  // what rounding has left
    sine = across_a.norm();
    across_a /= sine;
    across_b = cosine * across_a - sine * along_a;
  }

  bool spans() const { return sine > 0; }
  /// Onto what is at right angles to the plane.
  Eigen::MatrixXd normal() const {
    if (along_a.size() == 2) return Eigen::Matrix2d::Zero();
    return Eigen::MatrixXd::Identity(along_a.size(), along_a.size()) - along_a * along_a.transpose() -
           across_a * across_a.transpose();
  }
};

// u v^T + v u^T
Eigen::MatrixXd both(const Eigen::VectorXd& u, const Eigen::VectorXd& v) {
  return u * v.transpose() + v * u.transpose();
}

Eigen::VectorXd joined(const Eigen::VectorXd& of_a, const Eigen::VectorXd& of_b) {
  Eigen::VectorXd result(2 * of_a.size());
  result << of_a, of_b;
  return result;
}

Eigen::MatrixXd joined(const Eigen::MatrixXd& aa, const Eigen::MatrixXd& ab, const Eigen::MatrixXd& bb) {
  Eigen::MatrixXd result(2 * aa.rows(), 2 * aa.rows());
  result << aa, ab, ab.transpose(), bb;
  return result;
}

// From edges a = x_s - x_r and b = x_t - x_r to the corners, of which r is number `root`.
void to_corners(int root, int s, int t, const Eigen::VectorXd& of_edges,
                const Eigen::MatrixXd& second_of_edges, Eigen::VectorXd& gradient, Eigen::MatrixXd* second) {
  const Eigen::Index d = of_edges.size() / 2;
  Eigen::MatrixXd edges = Eigen::MatrixXd::Zero(2 * d, 3 * d);  // of the corners
  edges.block(0, s * d, d, d).setIdentity();
  edges.block(d, t * d, d, d).setIdentity();
  edges.middleCols(root * d, d) -= edges.middleCols(s * d, d) + edges.middleCols(t * d, d);
  gradient = edges.transpose().lazyProduct(of_edges);
  if (second == nullptr) return;
  const Eigen::MatrixXd half = second_of_edges.lazyProduct(edges);
  *second = edges.transpose().lazyProduct(half);
}

double none(double value, const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
            Eigen::MatrixXd* second) {
  gradient.setZero(corners.size());
  if (second != nullptr) second->setZero(corners.size(), corners.size());
  return value;
}

}  // namespace

TriangleTerm::TriangleTerm(std::string_view kind, int dim) : Term(kind, dim, 3, triangle_columns(), {}) {
  add_loss();
}

Angles::Angles(int dim) : TermOf("angles", dim) {}
Areas::Areas(int dim) : TermOf("areas", dim) {}

std::string TriangleTerm::defect(int node_count) const {
  std::string problem = Term::defect(node_count);
  return problem.empty() ? loss_defect() : problem;
}

// The difference of the two directions' angles in the plane. A direction turns by 1 / length for each unit
// that its end moves across; the edges' moves u and v out of the plane, as shares of their lengths, turn it
// by
// (|u|^2 + |v|^2) cot / 2 - u . v / sin.
double Angles::value(const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
                     Eigen::MatrixXd* second) const {
  const Plane plane(corners.col(0) - corners.col(1), corners.col(2) - corners.col(1));
  const double angle = std::atan2(plane.sine, plane.cosine);
  if (!plane.spans()) return none(plane.a > 0 && plane.b > 0 ? angle : 0, corners, gradient, second);
  const Eigen::VectorXd of_edges = joined(-plane.across_a / plane.a, plane.across_b / plane.b);
  Eigen::MatrixXd second_of_edges;
  if (second != nullptr) {
    const Eigen::MatrixXd normal = plane.normal(), turned = plane.cosine / plane.sine * normal;
    second_of_edges =
        joined(Eigen::MatrixXd((turned + both(plane.along_a, plane.across_a)) / plane.a / plane.a),
               Eigen::MatrixXd(-normal / plane.sine / plane.a / plane.b),
               Eigen::MatrixXd((turned - both(plane.along_b, plane.across_b)) / plane.b / plane.b));
  }
  to_corners(1, 0, 2, of_edges, second_of_edges, gradient, second);
  return angle;
}

// Half of a b sin; the edges' moves u and v out of the plane, as shares of their lengths, add
// (|u|^2 + |v|^2 - 2 u . v cos) a b / (4 sin).
double Areas::value(const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
                    Eigen::MatrixXd* second) const {
  const Eigen::VectorXd a = corners.col(1) - corners.col(0), b = corners.col(2) - corners.col(0);
  if (dim() == 2) {
    Eigen::VectorXd of_edges(4);
    of_edges << b[1] / 2, -b[0] / 2, -a[1] / 2, a[0] / 2;
    Eigen::MatrixXd second_of_edges = Eigen::MatrixXd::Zero(4, 4);
    second_of_edges(0, 3) = second_of_edges(3, 0) = 0.5;
    second_of_edges(1, 2) = second_of_edges(2, 1) = -0.5;
    to_corners(0, 1, 2, of_edges, second_of_edges, gradient, second);
    return (a[0] * b[1] - a[1] * b[0]) / 2;
  }
  const Plane plane(a, b);
  if (!plane.spans()) return none(0, corners, gradient, second);
  const Eigen::VectorXd of_edges = joined(-plane.b / 2 * plane.across_b, plane.a / 2 * plane.across_a);
  Eigen::MatrixXd second_of_edges;
  if (second != nullptr) {
    const Eigen::MatrixXd normal = plane.normal() / (2 * plane.sine);
    const Eigen::MatrixXd turned = plane.along_a * plane.across_a.transpose();
    second_of_edges = joined(Eigen::MatrixXd(plane.b / plane.a * normal),
                             Eigen::MatrixXd((turned - turned.transpose()) / 2 - plane.cosine * normal),
                             Eigen::MatrixXd(plane.a / plane.b * normal));
  }
  to_corners(0, 1, 2, of_edges, second_of_edges, gradient, second);
  return plane.a * plane.b * plane.sine / 2;
}

// Calls visit(element, phi, gradient of s, second derivatives of s, k, s).
template <typename Visit>
void TriangleTerm::for_each(const Points& x, bool needs_second, Visit&& visit) const {
  const Numbers rest = numbers(kAtRest), stiffness = numbers(kTriangleStiffness);
  const Numbers scale = this->scale(), sharpness = this->sharpness();
  Eigen::MatrixXd corners(dim(), 3), second;
  Eigen::VectorXd gradient;
  for (int e = 0; e < size(); ++e) {
    const double k = *stiffness[e];
    if (!(k > 0)) continue;
    for (int a = 0; a < 3; ++a) corners.col(a) = x.col(nodes()(a, e));
    const double s = value(corners, gradient, needs_second ? &second : nullptr) - *rest[e];
    visit(e, detail::of_residual(detail::loss_at(loss(), scale[e], sharpness[e], s * s), s), gradient, second,
          k, s);
  }
}

double TriangleTerm::energy(const Points& x, Points* gradient) const {
  double energy = 0;
  for_each(x, false,
           [&](int e, const Derivatives<double>& phi, const Eigen::VectorXd& of_s, const Eigen::MatrixXd&,
               double k, double) {
             energy += k * phi.value;
             for (int a = 0; gradient != nullptr && a < 3; ++a)
               gradient->col(nodes()(a, e)) += k * phi.first * of_s.segment(a * dim(), dim());
           });
  return energy;
}

void TriangleTerm::add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const {
  const bool is_true = curvature == Curvature::True;
  for_each(x, is_true,
           [&](int e, const Derivatives<double>& phi, const Eigen::VectorXd& of_s,
               const Eigen::MatrixXd& second, double k, double) {
             Eigen::MatrixXd matrix =
                 (k * (is_true ? phi.second : std::max(phi.second, 0.0))) * of_s * of_s.transpose();
             if (is_true) matrix += k * phi.first * second;
             sink.add(nodes().col(e).data(), 3, matrix.data(), 3 * dim());
           });
}

const char* TriangleTerm::problem_with(Curvature curvature) const {
  if (curvature == Curvature::Majorising) return "no bound of their curvature from above is known";
  if (curvature == Curvature::Minorising) return "no bound of their curvature from below is known";
  return nullptr;
}

// The curvature where the residual is 0.
void TriangleTerm::add_scales(const Points& x, Scales& scales) const {
  for_each(x, false,
           [&](int e, const Derivatives<double>&, const Eigen::VectorXd& of_s, const Eigen::MatrixXd&,
               double k, double) {
             for (int a = 0; a < 3; ++a)
               scales.hold(nodes()(a, e), k * of_s.segment(a * dim(), dim()).squaredNorm());
           });
}

// w . g = k phi'(s) (ds . w).
void TriangleTerm::add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const {
  for_each(x, false,
           [&](int e, const Derivatives<double>& phi, const Eigen::VectorXd& of_s, const Eigen::MatrixXd&,
               double k, double s) {
             double along = 0;
             for (int a = 0; a < 3; ++a) along += of_s.segment(a * dim(), dim()).dot(w.col(nodes()(a, e)));
             const auto column = [&](std::size_t i) { return by[i].col(by[i].cols() == 1 ? 0 : e); };
             column(kAtRest)[0] -= k * phi.second * along;
             column(kTriangleStiffness)[0] += phi.first * along;
             const auto rho = detail::loss_at(loss(), scale()[e], sharpness()[e], s * s);
             detail::add_by_loss(loss(), scale()[e], sharpness()[e], s * s, rho, k * along * s, e, by);
           });
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
