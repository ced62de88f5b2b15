#include <algorithm>
#include <asterism/solver/terms/kinds.hpp>
#include <cmath>
#include <utility>

#include "direction.hpp"
#include "loss.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

using detail::BlockOf;
using detail::PointOf;
using detail::stable_norm;

namespace {

std::vector<Column> columns_of(int dim, std::string_view target, std::vector<Column> coefficients) {
  std::vector<Column> columns{
      {.name = target, .rows = dim, .shape = Column::Shape::Vector},
      {.name = "stiffness", .range = Column::Range::NotNegative},
      {.name = "information", .rows = dim * dim, .is_optional = true, .shape = Column::Shape::Matrix}};
  for (Column& column : coefficients) columns.push_back(std::move(column));
  return columns;
}

// A coefficient of a node: a factor, or a matrix.
struct Coefficient {
  const double* matrix;  // or null
  double factor;

  template <int D>
  PointOf<D> times(const auto& point, int dim) const {
    if (matrix == nullptr) return factor * point;
    return Eigen::Map<const BlockOf<D>>(matrix, dim, dim).lazyProduct(point);
  }
  template <int D>
  PointOf<D> transposed_times(const PointOf<D>& point, int dim) const {
    if (matrix == nullptr) return factor * point;
    return Eigen::Map<const BlockOf<D>>(matrix, dim, dim).transpose().lazyProduct(point);
  }
};

// C_a^T W C_b of all pairs of nodes.
void spread(const Coefficient* c, int nodes, const Eigen::MatrixXd& w, Eigen::MatrixXd& matrix) {
  const Eigen::Index dim = w.rows();
  Eigen::MatrixXd all(dim, nodes * dim);
  for (int a = 0; a < nodes; ++a) {
    auto block = all.middleCols(a * dim, dim);
    if (c[a].matrix == nullptr) {
      block = c[a].factor * Eigen::MatrixXd::Identity(dim, dim);
    } else {
      block = Eigen::Map<const Eigen::MatrixXd>(c[a].matrix, dim, dim);
    }
  }
  // lazyProduct, here and elsewhere: without the kernels for large matrices, which take seconds to compile.
  const Eigen::MatrixXd weighted = w.lazyProduct(all);
  matrix = all.transpose().lazyProduct(weighted);
}

constexpr int kMaxArity = 3;

}  // namespace

LinearTerm::LinearTerm(std::string_view kind, int dim, int arity, std::string_view target,
                       std::vector<Column> coefficients)
    : Term(kind, dim, arity, columns_of(dim, target, std::move(coefficients)), {}) {
  add_loss();
}

Anchors::Anchors(int dim) : TermOf("anchors", dim, 1, "position", {}) {}
Offsets::Offsets(int dim) : TermOf("offsets", dim, 2, "offset", {}) {}
Differences::Differences(int dim)
    : TermOf("differences", dim, 3, "target",
             {{.name = "a", .other_rows = dim * dim},
              {.name = "b", .other_rows = dim * dim},
              {.name = "c", .other_rows = dim * dim}}) {}

std::string LinearTerm::defect(int node_count) const {
  if (std::string problem = Term::defect(node_count); !problem.empty()) return problem;
  if (std::string problem = loss_defect(); !problem.empty()) return problem;
  const Eigen::MatrixXd& shapes = columns()[2].values;
  for (Eigen::Index e = 0; e < shapes.cols(); ++e) {
    if (!detail::is_semidefinite(Eigen::Map<const Eigen::MatrixXd>(shapes.col(e).data(), dim(), dim())))
      return std::string(kind()) + ": information of element " + std::to_string(e) +
             " is not symmetric and positive semi-definite";
  }
  return {};
}

