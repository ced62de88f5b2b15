// System and its terms. Everything here goes by a term's columns and choices; only the functions that add
// terms, and functions of a user's own, know kinds.

#include <pybind11/stl.h>

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/solution.hpp>
#include <asterism/solver/terms/solve.hpp>
#include <asterism/solver/terms/system.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "bindings.hpp"
#include "interrupts.hpp"
#include "pickling.hpp"
#include "refusal.hpp"
#include "solving.hpp"
#include "term_system.hpp"

namespace asterism::python {

namespace {

using Eigen::MatrixXd;
using Eigen::MatrixXi;

std::string number_text(double value) { return py::repr(py::float_(value)).cast<std::string>(); }

/// Node numbers, an element in each row, or for arity 1 an element in each entry. Arity -1: any.
MatrixXi nodes_of(const py::object& object, const char* name, int arity, int node_count) {
  const py::array array = py::array::ensure(unmasked(object, name));
  if (!array) throw py::type_error(std::string(name) + ": expected numbers of nodes");
  if (array.size() == 0 && arity > 0) return {arity, 0};
  if (array.dtype().kind() != 'i' && array.dtype().kind() != 'u') {
    throw py::type_error(std::string(name) + ": expected integers, found " +
                         py::str(array.dtype()).cast<std::string>());
  }
  const bool is_list = arity == 1 && array.ndim() == 1;
  const bool is_table = array.ndim() == 2 && array.shape(1) > 0 &&
                        (arity < 0 || array.shape(1) == static_cast<py::ssize_t>(arity));
  if (!is_list && !is_table) {
    const std::string width = arity < 0 ? "nodes of each" : std::to_string(arity);
    throw py::value_error(std::string(name) + ": expected shape " +
                          (arity == 1 ? std::string("(count,)") : "(count, " + width + ")") + ", found " +
                          text_of(shape_of(array)));
  }
  const py::array_t<std::int64_t, py::array::c_style | py::array::forcecast> table(array);
  const auto columns = static_cast<Eigen::Index>(table.shape(0));
  MatrixXi nodes(is_list ? 1 : static_cast<Eigen::Index>(table.shape(1)), columns);
  for (Eigen::Index k = 0; k < nodes.size(); ++k) {
    const std::int64_t node = table.data()[k];
    if (node < 0 || node >= node_count) {
      throw py::value_error(std::string(name) + ": node " + std::to_string(node) + " of element " +
                            std::to_string(k / nodes.rows()) + " is out of range (" +
                            detail::counted(node_count, "node") + ")");
    }
    nodes.data()[k] = static_cast<int>(node);
  }
  return nodes;
}

std::vector<int> list_of(const MatrixXi& row) { return {row.data(), row.data() + row.size()}; }

/// The shape of an element's numbers: none for one number, (dim,) for a point, (dim, dim) for a matrix.
Shape form_of(Eigen::Index rows, int dim) {
  if (rows == 1) return {};
  if (rows == dim * dim) return {dim, dim};
  return {static_cast<py::ssize_t>(rows)};
}

/// Matrices stand by columns in a term, and by rows in NumPy.
void transpose_each(MatrixXd& values, int dim) {
  if (values.rows() != dim * dim || dim == 1) return;
  for (Eigen::Index e = 0; e < values.cols(); ++e) {
    Eigen::Map<MatrixXd> matrix(values.col(e).data(), dim, dim);
    matrix.transposeInPlace();
  }
}

/// The numbers of a column for `size` elements as an array that cannot be written to: with a row for each
/// element, or the numbers that are the same for all. None where there are none.
py::object shown(MatrixXd values, int dim, int size, bool is_optional) {
  if (values.size() == 0 && is_optional) return py::none();
  Shape shape = form_of(values.rows(), dim);
  if (values.cols() == size) shape.insert(shape.begin(), size);
  transpose_each(values, dim);
  py::array array = owned(std::move(values), shape);
  array.attr("setflags")(py::arg("write") = false);
  return array;
}

void require_range(const MatrixXd& values, Column::Range range, const std::string& name) {
  for (Eigen::Index k = 0; k < values.size(); ++k) {
    const double value = values.data()[k];
    if (detail::is_finite(value) &&
        (range == Column::Range::Any || value > 0 || (value == 0 && range == Column::Range::NotNegative)))
      continue;
    const char* expected = range == Column::Range::Any           ? "finite numbers"
                           : range == Column::Range::NotNegative ? "finite numbers >= 0"
                                                                 : "finite numbers > 0";
    throw py::value_error(name + ": expected " + expected + ", found " + number_text(value) +
                          (values.cols() > 1 ? " for element " + std::to_string(k / values.rows()) : ""));
  }
}

/// ValueError for angles at rest over a full turn, which are degrees.
void require_radians(const py::object& angles) {
  const auto array = numbers(angles, "angles");
  for (py::ssize_t k = 0; k < array.size(); ++k) {
    const double angle = array.data()[k];
    if (detail::is_finite(angle) && std::abs(angle) > 2 * std::numbers::pi)
      throw py::value_error("angles: expected radians, from 0 to pi, found " + number_text(angle));
  }
}

/// The numbers that are given for a column of `size` elements. `fill`: one number stands for all coordinates.
MatrixXd column_of(const Column& column, int dim, int size, const py::object& given, const std::string& name,
                   bool fill = false) {
  if (given.is_none()) {
    if (!column.is_optional) throw py::type_error(name + ": expected numbers, found NoneType");
    return MatrixXd(0, 0);
  }
  const auto array = numbers(given, name.c_str());
  const Shape found = shape_of(array);
  const auto taken = [&](Eigen::Index rows, Eigen::Index columns) {
    MatrixXd values = Eigen::Map<const MatrixXd>(array.data(), rows, columns);
    transpose_each(values, dim);
    require_range(values, column.range, name);
    return values;
  };
  if (array.size() == 0 && size == 0) return MatrixXd(column.rows, 0);
  std::string expected;
  for (const int rows : {column.rows, column.other_rows}) {
    if (rows == 0) continue;
    const Shape form = form_of(rows, dim);
    Shape each = form;
    each.insert(each.begin(), size);
    if (found == each) return taken(rows, size);
    if (found == form) return taken(rows, 1);
    // On a line, points and matrices are numbers, which may be written as such.
    if (dim == 1 && rows == 1 && (found == Shape{size, 1} || found == Shape{size, 1, 1}))
      return taken(1, size);
    if (found.empty() && fill) {
      require_range(MatrixXd::Constant(1, 1, *array.data()), column.range, name);
      return MatrixXd::Constant(rows, 1, *array.data());
    }
    for (const Shape& shape : {form, each}) expected += (expected.empty() ? "" : " or ") + text_of(shape);
  }
  throw py::value_error(name + ": expected shape " + expected + ", found " + text_of(found));
}

/// Python's function, which copies of a term share: its count of references needs the GIL.
using SharedFunction = std::shared_ptr<const py::object>;

SharedFunction shared(const py::object& function) {
  return {new py::object(function), [](const py::object* held) {
            const py::gil_scoped_acquire acquire;
            delete held;
          }};
}

/// The values that a function of a user returned, as that many arrays.
py::tuple results(const py::object& result, const char* name, std::size_t least, std::size_t most,
                  const char* expected) {
  if (py::isinstance<py::tuple>(result) || py::isinstance<py::list>(result)) {
    py::tuple parts(result);
    if (parts.size() >= least && parts.size() <= most) return parts;
  }
  throw py::type_error(std::string(name) + ": expected that it returns (" + expected + "), found " +
                       type_name(result));
}

LinkFunction link_function(const py::object& function) {
  return [held = shared(function)](std::size_t count, const double* length, const double* rest, double* value,
                                   double* first, double* second) {
    const py::gil_scoped_acquire acquire;
    const auto size = static_cast<py::ssize_t>(count);
    const py::tuple parts =
        results((*held)(py::array_t<double>(size, length), py::array_t<double>(size, rest)), "law", 3, 3,
                "value, first, second");
    static constexpr const char* kNames[] = {"law: value", "law: first", "law: second"};
    double* const to[] = {value, first, second};
    for (std::size_t k = 0; k < 3; ++k) {
      const auto array = numbers(parts[k], kNames[k], {size});
      std::copy_n(array.data(), count, to[k]);
    }
  };
}

ElementFunction element_function(const py::object& function, int dim, int arity, bool has_hessian) {
  return [held = shared(function), dim, arity, has_hessian](const MatrixXd& points, const MatrixXd&,
                                                            bool second, ElementValues& values) {
    const py::gil_scoped_acquire acquire;
    const py::ssize_t count = points.cols(), rows = points.rows();
    const Shape shape{count, arity, dim};
    const py::tuple parts =
        results((*held)(py::array_t<double>(shape, points.data())), "function", has_hessian ? 3 : 2, 3,
                has_hessian ? "energy, gradient, hessian" : "energy, gradient");
    const auto energy = numbers(parts[0], "function: energy", {count});
    const auto gradient = numbers(parts[1], "function: gradient", shape);
    values.energy = Eigen::Map<const Eigen::VectorXd>(energy.data(), count);
    values.gradient = Eigen::Map<const MatrixXd>(gradient.data(), rows, count);
    if (!second) return;
    const auto hessian = numbers(parts[2], "function: hessian", {count, rows, rows});
    values.second = Eigen::Map<const MatrixXd>(hessian.data(), rows * rows, count);
  };
}

/// What Python knows of a term beside its arrays.
struct OwnFunction {
  py::object function;  // None for a term that has none
  bool flag = false;    // of elements: has_hessian; of links: convex_in_square
};

/// A term without elements; for elements, of `arity` nodes.
std::unique_ptr<Term> made(const std::string& kind, int dim, int arity, const OwnFunction& own) {
  if (kind != "elements") return make_term(kind, dim);
  return std::make_unique<Elements>(dim, arity, 0, element_function(own.function, dim, arity, own.flag),
                                    own.flag);
}

void set_law(Term& term, const OwnFunction& own) {
  auto* const links = dynamic_cast<LengthTerm*>(&term);
  if (links == nullptr) throw py::value_error(std::string(term.kind()) + " have no law");
  links->set_function(link_function(own.function), own.flag);
}

bool has_choice(const Term& term, std::string_view name) {
  return std::any_of(term.choices().begin(), term.choices().end(),
                     [name](const Choice& choice) { return choice.name == name; });
}

const Column* find_column(const Term& term, std::string_view name) {
  const auto columns = term.columns();
  const auto at =
      std::find_if(columns.begin(), columns.end(), [name](const Column& c) { return c.name == name; });
  return at == columns.end() ? nullptr : &*at;
}

py::str text_of(std::string_view text) { return {text.data(), text.size()}; }

/// Of columns or choices.
template <typename Named>
py::tuple names_of(std::span<const Named> all) {
  py::list names;
  for (const Named& each : all) names.append(text_of(each.name));
  return py::tuple(names);
}

}  // namespace

/// asterism.System. Use it with the GIL held.
class TermSystem : public std::enable_shared_from_this<TermSystem> {
 public:
  using BoundToPython = void;

