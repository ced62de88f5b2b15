#include "json.hpp"

#include <asterism/solver/io/json.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <memory>
#include <stdexcept>
#include <utility>

// A term is stored by its columns and choices alone: a new kind needs nothing here.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

using namespace stored;
using OrderedJson = nlohmann::ordered_json;

namespace {

// Lists around a value, as far as its first elements say.
int list_depth(const Json& value) {
  return value.is_array() ? 1 + (value.empty() ? 0 : list_depth(value.front())) : 0;
}

// The same of an element's numbers: none around a number, one around a point, two around a matrix.
int form_depth(int rows, int dim) {
  if (rows == 1) return 0;
  return rows == dim * dim ? 2 : 1;
}

void read_element(const Json& value, const Place& place, int rows, int dim, double* numbers) {
  const int depth = form_depth(rows, dim);
  if (depth == 0) {
    // On a line, points and matrices are numbers, which may be written as such.
    const bool is_list = dim == 1 && value.is_array() && value.size() == 1;
    if (is_list) return read_element(value.front(), place, rows, dim, numbers);
    *numbers = number(value, place);
    return;
  }
  array(value, place, depth == 1 ? rows : dim, "dim");
  for (std::ptrdiff_t r = 0; r < std::ssize(value); ++r) {
    const Json& row = value[static_cast<std::size_t>(r)];
    if (depth == 1) {
      numbers[r] = number(row, place[r]);
      continue;
    }
    array(row, place[r], dim, "dim");
    for (std::ptrdiff_t c = 0; c < dim; ++c)
      numbers[r + c * dim] = number(row[static_cast<std::size_t>(c)], place[r][c]);
  }
}

Eigen::MatrixXd read_column(const Json& value, const Place& place, const Column& column, int dim, int size) {
  if (size == 0 && value.is_array() && value.empty()) return Eigen::MatrixXd(column.rows, 0);
  const int depth = list_depth(value);
  int rows = column.rows;
  if (const int other = column.other_rows; other > 0) {
    const int list = depth - form_depth(other, dim);
    if (list == 0 || list == 1) rows = other;
  }
  if (depth == form_depth(rows, dim)) {
    Eigen::MatrixXd values(rows, 1);
    read_element(value, place, rows, dim, values.data());
    return values;
  }
  array(value, place, size, "one for each element");
  Eigen::MatrixXd values(rows, size);
  for (std::ptrdiff_t e = 0; e < size; ++e)
    read_element(value[static_cast<std::size_t>(e)], place[e], rows, dim, values.col(e).data());
  return values;
}

int read_node(const Json& value, const Place& place, int node_count) {
  const int index = node(value, place);
  if (index < 0 || index >= node_count) refuse(place.text(), " is out of range");
  return index;
}

// An element with one node may be written as that node.
Eigen::MatrixXi read_nodes(const Json& value, std::string_view key, int arity, int node_count) {
  const Place place{key};
  Eigen::MatrixXi nodes(arity, std::ssize(array(value, place)));
  for (std::ptrdiff_t e = 0; e < nodes.cols(); ++e) {
    const Json& element = value[static_cast<std::size_t>(e)];
    if (arity == 1 && !element.is_array()) {
      nodes(0, e) = read_node(element, place[e], node_count);
      continue;
    }
    array(element, place[e], arity, "nodes of an element");
    for (std::ptrdiff_t a = 0; a < arity; ++a)
      nodes(a, e) = read_node(element[static_cast<std::size_t>(a)], place[e][a], node_count);
  }
  return nodes;
}

void refuse_unknown(const Json& object, const std::vector<std::string_view>& known) {
  for (const auto& [key, value] : object.items()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string_view unknown = std::string_view(key).substr(0, 40);  // the distance takes its length
    refuse("unknown key ", key_text(unknown), " (the nearest known one is ",
           key_text(*nearest(unknown, known)), ")");
  }
}

const std::string& text(const Json& value, const Place& place) {
  if (!value.is_string()) refuse_type(place, "a string", value);
  return value.get_ref<const std::string&>();
}

// Calls work(); what a term does not take, such as an unknown name, is refused.
template <typename Work>
auto refusing(Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    refuse(error.what());
  }
}

void require_no_defect(const Term& term, int node_count) {
  if (const std::string problem = term.defect(node_count); !problem.empty()) refuse(problem);
}

