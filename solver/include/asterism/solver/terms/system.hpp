#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <asterism/solver/terms/term.hpp>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Points and the terms of their energy: the general form of SpringSystem, whose terms are chosen at run
/// time. All methods take it, and nothing is compiled again for it.
///
///     asterism::System system(4, 2);
///     system.add_anchors(positions, 0.5);
///     system.add_links(asterism::all_pairs(4), lengths).set_loss(asterism::Loss::Huber, 3);
///     asterism::Summary summary = asterism::solve(system, x);
///
/// Nodes, terms and elements can be added, changed and removed between solves. A number that is given for
/// all elements of a term, such as the stiffness 0.5, is stored once and holds for elements that are added.
class ASTERISM_API System {
 public:
  using Scalar = double;
  using Points = Eigen::MatrixXd;     ///< dim x nodes, a node is a column
  static constexpr int kMaxDim = 64;  ///< the most coordinates of a point

  /// Throws std::invalid_argument for a negative number of nodes, or for less than one or more than kMaxDim
  /// coordinates.
  System(int nodes, int dim);
  System(const System& other);
  System(System&&) noexcept = default;
  System& operator=(const System& other);
  System& operator=(System&&) noexcept = default;
  ~System() = default;

  int nodes() const { return static_cast<int>(is_fixed_.size()); }
  /// The number of coordinates of a point.
  int dim() const { return dim_; }

  /// Adds nodes at the end.
  void add_nodes(int count);
  /// Removes nodes, and the elements that have one of them; the others keep their order.
  /// Throws std::out_of_range, and changes nothing, if one of them or of the elements' nodes does not exist.
  void remove_nodes(std::span<const int> nodes);

  /// A fixed node stays where the start has it. Throws std::out_of_range.
  void fix(int node) { is_fixed_[index(node, is_fixed_.size(), "node")] = true; }
  void unfix(int node) { is_fixed_[index(node, is_fixed_.size(), "node")] = false; }
  bool is_fixed(int node) const { return is_fixed_[static_cast<std::size_t>(node)]; }

  /// Adds a term. The reference holds until the term is removed. Throws std::invalid_argument for another
  /// number of coordinates.
  template <typename T>
  T& add(T term) {
    return static_cast<T&>(add(std::unique_ptr<Term>(std::make_unique<T>(std::move(term)))));
  }
  Term& add(std::unique_ptr<Term> term);
  /// Removes one of the terms.
  void remove(const Term& term);
  int term_count() const { return static_cast<int>(terms_.size()); }
  /// Throws std::out_of_range.
  Term& term(int t) { return *terms_[index(t, terms_.size(), "term")]; }
  const Term& term(int t) const { return *terms_[index(t, terms_.size(), "term")]; }

  /// Terms with elements. `nodes` has an element in each column; other arrays have one column, or entry, for
  /// each element, or one for all of them. Throws std::invalid_argument for sizes that do not fit.
  Anchors& add_anchors(const Eigen::MatrixXd& positions, const Eigen::VectorXd& stiffness);
  Anchors& add_anchors(const Eigen::RowVectorXi& nodes, const Eigen::MatrixXd& positions,
                       const Eigen::VectorXd& stiffness);
  Links& add_links(const Eigen::Matrix2Xi& nodes, const Eigen::VectorXd& lengths,
                   const Eigen::VectorXd& stiffness);
  Bendings& add_bendings(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& lengths,
                         const Eigen::VectorXd& stiffness);
  Offsets& add_offsets(const Eigen::Matrix2Xi& nodes, const Eigen::MatrixXd& offsets,
                       const Eigen::VectorXd& stiffness);
  Loads& add_loads(const Eigen::RowVectorXi& nodes, const Eigen::MatrixXd& forces);
  /// Second differences x_i - 2 x_j + x_k.
  Differences& add_differences(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& stiffness);
  Angles& add_angles(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& rest,
                     const Eigen::VectorXd& stiffness);
  Areas& add_areas(const Eigen::Matrix3Xi& nodes, const Eigen::VectorXd& rest,
                   const Eigen::VectorXd& stiffness);
  CommonLength& add_common_length(const Eigen::Matrix2Xi& nodes, const Eigen::VectorXd& stiffness,
                                  double prior = 0, double prior_stiffness = 0);
  Elements& add_elements(const Eigen::MatrixXi& nodes, ElementFunction function, bool has_second);

  /// The same number for all elements, as an argument of these functions.
  static Eigen::VectorXd all(double value) { return Eigen::VectorXd::Constant(1, value); }

 private:
  static std::size_t index(int i, std::size_t count, const char* of);

  int dim_;
  std::vector<bool> is_fixed_;
  std::vector<std::unique_ptr<Term>> terms_;
};

/// Every pair of n nodes, in the order (0,1), (0,2), ..., (1,2), ...
ASTERISM_API Eigen::Matrix2Xi all_pairs(int n);
/// x_i - x_j of each pair, dim x pairs: what their offsets are at x.
ASTERISM_API Eigen::MatrixXd offsets_at(const Eigen::MatrixXd& x, const Eigen::Matrix2Xi& pairs);
/// |x_i - x_j| of each pair: what their lengths are at x.
ASTERISM_API Eigen::VectorXd lengths_at(const Eigen::MatrixXd& x, const Eigen::Matrix2Xi& pairs);

/// The energy at x (dim x nodes), and with its gradient, which is 0 for fixed nodes. The system must be
/// valid.
ASTERISM_API double energy(const System& system, const Eigen::MatrixXd& x);
ASTERISM_API double energy_and_gradient(const System& system, const Eigen::MatrixXd& x,
                                        Eigen::MatrixXd& gradient);

/// Why a solver would refuse the system and x; empty if nothing is wrong. "links: stiffness 3 is negative or
/// not finite". With `need_hold`, also a connected component that nothing holds.
ASTERISM_API std::string validate(const System& system, const Eigen::MatrixXd& x, bool need_hold = true);

/// A_ii, what node i moves against when the others stand still, from the terms' upper bounds where they have
/// one, else from their second derivatives at x. For springs as that of SpringSystem.
ASTERISM_API Eigen::VectorXd node_stiffness(const System& system, const Eigen::MatrixXd& x);
/// The length L that distances are measured in, as for SpringSystem: the root mean square of the rest
/// lengths and of the anchors about their centroid; without any, that of x about its own; where that is 0,
/// how far the forces would move their nodes.
ASTERISM_API double characteristic_length(const System& system, const Eigen::MatrixXd& x);
/// max_i |g_i| / (A_ii L): how far x is from a stationary point, without units.
ASTERISM_API double stationarity(const System& system, const Eigen::MatrixXd& x);

}  // namespace ASTERISM_ABI
}  // namespace asterism
