#include <algorithm>
#include <array>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <vector>

#include "direction.hpp"
#include "kernels.hpp"
#include "loss.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

using detail::BlockOf;
using detail::PointOf;
using detail::stable_norm;

namespace {

constexpr std::string_view kLaws[] = {"hooke", "rope", "repulsion", "interval", "logarithm", "own"};
constexpr std::size_t kOwn = 5;
constexpr std::size_t kMostLaws = 64;

// The laws with a name of the user's. They are only ever added, and stay where they are.
struct NamedLaws {
  struct Law {
    std::string name;
    LinkFunction function;
    bool is_convex_in_square;
  };
  std::mutex mutex;
  std::array<Law, kMostLaws> laws;
  std::array<std::string_view, std::size(kLaws) + kMostLaws> names;  // of all laws
  std::atomic<std::size_t> count = 0;

  NamedLaws() { std::copy(std::begin(kLaws), std::end(kLaws), names.begin()); }
};

NamedLaws& named_laws() {
  // Never destroyed: a function may be another runtime's, which ends before this library does.
  static NamedLaws& laws = *new NamedLaws;
  return laws;
}

std::span<const std::string_view> law_names() {
  NamedLaws& named = named_laws();
  return {named.names.data(), std::size(kLaws) + named.count.load()};
}

constexpr std::size_t kLength = 0, kUpper = 1, kStiffness = 2, kOffset = 3, kInformation = 4;

// The stretch s of a link of length r, with its derivatives by r, and by the rest length mu.
struct Stretch {
  double value, first, second, by_rest;
};

Stretch stretch_of(LinkLaw law, double r, double mu, const double* upper) {
  const Stretch hooke{r - mu, 1, 0, -1}, none{0, 0, 0, 0};
  switch (law) {
    case LinkLaw::Rope:
      return r > mu ? hooke : none;
    case LinkLaw::Repulsion:
      return r < mu ? hooke : none;
    case LinkLaw::Interval:
      if (r < mu) return hooke;
      return r > *upper ? Stretch{r - *upper, 1, 0, 0} : none;
    case LinkLaw::Logarithm:
      return {std::log(r / mu), 1 / r, -1 / (r * r), -1 / mu};
    default:
      return hooke;
  }
}

std::vector<Column> columns_of(int dim) {
  return {{"length", 1, Column::Range::NotNegative},
          {"upper", 1, Column::Range::NotNegative, true},
          {"stiffness", 1, Column::Range::NotNegative},
          {.name = "offset", .rows = dim, .is_optional = true, .shape = Column::Shape::Vector},
          {.name = "information", .rows = dim * dim, .is_optional = true, .shape = Column::Shape::Matrix}};
}

}  // namespace

LengthTerm::LengthTerm(std::string_view kind, int dim, std::vector<double> coefficients)
    : Term(kind, dim, static_cast<int>(coefficients.size()), columns_of(dim), {{"law", law_names, 0}}),
      coefficients_(std::move(coefficients)) {
  add_loss();
}

Links::Links(int dim) : TermOf("links", dim, {1, -1}) {}
Bendings::Bendings(int dim) : TermOf("bendings", dim, {1, -2, 1}) {}

void add_link_law(std::string_view name, LinkFunction function, bool is_convex_in_square) {
  NamedLaws& named = named_laws();
  const std::lock_guard lock(named.mutex);
  const std::span<const std::string_view> known = law_names();
  if (name.empty() || std::find(known.begin(), known.end(), name) != known.end())
    detail::raise(std::invalid_argument("there is a law of links '" + std::string(name) + "' already"));
  const std::size_t count = named.count.load();
  if (count == kMostLaws) detail::raise(std::length_error("there are 64 named laws of links already"));
  named.laws[count] = {std::string(name), std::move(function), is_convex_in_square};
  named.names[std::size(kLaws) + count] = named.laws[count].name;
  named.count.store(count + 1);
}

void LengthTerm::set_law(LinkLaw law) { choose("law", law_names()[static_cast<std::size_t>(law)]); }

void LengthTerm::set_function(LinkFunction function, bool is_convex_in_square) {
  function_ = std::move(function);
  is_convex_in_square_ = is_convex_in_square;
  set_law(LinkLaw::Own);
}

