#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/terms/system.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "direction.hpp"
#include "stopping_rule.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

using detail::raise;

System::System(int nodes, int dim) : dim_(dim) {
  if (nodes < 0) raise(std::invalid_argument("the number of nodes is negative"));
  if (dim < 1 || dim > kMaxDim)
    raise(std::invalid_argument("a point has 1 to " + std::to_string(kMaxDim) + " coordinates, not " +
                                std::to_string(dim)));
  is_fixed_.resize(static_cast<std::size_t>(nodes));
}

System::System(const System& other) : dim_(other.dim_), is_fixed_(other.is_fixed_) {
  for (const auto& term : other.terms_) terms_.push_back(term->clone());
}

System& System::operator=(const System& other) {
  if (this != &other) *this = System(other);
  return *this;
}

std::size_t System::index(int i, std::size_t count, const char* of) {
  const auto at = static_cast<std::size_t>(i);
  if (at >= count)
    raise(std::out_of_range(std::string(of) + " " + std::to_string(i) + " is out of range (" +
                            std::to_string(count) + " " + of + "s)"));
  return at;
}

void System::add_nodes(int count) {
  if (count < 0) raise(std::invalid_argument("a negative number of nodes cannot be added"));
  is_fixed_.resize(is_fixed_.size() + static_cast<std::size_t>(count));
}

void System::remove_nodes(std::span<const int> nodes) {
  std::vector<int> number(is_fixed_.size(), 0);
  for (const int node : nodes) number[index(node, number.size(), "node")] = -1;
  std::vector<bool> fixed;
  for (std::size_t i = 0; i < number.size(); ++i) {
    if (number[i] < 0) continue;
    number[i] = static_cast<int>(fixed.size());
    fixed.push_back(is_fixed_[i]);
  }
  std::vector<std::vector<int>> gone(terms_.size());  // of all terms, before one is changed
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const Eigen::MatrixXi& of = terms_[t]->nodes();
    for (Eigen::Index e = 0; e < of.cols(); ++e) {
      bool is_gone = false;
      for (const int node : of.col(e)) is_gone |= number[index(node, number.size(), "node")] < 0;
      if (is_gone) gone[t].push_back(static_cast<int>(e));
    }
  }
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    terms_[t]->remove(gone[t]);
    Eigen::MatrixXi moved = terms_[t]->nodes();
    for (int& node : moved.reshaped()) node = number[static_cast<std::size_t>(node)];
    terms_[t]->set_nodes(std::move(moved));
  }
  is_fixed_ = std::move(fixed);
}

Term& System::add(std::unique_ptr<Term> term) {
  if (term->dim() != dim_)
    raise(std::invalid_argument(std::string(term->kind()) + ": a term of " + std::to_string(term->dim()) +
                                " coordinates in a system of " + std::to_string(dim_)));
  terms_.push_back(std::move(term));
  return *terms_.back();
}

void System::remove(const Term& term) {
  const auto at =
      std::find_if(terms_.begin(), terms_.end(), [&](const auto& each) { return each.get() == &term; });
  if (at == terms_.end()) raise(std::invalid_argument("this term is not one of the system"));
  terms_.erase(at);
}

namespace {

template <typename T>
T& filled(System& system, T term, const Eigen::MatrixXi& nodes,
          std::initializer_list<std::pair<const char*, Eigen::MatrixXd>> columns) {
  term.set_nodes(nodes);
  for (const auto& [name, values] : columns) {
    if (values.cols() != nodes.cols() && values.cols() != 1)
      raise(std::invalid_argument(
          std::string(term.kind()) + ": " + name +
          " must have one entry for each element, or one for all: " + std::to_string(values.cols()) + " of " +
          detail::counted(static_cast<int>(nodes.cols()), "element")));
    term.values(name) = values;
  }
  return system.add(std::move(term));
}

}  // namespace

