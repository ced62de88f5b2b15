#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/base/edit_distance.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/terms/term.hpp>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "direction.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

using detail::raise;

constexpr std::string_view kLosses[] = {"quadratic", "huber", "geman-mcclure", "truncated"};

std::span<const std::string_view> losses() { return kLosses; }

std::string unknown(std::string_view what, std::string_view name, std::span<const std::string_view> names) {
  return "unknown " + std::string(what) + " '" + std::string(name) + "'" + detail::name_hint(name, names);
}

bool is_allowed(double value, Column::Range range) {
  if (!detail::is_finite(value)) return false;
  if (range == Column::Range::NotNegative) return value >= 0;
  return range == Column::Range::Any || value > 0;
}

std::string number_text(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

const char* problem_of(Column::Range range) {
  if (range == Column::Range::Any) return "is not finite";
  return range == Column::Range::NotNegative ? "is negative or not finite" : "is not positive and finite";
}

// The columns of `values` that stay.
template <typename Matrix>
Matrix kept(const Matrix& values, std::span<const int> columns) {
  Matrix result(values.rows(), static_cast<Eigen::Index>(columns.size()));
  for (Eigen::Index c = 0; const int column : columns) result.col(c++) = values.col(column);
  return result;
}

// The columns of `first` and then those of `second`.
template <typename Matrix>
Matrix beside(const Matrix& first, const Matrix& second) {
  Matrix result(first.rows(), first.cols() + second.cols());
  result.leftCols(first.cols()) = first;
  result.rightCols(second.cols()) = second;
  return result;
}

}  // namespace

void CurvatureSink::add_blocks(const int* nodes, int arity, int count, const double* c, const double* B,
                               int dim) {
  Eigen::MatrixXd matrix(arity * dim, arity * dim);
  for (std::ptrdiff_t e = 0; e < count; ++e) {
    const Eigen::Map<const Eigen::MatrixXd> block(B + e * dim * dim, dim, dim);
    for (int a = 0; a < arity; ++a) {
      for (int b = 0; b < arity; ++b) matrix.block(a * dim, b * dim, dim, dim) = (c[a] * c[b]) * block;
    }
    add(nodes + e * arity, arity, matrix.data(), arity * dim);
  }
}

void CurvatureSink::add_multiples(const int* nodes, int arity, int count, const double* c, const double* k,
                                  int dim) {
  constexpr int kMost = 64;
  const int entries = dim * dim;
  std::vector<double> blocks(static_cast<std::size_t>(std::min(count, kMost) * entries));
  for (int first = 0; first < count; first += kMost) {
    const int part = std::min(kMost, count - first);
    for (int e = 0; e < part; ++e) {  // 0 beside the diagonals
      for (int d = 0; d < dim; ++d)
        blocks[static_cast<std::size_t>(e * entries + d * (dim + 1))] = k[first + e];
    }
    add_blocks(nodes + std::ptrdiff_t{arity} * first, arity, part, c, blocks.data(), dim);
  }
}

Term::Term(std::string_view kind, int dim, int arity, std::vector<Column> columns,
           std::vector<Choice> choices)
    : kind_(kind), dim_(dim), nodes_(arity, 0), columns_(std::move(columns)), choices_(std::move(choices)) {
  for (Column& column : columns_) column.values.resize(column.is_optional ? 0 : column.rows, 0);
}

std::size_t Term::find(std::string_view name) const {
  const auto at = std::find_if(columns_.begin(), columns_.end(),
                               [name](const Column& column) { return column.name == name; });
  if (at == columns_.end()) {
    std::vector<std::string_view> names;
    for (const Column& column : columns_) names.push_back(column.name);
    raise(std::invalid_argument(std::string(kind_) + ": " + unknown("column", name, names)));
  }
  return static_cast<std::size_t>(at - columns_.begin());
}

Eigen::MatrixXd& Term::values(std::string_view column) { return columns_[find(column)].values; }
const Eigen::MatrixXd& Term::values(std::string_view column) const { return columns_[find(column)].values; }

Choice& Term::find_choice(std::string_view name) {
  const auto at = std::find_if(choices_.begin(), choices_.end(),
                               [name](const Choice& choice) { return choice.name == name; });
  if (at == choices_.end()) {
    std::vector<std::string_view> names;
    for (const Choice& choice : choices_) names.push_back(choice.name);
    raise(std::invalid_argument(std::string(kind_) + ": " + unknown("choice", name, names)));
  }
  return *at;
}

void Term::choose(std::string_view name, std::string_view value) {
  Choice& choice = find_choice(name);
  const std::span<const std::string_view> names = choice.names();
  const auto at = std::find(names.begin(), names.end(), value);
  if (at == names.end())
    raise(std::invalid_argument(std::string(kind_) + ": " + unknown(name, value, names)));
  choice.value = static_cast<int>(at - names.begin());
}