const LinkFunction* LengthTerm::function(bool* is_convex) const {
  const auto law = static_cast<std::size_t>(choice(0));
  if (law < kOwn) return nullptr;
  const bool is_named = law > kOwn;
  const NamedLaws::Law* const named = is_named ? &named_laws().laws[law - kOwn - 1] : nullptr;
  if (is_convex != nullptr) *is_convex = is_named ? named->is_convex_in_square : is_convex_in_square_;
  return is_named ? &named->function : &function_;
}

std::string LengthTerm::defect(int node_count) const {
  if (std::string problem = Term::defect(node_count); !problem.empty()) return problem;
  if (std::string problem = loss_defect(); !problem.empty()) return problem;
  const std::string name(kind());
  if (function() != nullptr && !*function())
    return name + ": the law own needs a function, and the user gave none";
  if (function() != nullptr && loss() != Loss::Quadratic)
    return name + ": the user's function as a law cannot have a loss: the function computes the whole energy";
  if (law() == LinkLaw::Interval && size() > 0 && columns()[kUpper].values.size() == 0)
    return name + ": the law interval needs upper lengths";
  const Numbers length = numbers(kLength), upper = numbers(kUpper), information = numbers(kInformation);
  for (int e = 0; e < size(); ++e) {
    const auto refused = [&](const char* what) { return name + ": " + what + std::to_string(e); };
    if (law() == LinkLaw::Interval && !(*upper[e] >= *length[e]))
      return refused("the upper length is less than the length of element ");
    if (law() == LinkLaw::Logarithm && !(*length[e] > 0))
      return refused("the law logarithm needs a positive length of element ");
    if (!information) continue;
    const Eigen::Map<const Eigen::MatrixXd> shape(information[e], dim(), dim());
    if (!detail::is_semidefinite(shape))
      return refused("information is not symmetric and positive semi-definite of element ");
  }
  return {};
}

// A length in x: v with |v|_S = length, its direction u = S v / length, and the forces. across = tension /
// length; where the length is 0 that has no limit: 0 where the link pushes, else as along.
struct LengthTerm::Force {
  double length, energy, tension, along, across, tension_by_rest;
};

// A link's energy as a function of its length, for the laws of the library.
struct LengthTerm::Potential {
  struct Value {
    double value, first, second, first_by_rest;  // for stiffness 1
  };

  LinkLaw law;
  Loss loss;
  bool is_hooke;  // without a loss
  Numbers length, upper, scale, sharpness;

  // Of element e at length r.
  Value operator()(int e, double r) const {
    if (is_hooke) [[likely]] {
      const double s = r - *length[e];
      return {s * s / 2, s, 1, -1};
    }
    const Stretch s = stretch_of(law, r, *length[e], upper[e]);
    const auto phi =
        detail::of_residual(detail::loss_at(loss, scale[e], sharpness[e], s.value * s.value), s.value);
    return {phi.value, phi.first * s.first, phi.second * s.first * s.first + phi.first * s.second,
            phi.second * s.by_rest * s.first};
  }
};

LengthTerm::Potential LengthTerm::potential() const {
  return {law(),
          loss(),
          law() == LinkLaw::Hooke && loss() == Loss::Quadratic,
          numbers(kLength),
          numbers(kUpper),
          scale(),
          sharpness()};
}

namespace {

// tension / length, also where the length is 0: a link that pushes has a peak there, whose curvature has no
// bound from below. A number so far down, and no infinity, leaves the matrix without NaN.
double least_across(double tension, double length, double along) {
  const double across = tension / length;
  if (detail::is_finite(across)) return across;
  return tension < 0 ? -1e290 : along;
}

}  // namespace

