#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/export.hpp>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Which second derivative of the energy a matrix is made of.
enum class Curvature {
  True,        ///< the Hessian
  Clamped,     ///< without the elements' negative curvature: positive semi-definite
  Majorising,  ///< M with E(y) <= E(x) + g . (y - x) + (y - x)^T M (y - x) / 2 for all y; the same at every x
  Minorising   ///< M with E(y) >= E(x) + g . (y - x) + (y - x)^T M (y - x) / 2 for all y
};

/// The law by which an element's energy grows with the square s of its residual, 1/2 k rho(s); `scale` and
/// `sharpness` are its columns. See the classes Huber, GemanMcClure and Truncated for the formulas.
enum class Loss { Quadratic, Huber, GemanMcClure, Truncated };

/// Takes the second derivatives of a term, element by element.
class ASTERISM_API CurvatureSink {
 public:
  virtual ~CurvatureSink() = default;

  /// The symmetric matrix of one element over the coordinates of its `count` nodes, in the order of `nodes`,
  /// with `rows` rows, column by column. A node may come more than once. A hidden unknown is hidden_node()
  /// and has one row.
  virtual void add(const int* nodes, int count, const double* matrix, int rows) = 0;
  /// The same for `count` elements of `arity` nodes each, without a hidden unknown, whose nodes a and b have
  /// the block c_a c_b B. The elements' nodes follow each other, and so do their B: symmetric, dim x dim.
  virtual void add_blocks(const int* nodes, int arity, int count, const double* c, const double* B, int dim);
  /// The same for blocks that are multiples k of the identity, one number for each element.
  virtual void add_multiples(const int* nodes, int arity, int count, const double* c, const double* k,
                             int dim);

  /// The number that stands for the hidden unknown of the term that is visited, see Term::has_hidden.
  int hidden_node() const { return hidden_node_; }
  void set_hidden_node(int node) { hidden_node_ = node; }

 private:
  int hidden_node_ = -1;
};

/// The scales by which a stopping rule measures a system.
struct Scales {
  Eigen::VectorXd
      stiffness;            ///< of each node, as the other nodes stand still: an upper bound where one exists
  Eigen::VectorXi holders;  ///< how many elements with stiffness each node has
  /// Pairs of a spring's stiffness and the square of the length that it has at rest.
  std::vector<std::pair<double, double>> lengths;
  /// A node that is pulled to a position.
  struct Place {
    int node;          ///< its number
    double stiffness;  ///< of the spring that pulls
    /// The place where its force is 0: dim numbers that live as long as the term.
    const double* position;
  };
  std::vector<Place> places;  ///< one for each such spring
  Eigen::VectorXd loads;      ///< the length of each node's load

  /// Scales of so many nodes that nothing holds yet.
  explicit Scales(int nodes)
      : stiffness(Eigen::VectorXd::Zero(nodes)),
        holders(Eigen::VectorXi::Zero(nodes)),
        loads(Eigen::VectorXd::Zero(nodes)) {}
  /// An element holds this node with stiffness k.
  void hold(int node, double k) {
    stiffness[node] += k;
    holders[node] += k > 0;
  }
};

/// Numbers of a term, so many for each of its elements.
struct Column {
  /// Which numbers are allowed; NaN and infinity never are.
  enum class Range { Any, NotNegative, Positive };
  /// What becomes of an element's numbers in more coordinates, see Term::lifted: they stay; a vector gets
  /// zeros; a symmetric matrix gets its least eigenvalue on the diagonal, which leaves a multiple of the
  /// identity what it is.
  enum class Shape { Numbers, Vector, Matrix };

  std::string_view name;         ///< in C++, Python and files
  int rows = 1;                  ///< numbers for each element
  Range range = Range::Any;      ///< which are allowed
  bool is_optional = false;      ///< may be empty
  int other_rows = 0;            ///< also allowed, such as for a matrix instead of a factor
  Shape shape = Shape::Numbers;  ///< what they are
  bool is_common = false;        ///< must be the same for all elements
  Eigen::MatrixXd values{};      ///< rows x elements; or rows x 1, the same for all of them; or empty
};