// Calls visit(element, coefficients, d, shaped, rho, k) with shaped = S d.
template <int D, typename Visit>
void LinearTerm::for_each(const Points& x, Visit&& visit) const {
  const Numbers target = this->target(), stiffness = this->stiffness(), information = this->information();
  const Numbers scale = this->scale(), sharpness = this->sharpness();
  const Loss loss = this->loss();
  const int n = arity(), dim = this->dim();
  Coefficient c[kMaxArity] = {{nullptr, 1}, {nullptr, -1}, {nullptr, 0}};
  for (int e = 0; e < size(); ++e) {
    const double k = *stiffness[e];
    if (!(k > 0)) continue;  // the target means nothing then, and may be so far off that its square overflows
    for (int a = 0; n == 3 && a < n; ++a) {
      const Eigen::MatrixXd& values = columns()[3U + static_cast<std::size_t>(a)].values;
      const double* const at = numbers(values)[e];
      c[a] = values.rows() == 1 ? Coefficient{nullptr, *at} : Coefficient{at, 0};
    }
    const int* const node = nodes().col(e).data();
    PointOf<D> d = c[0].template times<D>(x.col(node[0]), dim) - Eigen::Map<const PointOf<D>>(target[e], dim);
    for (int a = 1; a < n; ++a) d += c[a].template times<D>(x.col(node[a]), dim);
    if (information) {
      const PointOf<D> shaped = Eigen::Map<const BlockOf<D>>(information[e], dim, dim) * d;
      // Not negative, also where rounding has left the information a little short of positive semi-definite.
      const double square = std::max(d.dot(shaped), 0.0);
      visit(e, c, d, shaped, detail::loss_at(loss, scale[e], sharpness[e], square), k);
    } else {
      visit(e, c, d, d, detail::loss_at(loss, scale[e], sharpness[e], d.squaredNorm()), k);
    }
  }
}

// The energy of springs without a loss or information, as most are; adds its gradient unless that is null.
template <int D, int kArity>
double LinearTerm::plain_sum(const Points& x, Points* gradient) const {
  const Numbers target = this->target(), stiffness = this->stiffness();
  const double* const points = x.data();
  double* const forces = gradient == nullptr ? nullptr : gradient->data();
  const int* node = nodes().data();
  double twice = 0;
  for (int e = 0, count = size(); e < count; ++e, node += kArity) {
    const double k = *stiffness[e];
    if (!(k > 0)) continue;
    const double* const at = target[e];
    for (int c = 0; c < D; ++c) {
      double d = points[D * node[0] + c] - at[c];
      if (kArity == 2) d -= points[D * node[1] + c];
      const double force = k * d;
      twice += force * d;
      if (forces == nullptr) continue;
      forces[D * node[0] + c] += force;
      if (kArity == 2) forces[D * node[1] + c] -= force;
    }
  }
  return twice / 2;
}

// The same of any.
template <int D>
double LinearTerm::sum(const Points& x, Points* gradient) const {
  if constexpr (D != Eigen::Dynamic) {
    if (arity() <= 2 && loss() == Loss::Quadratic && !information())
      return arity() == 1 ? plain_sum<D, 1>(x, gradient) : plain_sum<D, 2>(x, gradient);
  }
  double energy = 0;
  for_each<D>(x, [&](int e, const Coefficient* c, const PointOf<D>&, const PointOf<D>& shaped,
                     const Derivatives<double>& rho, double k) {
    energy += k * rho.value / 2;
    if (gradient == nullptr) return;
    const PointOf<D> force = (k * rho.first) * shaped;
    for (int a = 0; a < arity(); ++a)
      gradient->col(nodes()(a, e)) += c[a].template transposed_times<D>(force, dim());
  });
  return energy;
}

double LinearTerm::energy(const Points& x, Points* gradient) const {
  return detail::with_dim(dim(), [&]<int D>() { return sum<D>(x, gradient); });
}

