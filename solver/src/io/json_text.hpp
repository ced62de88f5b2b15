#pragma once

#include <algorithm>
#include <array>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/edit_distance.hpp>
#include <asterism/solver/base/finite.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// Values of JSON that are read without loss, and errors that name their place.

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail::stored {

using Json = nlohmann::json;

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

}  // namespace detail::stored
}  // namespace ASTERISM_ABI
}  // namespace asterism