  /// `system` has no functions of a user's own.
  explicit TermSystem(asterism::System system) : system_(std::move(system)) {
    for (int t = 0; t < system_.term_count(); ++t) slots_.push_back({&system_.term(t), {py::none()}, {}});
  }

  const asterism::System& system() const { return system_; }

  /// For what changes the system: RuntimeError while another thread, or the solve that a function belongs to,
  /// reads it.
  asterism::System& change() {
    if (readers_ > 0) {
      throw std::runtime_error(
          "this asterism.System is in use: it cannot be changed while it is solved or evaluated");
    }
    return system_;
  }

  /// f(system), which must not keep the GIL; the system cannot be changed meanwhile.
  template <typename F>
  auto read(F&& f) {
    struct Reading {
      int& readers;
      explicit Reading(int& count) : readers(count) { ++readers; }
      ~Reading() { --readers; }
    } const reading(readers_);
    return f(system_);
  }

  class Handle;

  /// Adds a term whose values may still be invalid.
  std::shared_ptr<Handle> add(std::unique_ptr<Term> term, OwnFunction own) {
    Term& added = change().add(std::move(term));
    slots_.push_back({&added, std::move(own), {}});
    return handle(slots_.size() - 1);
  }
  void remove(const Handle& handle);
  /// The object that stands for a term, the same one as long as it lives.
  std::shared_ptr<Handle> handle(std::size_t t);

  std::size_t term_count() const { return slots_.size(); }
  OwnFunction& own(const Term& term) { return slots_[place_of(term)].own; }
  bool has_functions() const {
    return std::any_of(slots_.begin(), slots_.end(),
                       [](const Slot& slot) { return !slot.own.function.is_none(); });
  }

 private:
  struct Slot {
    Term* term;
    OwnFunction own;
    std::weak_ptr<Handle> handle;
  };
  std::size_t place_of(const Term& term) const {
    const auto at =
        std::find_if(slots_.begin(), slots_.end(), [&](const Slot& slot) { return slot.term == &term; });
    return static_cast<std::size_t>(at - slots_.begin());
  }

  asterism::System system_;
  std::vector<Slot> slots_;  // of the terms, in their order
  int readers_ = 0;
};

/// asterism.Term: a term of a system, which it keeps alive.
class TermSystem::Handle {
 public:
  using BoundToPython = void;

