#include <asterism/solver/io/json.hpp>
#include <asterism/solver/terms/kinds.hpp>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>

#include "json_text.hpp"

// Both versions of the format. A term is stored by its columns and choices alone: a new kind needs nothing
// here.

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

constexpr auto kNode = "one for each node", kLink = "one for each link";

Eigen::MatrixXd read_matrix(const Json& object, const char* key, std::ptrdiff_t dim, std::ptrdiff_t count,
                            const char* unit) {
  Eigen::MatrixXd points(dim, count);
  read_points(member(object, key), {key}, unit, points);
  return points;
}

std::vector<int> read_fixed(const Json& object, int node_count) {
  const auto fixed = object.find("fixed");
  if (fixed == object.end()) return {};
  const Eigen::MatrixXi nodes = read_nodes(*fixed, "fixed", 1, node_count);
  return {nodes.reshaped().begin(), nodes.reshaped().end()};
}

void read_labels(const Json& object, std::string& name, std::string& origin) {
  if (const auto given = object.find("name"); given != object.end()) name = text(*given, {"name"});
  origin = "{}";
  if (const auto given = object.find("origin"); given != object.end()) {
    if (!given->is_object()) refuse_type({"origin"}, "an object", *given);
    origin = given->dump();
  }
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
  array(member(object, "start"), {"start"}, nodes, kNode);  // before memory for them is taken
  StoredTerms result{System(nodes, dim), read_matrix(object, "start", dim, nodes, kNode), {}, "{}"};
  std::size_t t = 0;
  for (const Json& term : array(member(object, "terms"), {"terms"})) {
    located(Place{"terms"}[static_cast<std::ptrdiff_t>(t++)].text(),
            [&] { result.system.add(read_term(term, dim, nodes)); });
  }
  for (const int each : read_fixed(object, nodes)) result.system.fix(each);
  read_labels(object, result.name, result.origin);
  if (const std::string problem = validate(result.system, result.start, false); !problem.empty())
    refuse(problem);
  return result;
}

constexpr std::string_view kSpringKeys[] = {
    "asterism_system",  "name",         "origin", "dim",         "anchors",
    "anchor_stiffness", "anchor_shape", "links",  "rest_length", "link_stiffness",
    "rest_offset",      "loads",        "fixed",  "start",
};
// Numbers that are not negative.
Eigen::VectorXd read_numbers(const Json& object, const char* key, std::ptrdiff_t count, const char* unit) {
  Eigen::VectorXd numbers(count);
  read_vector(member(object, key), {key}, unit, numbers);
  return numbers;
}

StoredSprings read_version_1(const Json& object, const StoredVisitor& visitor) {
  refuse_unknown(object, {std::begin(kSpringKeys), std::end(kSpringKeys)});
  const std::int64_t dim = integer(member(object, "dim"), {"dim"}, "an integer");
  if (dim < 1 || dim > System::kMaxDim) refuse("dim is ", object["dim"].dump());
  if (visitor.dim == 0 ? dim != 2 && dim != 3 : visitor.dim != kAnyDimension && dim != visitor.dim)
    refuse("dim is ", std::to_string(dim), ", expected ",
           visitor.dim == 0 ? "2 or 3" : std::to_string(visitor.dim));
  const std::ptrdiff_t nodes = std::ssize(array(member(object, "anchors"), {"anchors"}));
  StoredSprings result;
  const Json& pairs = array(member(object, "links"), {"links"});
  const std::ptrdiff_t links = std::ssize(pairs);
  result.links.reserve(pairs.size());
  for (const Json& pair : pairs) {
    const Place place = Place{"links"}[std::ssize(result.links)];
    array(pair, place, 2, "nodes");
    result.links.push_back({node(pair[0], place[0]), node(pair[1], place[1])});
  }
  if (const Defect defect = Topology<>::from_links(static_cast<int>(nodes), result.links).defect())
    refuse(Place{"links"}[defect.index].text(), " ", defect.problem);
  result.anchors = read_matrix(object, "anchors", dim, nodes, kNode);
  result.anchor_stiffness = read_numbers(object, "anchor_stiffness", nodes, kNode);
  result.rest_length = read_numbers(object, "rest_length", links, kLink);
  result.link_stiffness = read_numbers(object, "link_stiffness", links, kLink);
  if (object.contains("rest_offset"))
    result.rest_offset = read_matrix(object, "rest_offset", dim, links, kLink);
  if (object.contains("loads")) result.loads = read_matrix(object, "loads", dim, nodes, kNode);
  if (const auto shapes = object.find("anchor_shape"); shapes != object.end()) {
    if (!visitor.takes_shapes)
      refuse("anchor_shape: a system with anisotropic anchors, which was not asked for");
    array(*shapes, {"anchor_shape"}, nodes, kNode);
    result.anchor_shape.resize(dim, dim * nodes);
    for (std::ptrdiff_t i = 0; i < nodes; ++i) {
      auto shape = result.anchor_shape.middleCols(dim * i, dim);
      read_points((*shapes)[static_cast<std::size_t>(i)], Place{"anchor_shape"}[i], "dim", shape);
      shape.transposeInPlace();  // rows were read as columns
    }
  }
  result.fixed = read_fixed(object, static_cast<int>(nodes));
  result.start = object.contains("start") ? read_matrix(object, "start", dim, nodes, kNode) : result.anchors;
  read_labels(object, result.name, result.origin);
  return result;
}