/// The numbers that are given for a column, by its name.
struct NamedNumbers {
  std::string_view column;  ///< a name of Column
  Eigen::MatrixXd values;   ///< as Column::values
};

/// A property of a term as a whole, by name.
struct Choice {
  std::string_view name;                         ///< such as "loss"
  std::span<const std::string_view> (*names)();  ///< of its values
  int value = 0;                                 ///< an index into names
};

/// A part of the energy of a System: an array of like elements, such as all links. An element has as many
/// nodes as every other one of its term, and numbers, which stand in columns. Everything that copies, stores
/// or binds a term does so by these arrays.
///
/// For a term of your own, derive from TermOf; see docs/own-spring.md.
class ASTERISM_API Term {
 public:
  using Points = Eigen::MatrixXd;

  virtual ~Term() = default;
  /// A copy with all elements.
  virtual std::unique_ptr<Term> clone() const = 0;

  /// Such as "links": in messages and files.
  std::string_view kind() const { return kind_; }
  /// The number of coordinates of a point.
  int dim() const { return dim_; }
  /// The number of elements, and of nodes of each.
  int size() const { return static_cast<int>(nodes_.cols()); }
  int arity() const { return static_cast<int>(nodes_.rows()); }
  /// arity x size; an element is a column.
  const Eigen::MatrixXi& nodes() const { return nodes_; }

  /// The numbers of the elements, and the properties of the term as a whole; see values() and choose().
  std::span<const Column> columns() const { return columns_; }
  /// See columns().
  std::span<const Choice> choices() const { return choices_; }
  /// The numbers of a column, to be read, written and resized. Throws std::invalid_argument that names the
  /// nearest column for an unknown one.
  Eigen::MatrixXd& values(std::string_view column);
  const Eigen::MatrixXd& values(std::string_view column) const;
  /// Throws std::invalid_argument, with what is known, for an unknown choice or value.
  void choose(std::string_view choice, std::string_view value);
  std::string_view chosen(std::string_view choice) const;

  /// Chooses a loss with its parameters: one for all elements, or one for each.
  void set_loss(Loss loss, const Eigen::VectorXd& scale = {}, const Eigen::VectorXd& sharpness = {});
  void set_loss(Loss loss, double scale, double sharpness = 4);

  /// Adds elements: their nodes, arity x count, and the numbers of each column that is not the same for all
  /// elements, one for each new element or one for all of them. What a single element has may be left out,
  /// and is then meant for the new ones, too. A term without elements takes any columns, and keeps the
  /// numbers of those that are not given. Throws std::invalid_argument for a column that is missing, unknown
  /// or the same for all elements, std::length_error for wrong sizes; the term is then as it was.
  void append(const Eigen::MatrixXi& nodes, const std::vector<NamedNumbers>& given);
  /// Removes elements, by their numbers; the others keep their order.
  void remove(std::span<const int> elements);
  /// Replaces the nodes; the columns are to be changed to fit. Throws std::invalid_argument for another
  /// number of nodes of an element.
  void set_nodes(Eigen::MatrixXi nodes);

  /// The first problem of the numbers, for a system of so many nodes; empty if there is none.
  virtual std::string defect(int node_count) const;