  Handle(std::shared_ptr<TermSystem> owner, Term& term) : owner_(std::move(owner)), term_(&term) {}

  TermSystem& owner() const { return *owner_; }
  const Term& term() const {
    if (term_ == nullptr) throw std::runtime_error("this asterism.Term was removed from its system");
    return *term_;
  }
  Term& change() {
    term();
    owner_->change();
    return *term_;
  }
  bool is_of(const TermSystem& system) const { return owner_.get() == &system && term_ != nullptr; }
  void forget() { term_ = nullptr; }

 private:
  std::shared_ptr<TermSystem> owner_;
  Term* term_;
};

void TermSystem::remove(const Handle& handle) {
  if (!handle.is_of(*this)) throw py::value_error("term: it is not one of this system");
  const Term& term = handle.term();
  const std::size_t t = place_of(term);
  change().remove(term);
  if (const auto held = slots_[t].handle.lock()) held->forget();
  slots_.erase(slots_.begin() + static_cast<std::ptrdiff_t>(t));
}

std::shared_ptr<TermSystem::Handle> TermSystem::handle(std::size_t t) {
  Slot& slot = slots_[t];
  if (auto held = slot.handle.lock()) return held;
  auto made = std::make_shared<Handle>(shared_from_this(), *slot.term);
  slot.handle = made;
  return made;
}

using TermHandle = TermSystem::Handle;

namespace {

/// asterism.Solution, with what its arrays look like.
class BoundSolution {
 public:
  using BoundToPython = void;

  BoundSolution(asterism::System system, const MatrixXd& x)
      : solution(system, x), system_(std::move(system)) {}

  asterism::Solution solution;
  const asterism::System& system() const { return system_; }

