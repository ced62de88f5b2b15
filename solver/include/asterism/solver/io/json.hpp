#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/edit_distance.hpp>
#include <asterism/solver/detail/finite.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/message.hpp>
#include <cerrno>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <ostream>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

/// @file
/// Spring systems as JSON, so that a hard case can be kept and sent: docs/system-json.md is the format. A
/// file holds one system, an array of them, or one a line (JSON lines). Needs target asterism::json.

namespace asterism {
inline namespace ASTERISM_ABI {

/// A system that the format holds: of double, any dimension and bounds on the number of nodes; springs
/// (Springs) or springs on anisotropic anchors.
template <typename S>
concept StorableSystem = std::same_as<typename S::Scalar, double> &&
    std::same_as<typename S::Model, Model<Hooke, Quadratic, S::Model::kAnchorShape>>;

/// A spring system and the other contents of its file.
template <StorableSystem System = SpringSystem<double, 2>>
struct StoredSystem {
  System system;                                     ///< the springs themselves
  typename System::Points start;                     ///< start of a solve, Dim x N [px]; part of the problem
  std::string name;                                  ///< empty if it has none
  nlohmann::json origin = nlohmann::json::object();  ///< of any form: where the system comes from
};

/// A system of the plane or of space, whichever its file holds.
using AnyStoredSystem =
    std::variant<StoredSystem<SpringSystem<double, 2>>, StoredSystem<SpringSystem<double, 3>>>;

namespace detail::stored {

using Json = nlohmann::json;

inline constexpr int kVersion = 1;
inline constexpr std::array<const char*, 14> kKeys = {
    "asterism_system",  "name",         "origin", "dim",         "anchors",
    "anchor_stiffness", "anchor_shape", "links",  "rest_length", "link_stiffness",
    "rest_offset",      "loads",        "fixed",  "start",
};

/// The texts one after the other.
template <typename... Texts>
std::string concat(const Texts&... texts) {
  std::string all;
  ((all += texts), ...);
  return all;
}

template <typename... Texts>
[[noreturn]] void refuse(const Texts&... texts) {
  throw std::runtime_error(concat(texts...));
}

/// A value's place in the object, written out only where it is needed: "anchors[2][0]".
struct Place {
  std::string_view key;
  std::array<std::ptrdiff_t, 3> indices{-1, -1, -1};

  std::string text() const {
    std::string text(key);
    for (const std::ptrdiff_t i : indices) {
      if (i >= 0) text += concat("[", std::to_string(i), "]");
    }
    return text;
  }
  Place operator[](std::ptrdiff_t i) const {
    Place inner = *this;
    *std::find(inner.indices.begin(), inner.indices.end(), -1) = i;
    return inner;
  }
};

[[noreturn]] inline void refuse_type(const Place& place, const char* expected, const Json& found) {
  refuse(place.text(), ": expected ", expected, ", found ", found.type_name());
}

inline const Json& member(const Json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end()) refuse(key, " is missing");
  return *found;
}

inline const Json& array(const Json& value, const Place& place) {
  if (!value.is_array()) refuse_type(place, "an array", value);
  return value;
}

/// `unit` says why there must be as many: "one for each node".
inline const Json& array(const Json& value, const Place& place, std::ptrdiff_t count, const char* unit) {
  if (std::ssize(array(value, place)) != count) {
    refuse(place.text(), ": expected ", std::to_string(count), " (", unit, "), found ",
           std::to_string(value.size()));
  }
  return value;
}

inline double number(const Json& value, const Place& place) {
  if (!value.is_number()) refuse_type(place, "a number", value);
  const double result = value.get<double>();
  if (!detail::is_finite(result)) refuse(place.text(), " is not finite");
  return result;
}

/// The integer that a number is, also one written as 2.0 or 2e0, as in JSON Schema; the nearest one of 64
/// bits if it has more. Anything else is refused.
inline std::int64_t integer(const Json& value, const Place& place, const char* expected) {
  using Limits = std::numeric_limits<std::int64_t>;
  if (!value.is_number()) refuse_type(place, expected, value);
  if (value.is_number_unsigned() && value.get<std::uint64_t>() > Limits::max()) return Limits::max();
  if (value.is_number_integer()) return value.get<std::int64_t>();
  const auto number = value.get<double>();
  if (number != std::floor(number)) refuse(place.text(), ": expected ", expected, ", found ", value.dump());
  if (std::abs(number) < 0x1p63) return static_cast<std::int64_t>(number);
  return number < 0 ? Limits::min() : Limits::max();
}

/// A node's index, or -1 for an integer that cannot be one.
inline int node(const Json& value, const Place& place) {
  const std::int64_t index = integer(value, place, "a node's index");
  return 0 <= index && index <= std::numeric_limits<int>::max() ? static_cast<int>(index) : -1;
}

template <typename Vector>
void read_vector(const Json& value, const Place& place, const char* unit, Vector& vector) {
  array(value, place, vector.size(), unit);
  std::ptrdiff_t i = 0;
  for (const Json& entry : value) {
    const double x = number(entry, place[i]);
    if (x < 0) refuse(place[i].text(), " is negative");
    vector[i++] = x;
  }
}

/// A list of points to the columns of `points`.
template <typename Points>
void read_points(const Json& value, const Place& place, const char* unit, Points&& points) {
  array(value, place, points.cols(), unit);
  std::ptrdiff_t i = 0;
  for (const Json& point : value) {
    array(point, place[i], points.rows(), "dim");
    std::ptrdiff_t d = 0;
    for (const Json& entry : point) {
      points(d, i) = number(entry, place[i][d]);
      ++d;
    }
    ++i;
  }
}

/// A key as an error shows it: on one line, and not all of a very long one.
inline std::string key_text(std::string_view key) {
  return Json(key.substr(0, 40)).dump(-1, ' ', false, Json::error_handler_t::replace);
}

inline void check_keys(const Json& object) {
  for (const auto& [key, value] : object.items()) {
    if (std::find(kKeys.begin(), kKeys.end(), key) != kKeys.end()) continue;
    const std::string_view unknown = std::string_view(key).substr(0, 40);  // the distance takes its length
    refuse("unknown key ", key_text(unknown), " (the nearest known one is ",
           key_text(*nearest(unknown, kKeys)), ")");
  }
}

/// The object's dimension, once its version and keys are known to be right.
inline int checked_dimension(const Json& object) {
  if (!object.is_object()) refuse("expected an object, found ", object.type_name());
  // A later version may have any keys, so that it comes first.
  const Json& version = member(object, "asterism_system");
  if (integer(version, {"asterism_system"}, "an integer") != kVersion)
    refuse("asterism_system is ", version.dump(), ", known is version 1");
  check_keys(object);
  const std::int64_t dim = integer(member(object, "dim"), {"dim"}, "an integer");
  if (dim < 1 || dim > std::numeric_limits<int>::max()) refuse("dim is ", object["dim"].dump());
  return static_cast<int>(dim);
}

/// How deep values may be nested: more could use up the stack where they are copied.
constexpr int kMaxDepth = 100;

inline int depth_of(const Json& value) {
  if (!value.is_structured()) return 0;
  int deepest = 0;
  for (const Json& element : value) deepest = std::max(deepest, depth_of(element));
  return deepest + 1;
}

/// A character that a parser reads; `next` then is the one after it.
class Cursor {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  Cursor(const char* at, const char** next) : at_(at), next_(next) {}
  reference operator*() const { return *at_; }
  Cursor& operator++() {
    *next_ = ++at_;
    return *this;
  }
  Cursor operator++(int) {
    const Cursor before = *this;
    ++*this;
    return before;
  }
  friend bool operator==(const Cursor& a, const Cursor& b) { return a.at_ == b.at_; }
  friend bool operator!=(const Cursor& a, const Cursor& b) { return a.at_ != b.at_; }

 private:
  const char* at_;
  const char** next_;
};

/// Builds a value from what nlohmann's parser finds, and refuses what a Json would lose: a key that is given
/// twice, a number that is not 0 but would be read as 0, and an integer of more than 64 bits in an origin,
/// which is no double. Refuses nesting deeper than kMaxDepth, too.
class Builder final : public nlohmann::json_sax<Json> {
 public:
  explicit Builder(bool is_origin) : is_origin_(is_origin) {}

  Json result;
  std::size_t bytes_read = 0;  // where the text turned out not to be JSON, otherwise 0

  bool null() override { return put(nullptr); }
  bool boolean(bool value) override { return put(value); }
  bool number_integer(std::int64_t value) override { return put(value); }
  bool number_unsigned(std::uint64_t value) override { return put(value); }
  bool string(std::string& value) override { return put(std::move(value)); }
  bool binary(Json::binary_t& value) override { return put(std::move(value)); }
  bool number_float(double value, const std::string& text) override {
    if ((is_origin_ || in_origin_) && text.find_first_not_of("-0123456789") == std::string::npos)
      refuse("the origin's integer ", text.substr(0, 40), " has more than 64 bits: give it as a string");
    if (value == 0 &&
        text.substr(0, text.find_first_of("eE")).find_first_of("123456789") != std::string::npos)
      refuse("number underflow parsing '", text.substr(0, 40), "'");
    return put(value);
  }
  bool start_object(std::size_t) override { return open(Json::object()); }
  bool start_array(std::size_t) override { return open(Json::array()); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }
  bool key(std::string& key) override {
    const auto [place, is_new] = open_.back()->get_ref<Json::object_t&>().try_emplace(key);
    if (!is_new) refuse("duplicate key ", key_text(key));
    member_ = &place->second;
    const bool is_of_system = open_.size() == (open_.front()->is_array() ? 2u : 1u);
    if (is_of_system) in_origin_ = key == "origin";
    return true;
  }
  bool parse_error(std::size_t position, const std::string& /*token*/, const Json::exception& e) override {
    bytes_read = position;
    // "[json.exception...] parse error at line 1, column 2: reason", or "[json.exception...] number overflow"
    const std::string what = e.what();
    const bool is_number = dynamic_cast<const Json::out_of_range*>(&e) != nullptr;
    const std::size_t end = what.find(is_number ? "] " : ": ");
    refuse(is_number ? "" : "not JSON: ", what.substr(end == std::string::npos ? 0 : end + 2, 200));
  }

 private:
  template <typename Value>
  bool put(Value&& value) {
    add(std::forward<Value>(value));
    return true;
  }
  template <typename Value>
  Json& add(Value&& value) {
    if (open_.empty()) return result = std::forward<Value>(value);
    if (open_.back()->is_object()) return *member_ = std::forward<Value>(value);
    return open_.back()->emplace_back(std::forward<Value>(value));
  }
  bool open(Json value) {
    if (open_.size() >= kMaxDepth) refuse("is nested more than ", std::to_string(kMaxDepth), " deep");
    Json& added = add(std::move(value));
    open_.push_back(&added);
    return true;
  }
  bool close() {
    open_.pop_back();
    return true;
  }

  std::vector<Json*> open_;  // objects and arrays around what comes next
  Json* member_ = nullptr;   // of the innermost object: the value of the last key
  bool is_origin_, in_origin_ = false;
};

/// Parses `text`, which begins in line `line` of the source, a system or (is_origin) the origin of one.
/// Errors are "SOURCE:LINE: ...".
inline Json parse(std::string_view text, const std::string& source, std::ptrdiff_t line,
                  bool is_origin = false) {
  const char* next = text.data();
  Builder builder(is_origin);
  try {
    Json::sax_parse(Cursor(text.data(), &next), Cursor(text.data() + text.size(), nullptr), &builder);
  } catch (const std::runtime_error& e) {
    // The last byte may be one after a number, which shows its end.
    const std::size_t bytes = std::max<std::size_t>(
        builder.bytes_read > 0 ? builder.bytes_read : static_cast<std::size_t>(next - text.data()), 1);
    const std::string_view read = text.substr(0, bytes - 1);
    line += std::count(read.begin(), read.end(), '\n');
    refuse(source, ":", std::to_string(line), ": ", e.what());
  }
  return std::move(builder.result);
}

/// Calls work(); what it refuses gets the place.
template <typename Work>
void located(const std::string& place, Work&& work) {
  try {
    work();
  } catch (const std::runtime_error& e) {
    refuse(place, ": ", e.what());
  }
}

/// Calls visit(object) for each system of the text; a std::runtime_error of it gets the object's place.
template <typename Visit>
void for_each_object(std::string_view text, const std::string& source, Visit&& visit) {
  const auto value = [&visit](const Json& parsed, const std::string& place) {
    if (!parsed.is_array()) return located(place, [&] { visit(parsed); });
    std::size_t i = 0;
    for (const Json& object : parsed)
      located(concat(place, ": system ", std::to_string(i++)), [&] { visit(object); });
  };

  bool first = true;
  std::ptrdiff_t line_number = 1;
  for (std::string_view rest = text; !rest.empty(); ++line_number) {
    const std::string_view line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(rest.size(), line.size() + 1));
    if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    // It is JSON lines if the first line is a value by itself.
    if (first && !Json::accept(line.begin(), line.end())) {
      return value(parse(text, source, 1), source);
    }
    first = false;
    const std::string place = concat(source, ":", std::to_string(line_number));
    value(parse(line, source, line_number), place);
  }
}

inline std::string read_text(const std::filesystem::path& path) {
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

/// Refuses an origin that could not be read back.
inline void require_writable_origin(const Json& origin) {
  if (!origin.is_object()) refuse("origin is not an object but ", origin.type_name());
  // Around it are the system's object, and a list where there are several.
  if (depth_of(origin) > kMaxDepth - 2)
    refuse("origin is nested more than ", std::to_string(kMaxDepth - 2), " deep");
  const Json leaves = origin.flatten();
  for (const auto& [path, value] : leaves.items()) {
    if (value.is_number_float() && !detail::is_finite(value.template get<double>()))
      refuse("origin", path, " is not finite");
  }
}

template <typename Vector>
std::vector<double> numbers(const Vector& vector) {
  return {vector.begin(), vector.end()};
}

template <typename Points>
nlohmann::ordered_json points_to_json(const Points& points) {
  auto list = nlohmann::ordered_json::array();
  for (const auto& point : points.colwise()) list.push_back(numbers(point));
  return list;
}

}  // namespace detail::stored

/// The system that a JSON object holds. Throws std::runtime_error that names the field if the object is not
/// as docs/system-json.md says, has another dimension or more nodes than `System`, or has anisotropic anchors
/// and `System` does not (a System with anisotropic anchors also reads isotropic ones).
template <StorableSystem System = SpringSystem<double, 2>>
StoredSystem<System> system_from_json(const nlohmann::json& object) {
  using namespace detail::stored;
  constexpr int kDim = System::kDim;
  if (const int dim = checked_dimension(object); dim != kDim) {
    refuse("dim is ", std::to_string(dim), ", expected ", std::to_string(kDim));
  }
  const int nodes = static_cast<int>(array(member(object, "anchors"), {"anchors"}).size());
  std::vector<Link> links;
  const Json& pairs = array(member(object, "links"), {"links"});
  links.reserve(pairs.size());
  for (const Json& pair : pairs) {
    const Place place = Place{"links"}[std::ssize(links)];
    array(pair, place, 2, "nodes");
    links.push_back({node(pair[0], place[0]), node(pair[1], place[1])});
  }

  StoredSystem<System> result{
      .system = System(System::TopologyType::from_links(nodes, links)), .start = {}, .name = {}};
  System& system = result.system;
  if (const Defect& defect = system.defect()) {
    if (std::string_view(defect.subject) == "link") {
      refuse(Place{"links"}[defect.index].text(), " ", defect.problem);
    }
    refuse(std::string_view(Message(defect)));
  }
  constexpr auto kNode = "one for each node", kLink = "one for each link";
  read_points(object["anchors"], {"anchors"}, kNode, system.anchors);
  read_vector(member(object, "anchor_stiffness"), {"anchor_stiffness"}, kNode, system.anchor_stiffness);
  read_vector(member(object, "rest_length"), {"rest_length"}, kLink, system.rest_length);
  read_vector(member(object, "link_stiffness"), {"link_stiffness"}, kLink, system.link_stiffness);
  if (const auto offsets = object.find("rest_offset"); offsets != object.end()) {
    system.rest_offset.resize(kDim, system.link_count());
    read_points(*offsets, {"rest_offset"}, kLink, system.rest_offset);
  }
  if (const auto loads = object.find("loads"); loads != object.end()) {
    system.loads.resize(kDim, nodes);
    read_points(*loads, {"loads"}, kNode, system.loads);
  }
  const auto shapes = object.find("anchor_shape");
  if constexpr (System::kAnisotropic) {
    if (shapes != object.end()) array(*shapes, {"anchor_shape"}, nodes, kNode);
    for (int i = 0; i < nodes; ++i) {
      auto shape = system.anchor_shape.template block<kDim, kDim>(0, kDim * i);
      shape.setIdentity();
      if (shapes == object.end()) continue;
      read_points((*shapes)[static_cast<std::size_t>(i)], Place{"anchor_shape"}[i], "dim", shape);
      shape.transposeInPlace();  // rows were read as columns
    }
  } else if (shapes != object.end()) {
    refuse("anchor_shape: a system with anisotropic anchors, which was not asked for");
  }
  if (const auto fixed = object.find("fixed"); fixed != object.end()) {
    std::ptrdiff_t i = 0;
    for (const Json& entry : array(*fixed, {"fixed"})) {
      const Place place = Place{"fixed"}[i++];
      const int index = node(entry, place);
      if (index < 0 || index >= nodes) refuse(place.text(), " is out of range");
      system.fix(index);
    }
  }
  result.start = system.anchors;
  if (const auto start = object.find("start"); start != object.end()) {
    read_points(*start, {"start"}, kNode, result.start);
  }
  if (const auto name = object.find("name"); name != object.end()) {
    if (!name->is_string()) refuse_type({"name"}, "a string", *name);
    result.name = name->get<std::string>();
  }
  if (const auto origin = object.find("origin"); origin != object.end()) {
    if (!origin->is_object()) refuse_type({"origin"}, "an object", *origin);
    result.origin = *origin;
  }
  // No nodes, and shapes that are none.
  if (const Defect defect = detail::validate_values(system, result.start)) {
    refuse(std::string_view(Message(defect)));
  }
  return result;
}

/// The systems in `text`: a JSON object, an array of objects, or an object a line (JSON lines); blank text
/// holds none. Throws std::runtime_error "SOURCE:LINE: system INDEX: FIELD ...": the line for JSON lines and
/// for what cannot be read as a value, the index, from 0, for systems in an array; see system_from_json.
template <StorableSystem System>
std::vector<StoredSystem<System>> parse_systems(std::string_view text, const std::string& source = "text") {
  std::vector<StoredSystem<System>> systems;
  detail::stored::for_each_object(text, source, [&systems](const nlohmann::json& object) {
    systems.push_back(system_from_json<System>(object));
  });
  return systems;
}

/// The same as system_from_json for a system of the plane or of space.
inline AnyStoredSystem any_system_from_json(const nlohmann::json& object) {
  const int dim = detail::stored::checked_dimension(object);
  if (dim == 2) return system_from_json<SpringSystem<double, 2>>(object);
  if (dim == 3) return system_from_json<SpringSystem<double, 3>>(object);
  detail::stored::refuse("dim is ", std::to_string(dim), ", expected 2 or 3");
}

/// The same for systems of the plane and of space, also in one text.
inline std::vector<AnyStoredSystem> parse_systems(std::string_view text, const std::string& source = "text") {
  std::vector<AnyStoredSystem> systems;
  detail::stored::for_each_object(text, source, [&systems](const nlohmann::json& object) {
    systems.push_back(any_system_from_json(object));
  });
  return systems;
}

/// The systems in a file; also throws if the file cannot be read.
template <StorableSystem System>
std::vector<StoredSystem<System>> read_systems(const std::filesystem::path& path) {
  return parse_systems<System>(detail::stored::read_text(path), path.string());
}
inline std::vector<AnyStoredSystem> read_systems(const std::filesystem::path& path) {
  return parse_systems(detail::stored::read_text(path), path.string());
}

/// The JSON object of a system and a start (Dim x N); every double of it comes back bit for bit. Throws
/// std::runtime_error if a solver would refuse the values (NaN, infinity, a negative stiffness, ...; see
/// validate; components without an anchor are allowed), or if `origin` is not an object, is not finite, or is
/// nested more than 98 levels deep, which could not be read back.
template <StorableSystem System>
nlohmann::ordered_json system_to_json(const System& system, const typename System::Points& start,
                                      std::string_view name = {},
                                      const nlohmann::json& origin = nlohmann::json::object()) {
  using namespace detail::stored;
  const auto no_json = [](const auto&... why) { refuse("the system cannot be written: ", why...); };
  if (const Defect defect = detail::validate_values(system, start)) {
    no_json(std::string_view(Message(defect)));
  }
  located("the system cannot be written", [&origin] { require_writable_origin(origin); });

  nlohmann::ordered_json object;
  object["asterism_system"] = kVersion;
  if (!name.empty()) object["name"] = name;
  if (!origin.empty()) object["origin"] = origin;
  object["dim"] = System::kDim;
  object["anchors"] = points_to_json(system.anchors);
  object["anchor_stiffness"] = numbers(system.anchor_stiffness);
  if constexpr (System::kAnisotropic) {
    const auto shape = [&](int i) {
      return system.anchor_shape.template block<System::kDim, System::kDim>(0, System::kDim * i);
    };
    bool isotropic = true;  // a system that Springs alone can read is written as one
    for (int i = 0; i < system.nodes(); ++i) isotropic = isotropic && shape(i).isIdentity(0);
    if (!isotropic) {
      auto& shapes = object["anchor_shape"] = nlohmann::ordered_json::array();
      for (int i = 0; i < system.nodes(); ++i) shapes.push_back(points_to_json(shape(i).transpose()));
    }
  }
  auto& links = object["links"] = nlohmann::ordered_json::array();
  for (const Link& link : system.links()) links.push_back({link.i, link.j});
  object["rest_length"] = numbers(system.rest_length);
  object["link_stiffness"] = numbers(system.link_stiffness);
  if (system.has_offsets()) object["rest_offset"] = points_to_json(system.rest_offset);
  if (system.has_loads()) object["loads"] = points_to_json(system.loads);
  if (system.fixed_count() > 0) {
    auto& fixed = object["fixed"] = nlohmann::ordered_json::array();
    for (int i = 0; i < system.nodes(); ++i) {
      if (system.is_fixed(i)) fixed.push_back(i);
    }
  }
  object["start"] = points_to_json(start);
  return object;
}

/// Appends a system to a stream, as one line of JSON lines. Throws as system_to_json, also for text that is
/// not UTF-8, and then writes nothing. The stream's state says whether it was written.
template <StorableSystem System>
void write_system(std::ostream& out, const System& system, const typename System::Points& start,
                  std::string_view name = {}, const nlohmann::json& origin = nlohmann::json::object()) {
  const nlohmann::ordered_json object = system_to_json(system, start, name, origin);
  std::string line;
  try {
    line = object.dump();
  } catch (const nlohmann::json::exception&) {
    detail::stored::refuse("the system cannot be written: its name or origin is not UTF-8");
  }
  out << (line += '\n');
}
template <StorableSystem System>
void write_system(std::ostream& out, const StoredSystem<System>& stored) {
  write_system(out, stored.system, stored.start, stored.name, stored.origin);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
