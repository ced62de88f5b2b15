#pragma once

// Shared by the sources of the module: the classes that several of them bind, and NumPy arrays as points.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "numerics.hpp"

namespace asterism::python {

namespace py = pybind11;

void bind_systems(py::module_& m);
void bind_random(py::module_& m);
void bind_solvers(py::module_& m);
void bind_batch(py::module_& m);
void bind_discrete(py::module_& m);
void bind_graph(py::module_& m);
void bind_json(py::module_& m);
void bind_trackers(py::module_& m);

/// asterism.SpringSystem.
struct AnySystem {
  std::variant<System<2>, System<3>> of_dim;

  template <typename F>
  decltype(auto) visit(F&& f) {
    return std::visit(std::forward<F>(f), of_dim);
  }
};

/// Holds `busy` at true while it lives: other threads, which may run while the GIL is released, get a
/// RuntimeError instead of a race. Construct and destroy it with the GIL held.
class Exclusive {
 public:
  Exclusive(bool& busy, const char* what) : busy_(busy) {
    if (busy) throw std::runtime_error(std::string(what) + " is in use by another thread");
    busy = true;
  }
  ~Exclusive() { busy_ = false; }
  Exclusive(const Exclusive&) = delete;
  Exclusive& operator=(const Exclusive&) = delete;

 private:
  bool& busy_;
};

using Shape = std::vector<py::ssize_t>;

inline std::string text_of(const Shape& shape) {
  std::string text = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) text += (i > 0 ? ", " : "") + std::to_string(shape[i]);
  return text + (shape.size() == 1 ? ",)" : ")");
}

inline Shape shape_of(const py::array& array) { return {array.shape(), array.shape() + array.ndim()}; }

inline std::string type_name(const py::handle& object) {
  return py::str(py::type::handle_of(object).attr("__name__")).cast<std::string>();
}

/// Input as a C-contiguous array of float64: the array itself if it is one, else a copy. Lists, scalars,
/// bools, integers and floats of any size are accepted; anything else is a TypeError that begins with `name`.
inline py::array_t<double> numbers(const py::object& object, const char* name) {
  constexpr int kFlags = py::array::c_style | py::array::forcecast;
  const auto array = py::array::ensure(object);
  const bool is_of_numbers =
      array && std::string_view("biuf").find(array.dtype().kind()) != std::string_view::npos;
  const auto result =
      is_of_numbers ? py::array_t<double, kFlags>::ensure(array) : py::array_t<double, kFlags>();
  if (!is_of_numbers || !result) {
    PyErr_Clear();
    const bool says_no_more = !py::isinstance<py::array>(object) && (!array || array.dtype().kind() == 'O');
    throw py::type_error(std::string(name) + ": expected numbers, found " +
                         (says_no_more ? type_name(object) : py::str(array.dtype()).cast<std::string>()));
  }
  if (reinterpret_cast<std::uintptr_t>(result.data()) % alignof(double) == 0) return result;
  return result.attr("copy")();
}

/// The same; ValueError for any other shape.
inline py::array_t<double> numbers(const py::object& object, const char* name, const Shape& shape) {
  auto array = numbers(object, name);
  if (const Shape found = shape_of(array); found != shape) {
    throw py::value_error(std::string(name) + ": expected shape " + text_of(shape) + ", found " +
                          text_of(found));
  }
  return array;
}

/// The given array, for a result to be written into. TypeError or ValueError, which describes what is
/// expected, if that cannot be done without a copy.
inline py::array_t<double> output(const py::object& object, const char* name, const Shape& shape) {
  const std::string expected =
      std::string(name) +
      ": the result is written into it, so expected a C-contiguous, writeable NumPy array "
      "of float64 and shape " +
      text_of(shape) + "; found ";
  if (!py::isinstance<py::array>(object)) throw py::type_error(expected + type_name(object));
  const auto array = py::reinterpret_borrow<py::array>(object);
  if (!py::isinstance<py::array_t<double>>(array)) {
    throw py::type_error(expected + py::str(array.dtype()).cast<std::string>());
  }
  if (const Shape found = shape_of(array); found != shape) {
    throw py::value_error(expected + "shape " + text_of(found));
  }
  if (!(array.flags() & py::array::c_style) ||
      reinterpret_cast<std::uintptr_t>(array.data()) % alignof(double) != 0) {
    throw py::value_error(expected + "one that is not C-contiguous or not aligned");
  }
  if (!array.writeable()) throw py::value_error(expected + "one that is read-only");
  return py::reinterpret_borrow<py::array_t<double>>(array);
}

/// (N, Dim) in C order has the same memory as Dim x N in Eigen's order.
template <int Dim>
auto map_points(const py::array_t<double>& array) {
  return Eigen::Map<const typename System<Dim>::Points>(array.data(), Dim, array.shape(0));
}

template <int Dim>
typename System<Dim>::Points points_of(const System<Dim>& system, const py::object& x) {
  return map_points<Dim>(numbers(x, "x", {system.nodes(), Dim}));
}

/// An array of this shape, in C order, that owns the matrix; nothing is copied.
template <typename Matrix>
py::array owned(Matrix matrix, const Shape& shape) {
  auto* held = new Matrix(std::move(matrix));
  const py::capsule owner(held, [](void* pointer) { delete static_cast<Matrix*>(pointer); });
  return py::array_t<double>(shape, held->data(), owner);
}

/// Throws a defect as ValueError: for functions that, unlike solvers, do not validate.
void require_valid(const Defect& defect);

/// The value of an option: a NumPy scalar, or an array of no dimensions, as the equivalent Python object
/// (numpy.bool_ is not a bool, nor numpy.float32 a float), anything else as it is.
inline py::object plain(const py::handle& value) {
  const bool is_numpys =
      py::isinstance<py::array>(value) || py::isinstance(value, py::module_::import("numpy").attr("generic"));
  if (is_numpys && value.attr("ndim").cast<int>() == 0) return value.attr("item")();
  return py::reinterpret_borrow<py::object>(value);
}

}  // namespace asterism::python

/// asterism.Status is an enum.IntEnum, which NumPy compares with arrays of its values.
template <>
struct pybind11::detail::type_caster<asterism::Status> {
  PYBIND11_TYPE_CASTER(asterism::Status, const_name("Status"));
  static object type() { return module_::import("asterism._asterism").attr("Status"); }
  bool load(handle source, bool /*convert*/) {
    if (!isinstance(source, type())) return false;
    value = static_cast<asterism::Status>(source.cast<int>());
    return true;
  }
  static handle cast(asterism::Status status, return_value_policy /*policy*/, handle /*parent*/) {
    return type()(static_cast<int>(status)).release();
  }
};
