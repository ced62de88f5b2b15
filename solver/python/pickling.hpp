#pragma once

// Support of pickle and copy: a class's fields as a tuple, and back.

#include <pybind11/stl.h>

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <optional>
#include <set>
#include <type_traits>

#include "bindings.hpp"

namespace asterism::python {

/// The fields of a pickle; ValueError if their number is not `count`.
class Fields {
 public:
  Fields(py::tuple state, std::size_t count) : state_(std::move(state)) {
    if (state_.size() == count) return;
    throw py::value_error("pickled by another version of Asterism: expected " + std::to_string(count) +
                          " fields, found " + std::to_string(state_.size()));
  }
  py::object operator[](std::size_t i) const { return state_[i]; }

 private:
  py::tuple state_;
};

/// A copy of the text that lives as long as the process, as names of solvers and stages must. There are few
/// different ones. Call it with the GIL held.
inline std::string_view interned(const std::string& text) {
  static auto* const all = new std::set<std::string>;
  return *all->insert(text).first;
}

template <typename T>
constexpr bool kIsMatrix = std::is_base_of_v<Eigen::MatrixBase<T>, T>;

/// One field as an object of Python's own types, and back.
template <typename T>
py::object to_field(const T& value) {
  if constexpr (std::is_enum_v<T>) {
    return py::int_(static_cast<int>(value));
  } else if constexpr (std::is_same_v<T, Message>) {
    return py::str(std::string(std::string_view(value)));
  } else if constexpr (kIsMatrix<T>) {
    return py::cast(std::vector<double>(value.data(), value.data() + value.size()));
  } else {
    return py::cast(value);
  }
}

template <typename T>
void from_field(const py::object& field, T& value) {
  if constexpr (std::is_enum_v<T>) {
    value = static_cast<T>(field.cast<int>());
  } else if constexpr (std::is_same_v<T, Message>) {
    value = Message(field.cast<std::string>());
  } else if constexpr (std::is_same_v<T, std::string_view>) {
    value = interned(field.cast<std::string>());
  } else if constexpr (kIsMatrix<T>) {
    const auto numbers = field.cast<std::vector<double>>();
    if (numbers.size() != static_cast<std::size_t>(value.size()))
      throw py::value_error("a pickle of another size");
    std::copy(numbers.begin(), numbers.end(), value.data());
  } else {
    value = field.cast<T>();
  }
}

/// An argument for class_::def that pickles a T: visit(object, field) calls `field` on each field, in a fixed
/// order.
template <typename T, typename Visit>
auto pickled(Visit visit) {
  return py::pickle(
      [visit](const T& object) {
        py::list state;
        visit(object, [&state](const auto& field) { state.append(to_field(field)); });
        return py::tuple(state);
      },
      [visit](const py::tuple& state) {
        T object;
        std::size_t count = 0;
        visit(object, [&count](auto&) { ++count; });
        const Fields fields(state, count);
        std::size_t next = 0;
        visit(object, [&](auto& field) { from_field(fields[next++], field); });
        return object;
      });
}

/// Adds copy(), which does what copy.copy does for a class that can be pickled.
template <typename Class>
void def_copy(Class& type) {
  def_reduce(type);
  type.def(
      "copy", [](const py::object& self) { return py::module_::import("copy").attr("copy")(self); },
      "An object of its own with the same values, as copy.copy and copy.deepcopy make it.");
}

}  // namespace asterism::python