// Calls visit(element, v, direction, force, k) for the elements from `begin` to before `end`.
template <int D, typename Visit>
void LengthTerm::for_each(const Points& x, int begin, int end, Visit&& visit) const {
  const Numbers length = numbers(kLength), stiffness = numbers(kStiffness);
  const Numbers offset = numbers(kOffset), information = numbers(kInformation);
  const Potential potential = this->potential();
  const int dim = this->dim(), n = arity();

  const auto vector_of = [&](int e) {
    const int* const node = nodes().col(e).data();
    PointOf<D> v = x.col(node[0]) + coefficients_[1] * x.col(node[1]);
    if (n == 3) v += coefficients_[2] * x.col(node[2]);
    if (offset) v -= Eigen::Map<const PointOf<D>>(offset[e], dim);
    return v;
  };
  const auto direction_of = [&](int e, const PointOf<D>& v, PointOf<D>& direction) -> double {
    const int* const node = nodes().col(e).data();
    if (!information) return detail::length_and_direction(node[0], node[n - 1], v, direction);
    return detail::length_and_direction(node[0], node[n - 1], v, direction,
                                        Eigen::Map<const BlockOf<D>>(information[e], dim, dim));
  };
  const auto force_of = [](double k, double r, const Potential::Value& phi) {
    Force force{r, k * phi.value, k * phi.first, k * phi.second, k * phi.first / r, k * phi.first_by_rest};
    if (!detail::is_finite(force.across)) [[unlikely]]
      force.across = force.tension < 0 ? 0.0 : force.along;
    return force;
  };

  PointOf<D> direction(dim);
  if (const LinkFunction* const own = function()) {
    const auto count = static_cast<std::size_t>(end - begin);
    Eigen::VectorXd r(end - begin), rest(r.size()), value(r.size()), first(r.size()), second(r.size());
    for (int e = begin; e < end; ++e) {
      r[e - begin] = direction_of(e, vector_of(e), direction);
      rest[e - begin] = *length[e];
    }
    (*own)(count, r.data(), rest.data(), value.data(), first.data(), second.data());
    for (int e = begin; e < end; ++e) {
      const double k = *stiffness[e];
      if (!(k > 0)) continue;
      const PointOf<D> v = vector_of(e);
      direction_of(e, v, direction);
      const int at = e - begin;
      visit(e, v, direction, force_of(k, r[at], {value[at], first[at], second[at], 0}), k);
    }
    return;
  }
  for (int e = begin; e < end; ++e) {
    const double k = *stiffness[e];
    if (!(k > 0)) continue;
    const PointOf<D> v = vector_of(e);
    const double r = direction_of(e, v, direction);
    visit(e, v, direction, force_of(k, r, potential(e, r)), k);
  }
}

// The energy of the elements from `begin` to before `end`; adds its gradient unless that is null.
template <int D>
double LengthTerm::sum(const Points& x, int begin, int end, Points* gradient) const {
  double energy = 0;
  const auto add = [&](int e, const PointOf<D>&, const PointOf<D>& direction, const Force& force, double) {
    energy += force.energy;
    if (gradient == nullptr) return;
    const int* const node = nodes().col(e).data();
    const PointOf<D> pull = force.tension * direction;
    for (int a = 0; a < arity(); ++a)
      gradient->col(node[a]) += coefficients_[static_cast<std::size_t>(a)] * pull;
  };
  for_each<D>(x, begin, end, add);
  return energy;
}

// Some elements at a time, one in each lane, for all laws except the user's functions, and lengths without
// information.
template <int D, int kArity>
struct LengthTerm::Lanes {
  static constexpr int kMost = 16;
  static constexpr double kCoefficients[] = {1, kArity == 2 ? -1 : -2, 1};
  using Lane = Eigen::Array<double, kMost, 1>;

  explicit Lanes(const LengthTerm& term)
      : run_time_dim(term.dim()),
        nodes(term.nodes().data()),
        stiffness(term.numbers(kStiffness)),
        offset(term.numbers(kOffset)),
        potential(term.potential()) {}