// d is a sum, and rounded as its parts are; the one difference of an anchor is rounded as itself.
Term::Magnitude LinearTerm::magnitude(const Points& x) const {
  Magnitude result;
  const int n = arity(), dim = this->dim();
  detail::with_dim(dim, [&]<int D>() {
    for_each<D>(x, [&](int e, const Coefficient* c, const PointOf<D>& d, const PointOf<D>&,
                       const Derivatives<double>&, double k) {
      const double length = stable_norm(d);
      double parts = length, largest = 1;
      if (n > 1) parts += stable_norm(target()[e], dim);
      for (int a = 0; n > 1 && a < n; ++a) {
        const double size = c[a].matrix == nullptr ? std::abs(c[a].factor)
                                                   : stable_norm(c[a].matrix, Eigen::Index{dim} * dim);
        parts += size * stable_norm(x.col(nodes()(a, e)));
        largest = std::max(largest, size);
      }
      // The force changes with d by at most k S, for robust losses as far as they are not convex.
      const double sharpness = loss() == Loss::Truncated ? *this->sharpness()[e] : 0.0;
      const double stiffness = k * size_of_information(e) * std::max(1.0, sharpness);
      result.energy += stiffness * length * parts;
      result.gradient += stiffness * parts * largest * n;
    });
  });
  return result;
}

// That of springs without a loss or information, of up to two nodes: k I.
void LinearTerm::add_plain_curvature(CurvatureSink& sink) const {
  constexpr int kMost = 64;
  constexpr double kFactors[] = {1, -1};
  const Numbers stiffness = this->stiffness();
  double numbers[kMost];
  int count = 0;
  const auto flush = [&](int next) {
    if (count > 0)
      sink.add_multiples(nodes().col(next - count).data(), arity(), count, kFactors, numbers, dim());
    count = 0;
  };
  for (int e = 0; e < size(); ++e) {
    const double k = *stiffness[e];
    if (count == kMost || !(k > 0)) flush(e);
    if (k > 0) numbers[count++] = k;
  }
  flush(size());
}

void LinearTerm::add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const {
  const int n = arity(), dim = this->dim();
  const Numbers information = this->information(), sharpness = this->sharpness();
  Eigen::MatrixXd matrix;
  const bool is_plain = loss() == Loss::Quadratic && !information && n <= 2;
  detail::with_dim(dim, [&]<int D>() {
    if (is_plain) return add_plain_curvature(sink);
    for_each<D>(x, [&](int e, const Coefficient* c, const PointOf<D>&, const PointOf<D>& shaped,
                       const Derivatives<double>& rho, double k) {
      BlockOf<D> w = BlockOf<D>::Identity(dim, dim);
      if (information) w = Eigen::Map<const BlockOf<D>>(information[e], dim, dim);
      if (curvature == Curvature::True || curvature == Curvature::Clamped) {
        w *= k * rho.first;
        if (curvature == Curvature::True) w += (2 * k * rho.second) * shaped * shaped.transpose();
      } else if (loss() == Loss::Quadratic || curvature == Curvature::Majorising) {
        w *= k;
      } else {
        w *= k * detail::least_curvature(loss(), sharpness[e]);
      }
      const int* const node = nodes().col(e).data();
      const auto has_matrix = [](const Coefficient& each) { return each.matrix != nullptr; };
      if (std::any_of(c, c + n, has_matrix)) {
        spread(c, n, w, matrix);
        sink.add(node, n, matrix.data(), n * dim);
      } else {
        double factors[kMaxArity];
        for (int a = 0; a < n; ++a) factors[a] = c[a].factor;
        sink.add_blocks(node, n, 1, factors, w.data(), dim);
      }
    });
  });
}