Anchors& System::add_anchors(const Eigen::MatrixXd& positions, const Eigen::VectorXd& stiffness) {
  return add_anchors(Eigen::RowVectorXi::LinSpaced(nodes(), 0, nodes() - 1), positions, stiffness);
}
Anchors& System::add_anchors(const Eigen::RowVectorXi& nodes, const Eigen::MatrixXd& positions,
                             const Eigen::VectorXd& stiffness) {
  return filled(*this, Anchors(dim_), nodes, {{"position", positions}, {"stiffness", stiffness.transpose()}});
}
Links& System::add_links(const Eigen::Matrix2Xi& nodes, const Eigen::VectorXd& lengths,
                         const Eigen::VectorXd& stiffness) {
  return filled(*this, Links(dim_), nodes,
                {{"length", lengths.transpose()}, {"stiffness", stiffness.transpose()}});
}
Bendings& System::add_bendings(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& lengths,
                               const Eigen::VectorXd& stiffness) {
  return filled(*this, Bendings(dim_), nodes,
                {{"length", lengths.transpose()}, {"stiffness", stiffness.transpose()}});
}
Offsets& System::add_offsets(const Eigen::Matrix2Xi& nodes, const Eigen::MatrixXd& offsets,
                             const Eigen::VectorXd& stiffness) {
  return filled(*this, Offsets(dim_), nodes, {{"offset", offsets}, {"stiffness", stiffness.transpose()}});
}
Loads& System::add_loads(const Eigen::RowVectorXi& nodes, const Eigen::MatrixXd& forces) {
  return filled(*this, Loads(dim_), nodes, {{"force", forces}});
}
Differences& System::add_differences(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& stiffness) {
  const auto one = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  return filled(*this, Differences(dim_), nodes,
                {{"target", Eigen::MatrixXd::Zero(dim_, 1)},
                 {"stiffness", stiffness.transpose()},
                 {"a", one(1)},
                 {"b", one(-2)},
                 {"c", one(1)}});
}
Angles& System::add_angles(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& rest,
                           const Eigen::VectorXd& stiffness) {
  return filled(*this, Angles(dim_), nodes,
                {{"rest", rest.transpose()}, {"stiffness", stiffness.transpose()}});
}
Areas& System::add_areas(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& rest,
                         const Eigen::VectorXd& stiffness) {
  return filled(*this, Areas(dim_), nodes,
                {{"rest", rest.transpose()}, {"stiffness", stiffness.transpose()}});
}
CommonLength& System::add_common_length(const Eigen::Matrix2Xi& nodes, const Eigen::VectorXd& stiffness,
                                        double prior, double prior_stiffness) {
  const auto one = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  return filled(*this, CommonLength(dim_), nodes,
                {{"length", one(0)},
                 {"stiffness", stiffness.transpose()},
                 {"prior", one(prior)},
                 {"prior_stiffness", one(prior_stiffness)}});
}
Elements& System::add_elements(const Eigen::MatrixXi& nodes, ElementFunction function, bool has_second) {
  Elements term(dim_, static_cast<int>(nodes.rows()), 0, std::move(function), has_second);
  term.set_nodes(nodes);
  return add(std::move(term));
}

Eigen::Matrix2Xi all_pairs(int n) {
  const Eigen::Index count = std::max(0, n);
  Eigen::Matrix2Xi pairs(2, count * (count - 1) / 2);
  int l = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n; ++j) pairs.col(l++) << i, j;
  }
  return pairs;
}

Eigen::MatrixXd offsets_at(const Eigen::MatrixXd& x, const Eigen::Matrix2Xi& pairs) {
  Eigen::MatrixXd offsets(x.rows(), pairs.cols());
  for (Eigen::Index l = 0; l < pairs.cols(); ++l) offsets.col(l) = x.col(pairs(0, l)) - x.col(pairs(1, l));
  return offsets;
}

Eigen::VectorXd lengths_at(const Eigen::MatrixXd& x, const Eigen::Matrix2Xi& pairs) {
  Eigen::VectorXd lengths(pairs.cols()), offset(x.rows());
  for (Eigen::Index l = 0; l < pairs.cols(); ++l) {
    offset = x.col(pairs(0, l)) - x.col(pairs(1, l));
    lengths[l] = detail::stable_norm(offset);
  }
  return lengths;
}

double energy(const System& system, const Eigen::MatrixXd& x) {
  double sum = 0;
  for (int t = 0; t < system.term_count(); ++t) sum += system.term(t).energy(x, nullptr);
  return sum;
}

double energy_and_gradient(const System& system, const Eigen::MatrixXd& x, Eigen::MatrixXd& gradient) {
  gradient.setZero(x.rows(), x.cols());
  double sum = 0;
  for (int t = 0; t < system.term_count(); ++t) sum += system.term(t).energy(x, &gradient);
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) gradient.col(i).setZero();
  }
  return sum;
}