  // Computes all below for `count` elements. False where rounding takes too much of the square of a length,
  // or a number leaves the range of a double: these elements are to be left to for_each.
  bool evaluate(const double* points, int begin, int count) {
    const int dim = D == Eigen::Dynamic ? run_time_dim : D;
    node = nodes + std::ptrdiff_t{kArity} * begin;
    for (int e = 0; e < kMost; ++e) {
      k[e] = e < count ? *stiffness[begin + e] : 0.0;
      const bool counts =
          k[e] > 0;  // what does not, whatever its length at rest, has numbers that do no harm
      rest[e] = counts ? *potential.length[begin + e] : 0.0;
      for (int c = 0; c < dim; ++c) {
        double d = 1;
        if (counts) {
          d = points[dim * node[kArity * e] + c];
          for (int a = 1; a < kArity; ++a) d += kCoefficients[a] * points[dim * node[kArity * e + a] + c];
          if (offset) d -= offset[begin + e][c];
        }
        v[c][e] = d;
      }
    }
    square = v[0] * v[0];
    for (int c = 1; c < dim; ++c) square += v[c] * v[c];
    length = square.sqrt();
    if (potential.is_hooke) {
      const Lane stretch = length - rest;
      energy = k * stretch * stretch / 2;
      tension = k * stretch;
      along = k;
    } else {
      energy = tension = along = 0;
      for (int e = 0; e < count; ++e) {
        if (!(k[e] > 0)) continue;
        const Potential::Value phi = potential(begin + e, length[e]);
        energy[e] = k[e] * phi.value;
        tension[e] = k[e] * phi.first;
        along[e] = k[e] * phi.second;
      }
    }
    across = tension / length;
    return square.minCoeff() >= lanes_v0_1::kLeastLengthSquare &&
           detail::is_finite(energy.sum() + tension.abs().sum() + along.sum() + across.sum());
  }

  const int run_time_dim;
  const int* nodes;
  const Numbers stiffness, offset;
  const Potential potential;
  const int* node = nullptr;  // of the first element
  Lane v[D == Eigen::Dynamic ? detail::kMaxCoordinates : D];
  Lane square, length, rest, k, energy, tension, along, across;
};

// The same for all elements: what most of them need and no more.
template <int D, int kArity>
double LengthTerm::plain_sum(const Points& x, Points* gradient) const {
  if (law() == LinkLaw::Hooke && loss() == Loss::Quadratic && !numbers(kOffset))
    return hooke_sum<D, kArity>(x, gradient);
  using L = Lanes<D, kArity>;
  L lanes(*this);
  const int dim = D == Eigen::Dynamic ? this->dim() : D;
  double* const forces = gradient == nullptr ? nullptr : gradient->data();
  double energy = 0;
  for (int begin = 0; begin < size(); begin += L::kMost) {
    const int count = std::min(L::kMost, size() - begin);
    if (!lanes.evaluate(x.data(), begin, count)) [[unlikely]] {
      energy += sum<D>(x, begin, begin + count, gradient);
      continue;
    }
    energy += lanes.energy.sum();
    for (int e = 0; forces != nullptr && e < count; ++e) {
      for (int c = 0; c < dim; ++c) {
        const double pull = lanes.across[e] * lanes.v[c][e];
        for (int a = 0; a < kArity; ++a)
          forces[dim * lanes.node[kArity * e + a] + c] += L::kCoefficients[a] * pull;
      }
    }
  }
  return energy;
}

// The same for springs by Hooke's law: one after the other, as it is to load and store nodes that takes time.
template <int D, int kArity>
double LengthTerm::hooke_sum(const Points& x, Points* gradient) const {
  constexpr const double* kCoefficients = Lanes<D, kArity>::kCoefficients;
  const Numbers length = numbers(kLength), stiffness = numbers(kStiffness);
  const double* const points = x.data();
  double* const forces = gradient == nullptr ? nullptr : gradient->data();
  const int* node = nodes().data();
  const int count = size(), dim = D == Eigen::Dynamic ? this->dim() : D;
  constexpr int kPart = 16;    // sums of parts are rounded less than one sum
  double twice = 0, part = 0;  // the energy
  for (int e = 0; e < count; ++e, node += kArity) {
    if (e % kPart == 0) twice += std::exchange(part, 0);
    double v[D == Eigen::Dynamic ? detail::kMaxCoordinates : D], square = 0;
    for (int c = 0; c < dim; ++c) {
      v[c] = points[dim * node[0] + c];
      for (int a = 1; a < kArity; ++a) v[c] += kCoefficients[a] * points[dim * node[a] + c];
      square += v[c] * v[c];
    }
    const double k = *stiffness[e], r = std::sqrt(square), stretch = r - *length[e];
    const double tension = k * stretch, across = tension / r;
    if (!(square >= lanes_v0_1::kLeastLengthSquare && detail::is_finite(across) && k > 0)) [[unlikely]] {
      part += 2 * sum<D>(x, e, e + 1, gradient);
      continue;
    }
    part += tension * stretch;
    if (forces == nullptr) continue;
    for (int c = 0; c < dim; ++c) {
      const double pull = across * v[c];
      for (int a = 0; a < kArity; ++a) forces[dim * node[a] + c] += kCoefficients[a] * pull;
    }
  }
  return (twice + part) / 2;
}

