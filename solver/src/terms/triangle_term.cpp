#include <algorithm>
#include <asterism/solver/detail/finite.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <cmath>

#include "loss.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

constexpr std::size_t kRest = 0, kStiffness = 1;

std::vector<Column> columns_of() { return {{"rest"}, {"stiffness", 1, Column::Range::NotNegative}}; }

// A function f(p, q, c) of the products p = a . a, q = b . b and c = a . b of two edges, with its
// derivatives.
struct OfProducts {
  double value, p, q, c, pp, pq, pc, qq, qc, cc;
};

// The chain rule from p, q and c to the edges' coordinates: their gradient, 2 D, and second derivatives.
void to_edges(const OfProducts& f, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
              Eigen::VectorXd& gradient, Eigen::MatrixXd* second) {
  const Eigen::Index d = a.size();
  gradient.resize(2 * d);
  gradient.head(d) = 2 * f.p * a + f.c * b;
  gradient.tail(d) = 2 * f.q * b + f.c * a;
  if (second == nullptr) return;
  const Eigen::MatrixXd aa = a * a.transpose(), ab = a * b.transpose(), bb = b * b.transpose();
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(d, d);
  second->resize(2 * d, 2 * d);
  second->topLeftCorner(d, d) = 2 * f.p * one + 4 * f.pp * aa + 2 * f.pc * (ab + ab.transpose()) + f.cc * bb;
  second->bottomRightCorner(d, d) =
      2 * f.q * one + 4 * f.qq * bb + 2 * f.qc * (ab + ab.transpose()) + f.cc * aa;
  second->topRightCorner(d, d) =
      f.c * one + 4 * f.pq * ab + 2 * f.pc * aa + 2 * f.qc * bb + f.cc * ab.transpose();
  second->bottomLeftCorner(d, d) = second->topRightCorner(d, d).transpose();
}

// From edges a = x_s - x_r and b = x_t - x_r to the corners, of which r is number `root`.
void to_corners(int root, int s, int t, const Eigen::VectorXd& of_edges,
                const Eigen::MatrixXd& second_of_edges, Eigen::VectorXd& gradient, Eigen::MatrixXd* second) {
  const Eigen::Index d = of_edges.size() / 2;
  Eigen::MatrixXd edges = Eigen::MatrixXd::Zero(2 * d, 3 * d);  // of the corners
  edges.block(0, s * d, d, d).setIdentity();
  edges.block(d, t * d, d, d).setIdentity();
  edges.middleCols(root * d, d) -= edges.middleCols(s * d, d) + edges.middleCols(t * d, d);
  gradient = edges.transpose() * of_edges;
  if (second != nullptr) *second = edges.transpose() * second_of_edges * edges;
}

double of_products(const OfProducts& f, int root, int s, int t, const Eigen::VectorXd& a,
                   const Eigen::VectorXd& b, Eigen::VectorXd& gradient, Eigen::MatrixXd* second) {
  Eigen::VectorXd of_edges;
  Eigen::MatrixXd second_of_edges;
  to_edges(f, a, b, of_edges, second != nullptr ? &second_of_edges : nullptr);
  to_corners(root, s, t, of_edges, second_of_edges, gradient, second);
  return f.value;
}

double none(double value, const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
            Eigen::MatrixXd* second) {
  gradient.setZero(corners.size());
  if (second != nullptr) second->setZero(corners.size(), corners.size());
  return value;
}

// (p q - c^2)^(1/2) = |a| |b - (b . a / a . a) a| without cancellation.
double cross_length(const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  const double square = a.squaredNorm();
  return square > 0 ? std::sqrt(square) * (b - (a.dot(b) / square) * a).norm() : 0.0;
}

}  // namespace

TriangleTerm::TriangleTerm(std::string_view kind, int dim) : Term(kind, dim, 3, columns_of(), {}) {
  add_loss();
}

Angles::Angles(int dim) : TermOf("angles", dim) {}
Areas::Areas(int dim) : TermOf("areas", dim) {}