namespace detail {

namespace {

int root_of(std::vector<int>& up, int node) {
  const auto at = [&up](int i) -> int& { return up[static_cast<std::size_t>(i)]; };
  while (at(node) != node) node = at(node) = at(at(node));
  return node;
}

}  // namespace

std::vector<int> floating_nodes(const System& system) {
  const int n = system.nodes();
  std::vector<int> up(static_cast<std::size_t>(n) + 1);  // the last stands for what is held
  std::iota(up.begin(), up.end(), 0);
  int apart = n;  // from each other or from what is held
  const auto join = [&](int i, int j) {
    const int one = root_of(up, i), other = root_of(up, j);
    apart -= one != other;
    up[static_cast<std::size_t>(one)] = other;
  };
  for (int i = 0; i < n; ++i) {
    if (system.is_fixed(i)) join(i, n);
  }
  for (int t = 0; t < system.term_count() && apart > 0; ++t) {
    const Term& term = system.term(t);
    for (int e = 0; e < term.size() && apart > 0; ++e) {
      const Term::Role role = term.role(e);
      if (role == Term::Role::Pulls || !term.is_stiff(e)) continue;
      for (int a = 1; a < term.arity(); ++a) join(term.nodes()(a, e), term.nodes()(0, e));
      if (role == Term::Role::Holds) join(term.nodes()(0, e), n);
    }
  }
  std::vector<int> first;
  for (int i = 0; i < n; ++i) {
    if (root_of(up, i) == root_of(up, n)) continue;
    first.push_back(i);
    join(i, n);
  }
  return first;
}

Scales scales_of(const System& system, const Eigen::MatrixXd& x) {
  Scales scales(system.nodes());
  for (int t = 0; t < system.term_count(); ++t) system.term(t).add_scales(x, scales);
  return scales;
}

double energy_scale(const System& system, const Eigen::MatrixXd& x, double energy) {
  double scale = std::abs(energy);
  for (int t = 0; t < system.term_count(); ++t) {
    if (system.term(t).size() > 0 && system.term(t).role(0) == Term::Role::Pulls)
      scale += 2 * system.term(t).magnitude(x).energy;
  }
  return scale;
}

double energy_rounding(const System& system, const Eigen::MatrixXd& x, double energy) {
  double terms = system.nodes();
  for (int t = 0; t < system.term_count(); ++t) terms += system.term(t).size();
  return terms * std::numeric_limits<double>::epsilon() * energy_scale(system, x, energy);
}

bool SystemRule::set(const System& system, const Eigen::MatrixXd& x, double tolerance) {
  constexpr double kLeastTolerance = 64 * std::numeric_limits<double>::epsilon();
  tolerance_ = std::max(tolerance, kLeastTolerance);
  const int n = system.nodes();
  Scales scales = scales_of(system, x);
  changes_with_x_ = false;
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    changes_with_x_ |=
        term.size() > 0 && (term.has_hidden() || term.problem_with(Curvature::Majorising) != nullptr);
  }
  stiffness_ = scales.stiffness;
  length_ = length_of(system, x, scales);
  places_.swap(scales.places);
  weights_.setZero(n);
  double unknown = stiffness_.size() > 0 ? stiffness_.maxCoeff() : 0.0;
  is_by_gradient_ = length_ == 0 || !(unknown > 0);
  Eigen::MatrixXd gradient;
  if (is_by_gradient_) energy_and_gradient(system, x, gradient);
  // Where nothing has an extent, the length is how far the forces would move their nodes; where nothing has
  // stiffness either, any length will do.
  if (length_ == 0 && (gradient.array() != 0).any()) {
    for (int i = 0; i < n; ++i) {
      if (stiffness_[i] > 0)
        length_ = std::max(length_, detail::stable_norm(gradient.col(i)) / stiffness_[i]);
    }
    if (length_ == 0) length_ = 1;
  }
  if (!(length_ > 0)) return length_ == 0;
  // A node whose scale is unknown counts as the stiffest; if all are, the gradient at x tells the scale.
  if (!(unknown > 0)) unknown = gradient.cwiseAbs().maxCoeff() / length_;
  if (!(unknown > 0)) unknown = 1;
  bool in_range = true;
  for (int i = 0; i < n; ++i) {
    if (!(stiffness_[i] > 0)) stiffness_[i] = unknown;
    weights_[i] = 1 / (stiffness_[i] * length_);
    in_range = in_range && weights_[i] > 0 && is_finite(weights_[i]);
  }
  return in_range;
}

void SystemRule::renew(const System& system, const Eigen::MatrixXd& x) {
  if (is_by_gradient_ || !changes_with_x_) return;
  SystemRule here;
  if (here.set(system, x, tolerance_) && !here.is_by_gradient_) *this = here;
}