// The same for links that are many times as many as their nodes, by vectors of them.
template <int D>
double LengthTerm::sum_of_rows(const Points& x, Points* gradient) const {
  static_assert(lanes_v0_1::kMostCoordinates == System::kMaxDim);
  const auto n = static_cast<int>(x.cols());
  const int dim = this->dim();
  const std::ptrdiff_t stride = n + lanes_v0_1::kBeyond, size_of_all = (2 * dim + 3) * stride;
  constexpr std::ptrdiff_t kFew = 1024 * (2 * 3 + 3);
  double few[kFew];  // so few numbers need no heap
  std::vector<double> many(size_of_all > kFew ? static_cast<std::size_t>(size_of_all) : 0);
  double* const points = size_of_all > kFew ? many.data() : few;
  double* const forces = points + dim * stride;
  double* const repeated = forces + dim * stride;
  for (int c = 0; c < dim; ++c) {
    for (int i = 0; i < n; ++i) points[c * stride + i] = x(c, i);
    std::fill_n(points + c * stride + n, stride - n, 0.0);
  }
  std::fill_n(forces, dim * stride, 0.0);
  const auto row = [&](const Numbers& numbers, int r) {
    double* const copies = repeated + r * stride;
    if (numbers.stride == 0) std::fill_n(copies, stride, *numbers[0]);
    return lanes_v0_1::LinkNumbers{numbers.stride == 0 ? copies : numbers.data, numbers.stride};
  };
  constexpr double kEnds[] = {-std::numeric_limits<double>::infinity(),
                              std::numeric_limits<double>::infinity()};
  const LinkLaw law = this->law();
  const Numbers length = numbers(kLength);
  const Numbers lower = law == LinkLaw::Rope ? Numbers{&kEnds[0], 0} : length;
  const Numbers upper = law == LinkLaw::Repulsion  ? Numbers{&kEnds[1], 0}
                        : law == LinkLaw::Interval ? numbers(kUpper)
                                                   : length;
  struct LeftOut {
    const LengthTerm& term;
    const Points& x;
    Points* gradient;
    double energy = 0;
  } left_out{*this, x, gradient};
  const lanes_v0_1::LinkRows rows{.pairs = all_pairs_of() > 0 ? nullptr : nodes().data(),
                                  .count = size(),
                                  .nodes = all_pairs_of() > 0 ? all_pairs_of() : n,
                                  .dim = dim,
                                  .stride = stride,
                                  .points = points,
                                  .forces = gradient == nullptr ? nullptr : forces,
                                  .is_hooke = law == LinkLaw::Hooke,
                                  .lower = row(lower, 0),
                                  .upper = row(upper, 1),
                                  .stiffness = row(numbers(kStiffness), 2),
                                  .left_out =
                                      [](void* context, int e) {
                                        auto& here = *static_cast<LeftOut*>(context);
                                        here.energy +=
                                            here.term.template sum<D>(here.x, e, e + 1, here.gradient);
                                      },
                                  .context = &left_out};
  const double energy = lanes_v0_1::sum(rows) / 2;
  if (!detail::is_finite(energy)) return sum<D>(x, 0, size(), gradient);
  for (int i = 0; gradient != nullptr && i < n; ++i) {
    for (int c = 0; c < dim; ++c) (*gradient)(c, i) += forces[c * stride + i];
  }
  return energy + left_out.energy;
}