std::string_view Term::chosen(std::string_view name) const {
  const Choice& choice = const_cast<Term*>(this)->find_choice(name);
  return choice.names()[static_cast<std::size_t>(choice.value)];
}

void Term::set_loss(Loss loss, const Eigen::VectorXd& scale, const Eigen::VectorXd& sharpness) {
  find_choice("loss").value = static_cast<int>(loss);
  values("scale") = scale.transpose();
  values("sharpness") = sharpness.transpose();
}

void Term::set_loss(Loss loss, double scale, double sharpness) {
  const auto one = [](double value) { return Eigen::VectorXd::Constant(1, value); };
  set_loss(loss, one(scale), loss == Loss::Truncated ? Eigen::VectorXd(one(sharpness)) : Eigen::VectorXd());
}

void Term::set_nodes(Eigen::MatrixXi nodes) {
  if (nodes.rows() != arity())
    raise(std::invalid_argument(std::string(kind_) + ": an element has " + detail::counted(arity(), "node") +
                                ", not " + std::to_string(nodes.rows())));
  nodes_ = std::move(nodes);
  look_for_all_pairs();
}

void Term::look_for_all_pairs() {
  all_pairs_of_ = 0;
  if (arity() != 2 || size() == 0) return;
  const int n = nodes_(1, size() - 1) + 1;
  if (n < 2 || std::int64_t{n} * (n - 1) / 2 != size()) return;
  const int* pair = nodes_.data();
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n; ++j, pair += 2) {
      if (pair[0] != i || pair[1] != j) return;
    }
  }
  all_pairs_of_ = n;
}

Term::Magnitude Term::magnitude(const Points& x) const { return {std::abs(energy(x, nullptr)), 0}; }

void Term::append(const Eigen::MatrixXi& nodes, const std::vector<NamedNumbers>& given) {
  const auto wrong_size = [](std::string_view name, const char* what) {
    raise(std::length_error("append: " + std::string(name) + what));
  };
  const auto refuse = [](std::string_view name, const char* what) {
    raise(std::invalid_argument("append: " + std::string(name) + what));
  };
  if (nodes.rows() != arity()) wrong_size("nodes", " of another number for each element");
  for (const NamedNumbers& each : given) find(each.column);
  const Eigen::Index count = nodes.cols();
  std::vector<Eigen::MatrixXd> becomes;  // of each column
  for (const Column& column : columns_) {
    const Eigen::MatrixXd& known = column.values;
    const auto at = std::find_if(given.begin(), given.end(),
                                 [&](const NamedNumbers& each) { return each.column == column.name; });
    const bool is_none = known.size() == 0 && column.is_optional;
    const bool is_same = is_none || column.is_common || (known.cols() == 1 && size() != 1);
    if (at == given.end()) {
      // Numbers of former elements hold for the first new ones, and those of one may have been meant for all.
      if (known.size() == 0 && !column.is_optional) refuse(column.name, " is missing");
      if (size() > 1 && !is_same) refuse(column.name, " is missing");
      becomes.push_back(size() == 1 && !is_same ? beside<Eigen::MatrixXd>(known, known.replicate(1, count))
                                                : known);
      continue;
    }
    const Eigen::MatrixXd& more = at->values;
    if (more.size() > 0 && more.cols() != count && more.cols() != 1)
      wrong_size(column.name, " has not one entry for each new element, or one for all");
    if (size() == 0) {
      becomes.push_back(more);
      continue;
    }
    if (is_same) refuse(column.name, " is the same for all elements, or none has it");
    if (more.rows() != known.rows()) wrong_size(column.name, " has another form than before");
    becomes.push_back(more.cols() == count ? beside(known, more)
                                           : beside<Eigen::MatrixXd>(known, more.replicate(1, count)));
  }
  nodes_ = beside(nodes_, nodes);
  for (std::size_t c = 0; c < columns_.size(); ++c) columns_[c].values.swap(becomes[c]);
  look_for_all_pairs();
}

void Term::remove(std::span<const int> elements) {
  std::vector<bool> is_gone(static_cast<std::size_t>(size()));
  for (const int element : elements) {
    if (element < 0 || element >= size())
      raise(std::invalid_argument(std::string(kind_) + ": there is no element " + std::to_string(element)));
    is_gone[static_cast<std::size_t>(element)] = true;
  }
  std::vector<int> rest;
  for (int element = 0; element < size(); ++element) {
    if (!is_gone[static_cast<std::size_t>(element)]) rest.push_back(element);
  }
  for (Column& column : columns_) {
    if (column.values.cols() == size() && size() != 1) column.values = kept(column.values, rest);
  }
  nodes_ = kept(nodes_, rest);
  look_for_all_pairs();
}