std::unique_ptr<Term> read_term(const Json& object, int dim, int node_count) {
  if (!object.is_object()) refuse("expected an object, found ", object.type_name());
  std::unique_ptr<Term> term =
      refusing([&] { return make_term(text(member(object, "kind"), {"kind"}), dim); });
  std::vector<std::string_view> known{"kind", "nodes"};
  for (const Column& column : term->columns()) known.push_back(column.name);
  for (const Choice& choice : term->choices()) known.push_back(choice.name);
  refuse_unknown(object, known);

  term->set_nodes(read_nodes(member(object, "nodes"), "nodes", term->arity(), node_count));
  for (const Column& column : term->columns()) {
    const std::string name(column.name);
    if (column.is_optional && !object.contains(name)) continue;
    term->values(name) = read_column(member(object, name.c_str()), {name}, column, dim, term->size());
  }
  for (const Choice& choice : term->choices()) {
    const std::string name(choice.name);
    if (const auto chosen = object.find(name); chosen != object.end())
      refusing([&] { term->choose(name, text(*chosen, {name})); });
  }
  require_no_defect(*term, node_count);
  return term;
}

void read_start(const Json& value, Eigen::MatrixXd& start) {
  read_points(value, {"start"}, "one for each node", start);
}

void read_common(const Json& object, StoredTerms& result) {
  if (const auto fixed = object.find("fixed"); fixed != object.end()) {
    const Eigen::MatrixXi nodes = read_nodes(*fixed, "fixed", 1, result.system.nodes());
    for (const int node : nodes.reshaped()) result.system.fix(node);
  }
  if (const auto name = object.find("name"); name != object.end()) result.name = text(*name, {"name"});
  if (const auto origin = object.find("origin"); origin != object.end()) {
    if (!origin->is_object()) refuse_type({"origin"}, "an object", *origin);
    result.origin = origin->dump();
  }
  if (const std::string problem = validate(result.system, result.start, false); !problem.empty())
    refuse(problem);
}

int read_dimension(const Json& object) {
  const std::int64_t dim = integer(member(object, "dim"), {"dim"}, "an integer");
  if (dim < 1 || dim > System::kMaxDim)
    refuse("dim is ", object["dim"].dump(), ", expected 1 to ", std::to_string(System::kMaxDim));
  return static_cast<int>(dim);
}

StoredTerms read_version_2(const Json& object) {
  refuse_unknown(object, {"asterism_system", "name", "origin", "dim", "nodes", "fixed", "start", "terms"});
  const int dim = read_dimension(object);
  const int nodes = node(member(object, "nodes"), {"nodes"});
  if (nodes < 0) refuse("nodes is ", object["nodes"].dump());
  array(member(object, "start"), {"start"}, nodes, "one for each node");  // before memory for them is taken
  StoredTerms result{System(nodes, dim), Eigen::MatrixXd(dim, nodes), {}, "{}"};
  read_start(object["start"], result.start);
  std::size_t t = 0;
  for (const Json& term : array(member(object, "terms"), {"terms"})) {
    located(Place{"terms"}[static_cast<std::ptrdiff_t>(t++)].text(),
            [&] { result.system.add(read_term(term, dim, nodes)); });
  }
  read_common(object, result);
  return result;
}

// Springs: lists for all nodes and all links, which are columns of anchors, links and loads.
StoredTerms read_version_1(const Json& object) {
  check_keys(object);
  const int dim = read_dimension(object);
  const Json& anchors = array(member(object, "anchors"), {"anchors"});
  const int nodes = static_cast<int>(anchors.size());
  StoredTerms result{System(nodes, dim), Eigen::MatrixXd(dim, nodes), {}, "{}"};
  const auto add = [&](std::unique_ptr<Term> term, const char* unit, Eigen::MatrixXi of,
                       std::initializer_list<std::pair<const char*, const char*>> columns) {
    term->set_nodes(std::move(of));
    for (const auto& [name, key] : columns) {
      const auto given = object.find(key);
      Eigen::MatrixXd& values = term->values(name);
      const bool is_optional = name == std::string_view("information") || name == std::string_view("offset");
      if (given == object.end() && is_optional) continue;
      const Json& list = array(member(object, key), {key}, term->size(), unit);
      for (const Column& column : term->columns()) {
        if (column.name == name) values = read_column(list, {key}, column, dim, term->size());
      }
    }
    require_no_defect(*term, nodes);
    result.system.add(std::move(term));
  };
  const Eigen::MatrixXi all = Eigen::RowVectorXi::LinSpaced(nodes, 0, nodes - 1);
  add(std::make_unique<Anchors>(dim), "one for each node", all,
      {{"position", "anchors"}, {"stiffness", "anchor_stiffness"}, {"information", "anchor_shape"}});
  add(std::make_unique<Links>(dim), "one for each link",
      read_nodes(member(object, "links"), "links", 2, nodes),
      {{"length", "rest_length"}, {"stiffness", "link_stiffness"}, {"offset", "rest_offset"}});
  if (object.contains("loads"))
    add(std::make_unique<Loads>(dim), "one for each node", all, {{"force", "loads"}});
  result.start = result.system.term(0).values("position");
  if (const auto start = object.find("start"); start != object.end()) read_start(*start, result.start);
  read_common(object, result);
  return result;
}