// Springs as anchors, links and loads.
StoredTerms terms_of(StoredSprings&& springs) {
  const std::ptrdiff_t dim = springs.anchors.rows(), nodes = springs.anchors.cols();
  StoredTerms result{System(static_cast<int>(nodes), static_cast<int>(dim)), std::move(springs.start),
                     std::move(springs.name), std::move(springs.origin)};
  System& system = result.system;
  Anchors& anchors = system.add_anchors(springs.anchors, springs.anchor_stiffness);
  if (springs.anchor_shape.size() > 0)
    anchors.values("information") = springs.anchor_shape.reshaped(dim * dim, nodes);
  Eigen::Matrix2Xi pairs(2, std::ssize(springs.links));
  for (Eigen::Index l = 0; const Link& link : springs.links) pairs.col(l++) << link.i, link.j;
  Links& links = system.add_links(pairs, springs.rest_length, springs.link_stiffness);
  if (springs.rest_offset.cols() > 0) links.values("offset") = springs.rest_offset;
  if (springs.loads.cols() > 0) {
    system.add_loads(Eigen::RowVectorXi::LinSpaced(nodes, 0, static_cast<int>(nodes) - 1), springs.loads);
  }
  for (const int node : springs.fixed) system.fix(node);
  if (const std::string problem = validate(system, result.start, false); !problem.empty()) refuse(problem);
  return result;
}

template <typename Vector>
std::vector<double> numbers(const Vector& vector) {
  return {vector.begin(), vector.end()};
}

template <typename Points>
OrderedJson points_to_json(const Points& points) {
  auto list = OrderedJson::array();
  for (const auto& point : points.colwise()) list.push_back(numbers(point));
  return list;
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
  std::unique_ptr<Term> stored;  // as a file would give it: without the user's function
  try {
    stored = make_term(term.kind(), term.dim());
  } catch (const std::invalid_argument&) {
    refuse(term.kind(), ": a term whose energy is the user's function cannot be stored");
  }
  stored->set_nodes(term.nodes());
  for (const Column& column : term.columns()) {
    stored->values(column.name) = column.values;
    if (column.values.size() == 0 && column.is_optional) continue;
    object[std::string(column.name)] = column_to_json(column.values, term.dim(), term.size());
  }
  for (const Choice& choice : term.choices()) {
    if (choice.name == "law" && term.chosen(choice.name) == "own")
      refuse(term.kind(),
             ": the law is the user's function, which is stored only by a name: see add_link_law");
    stored->choose(choice.name, term.chosen(choice.name));
    if (choice.value != 0) object[std::string(choice.name)] = term.chosen(choice.name);
  }
  require_no_defect(*stored, node_count);
  return object;
}

// What the versions have in common at the beginning of an object.
OrderedJson begin_object(int version, const std::string& name, const std::string& origin) {
  const Json parsed = parse(origin, "origin", 1, true);
  require_writable_origin(parsed);
  OrderedJson object;
  object["asterism_system"] = version;
  if (!name.empty()) object["name"] = name;
  if (!parsed.empty()) object["origin"] = parsed;
  return object;
}

std::string line_of(const OrderedJson& object) {
  try {
    return object.dump();
  } catch (const nlohmann::json::exception&) {
    refuse("its name or origin is not UTF-8");
  }
}

constexpr auto kCannot = "the system cannot be written";

}  // namespace