namespace {

// Whether most links are followed by the next one of a row, to judge by some of them.
bool mostly_in_rows(const Eigen::MatrixXi& pairs) {
  constexpr Eigen::Index kProbes = 64;
  const Eigen::Index links = pairs.cols() - 1, step = 1 + links / kProbes;
  Eigen::Index followed = 0, probes = 0;
  for (Eigen::Index l = 0; l < links; l += step, ++probes)
    followed += pairs(0, l + 1) == pairs(0, l) && pairs(1, l + 1) == pairs(1, l) + 1;
  return 4 * followed >= 3 * probes;
}

}  // namespace

double LengthTerm::energy(const Points& x, Points* gradient) const {
  return detail::with_dim(dim(), [&]<int D>() {
    if (function() == nullptr && !numbers(kInformation)) {
      const auto n = static_cast<int>(x.cols());
      const bool are_rows = arity() == 2 && size() / 3 >= n && law() <= LinkLaw::Interval &&
                            loss() == Loss::Quadratic && !numbers(kOffset) &&
                            (all_pairs_of() > 0 || mostly_in_rows(nodes()));
      if (are_rows) return sum_of_rows<D>(x, gradient);
      return arity() == 2 ? plain_sum<D, 2>(x, gradient) : plain_sum<D, 3>(x, gradient);
    }
    return sum<D>(x, 0, size(), gradient);
  });
}

// v is a sum, and rounded as its parts are; the stretch is a difference of the length and that at rest.
template <int D>
Term::Magnitude LengthTerm::magnitude(const Points& x, int begin, int end) const {
  Magnitude result;
  const int n = arity(), dim = this->dim();
  const Numbers rest = numbers(kLength), upper = numbers(kUpper), offset = numbers(kOffset);
  const Numbers information = numbers(kInformation);
  for_each<D>(
      x, begin, end, [&](int e, const PointOf<D>& v, const PointOf<D>&, const Force& force, double k) {
        const double length = stable_norm(v);
        double parts = length, size = 1;
        if (offset) parts += 2 * stable_norm(offset[e], dim);
        for (int a = 0; n > 2 && a < n; ++a)
          parts += std::abs(coefficients_[static_cast<std::size_t>(a)]) * stable_norm(x.col(nodes()(a, e)));
        if (information)
          size = detail::largest_eigenvalue(Eigen::Map<const Eigen::MatrixXd>(information[e], dim, dim));
        const double lengths = *rest[e] + (law() == LinkLaw::Interval ? *upper[e] : 0.0);
        const double across = std::abs(force.across) * size;
        result.energy += across * length * parts + std::abs(force.tension) * (force.length + lengths);
        result.gradient += 4 * ((across + std::abs(force.along) * size) * parts +
                                k * std::sqrt(size) * (force.length + lengths));
      });
  return result;
}

// The same for links by most laws, some at a time.
template <int D>
Term::Magnitude LengthTerm::plain_magnitude(const Points& x) const {
  using L = Lanes<D, 2>;
  L lanes(*this);
  Magnitude result;
  for (int begin = 0; begin < size(); begin += L::kMost) {
    const int count = std::min(L::kMost, size() - begin);
    if (!lanes.evaluate(x.data(), begin, count)) [[unlikely]] {
      const Magnitude some = magnitude<D>(x, begin, begin + count);
      result.energy += some.energy;
      result.gradient += some.gradient;
      continue;
    }
    const typename L::Lane lengths = lanes.length + lanes.rest, tension = lanes.tension.abs();
    result.energy += (tension * (lanes.length + lengths)).sum();
    result.gradient += 4 * (tension + lanes.along.abs() * lanes.length + lanes.k * lengths).sum();
  }
  return result;
}

Term::Magnitude LengthTerm::magnitude(const Points& x) const {
  return detail::with_dim(dim(), [&]<int D>() {
    const bool is_plain = arity() == 2 && function() == nullptr && law() != LinkLaw::Interval &&
                          !numbers(kInformation) && !numbers(kOffset);
    return is_plain ? plain_magnitude<D>(x) : magnitude<D>(x, 0, size());
  });
}

const char* LengthTerm::problem_with(Curvature curvature) const {
  if (curvature == Curvature::Majorising && law() == LinkLaw::Logarithm)
    return "the law logarithm has no bound of its curvature from above";
  if (curvature != Curvature::Minorising) return nullptr;
  if (bool is_convex = false; function(&is_convex) != nullptr)
    return is_convex ? nullptr
                     : "the user's function is not declared to be convex in the square of the length";
  if (law() == LinkLaw::Logarithm) return "the law logarithm has no bound of its curvature from below";
  return loss() == Loss::Quadratic ? nullptr : "a loss of lengths has no bound of its curvature from below";
}