// w . g = k rho' delta^T S d with delta = sum_a C_a w_a.
void LinearTerm::add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const {
  const int dim = this->dim();
  const Numbers information = this->information();
  detail::with_dim(dim, [&]<int D>() {
    for_each<D>(x, [&](int e, const Coefficient* c, const PointOf<D>& d, const PointOf<D>& shaped,
                       const Derivatives<double>& rho, double k) {
      PointOf<D> delta = PointOf<D>::Zero(dim);
      for (int a = 0; a < arity(); ++a) delta += c[a].template times<D>(w.col(nodes()(a, e)), dim);
      PointOf<D> shaped_delta = delta;
      if (information) shaped_delta = Eigen::Map<const BlockOf<D>>(information[e], dim, dim) * delta;
      const double along = delta.dot(shaped);
      const auto column = [&](std::size_t i) { return by[i].col(by[i].cols() == 1 ? 0 : e); };
      const PointOf<D> by_d = k * rho.first * shaped_delta + (2 * k * rho.second * along) * shaped;
      column(0) -= by_d;
      column(1)[0] += rho.first * along;
      for (int a = 0; arity() == 3 && a < 3; ++a) {  // of C_a, by which d and delta change
        const int node = nodes()(a, e);
        const BlockOf<D> by_matrix =
            by_d * x.col(node).transpose() + (k * rho.first) * shaped * w.col(node).transpose();
        auto numbers = column(3U + static_cast<std::size_t>(a));
        if (numbers.size() == 1) {
          numbers[0] += by_matrix.trace();
        } else {
          numbers += Eigen::Map<const Eigen::VectorXd>(by_matrix.data(), dim * dim);
        }
      }
      detail::add_by_loss(loss(), scale()[e], sharpness()[e], std::max(d.dot(shaped), 0.0), rho, k * along, e,
                          by);
      if (information) {
        const BlockOf<D> both = delta * d.transpose();
        const BlockOf<D> shape =
            (k * rho.first / 2) * (both + both.transpose()) + (k * rho.second * along) * d * d.transpose();
        column(2) += Eigen::Map<const Eigen::VectorXd>(shape.data(), dim * dim);
      }
    });
  });
}

double LinearTerm::size_of_information(int e) const {
  if (!information()) return 1;
  return detail::largest_eigenvalue(Eigen::Map<const Eigen::MatrixXd>(information()[e], dim(), dim()));
}

void Anchors::add_scales(const Points&, Scales& scales) const {
  for (int e = 0; e < size(); ++e) {
    const int node = nodes()(0, e);
    const double k = *stiffness()[e] * size_of_information(e);
    scales.hold(node, k);
    scales.places.push_back({node, k, target()[e]});
  }
}

void Offsets::add_scales(const Points&, Scales& scales) const {
  for (int e = 0; e < size(); ++e) {
    const double k = *stiffness()[e] * size_of_information(e);
    for (int a = 0; a < 2; ++a) scales.hold(nodes()(a, e), k);
    scales.lengths.emplace_back(k, Eigen::Map<const Eigen::VectorXd>(target()[e], dim()).squaredNorm());
  }
}

Term::Role Differences::role(int e) const {
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(dim(), dim());
  double largest = 0;
  for (std::size_t a = 3; a < 6; ++a) {
    const Eigen::MatrixXd& values = columns()[a].values;
    const double* const at = numbers(values)[e];
    if (values.rows() == 1) {
      sum.diagonal().array() += *at;
    } else {
      sum += Eigen::Map<const Eigen::MatrixXd>(at, dim(), dim());
    }
    largest = std::max(largest, Eigen::Map<const Eigen::VectorXd>(at, values.rows()).cwiseAbs().maxCoeff());
  }
  return sum.cwiseAbs().maxCoeff() <= 1e-12 * largest ? Role::Connects : Role::Holds;
}

const char* Differences::why_not_liftable() const {
  for (std::size_t a = 3; a < 6; ++a) {
    if (columns()[a].values.rows() > 1)
      return "coefficients that are matrices cannot be given more dimensions";
  }
  return nullptr;
}

// Its targets are differences of places, and most often 0: they are no lengths of the system.
void Differences::add_scales(const Points&, Scales& scales) const {
  for (int e = 0; e < size(); ++e) {
    for (int a = 0; a < 3; ++a) {
      const Eigen::MatrixXd& values = columns()[3U + static_cast<std::size_t>(a)].values;
      const double square =
          Eigen::Map<const Eigen::VectorXd>(numbers(values)[e], values.rows()).squaredNorm();
      scales.hold(nodes()(a, e),
                  *stiffness()[e] * size_of_information(e) * (values.rows() == 1 ? square : square / dim()));
    }
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