void for_each_stored(std::string_view text, const std::string& source, const StoredVisitor& visitor) {
  for_each_object(text, source, [&visitor](const Json& object) {
    if (!object.is_object()) refuse("expected an object, found ", object.type_name());
    // Another version may have any keys, so that it comes first.
    const Json& version = member(object, "asterism_system");
    const std::int64_t number = integer(version, {"asterism_system"}, "an integer");
    if (number == 1) return visitor.springs(read_version_1(object, visitor));
    if (number == 2 && visitor.terms) return visitor.terms(read_version_2(object));
    refuse("asterism_system is ", version.dump(), ", known ",
           visitor.terms ? "are versions 1 and 2" : "is version 1");
  });
}

std::string read_text(const std::filesystem::path& path) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::string text, block(1 << 16, '\0');
  while (file.read(block.data(), std::ssize(block)) || file.gcount() > 0) {
    text.append(block, 0, static_cast<std::size_t>(file.gcount()));
  }
  if (!file.is_open() || file.bad()) {
    refuse(path.string(), ": cannot be read", errno == 0 ? "" : ": ", errno == 0 ? "" : std::strerror(errno));
  }
  return text;
}

std::string to_json(const StoredSprings& springs) {
  std::string line;
  located(kCannot, [&] {
    const std::ptrdiff_t dim = springs.anchors.rows(), nodes = springs.anchors.cols();
    OrderedJson object = begin_object(1, springs.name, springs.origin);
    object["dim"] = dim;
    object["anchors"] = points_to_json(springs.anchors);
    object["anchor_stiffness"] = numbers(springs.anchor_stiffness);
    const auto shape = [&](std::ptrdiff_t i) { return springs.anchor_shape.middleCols(dim * i, dim); };
    bool is_isotropic = true;  // a system that Springs alone can read is written as one
    for (std::ptrdiff_t i = 0; springs.anchor_shape.size() > 0 && i < nodes; ++i)
      is_isotropic = is_isotropic && shape(i).isIdentity(0);
    if (!is_isotropic) {
      auto& shapes = object["anchor_shape"] = OrderedJson::array();
      for (std::ptrdiff_t i = 0; i < nodes; ++i) shapes.push_back(points_to_json(shape(i).transpose()));
    }
    auto& links = object["links"] = OrderedJson::array();
    for (const Link& link : springs.links) links.push_back({link.i, link.j});
    object["rest_length"] = numbers(springs.rest_length);
    object["link_stiffness"] = numbers(springs.link_stiffness);
    if (springs.rest_offset.cols() > 0) object["rest_offset"] = points_to_json(springs.rest_offset);
    if (springs.loads.cols() > 0) object["loads"] = points_to_json(springs.loads);
    if (!springs.fixed.empty()) object["fixed"] = springs.fixed;
    object["start"] = points_to_json(springs.start);
    line = line_of(object);
  });
  return line;
}

}  // namespace detail

std::vector<StoredTerms> parse_stored_terms(std::string_view text, const std::string& source) {
  std::vector<StoredTerms> systems;
  detail::for_each_stored(
      text, source,
      {detail::kAnyDimension, true,
       [&](detail::StoredSprings&& springs) { systems.push_back(detail::terms_of(std::move(springs))); },
       [&](StoredTerms&& terms) { systems.push_back(std::move(terms)); }});
  return systems;
}

std::vector<StoredTerms> read_stored_terms(const std::filesystem::path& path) {
  return parse_stored_terms(detail::read_text(path), path.string());
}

std::string to_json(const StoredTerms& stored) {
  std::string line;
  detail::stored::located(detail::kCannot, [&] {
    const System& system = stored.system;
    if (const std::string problem = validate(system, stored.start, false); !problem.empty())
      detail::stored::refuse(problem);
    detail::OrderedJson object = detail::begin_object(2, stored.name, stored.origin);
    object["dim"] = system.dim();
    object["nodes"] = system.nodes();
    auto fixed = detail::OrderedJson::array();
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) fixed.push_back(i);
    }
    if (!fixed.empty()) object["fixed"] = std::move(fixed);
    object["start"] = detail::points_to_json(stored.start);
    auto& terms = object["terms"] = detail::OrderedJson::array();
    for (int t = 0; t < system.term_count(); ++t)
      terms.push_back(detail::term_to_json(system.term(t), system.nodes()));
    line = detail::line_of(object);
  });
  return line;
}

void write_stored_terms(std::ostream& out, const StoredTerms& stored) { out << to_json(stored) + '\n'; }

}  // namespace ASTERISM_ABI
}  // namespace asterism