double SystemRule::length_of(const System& system, const Eigen::MatrixXd& x, const Scales& scales) {
  const auto position_of = [&](const Scales::Place& place) {
    return Eigen::Map<const Eigen::VectorXd>(place.position, system.dim());
  };
  const auto places = [&](bool all) {
    std::vector<const Scales::Place*> result;
    for (const Scales::Place& place : scales.places) {
      const bool holds_others = scales.holders[place.node] > 1 && !system.is_fixed(place.node);
      if (place.stiffness > 0 && (all || holds_others)) result.push_back(&place);
    }
    return result;
  };
  Eigen::VectorXd centroid = Eigen::VectorXd::Zero(system.dim());
  for (const bool all : {false, true}) {
    const auto held = places(all);
    double strongest = 0;
    for (const auto* place : held) strongest = std::max(strongest, place->stiffness);
    for (const auto& [stiffness, square] : scales.lengths) strongest = std::max(strongest, stiffness);
    const auto weight_of = [full = 1e-4 * strongest](double stiffness) {
      return stiffness >= full && stiffness > 0 ? 1.0 : full > 0 ? stiffness / full : 0.0;
    };
    double total = 0, sum = 0;
    centroid.setZero();
    for (const auto* place : held) {
      total += weight_of(place->stiffness);
      centroid += weight_of(place->stiffness) * position_of(*place);
    }
    if (total > 0) centroid /= total;
    for (const auto* place : held)
      sum += weight_of(place->stiffness) * (position_of(*place) - centroid).squaredNorm();
    for (const auto& [stiffness, square] : scales.lengths) {
      if (!(stiffness > 0)) continue;  // its length may be so far off that its square overflows
      total += weight_of(stiffness);
      sum += weight_of(stiffness) * square;
    }
    if (sum > 0) return std::sqrt(sum / total);
  }
  double reach = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    if (scales.stiffness[i] > 0 && !system.is_fixed(i))
      reach = std::max(reach, scales.loads[i] / scales.stiffness[i]);
  }
  if (reach > 0) return reach;
  if (x.cols() == 0) return 0;
  changes_with_x_ = true;
  if (scales.places.empty()) centroid = x.rowwise().mean();
  const double spread = std::sqrt((x.colwise() - centroid).squaredNorm() / static_cast<double>(x.cols()));
  double extent = 0;
  for (const Scales::Place& place : scales.places)
    extent = std::max(extent, position_of(place).cwiseAbs().maxCoeff());
  return extent > 0 ? std::min(extent, spread) : spread;
}

double SystemRule::stationarity(const Eigen::MatrixXd& gradient) const {
  double largest = 0;
  for (Eigen::Index i = 0; i < weights_.size(); ++i) {
    const double value = stable_norm(gradient.col(i)) * weights_[i];
    if (!(value <= largest)) largest = value;
  }
  return largest;
}

bool SystemRule::is_rounding(const Eigen::MatrixXd& x, const Eigen::MatrixXd& gradient) const {
  constexpr double kRounding = 8 * std::numeric_limits<double>::epsilon();
  for (Eigen::Index i = 0; i < weights_.size(); ++i) {
    const double rounding = kRounding * (length_ + x.col(i).cwiseAbs().maxCoeff());
    if (!(stable_norm(gradient.col(i)) * weights_[i] * length_ <= rounding)) return false;
  }
  return true;
}

}  // namespace detail

std::string validate(const System& system, const Eigen::MatrixXd& x, bool need_hold) {
  if (system.nodes() == 0) return "system has no nodes";
  if (x.rows() != system.dim() || x.cols() != system.nodes())
    return "x must have " + detail::counted(system.dim(), "coordinate") + " for each of " +
           detail::counted(system.nodes(), "node");
  for (int t = 0; t < system.term_count(); ++t) {
    if (std::string problem = system.term(t).defect(system.nodes()); !problem.empty()) return problem;
  }
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    for (Eigen::Index d = 0; d < x.rows(); ++d) {
      if (!detail::is_finite(x(d, i))) return "x of node " + std::to_string(i) + " is not finite";
    }
  }
  if (!need_hold) return {};
  const std::vector<int> floating = detail::floating_nodes(system);
  if (floating.empty()) return {};
  return "node " + std::to_string(floating.front()) + " is in a connected component that nothing holds";
}

Eigen::VectorXd node_stiffness(const System& system, const Eigen::MatrixXd& x) {
  detail::SystemRule rule;
  rule.set(system, x, 0);
  return rule.node_stiffness();
}

double characteristic_length(const System& system, const Eigen::MatrixXd& x) {
  detail::SystemRule rule;
  rule.set(system, x, 0);
  return rule.length();
}

double stationarity(const System& system, const Eigen::MatrixXd& x) {
  detail::SystemRule rule;
  rule.set(system, x, 0);
  Eigen::MatrixXd gradient;
  energy_and_gradient(system, x, gradient);
  return rule.stationarity(gradient);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