std::string TriangleTerm::defect(int node_count) const {
  std::string problem = Term::defect(node_count);
  return problem.empty() ? loss_defect() : problem;
}

double Angles::value(const Eigen::MatrixXd& corners, Eigen::VectorXd& gradient,
                     Eigen::MatrixXd* second) const {
  const Eigen::VectorXd a = corners.col(0) - corners.col(1), b = corners.col(2) - corners.col(1);
  const double p = a.squaredNorm(), q = b.squaredNorm(), c = a.dot(b), s = cross_length(a, b);
  const double angle = std::atan2(s, c);
  if (!(s > 0 && p > 0 && q > 0)) return none(p > 0 && q > 0 ? angle : 0, corners, gradient, second);
  const double cube = 2 * s * s * s;
  const OfProducts f{angle,
                     c / (2 * s * p),
                     c / (2 * s * q),
                     -1 / s,
                     -c / (2 * s * p * p) - c * q / (2 * cube * p),
                     -c / (2 * cube),
                     q / cube,
                     -c / (2 * s * q * q) - c * p / (2 * cube * q),
                     p / cube,
                     -2 * c / cube};
  return of_products(f, 1, 0, 2, a, b, gradient, second);
}

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
  const double p = a.squaredNorm(), q = b.squaredNorm(), c = a.dot(b), s = cross_length(a, b);
  if (!(s > 0)) return none(0, corners, gradient, second);
  const double cube = s * s * s;
  const OfProducts f{s / 2,
                     q / (4 * s),
                     p / (4 * s),
                     -c / (2 * s),
                     -q * q / (8 * cube),
                     1 / (4 * s) - p * q / (8 * cube),
                     q * c / (4 * cube),
                     -p * p / (8 * cube),
                     p * c / (4 * cube),
                     -p * q / (2 * cube)};
  return of_products(f, 0, 1, 2, a, b, gradient, second);
}

// Calls visit(element, phi, gradient of s, second derivatives of s, k).
template <typename Visit>
void TriangleTerm::for_each(const Points& x, bool needs_second, Visit&& visit) const {
  const Numbers rest = numbers(kRest), stiffness = numbers(kStiffness);
  const Numbers scale = this->scale(), sharpness = this->sharpness();
  Eigen::MatrixXd corners(dim(), 3), second;
  Eigen::VectorXd gradient;
  for (int e = 0; e < size(); ++e) {
    const double k = *stiffness[e];
    if (!(k > 0)) continue;
    for (int a = 0; a < 3; ++a) corners.col(a) = x.col(nodes()(a, e));
    const double s = value(corners, gradient, needs_second ? &second : nullptr) - *rest[e];
    visit(e, detail::of_residual(detail::loss_at(loss(), scale[e], sharpness[e], s * s), s), gradient, second,
          k);
  }
}

double TriangleTerm::energy(const Points& x, Points* gradient) const {
  double energy = 0;
  for_each(x, false,
           [&](int e, const Derivatives<double>& phi, const Eigen::VectorXd& of_s, const Eigen::MatrixXd&,
               double k) {
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
               const Eigen::MatrixXd& second, double k) {
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
  for_each(
      x, false,
      [&](int e, const Derivatives<double>&, const Eigen::VectorXd& of_s, const Eigen::MatrixXd&, double k) {
        for (int a = 0; a < 3; ++a)
          scales.stiffness[nodes()(a, e)] += k * of_s.segment(a * dim(), dim()).squaredNorm();
      });
}

// w . g = k phi'(s) (ds . w).
void TriangleTerm::add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const {
  for_each(x, false,
           [&](int e, const Derivatives<double>& phi, const Eigen::VectorXd& of_s, const Eigen::MatrixXd&,
               double k) {
             double along = 0;
             for (int a = 0; a < 3; ++a) along += of_s.segment(a * dim(), dim()).dot(w.col(nodes()(a, e)));
             const auto column = [&](std::size_t i) { return by[i].col(by[i].cols() == 1 ? 0 : e); };
             column(kRest)[0] -= k * phi.second * along;
             column(kStiffness)[0] += phi.first * along;
           });
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