std::string Term::defect(int node_count) const {
  const auto says = [this](auto&&... words) {
    std::string text(kind_);
    text += ": ";
    (text += ... += words);
    return text;
  };
  for (int e = 0; e < size(); ++e) {
    for (int a = 0; a < arity(); ++a) {
      if (nodes_(a, e) < 0 || nodes_(a, e) >= node_count)
        return says("element ", std::to_string(e), " has a node out of range: ", std::to_string(nodes_(a, e)),
                    " of ", detail::counted(node_count, "node"));
      for (int b = 0; b < a; ++b) {
        if (nodes_(a, e) == nodes_(b, e)) return says("element ", std::to_string(e), " has one node twice");
      }
    }
  }
  for (const Column& column : columns_) {
    const std::string name(column.name);
    const Eigen::MatrixXd& values = column.values;
    if (values.size() == 0 && (column.is_optional || size() == 0)) continue;
    if (values.rows() != column.rows && !(column.other_rows > 0 && values.rows() == column.other_rows))
      return says(name, " must have ", detail::counted(column.rows, "number"), " for each element");
    if (values.cols() != size() && values.cols() != 1)
      return says(name,
                  " must have one entry for each element, or one for all: ", std::to_string(values.cols()),
                  " of ", detail::counted(size(), "element"));
    if (column.is_common && values.cols() != 1) return says(name, " must be the same for all elements");
    for (Eigen::Index e = 0; e < values.cols(); ++e) {
      for (Eigen::Index r = 0; r < values.rows(); ++r) {
        if (!is_allowed(values(r, e), column.range))
          return says(name, " of element ", std::to_string(e), " ", problem_of(column.range), ": ",
                      number_text(values(r, e)));
      }
    }
  }
  return {};
}

std::string Term::loss_defect() const {
  const Loss kind = loss();
  if (size() == 0) return {};
  const auto lacks = [&](const char* parameter) {
    return std::string(kind_) + ": the loss " + std::string(kLosses[choices_.back().value]) + " needs a " +
           parameter;
  };
  if (kind != Loss::Quadratic && columns_[columns_.size() - 2].values.size() == 0) return lacks("scale");
  if (kind == Loss::Truncated && columns_.back().values.size() == 0) return lacks("sharpness");
  return {};
}

bool Term::is_stiff(int element) const {
  for (std::size_t c = 0; c < columns_.size(); ++c) {
    if (columns_[c].name == "stiffness") return *numbers(c)[element] > 0;
  }
  return false;
}

std::unique_ptr<Term> Term::lifted(int dim) const {
  std::unique_ptr<Term> result = clone();
  result->dim_ = dim;
  for (Column& column : result->columns_) {
    if (column.other_rows > 0) column.other_rows = dim * dim;
    if (column.shape == Column::Shape::Numbers) continue;
    const bool is_matrix = column.shape == Column::Shape::Matrix;
    column.rows = is_matrix ? dim * dim : dim;
    const Eigen::MatrixXd given = std::move(column.values);
    column.values.setZero(given.size() > 0 ? column.rows : given.rows(), given.cols());
    for (Eigen::Index e = 0; given.size() > 0 && e < given.cols(); ++e) {
      if (!is_matrix) {
        column.values.col(e).head(dim_) = given.col(e);
        continue;
      }
      const Eigen::Map<const Eigen::MatrixXd> matrix(given.col(e).data(), dim_, dim_);
      Eigen::Map<Eigen::MatrixXd> larger(column.values.col(e).data(), dim, dim);
      larger.diagonal().setConstant(std::max(-detail::largest_eigenvalue(-matrix), 0.0));
      larger.topLeftCorner(dim_, dim_) = matrix;
    }
  }
  return result;
}

const char* Term::why_not_liftable() const { return "this kind of term cannot be given more dimensions"; }

void Term::add_mixed(const Points&, const Points&, std::span<Eigen::MatrixXd>) const {}

Term::Numbers Term::numbers(const Eigen::MatrixXd& values) {
  if (values.size() == 0) return {nullptr, 0};
  return {values.data(), values.cols() == 1 ? 0 : values.rows()};
}

Term::Numbers Term::numbers(std::size_t column) const { return numbers(columns_[column].values); }

void Term::add_loss() {
  columns_.push_back({"scale", 1, Column::Range::Positive, true});
  columns_.push_back({"sharpness", 1, Column::Range::Positive, true});
  choices_.push_back({"loss", losses, 0});
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