OrderedJson element_to_json(const double* numbers, int rows, int dim) {
  const int depth = form_depth(rows, dim);
  if (depth == 0) return *numbers;
  auto list = OrderedJson::array();
  if (depth == 1) {
    for (int r = 0; r < rows; ++r) list.push_back(numbers[r]);
    return list;
  }
  for (int r = 0; r < dim; ++r) {
    auto& row = list.emplace_back(OrderedJson::array());
    for (int c = 0; c < dim; ++c) row.push_back(numbers[r + c * dim]);
  }
  return list;
}

OrderedJson column_to_json(const Eigen::MatrixXd& values, int dim, int size) {
  const auto rows = static_cast<int>(values.rows());
  if (values.cols() != size) return element_to_json(values.data(), rows, dim);
  auto list = OrderedJson::array();
  for (int e = 0; e < size; ++e) list.push_back(element_to_json(values.col(e).data(), rows, dim));
  return list;
}

OrderedJson term_to_json(const Term& term, int node_count) {
  OrderedJson object;
  object["kind"] = term.kind();
  auto& nodes = object["nodes"] = OrderedJson::array();
  for (int e = 0; e < term.size(); ++e) {
    const int* const of = term.nodes().col(e).data();
    if (term.arity() == 1) {
      nodes.push_back(*of);
    } else {
      nodes.push_back(std::vector<int>(of, of + term.arity()));
    }
  }
  // What is left without a function of one's own is no term any more: it cannot be stored.
  const std::unique_ptr<Term> stored = refusing([&] { return make_term(term.kind(), term.dim()); });
  stored->set_nodes(term.nodes());
  for (const Column& column : term.columns()) {
    stored->values(column.name) = column.values;
    if (column.values.size() == 0 && column.is_optional) continue;
    object[std::string(column.name)] = column_to_json(column.values, term.dim(), term.size());
  }
  for (const Choice& choice : term.choices()) {
    stored->choose(choice.name, term.chosen(choice.name));
    if (choice.value != 0) object[std::string(choice.name)] = term.chosen(choice.name);
  }
  require_no_defect(*stored, node_count);
  return object;
}

}  // namespace

bool holds_terms(const Json& object) {
  if (!object.is_object()) return false;
  const auto version = object.find("asterism_system");
  return version != object.end() && version->is_number() && version->get<double>() != 1;
}

StoredTerms stored_terms_from_json(const Json& object) {
  if (!object.is_object()) refuse("expected an object, found ", object.type_name());
  const Json& version = member(object, "asterism_system");
  switch (integer(version, {"asterism_system"}, "an integer")) {
    case 1:
      return read_version_1(object);
    case 2:
      return read_version_2(object);
    default:
      refuse("asterism_system is ", version.dump(), ", known are versions 1 and 2");
  }
}

}  // namespace detail

std::vector<StoredTerms> parse_stored_terms(std::string_view text, const std::string& source) {
  std::vector<StoredTerms> systems;
  detail::stored::for_each_object(text, source, [&systems](const nlohmann::json& object) {
    systems.push_back(detail::stored_terms_from_json(object));
  });
  return systems;
}

std::vector<StoredTerms> read_stored_terms(const std::filesystem::path& path) {
  return parse_stored_terms(detail::stored::read_text(path), path.string());
}

std::string to_json(const StoredTerms& stored) {
  using namespace detail::stored;
  constexpr auto kCannot = "the system cannot be written";
  std::string line;
  located(kCannot, [&] {
    const System& system = stored.system;
    if (const std::string problem = validate(system, stored.start, false); !problem.empty()) refuse(problem);
    const Json origin = parse(stored.origin, "origin", 1, true);
    require_writable_origin(origin);
    nlohmann::ordered_json object;
    object["asterism_system"] = 2;
    if (!stored.name.empty()) object["name"] = stored.name;
    if (!origin.empty()) object["origin"] = origin;
    object["dim"] = system.dim();
    object["nodes"] = system.nodes();
    auto fixed = nlohmann::ordered_json::array();
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) fixed.push_back(i);
    }
    if (!fixed.empty()) object["fixed"] = std::move(fixed);
    object["start"] = points_to_json(stored.start);
    auto& terms = object["terms"] = nlohmann::ordered_json::array();
    for (int t = 0; t < system.term_count(); ++t)
      terms.push_back(detail::term_to_json(system.term(t), system.nodes()));
    try {
      line = object.dump();
    } catch (const nlohmann::json::exception&) {
      refuse("its name or origin is not UTF-8");
    }
  });
  return line;
}

void write_stored_terms(std::ostream& out, const StoredTerms& stored) { out << to_json(stored) + '\n'; }

}  // namespace ASTERISM_ABI
}  // namespace asterism