// d2 = along u u^T + across (S - u u^T). A majoriser is k S; a minoriser, where phi is convex as a function
// of r^2, across S.
template <int D>
void LengthTerm::add_curvature(const Points& x, int begin, int end, Curvature curvature,
                               CurvatureSink& sink) const {
  const int dim = this->dim();
  const Numbers information = numbers(kInformation);
  BlockOf<D> shape = BlockOf<D>::Identity(dim, dim);
  for_each<D>(x, begin, end,
              [&](int e, const PointOf<D>&, const PointOf<D>& u, const Force& force, double k) {
                if (information) shape = Eigen::Map<const BlockOf<D>>(information[e], dim, dim);
                double along = force.along, across = force.across;
                if (curvature == Curvature::Clamped)
                  along = std::max(along, 0.0), across = std::max(across, 0.0);
                if (dim == 1) across = along;  // on a line nothing is across
                if (curvature == Curvature::Majorising) along = across = k;
                if (curvature == Curvature::Minorising)
                  along = across = least_across(force.tension, force.length, force.along);
                BlockOf<D> block = u * u.transpose();
                block *= along - across;
                block += across * shape;
                sink.add_blocks(nodes().col(e).data(), arity(), 1, coefficients_.data(), block.data(), dim);
              });
}

// That of the majoriser without information, k I.
void LengthTerm::add_stiffness(CurvatureSink& sink) const {
  constexpr int kMost = 256;
  const Numbers stiffness = numbers(kStiffness);
  double same[kMost];  // for elements that all have one stiffness
  if (stiffness.stride == 0) std::fill_n(same, kMost, *stiffness[0]);
  for (int e = 0; e < size(); e += kMost) {
    sink.add_multiples(nodes().col(e).data(), arity(), std::min(kMost, size() - e), coefficients_.data(),
                       stiffness.stride == 0 ? same : stiffness[e], dim());
  }
}

// The same for all elements, as plain_sum.
template <int D, int kArity>
void LengthTerm::add_plain_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const {
  using L = Lanes<D, kArity>;
  if (curvature == Curvature::Majorising) return add_stiffness(sink);
  L lanes(*this);
  const int dim = D == Eigen::Dynamic ? this->dim() : D, entries = dim * dim;
  constexpr int kFixed = D == Eigen::Dynamic ? 0 : L::kMost * D * D;
  std::conditional_t<D == Eigen::Dynamic, std::vector<double>, std::array<double, std::size_t{kFixed}>>
      blocks;
  if constexpr (D == Eigen::Dynamic) blocks.resize(static_cast<std::size_t>(L::kMost * entries));
  for (int begin = 0; begin < size(); begin += L::kMost) {
    const int count = std::min(L::kMost, size() - begin);
    const bool is_plain = lanes.evaluate(x.data(), begin, count);
    typename L::Lane along = lanes.along, across = lanes.across;
    if (curvature == Curvature::Minorising && is_plain) {
      sink.add_multiples(lanes.node, kArity, count, coefficients_.data(), across.data(), dim);
      continue;
    }
    if (curvature == Curvature::Clamped) {
      along = along.max(0.0);
      across = across.max(0.0);
    }
    if (dim == 1) across = along;  // on a line nothing is across
    const typename L::Lane excess = (along - across) / lanes.square;
    if (!is_plain || !detail::is_finite(excess.sum())) [[unlikely]] {
      add_curvature<D>(x, begin, begin + count, curvature, sink);
      continue;
    }
    for (int j = 0; j < dim; ++j) {
      for (int i = 0; i <= j; ++i) {
        typename L::Lane entry = excess * lanes.v[i] * lanes.v[j];
        if (i == j) entry += across;
        double* block = blocks.data();
        for (int e = 0; e < count; ++e, block += entries) block[dim * j + i] = block[dim * i + j] = entry[e];
      }
    }
    sink.add_blocks(lanes.node, kArity, count, coefficients_.data(), blocks.data(), dim);
  }
}