 private:
  asterism::System system_;
};

/// A function in a pickle: copies of a system share it, and pickle takes it by its name.
struct PickledFunction {
  using BoundToPython = void;
  py::object function;
};

MatrixXd points_of(const asterism::System& system, const py::object& x, const char* name = "x") {
  const auto array = numbers(x, name, {system.nodes(), system.dim()});
  return Eigen::Map<const MatrixXd>(array.data(), system.dim(), system.nodes());
}

/// Points of a system whose values a solver would take; ValueError.
MatrixXd valid_points(const asterism::System& system, const py::object& x) {
  MatrixXd points = points_of(system, x);
  if (const std::string problem = validate(system, points, false); !problem.empty())
    throw py::value_error(problem);
  return points;
}

/// f(system, x) without the GIL.
template <typename F>
auto evaluated(TermSystem& self, const py::object& x, F&& f) {
  const MatrixXd points = valid_points(self.system(), x);
  return self.read([&](const asterism::System& system) {
    const py::gil_scoped_release release;
    return f(system, points);
  });
}

int element_count(const asterism::System& system) {
  int count = 0;
  for (int t = 0; t < system.term_count(); ++t) count += system.term(t).size();
  return count;
}

/// Whether a factorisation may take tenths of a second or more, in a thread that may go on by itself.
bool is_large(const TermSystem& self) {
  return !self.has_functions() && self.system().nodes() + element_count(self.system()) > 1000;
}

int checked_node(const asterism::System& system, int node) {
  if (node >= 0 && node < system.nodes()) return node;
  throw py::index_error("node " + std::to_string(node) + " is out of range (" +
                        detail::counted(system.nodes(), "node") + ")");
}

/// An argument for a column: that column, the argument's name, and its value.
struct Given {
  const char* column;
  const char* name;
  py::object value;
  bool fill = false;
};

/// The loss and its parameters, and for links the law, as keyword arguments.
struct Chosen {
  std::string loss = "quadratic";
  py::object scale = py::none(), sharpness = py::none(), law = py::none();
  bool convex_in_square = false;
};

std::shared_ptr<TermHandle> add_term(TermSystem& self, const std::string& kind, MatrixXi nodes,
                                     const std::vector<Given>& given, const Chosen& chosen = {},
                                     OwnFunction own = {py::none()}) {
  const asterism::System& system = self.change();
  const int dim = system.dim();
  std::unique_ptr<Term> term = made(kind, dim, static_cast<int>(nodes.rows()), own);
  const auto size = static_cast<int>(nodes.cols());
  term->set_nodes(std::move(nodes));
  for (const Given& each : given)
    term->values(each.column) =
        column_of(*find_column(*term, each.column), dim, size, each.value, each.name, each.fill);
  if (has_choice(*term, "loss")) {
    term->choose("loss", chosen.loss);
    term->values("scale") = column_of(*find_column(*term, "scale"), dim, size, chosen.scale, "scale");
    const py::object sharpness =
        chosen.loss == "truncated" && chosen.sharpness.is_none() ? py::float_(4.0) : chosen.sharpness;
    term->values("sharpness") =
        column_of(*find_column(*term, "sharpness"), dim, size, sharpness, "sharpness");
  }
  if (PyCallable_Check(chosen.law.ptr()) != 0) {
    own = {chosen.law, chosen.convex_in_square};
    set_law(*term, own);
  } else if (!chosen.law.is_none()) {
    if (!py::isinstance<py::str>(chosen.law))
      throw py::type_error("law: expected a name or a function, found " + type_name(chosen.law));
    term->choose("law", chosen.law.cast<std::string>());
  }
  if (const std::string problem = term->defect(system.nodes()); !problem.empty())
    throw py::value_error(problem);
  return self.add(std::move(term), std::move(own));
}

/// The nodes of elements of one each: all of the system, if none are given.
MatrixXi nodes_or_all(const TermSystem& self, const py::object& nodes) {
  const int count = self.system().nodes();
  if (nodes.is_none()) return Eigen::RowVectorXi::LinSpaced(count, 0, count - 1);
  return nodes_of(nodes, "nodes", 1, count);
}

py::object value_of(const TermHandle& self, const std::string& name) {
  const Term& term = self.term();
  if (has_choice(term, name)) {
    const OwnFunction& own = self.owner().own(term);
    if (name == "law" && term.chosen(name) == "own" && !own.function.is_none()) return own.function;
    return text_of(term.chosen(name));
  }
  if (const Column* column = find_column(term, name))
    return shown(column->values, term.dim(), term.size(), column->is_optional);
  throw py::attribute_error(std::string(term.kind()) + " have no '" + name + "'");
}

void set_value(TermHandle& self, const std::string& name, const py::object& value) {
  const Term& known = self.term();
  const Column* const column = find_column(known, name);
  if (column == nullptr && !has_choice(known, name))
    throw py::attribute_error(std::string(known.kind()) + " have no '" + name + "' that can be assigned to");
  Term& term = self.change();
  OwnFunction& own = self.owner().own(term);
  if (column != nullptr) {
    term.values(name) = column_of(*column, term.dim(), term.size(), value, name);
  } else if (name == "law" && PyCallable_Check(value.ptr()) != 0) {
    own = {value, false};
    set_law(term, own);
  } else if (py::isinstance<py::str>(value)) {
    const auto chosen = value.cast<std::string>();
    if (name == "law" && chosen == "own") throw py::value_error("law: expected your function itself");
    term.choose(name, chosen);
    if (name == "law") own = {py::none()};
  } else {
    throw py::type_error(name + ": expected a name, found " + type_name(value));
  }
}

void append(TermHandle& self, const py::object& nodes, const py::kwargs& given) {
  Term& term = self.change();
  const int node_count = self.owner().system().nodes();
  const MatrixXi added = nodes_of(nodes, "nodes", term.arity(), node_count);
  std::vector<NamedNumbers> numbers;
  for (const auto& [key, value] : given) {
    const auto name = key.cast<std::string>();
    const Column* const column = find_column(term, name);
    if (column == nullptr)
      throw py::type_error("append: " + std::string(term.kind()) + " have no '" + name + "'");
    numbers.push_back({column->name, column_of(*column, term.dim(), static_cast<int>(added.cols()),
                                               py::reinterpret_borrow<py::object>(value), name)});
  }
  const std::unique_ptr<Term> changed = term.clone();
  try {
    changed->append(added, numbers);
  } catch (const std::invalid_argument& error) {
    throw py::type_error(error.what());
  }
  if (const std::string problem = changed->defect(node_count); !problem.empty())
    throw py::value_error(problem);
  term.append(added, numbers);
}

std::string contents(const Term& term) {
  std::string kind(term.kind());
  if (term.size() == 1 && kind.ends_with('s')) kind.pop_back();
  std::string text = std::to_string(term.size()) + " " + kind;
  for (const Choice& choice : term.choices()) {
    if (choice.value != 0)
      text += ", " + std::string(choice.name) + " " + std::string(term.chosen(choice.name));
  }
  return text;
}

py::tuple state_of(TermSystem& self) {
  const asterism::System& system = self.system();
  py::array_t<bool> fixed(system.nodes());
  for (int i = 0; i < system.nodes(); ++i) fixed.mutable_at(i) = system.is_fixed(i);
  py::list terms;
  for (int t = 0; t < system.term_count(); ++t) {
    const Term& term = system.term(t);
    py::dict columns, choices;
    for (const Column& column : term.columns())
      columns[text_of(column.name)] =
          owned(MatrixXd(column.values), {column.values.cols(), column.values.rows()});
    for (const Choice& choice : term.choices())
      choices[text_of(choice.name)] = text_of(term.chosen(choice.name));
    const OwnFunction& own = self.own(term);
    const py::object function =
        own.function.is_none() ? py::object(py::none()) : py::cast(PickledFunction{own.function});
    terms.append(py::make_tuple(text_of(term.kind()),
                                py::array_t<int>(Shape{term.size(), term.arity()}, term.nodes().data()),
                                columns, choices, function, own.flag));
  }
  return py::make_tuple(system.dim(), fixed, terms);
}

void add_from(TermSystem& self, const py::tuple& state) {
  const Fields fields(state, 6);
  const asterism::System& system = self.system();
  const auto kind = fields[0].cast<std::string>();
  OwnFunction own{py::none(), fields[5].cast<bool>()};
  if (!fields[4].is_none()) own.function = fields[4].cast<PickledFunction&>().function;
  const auto table = py::array::ensure(fields[1]);
  if (!table || table.ndim() != 2 || table.shape(1) < 1 || table.shape(1) > 1000)
    throw py::value_error("nodes: not those of a term");
  const auto arity = static_cast<int>(table.shape(1));
  if (kind == "elements" && own.function.is_none())
    throw py::value_error("elements: the function is missing");
  std::unique_ptr<Term> term = made(kind, system.dim(), arity, own);
  if (arity != term->arity()) throw py::value_error(kind + ": another number of nodes");
  term->set_nodes(nodes_of(table, "nodes", arity, system.nodes()));
  const py::dict columns = fields[2], choices = fields[3];
  for (const Column& column : term->columns()) {
    const std::string name(column.name);
    const auto values = numbers(columns[name.c_str()], name.c_str());
    if (values.ndim() != 2) throw py::value_error(name + ": not a column");
    const py::ssize_t count = values.shape(0), rows = values.shape(1);
    const bool is_empty = values.size() == 0 && (column.is_optional || term->size() == 0);
    const bool fits = (rows == column.rows || (rows == column.other_rows && rows > 0)) &&
                      (count == term->size() || count == 1);
    if (!is_empty && !fits) throw py::value_error(name + ": not a column of " + kind);
    term->values(name) = Eigen::Map<const MatrixXd>(values.data(), rows, count);
  }
  const bool has_law = !own.function.is_none() && kind != "elements";
  if (has_law) set_law(*term, own);
  for (const Choice& choice : term->choices()) {
    const std::string name(choice.name);
    term->choose(name, choices[name.c_str()].cast<std::string>());
  }
  self.add(std::move(term), std::move(own));
}

/// Adds the keyword arguments of a loss to a function that adds a term.
template <typename F, typename... Extra>
void def_add(py::class_<TermSystem, std::shared_ptr<TermSystem>>& type, const char* name, F f,
             const char* doc, const Extra&... arguments) {
  type.def(name, std::move(f), arguments..., py::arg("loss") = "quadratic", py::arg("scale") = py::none(),
           py::arg("sharpness") = py::none(), doc);
}

constexpr const char* kSolve =
    "Moves x (N, dim), the start, to a minimum of the energy and writes it back into x, a float64,\n"
    "C-contiguous, writeable array (otherwise TypeError or ValueError). The Summary says how the solve\n"
    "ended. If `usable` is false, x is unchanged. The GIL is released during the solve; KeyboardInterrupt,\n"
    "and an exception of a function of yours, end it and leave x unchanged.\n\n"
    "ValueError for input that the method refuses: a value that is not finite or out of range; MemoryError\n"
    "if memory runs out. With check=False, the Summary says so instead, and nothing is raised.\n\n"
    "method: one of System.methods(), otherwise ValueError. options: its options by name, otherwise\n"
    "TypeError. on_iteration(iteration, x, energy, gradient_norm) is that of asterism.solve().";

void bind_term(py::module_& m) {
  py::class_<TermHandle, std::shared_ptr<TermHandle>> type(
      m, "Term",
      "A term of a System: an array of elements of one kind. Its columns and choices are attributes, such\n"
      "as `term.stiffness` and `term.loss`; `columns` and `choices` list them. A column is an array with\n"
      "a row for each element, or one number, point or matrix for all of them, or None. It is a copy that\n"
      "cannot be written to: assign a new one. RuntimeError while the system is solved, and once the term\n"
      "was removed.");
  def_reduce(type);
  type.def_property_readonly(
          "kind", [](const TermHandle& self) { return text_of(self.term().kind()); }, "Such as 'links'.")
      .def_property_readonly(
          "nodes",
          [](const TermHandle& self) {
            const Term& term = self.term();
            py::array_t<int> nodes(Shape{term.size(), term.arity()}, term.nodes().data());
            nodes.attr("setflags")(py::arg("write") = false);
            return nodes;
          },
          "The nodes of each element, (m, K), a copy.")
      .def_property_readonly(
          "columns", [](const TermHandle& self) { return names_of(self.term().columns()); },
          "The names of its columns.")
      .def_property_readonly(
          "choices", [](const TermHandle& self) { return names_of(self.term().choices()); },
          "The names of its choices: law and loss, as far as it has them.")
      .def("__getattr__", &value_of, py::arg("name"))
      .def("__setattr__", &set_value, py::arg("name"), py::arg("value"))
      .def("__dir__",
           [](const py::object& self) {
             py::list names = py::module_::import("builtins").attr("dir")(py::type::of(self));
             for (const char* own : {"columns", "choices"}) names.attr("extend")(self.attr(own));
             return names;
           })
      .def("append", &append, py::arg("nodes"),
           "Adds elements: nodes (m, K), or (m,) where an element has one, and by name each column that is\n"
           "not the same for all elements. Errors as where the term was added.")
      .def(
          "remove",
          [](TermHandle& self, const py::object& elements) {
            Term& term = self.change();
            // Their numbers are checked as those of nodes are.
            const py::array array = py::array::ensure(unmasked(elements, "elements"));
            if (!array) throw py::type_error("elements: expected integers");
            if (array.size() == 0) return;
            if (array.ndim() != 1 || (array.dtype().kind() != 'i' && array.dtype().kind() != 'u'))
              throw py::type_error("elements: expected a list of integers");
            const auto list = array.cast<std::vector<std::int64_t>>();
            std::vector<int> gone;
            for (const std::int64_t element : list) {
              if (element < 0 || element >= term.size())
                throw py::index_error("element " + std::to_string(element) + " is out of range (" +
                                      detail::counted(term.size(), "element") + ")");
              gone.push_back(static_cast<int>(element));
            }
            term.remove(gone);
          },
          py::arg("elements"),
          "Removes elements by their numbers; the others keep their order. IndexError if one is out of "
          "range.")
      .def(
          "estimate",
          [](const TermHandle& self, const py::object& x) {
            const auto* const common = dynamic_cast<const CommonLength*>(&self.term());
            if (common == nullptr)
              throw py::type_error(std::string(self.term().kind()) + " estimate no length");
            return common->estimate(valid_points(self.owner().system(), x));
          },
          py::arg("x"),
          "The length that a term of kind common_length estimates at x (N, dim); TypeError for any other "
          "kind.")
      .def("__len__", [](const TermHandle& self) { return self.term().size(); })
      .def("__repr__",
           [](const TermHandle& self) { return "<asterism.Term: " + contents(self.term()) + ">"; });
}

void bind_solution(py::module_& m) {
  py::class_<BoundSolution> type(m, "Solution",
                                 "Answers questions about a minimum x of a System, whose Hessian is factored "
                                 "once; System.solution() makes\n"
                                 "it. The system and x may change afterwards.");
  def_reduce(type);
  type.def(
          "covariance",
          [](const BoundSolution& self, int node) {
            const int dim = self.system().dim();
            return owned(self.solution.covariance(checked_node(self.system(), node)), {dim, dim});
          },
          py::arg("node").noconvert(),
          "The covariance (dim, dim) of a node by Laplace's approximation; 0 for a fixed one. IndexError\n"
          "if it is out of range.")
      .def_property_readonly(
          "covariances",
          [](const BoundSolution& self) {
            const int dim = self.system().dim();
            return owned(self.solution.covariances(), {self.system().nodes(), dim, dim});
          },
          "Those of all nodes, (N, dim, dim), by selected inversion.")
      .def_property_readonly(
          "joint_covariance",
          [](const BoundSolution& self) {
            const int size = self.system().dim() * self.system().nodes();
            return owned(self.solution.joint_covariance(), {size, size});
          },
          "The whole matrix, (dim N, dim N); coordinate d of node i is row dim i + d.")
      .def_property_readonly(
          "log_determinant", [](const BoundSolution& self) { return self.solution.log_determinant(); },
          "log det of the Hessian over the points and estimated lengths.")
      .def(
          "gradients",
          [](const BoundSolution& self, const py::object& by_x) {
            const asterism::System& system = self.system();
            auto all = self.solution.gradients(points_of(system, by_x, "by_x"));
            py::list result;
            for (int t = 0; t < system.term_count(); ++t) {
              const Term& term = system.term(t);
              py::dict of_term;
              for (std::size_t c = 0; c < term.columns().size(); ++c) {
                const Column& column = term.columns()[c];
                of_term[text_of(column.name)] =
                    shown(std::move(all[static_cast<std::size_t>(t)][c]), term.dim(), term.size(), true);
              }
              result.append(of_term);
            }
            return result;
          },
          py::arg("by_x"),
          "The derivatives of a function of the solution by all numbers of the system, from by_x (N, dim),\n"
          "those by the points: for each term a dict with an array of the shape of each column, None for\n"
          "none. ValueError for a term that is not differentiable.")
      .def("__repr__", [](const BoundSolution& self) {
        return "<asterism.Solution: " + detail::counted(self.system().nodes(), "node") + ", dim " +
               std::to_string(self.system().dim()) + ">";
      });
}

std::unique_ptr<BoundSolution> solution_of(TermSystem& self, const py::object& x) {
  MatrixXd points = valid_points(self.system(), x);
  for (int t = 0; t < self.system().term_count(); ++t) {
    const Term& term = self.system().term(t);
    if (const char* problem = term.problem_with(Curvature::True); problem != nullptr && term.size() > 0)
      throw py::value_error(std::string(term.kind()) + ": " + problem);
  }
  auto solution = self.read([&](const asterism::System& system) {
    return interruptible_copy(is_large(self), [system, points = std::move(points)] {
      return std::make_unique<BoundSolution>(system, points);
    });
  });
  if (solution->solution) return solution;
  const py::object type = py::module_::import("numpy.linalg").attr("LinAlgError");
  PyErr_SetString(type.ptr(), std::string(solution->solution.problem()).c_str());
  throw py::error_already_set();
}

}  // namespace

py::object to_python(asterism::System system) {
  return py::cast(std::make_shared<TermSystem>(std::move(system)));
}

const asterism::System* system_in(const py::handle& object) {
  if (!py::isinstance<TermSystem>(object)) return nullptr;
  return &object.cast<const TermSystem&>().system();
}

void bind_system(py::module_& m) {
  py::class_<PickledFunction> pickled(m, "_Function");
  pickled.attr("__module__") = "asterism._asterism";
  pickled
      .def(py::init([](py::object given) { return PickledFunction{std::move(given)}; }), py::arg("function"))
      .def("__deepcopy__", [](const PickledFunction& self, const py::object&) { return self; })
      .def("__reduce_ex__", [](const py::object& self, int protocol) {
        const py::object given = self.cast<PickledFunction&>().function;
        try {
          py::module_::import("pickle").attr("dumps")(given, protocol);
        } catch (const py::error_already_set& error) {
          throw py::type_error("asterism.System: its function " + py::repr(given).cast<std::string>() +
                               " cannot be pickled, only one that a module defines at its top level (" +
                               py::str(error.value()).cast<std::string>() + ")");
        }
        return py::make_tuple(py::type::of(self), py::make_tuple(given));
      });

  bind_term(m);
  bind_solution(m);
  m.def(
      "add_link_law",
      [](const std::string& name, const py::object& function, bool convex_in_square) {
        if (!PyCallable_Check(function.ptr())) throw py::type_error("function must be callable");
        add_link_law(name, link_function(function), convex_in_square);
      },
      py::arg("name"), py::arg("function"), py::arg("convex_in_square") = false,
      "Gives a function a name, by which links take it as their law from then on, also from files:\n"
      "function(lengths, rest_lengths) returns arrays of values >= 0 and of first and second derivatives by\n"
      "the length, for unit stiffness. convex_in_square: whether the value is convex as a function of the\n"
      "length's square, which certificates need. ValueError for a name that is taken.");

  py::class_<TermSystem, std::shared_ptr<TermSystem>> type(
      m, "System",
      "Points, N of them, and the terms of their energy, of any kinds: the general form of SpringSystem.\n\n"
      "An element of a term is given by its nodes and its numbers; a number, point or matrix that is\n"
      "given once holds for all elements. Every function that adds a term returns it. The energy of an\n"
      "element is 1/2 stiffness rho(s^2) with its residual s and the loss rho: 'quadratic', 'huber',\n"
      "'geman-mcclure' or 'truncated', with `scale` and, for 'truncated', `sharpness` (4 if it is not\n"
      "given).\n\n"
      "Bad values are a ValueError that names the argument. A system cannot be changed while it is solved\n"
      "or evaluated, also not by a function of yours or on_iteration: RuntimeError.");
  type.def(
      py::init([](int nodes, int dim) { return std::make_shared<TermSystem>(asterism::System(nodes, dim)); }),
      py::arg("nodes").noconvert(), py::arg("dim").noconvert() = 2, "dim: coordinates of a point, 1 to 64.");
  type.def(py::pickle([](TermSystem& self) { return state_of(self); },
                      [](const py::tuple& state) {
                        const Fields fields(state, 3);
                        const auto fixed = py::array::ensure(fields[1]);
                        if (!fixed || fixed.ndim() != 1 || fixed.dtype().kind() != 'b' ||
                            fixed.size() > std::numeric_limits<int>::max())
                          throw py::value_error("a pickle without the fixed nodes");
                        auto made = std::make_shared<TermSystem>(
                            asterism::System(static_cast<int>(fixed.size()), fields[0].cast<int>()));
                        const py::array_t<bool> is_fixed(fixed);
                        for (int i = 0; i < made->system().nodes(); ++i) {
                          if (is_fixed.at(i)) made->change().fix(i);
                        }
                        for (const py::handle term : py::list(fields[2]))
                          add_from(*made, py::cast<py::tuple>(term));
                        return made;
                      }));
  def_copy(type);
  type.def_static(
          "methods", [] { return system_solvers().names(); }, "The methods of solve.")
      .def_property_readonly(
          "nodes", [](const TermSystem& self) { return self.system().nodes(); }, "Number of nodes N.")
      .def_property_readonly(
          "dim", [](const TermSystem& self) { return self.system().dim(); }, "Coordinates of a point.")
      .def_property_readonly(
          "terms",
          [](TermSystem& self) {
            py::list terms;
            for (std::size_t t = 0; t < self.term_count(); ++t) terms.append(py::cast(self.handle(t)));
            return py::tuple(terms);
          },
          "Its terms, in the order in which they were added.")
      .def(
          "fix", [](TermSystem& self, int node) { self.change().fix(checked_node(self.system(), node)); },
          py::arg("node").noconvert(),
          "Holds a node where the start of a solve has it. IndexError if it is out of range.")
      .def(
          "unfix", [](TermSystem& self, int node) { self.change().unfix(checked_node(self.system(), node)); },
          py::arg("node").noconvert(), "Lets a node move again.")
      .def(
          "is_fixed",
          [](const TermSystem& self, int node) {
            return self.system().is_fixed(checked_node(self.system(), node));
          },
          py::arg("node").noconvert(), "Whether a node is held.")
      .def(
          "add_nodes",
          [](TermSystem& self, int count) {
            if (count < 0 || count > std::numeric_limits<int>::max() - self.system().nodes())
              throw py::value_error("count: " + detail::counted(count, "node") + " cannot be added");
            self.change().add_nodes(count);
          },
          py::arg("count").noconvert(), "Adds nodes at the end.")
      .def(
          "remove_nodes",
          [](TermSystem& self, const py::object& nodes) {
            asterism::System& system = self.change();
            system.remove_nodes(list_of(nodes_of(nodes, "nodes", 1, system.nodes())));
          },
          py::arg("nodes"),
          "Removes nodes, and the elements that have one of them; the others are numbered again, in their "
          "order.")
      .def(
          "remove", [](TermSystem& self, const TermHandle& term) { self.remove(term); }, py::arg("term"),
          "Removes one of its terms.");

  def_add(
      type, "add_anchors",
      [](TermSystem& self, const py::object& positions, const py::object& stiffness, const py::object& nodes,
         const py::object& information, const std::string& loss, const py::object& scale,
         const py::object& sharpness) {
        return add_term(self, "anchors", nodes_or_all(self, nodes),
                        {{"position", "positions", positions},
                         {"stiffness", "stiffness", stiffness},
                         {"information", "information", information}},
                        {loss, scale, sharpness});
      },
      "Points that are pulled to positions (m, dim): s^2 = d^T S d with d = x_i - position and S the\n"
      "information (m, dim, dim), also of lower rank, or the identity. nodes (m,): all, if it is not given.",
      py::arg("positions"), py::arg("stiffness") = 1, py::kw_only(), py::arg("nodes") = py::none(),
      py::arg("information") = py::none());
  def_add(
      type, "add_offsets",
      [](TermSystem& self, const py::object& pairs, const py::object& offsets, const py::object& stiffness,
         const py::object& information, const std::string& loss, const py::object& scale,
         const py::object& sharpness) {
        return add_term(self, "offsets", nodes_of(pairs, "pairs", 2, self.system().nodes()),
                        {{"offset", "offsets", offsets},
                         {"stiffness", "stiffness", stiffness},
                         {"information", "information", information}},
                        {loss, scale, sharpness});
      },
      "Pairs (m, 2) with a displacement at rest, offsets (m, dim): s^2 = d^T S d with d = x_i - x_j - "
      "offset.",
      py::arg("pairs"), py::arg("offsets"), py::arg("stiffness") = 1, py::kw_only(),
      py::arg("information") = py::none());
  def_add(
      type, "add_differences",
      [](TermSystem& self, const py::object& triples, const py::object& stiffness, const py::object& target,
         const py::object& coefficients, const py::object& information, const std::string& loss,
         const py::object& scale, const py::object& sharpness) {
        const py::object list = py::module_::import("builtins").attr("list");
        const py::list of(py::module_::import("asterism.inputs")
                              .attr("items")(coefficients, "coefficients", "three numbers or matrices"));
        if (of.size() != 3) throw py::value_error("coefficients: expected three numbers or matrices");
        return add_term(self, "differences", nodes_of(triples, "triples", 3, self.system().nodes()),
                        {{"target", "target", target, true},
                         {"stiffness", "stiffness", stiffness},
                         {"information", "information", information},
                         {"a", "coefficients[0]", of[0]},
                         {"b", "coefficients[1]", of[1]},
                         {"c", "coefficients[2]", of[2]}},
                        {loss, scale, sharpness});
      },
      "Triples (m, 3) with a linear relation: s^2 = d^T S d with d = A x_i + B x_j + C x_k - target (m,\n"
      "dim). coefficients: A, B and C, each a number or a matrix (dim, dim), for all elements or (m,) and\n"
      "(m, dim, dim); those of second differences, if they are not given.",
      py::arg("triples"), py::arg("stiffness") = 1, py::kw_only(), py::arg("target") = 0,
      py::arg_v("coefficients", py::make_tuple(1, -2, 1), "..."), py::arg("information") = py::none());
  const auto lengths_of = [](const char* kind, const char* name, int arity) {
    return
        [kind, name, arity](TermSystem& self, const py::object& nodes, const py::object& lengths,
                            const py::object& stiffness, const py::object& law, const py::object& upper,
                            const py::object& offsets, const py::object& information, bool convex_in_square,
                            const std::string& loss, const py::object& scale, const py::object& sharpness) {
          return add_term(self, kind, nodes_of(nodes, name, arity, self.system().nodes()),
                          {{"length", "lengths", lengths},
                           {"upper", "upper", upper},
                           {"stiffness", "stiffness", stiffness},
                           {"offset", "offsets", offsets},
                           {"information", "information", information}},
                          {loss, scale, sharpness, law, convex_in_square});
        };
  };
  def_add(
      type, "add_links", lengths_of("links", "pairs", 2),
      "Pairs (m, 2) with lengths (m,) at rest. With r = |x_i - x_j - offset| (of v^T S v, with information\n"
      "S) and mu the length, law says what s is: 'hooke' r - mu; 'rope' and 'repulsion' the same where it\n"
      "is positive, or negative, else 0; 'interval' 0 from mu to `upper`, else the distance to the nearer\n"
      "of both; 'logarithm' log(r / mu). Or a function of yours, law(r, mu) -> (value, first, second): the\n"
      "energies (m,), >= 0, for unit stiffness and their derivatives by r, for arrays of r and mu (m,);\n"
      "convex_in_square: whether it is convex as a function of r^2, which certify() needs to know.",
      py::arg("pairs"), py::arg("lengths"), py::arg("stiffness") = 1, py::kw_only(), py::arg("law") = "hooke",
      py::arg("upper") = py::none(), py::arg("offsets") = py::none(), py::arg("information") = py::none(),
      py::arg("convex_in_square") = false);
  def_add(type, "add_bendings", lengths_of("bendings", "triples", 3),
          "Triples (m, 3) with lengths (m,) of the second difference at rest: as links, with\n"
          "r = |x_i - 2 x_j + x_k - offset|.",
          py::arg("triples"), py::arg("lengths"), py::arg("stiffness") = 1, py::kw_only(),
          py::arg("law") = "hooke", py::arg("upper") = py::none(), py::arg("offsets") = py::none(),
          py::arg("information") = py::none(), py::arg("convex_in_square") = false);
  const auto triangles_of = [](const char* kind) {
    return [kind](TermSystem& self, const py::object& triples, const py::object& rest,
                  const py::object& stiffness, const std::string& loss, const py::object& scale,
                  const py::object& sharpness) {
      const std::string_view name = kind;
      if (name == "angles") require_radians(rest);
      return add_term(self, kind, nodes_of(triples, "triples", 3, self.system().nodes()),
                      {{"rest", kind, rest}, {"stiffness", "stiffness", stiffness}},
                      {loss, scale, sharpness});
    };
  };
  def_add(
      type, "add_angles", triangles_of("angles"),
      "Triples (m, 3) with angles (m,) at rest: s is the angle at node j between i and k, in [0, pi], less\n"
      "the angle at rest [radians].",
      py::arg("triples"), py::arg("angles"), py::arg("stiffness") = 1, py::kw_only());
  def_add(
      type, "add_areas", triangles_of("areas"),
      "Triples (m, 3) with areas (m,) at rest: s is the triangle's area less that at rest [px^2]. In the\n"
      "plane it has a sign, positive where i, j, k turn from the x axis to the y axis.",
      py::arg("triples"), py::arg("areas"), py::arg("stiffness") = 1, py::kw_only());
  def_add(
      type, "add_common_length",
      [](TermSystem& self, const py::object& pairs, const py::object& stiffness, const py::object& lengths,
         const py::object& prior, const py::object& prior_stiffness, const std::string& loss,
         const py::object& scale, const py::object& sharpness) {
        return add_term(self, "common_length", nodes_of(pairs, "pairs", 2, self.system().nodes()),
                        {{"length", "lengths", lengths},
                         {"stiffness", "stiffness", stiffness},
                         {"prior", "prior", prior},
                         {"prior_stiffness", "prior_stiffness", prior_stiffness}},
                        {loss, scale, sharpness});
      },
      "Pairs (m, 2) that share one unknown length b, which is estimated with the points: s = r - mu - b "
      "with\n"
      "mu the lengths, and 1/2 prior_stiffness (b - prior)^2 besides. The loss is 'quadratic' or 'huber'.",
      py::arg("pairs"), py::arg("stiffness") = 1, py::kw_only(), py::arg("lengths") = 0, py::arg("prior") = 0,
      py::arg("prior_stiffness") = 0);
  type.def(
      "add_loads",
      [](TermSystem& self, const py::object& forces, const py::object& nodes) {
        return add_term(self, "loads", nodes_or_all(self, nodes), {{"force", "forces", forces}});
      },
      py::arg("forces"), py::kw_only(), py::arg("nodes") = py::none(),
      "Constant forces (m, dim) on nodes (m,), or on all: the energy is -force . x_i.");
  type.def(
      "add_elements",
      [](TermSystem& self, const py::object& nodes, const py::object& function, bool has_hessian) {
        if (PyCallable_Check(function.ptr()) == 0)
          throw py::type_error("function: expected a function, found " + type_name(function));
        return add_term(self, "elements", nodes_of(nodes, "nodes", -1, self.system().nodes()), {}, {},
                        {function, has_hessian});
      },
      py::arg("nodes"), py::arg("function"), py::arg("has_hessian") = false,
      "Elements of your own on nodes (m, K). function(points) gets the points (m, K, dim) of all elements\n"
      "and returns their energies (m,), the gradients (m, K, dim) and, with has_hessian, the second\n"
      "derivatives (m, K dim, K dim); without, only methods that need none take them.");

  type.def(
          "energy",
          [](TermSystem& self, const py::object& x) {
            return evaluated(self, x,
                             [](const auto& system, const auto& at) { return asterism::energy(system, at); });
          },
          py::arg("x"), "E(x) for x (N, dim).")
      .def(
          "gradient",
          [](TermSystem& self, const py::object& x) {
            MatrixXd gradient = evaluated(self, x, [](const auto& system, const auto& at) {
              MatrixXd found;
              energy_and_gradient(system, at, found);
              return found;
            });
            return owned(std::move(gradient), {self.system().nodes(), self.system().dim()});
          },
          py::arg("x"), "dE/dx, (N, dim); zero for fixed nodes.")
      .def(
          "stationarity",
          [](TermSystem& self, const py::object& x) {
            return evaluated(self, x, [](const auto& system, const auto& at) {
              return asterism::stationarity(system, at);
            });
          },
          py::arg("x"),
          "How far x is from a stationary point, without units. The methods' tolerance applies to it.")
      .def(
          "solve",
          [](TermSystem& self, const py::object& x, const std::string& method, const py::object& on_iteration,
             bool check, const py::kwargs& options) {
            AnySolver<asterism::System> solver = system_solvers().make(method);
            set_options(solver, method, options);
            py::array_t<double> array = output(x, "x", {self.system().nodes(), self.system().dim()});
            MatrixXd points = points_of(self.system(), array);
            const bool is_long = may_be_long(element_count(self.system()), most_rounds(options_of(solver)));
            const Summary summary = self.read([&](const asterism::System& system) {
              return run(solver, system, points, on_iteration, is_long, [] { return true; });
            });
            if (summary.usable()) std::copy_n(points.data(), points.size(), array.mutable_data());
            if (check && summary.status == Status::InvalidInput)
              refuse_value(summary.message, py::none(), x, options_of(solver));
            return checked(summary, check);
          },
          py::arg("x"), py::arg("method") = "auto", py::arg("on_iteration") = py::none(),
          py::arg("check") = true, kSolve)
      .def(
          "solve_turning",
          [](TermSystem& self, const py::object& x, bool scale, double tolerance, int max_iterations,
             bool hold_floating, bool check) {
            TurningOptions options;
            options.scale = scale;
            options.tolerance = tolerance;
            options.max_iterations = max_iterations;
            options.hold_floating = hold_floating;
            const int dim = self.system().dim();
            py::array_t<double> array = output(x, "x", {self.system().nodes(), dim});
            MatrixXd points = points_of(self.system(), array), transform = MatrixXd::Identity(dim, dim);
            const Summary summary = self.read([&](const asterism::System& system) {
              return interruptible([&](const std::atomic<bool>& stop) {
                options.stop = &stop;
                return solve_turning(system, points, transform, options);
              });
            });
            checked(summary, check);
            if (summary.usable()) std::copy_n(points.data(), points.size(), array.mutable_data());
            transform.transposeInPlace();  // rows are next to each other in Python
            return py::make_tuple(summary, owned(std::move(transform), {dim, dim}));
          },
          py::arg("x"), py::arg("scale") = true, py::kw_only(),
          py::arg("tolerance") = TurningOptions().tolerance,
          py::arg("max_iterations") = TurningOptions().max_iterations, py::arg("hold_floating") = false,
          py::arg("check") = true,
          "Minimises the energy over x (N, dim), in place, and over one rotation T, with `scale` one\n"
          "similarity T, that all offsets m of links turn by: a link prefers T @ m. Returns (Summary, T),\n"
          "T (dim, dim). With offsets or springs without rest length, and plain anchors, it is the global\n"
          "minimum. ValueError for terms other than anchors, loads, links and offsets; check: as of\n"
          "solve().")
      .def(
          "certify",
          [](TermSystem& self, const py::object& x, double gap) {
            const CertifyOptions options{gap};
            if (const char* problem = options.problem()) throw py::value_error(problem);
            MatrixXd points = points_of(self.system(), x);
            return self.read([&](const asterism::System& system) {
              return interruptible_copy(is_large(self), [system, points = std::move(points), options] {
                return asterism::certify(system, points, options);
              });
            });
          },
          py::arg("x"), py::arg("gap") = CertifyOptions().gap,
          "Whether x (N, dim) is proven to be the global minimum, and a lower bound of the energy: a "
          "Certificate.\n"
          "Its reason names the term where one has no bound of its curvature. gap: as of asterism.certify().")
      .def("solution", &solution_of, py::arg("x"),
           "The Solution at a minimum x (N, dim). ValueError for values that a solver refuses, or a term "
           "without\n"
           "second derivatives; numpy.linalg.LinAlgError where the Hessian is not positive definite.")
      .def("__repr__", [](const TermSystem& self) {
        const asterism::System& system = self.system();
        std::string text = "<asterism.System: " + detail::counted(system.nodes(), "node") + ", dim " +
                           std::to_string(system.dim());
        constexpr int kShown = 8;
        for (int t = 0; t < std::min(system.term_count(), kShown); ++t)
          text += "; " + contents(system.term(t));
        if (system.term_count() > kShown)
          text += "; " + std::to_string(system.term_count() - kShown) + " more";
        return text + ">";
      });
}

}  // namespace asterism::python