  /// The energy at x (dim x nodes); adds its gradient to `gradient` unless that is null.
  virtual double energy(const Points& x, Points* gradient) const = 0;
  /// The reference of relative rounding errors, see magnitude().
  struct Magnitude {
    double energy = 0;    ///< of the energy
    double gradient = 0;  ///< of the gradient's norm
  };
  /// The sums of the absolute values that energy() and its gradient are computed from, such as of a link's
  /// tension times its length and its length at rest: certificates take a share of them off, so that rounding
  /// does not make a bound wrong. Without, the energy's own for terms of one's own.
  virtual Magnitude magnitude(const Points& x) const;
  /// Adds the second derivatives at x. Only if there is no problem_with(curvature).
  virtual void add_curvature(const Points& x, Curvature curvature, CurvatureSink& sink) const = 0;
  /// Why the term does not have this curvature; nullptr if it has.
  virtual const char* problem_with(Curvature) const { return nullptr; }
  /// Whether the energy is a quadratic function of the points.
  virtual bool is_quadratic() const { return false; }
  /// Adds what it holds its nodes by, and its lengths.
  virtual void add_scales(const Points& x, Scales& scales) const = 0;
  /// Whether an element holds its nodes in place, rather than to each other, or only pulls at them.
  enum class Role { Holds, Connects, Pulls };
  virtual Role role(int) const { return arity() == 1 ? Role::Holds : Role::Connects; }
  /// Whether an element has any stiffness.
  virtual bool is_stiff(int element) const;

  /// The same term for points of `dim` coordinates, at least as many as here. Its energy is the same where
  /// the further coordinates are 0, so that its least energy is no higher. Only if there is no
  /// why_not_liftable().
  std::unique_ptr<Term> lifted(int dim) const;
  /// Why there is no such term; nullptr if there is one.
  virtual const char* why_not_liftable() const;

  /// Whether it has one more unknown, which is minimised for every x.
  virtual bool has_hidden() const { return false; }

  /// For the derivative of a solution by the numbers: adds the derivatives of w . g, with g the term's
  /// gradient at x, by the numbers of each column, to matrices of the sizes of these columns. Columns that
  /// nothing is differentiated by are left as they are. See why_not_differentiable.
  virtual void add_mixed(const Points& x, const Points& w, std::span<Eigen::MatrixXd> by) const;
  virtual const char* why_not_differentiable() const { return nullptr; }

 protected:
  /// A term without elements, with columns and choices that last as long as it does.
  Term(std::string_view kind, int dim, int arity, std::vector<Column> columns, std::vector<Choice> choices);
  Term(const Term&) = default;             ///< for clone()
  Term& operator=(const Term&) = default;  ///< for terms of the same kind

  /// A column's numbers for an element.
  struct Numbers {
    const double* data;     ///< of the first element; null for a column without numbers
    std::ptrdiff_t stride;  ///< from one element to the next; 0 where all elements have the same numbers
    /// The numbers of an element.
    const double* operator[](int element) const { return data + stride * element; }
    /// Whether there are any.
    explicit operator bool() const { return data != nullptr; }
  };
  /// The numbers of columns()[column].
  Numbers numbers(std::size_t column) const;
  /// The numbers of an array of the shape of Column::values.
  static Numbers numbers(const Eigen::MatrixXd& values);
  /// Of so many nodes, the first ones, the elements are all pairs (0, 1), (0, 2), ..., in this order; else 0.
  int all_pairs_of() const { return all_pairs_of_; }
  /// The value of choices()[index].
  int choice(std::size_t index) const { return choices_[index].value; }

  /// Adds the columns and the choice of a loss, after all others: for constructors.
  void add_loss();
  Loss loss() const { return static_cast<Loss>(choices_.back().value); }
  Numbers scale() const { return numbers(columns_.size() - 2); }
  Numbers sharpness() const { return numbers(columns_.size() - 1); }
  std::string loss_defect() const;

 private:
  std::size_t find(std::string_view column) const;
  Choice& find_choice(std::string_view choice);
  void look_for_all_pairs();

  std::string_view kind_;
  int dim_;
  Eigen::MatrixXi nodes_;
  int all_pairs_of_ = 0;
  std::vector<Column> columns_;
  std::vector<Choice> choices_;
};

/// The base of the term Derived, which copies it.
template <typename Derived, typename Base = Term>
class TermOf : public Base {
 public:
  /// A copy with all elements.
  std::unique_ptr<Term> clone() const override {
    return std::make_unique<Derived>(static_cast<const Derived&>(*this));
  }

 protected:
  /// The constructors of the base.
  using Base::Base;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