void LengthTerm::add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const {
  const bool is_plain = function() == nullptr && !numbers(kInformation);
  if (dim() == 4 && is_plain && arity() == 2)  // where proofs by more dimensions often end
    return add_plain_curvature<4, 2>(x, curvature, sink);
  detail::with_dim(dim(), [&]<int D>() {
    if (is_plain) {
      if (arity() == 2) return add_plain_curvature<D, 2>(x, curvature, sink);
      return add_plain_curvature<D, 3>(x, curvature, sink);
    }
    add_curvature<D>(x, 0, size(), curvature, sink);
  });
}

// w . g = k phi'(r) u . delta, with delta = sum_a c_a w_a.
void LengthTerm::add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const {
  const int dim = this->dim();
  const Numbers information = numbers(kInformation);
  detail::with_dim(dim, [&]<int D>() {
    BlockOf<D> shape = BlockOf<D>::Identity(dim, dim);
    for_each<D>(
        x, 0, size(), [&](int e, const PointOf<D>& v, const PointOf<D>& u, const Force& force, double k) {
          const int* const node = nodes().col(e).data();
          PointOf<D> delta = PointOf<D>::Zero(dim);
          for (int a = 0; a < arity(); ++a)
            delta += coefficients_[static_cast<std::size_t>(a)] * w.col(node[a]);
          const double along = u.dot(delta);
          const auto column = [&](std::size_t i) { return by[i].col(by[i].cols() == 1 ? 0 : e); };
          const auto at_rest = numbers(kLength)[e];
          if (law() != LinkLaw::Interval || force.length < *at_rest) {
            column(kLength)[0] += force.tension_by_rest * along;
          } else {
            column(kUpper)[0] += force.tension > 0 ? -force.along * along : 0;
          }
          column(kStiffness)[0] += force.tension / k * along;
          const Stretch s = stretch_of(law(), force.length, *at_rest, numbers(kUpper)[e]);
          const double square = s.value * s.value;
          const auto rho = detail::loss_at(loss(), scale()[e], sharpness()[e], square);
          detail::add_by_loss(loss(), scale()[e], sharpness()[e], square, rho, k * along * s.value * s.first,
                              e, by);
          if (information) shape = Eigen::Map<const BlockOf<D>>(information[e], dim, dim);
          if (by[kOffset].size() > 0)
            column(kOffset) -= (force.along - force.across) * along * u + force.across * (shape * delta);
          if (information && force.length > 0) {
            const BlockOf<D> both = delta * v.transpose();
            const BlockOf<D> by_shape =
                (force.across / 2) * (both + both.transpose()) +
                ((force.along - force.across) * along / (2 * force.length)) * v * v.transpose();
            column(kInformation) += Eigen::Map<const Eigen::VectorXd>(by_shape.data(), dim * dim);
          }
        });
  });
}

const char* LengthTerm::why_not_differentiable() const {
  return function() != nullptr ? "the user's function gives no derivatives by the rest lengths" : nullptr;
}

void LengthTerm::add_scales(const Points&, Scales& scales) const {
  const Numbers length = numbers(kLength), stiffness = numbers(kStiffness), offset = numbers(kOffset);
  scales.lengths.reserve(scales.lengths.size() + static_cast<std::size_t>(size()));
  for (int e = 0; e < size(); ++e) {
    double k = *stiffness[e];
    const double at_rest = *length[e] * *length[e];
    double square = at_rest;
    if (offset) square += Eigen::Map<const Eigen::VectorXd>(offset[e], dim()).squaredNorm();
    scales.lengths.emplace_back(k, square);
    if (const Numbers information = numbers(kInformation))
      k *= detail::largest_eigenvalue(Eigen::Map<const Eigen::MatrixXd>(information[e], dim(), dim()));
    // The curvature of 1/2 log(r / mu)^2 is 1 / mu^2 at rest.
    if (law() == LinkLaw::Logarithm) k /= at_rest;
    for (int a = 0; a < arity(); ++a) {
      const double c = coefficients_[static_cast<std::size_t>(a)];
      scales.hold(nodes()(a, e), k * c * c);
    }
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
