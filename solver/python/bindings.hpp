#pragma once

// Shared by the sources of the module: the classes that several of them bind, and NumPy arrays as points.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <array>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "numerics.hpp"

namespace asterism::python {

namespace py = pybind11;

void bind_systems(py::module_& m);
void bind_random(py::module_& m);
void bind_solvers(py::module_& m);
void bind_system(py::module_& m);
void bind_batch(py::module_& m);
void bind_discrete(py::module_& m);
void bind_graph(py::module_& m);
void bind_ranges(py::module_& m);
void bind_placement(py::module_& m);
void bind_pose(py::module_& m);
void bind_json(py::module_& m);
void bind_trackers(py::module_& m);

/// After all of these: functions that get wrong arguments name them.
void explain_arguments(py::module_& m);

/// asterism.SpringSystem. Use it with the GIL held.
class AnySystem {
 public:
  using BoundToPython = void;

  template <int Dim>
  AnySystem(System<Dim> system) : of_dim_(std::move(system)) {}

  template <typename F>
  decltype(auto) visit(F&& f) {
    return std::visit(std::forward<F>(f), of_dim_);
  }

  /// The same, for what changes the system: RuntimeError while another thread, or the solve that an
  /// on_iteration belongs to, reads it.
  template <typename F>
  decltype(auto) change(F&& f) {
    if (readers_ > 0) {
      throw std::runtime_error(
          "this asterism.SpringSystem is in use: it cannot be changed while it is solved or evaluated");
    }
    return visit(std::forward<F>(f));
  }

  /// While it lives, the system cannot be changed.
  class Reading {
   public:
    explicit Reading(AnySystem& system) : readers_(system.readers_) { ++readers_; }
    ~Reading() { --readers_; }
    Reading(const Reading&) = delete;
    Reading& operator=(const Reading&) = delete;

   private:
    int& readers_;
  };

  /// f() without the GIL; f reads the system.
  template <typename F>
  auto without_gil(F&& f) {
    const Reading reading(*this);
    const py::gil_scoped_release release;
    return f();
  }

  /// What an array that was set to None held: NumPy arrays that show it may outlive it, and its memory is
  /// used again when the array is set.
  template <int Dim>
  struct Removed {
    decltype(System<Dim>::rest_offset) rest_offset;
    decltype(System<Dim>::loads) loads;
  };
  template <int Dim>
  Removed<Dim>& removed() {
    return std::get<Removed<Dim>>(removed_);
  }

 private:
  std::variant<System<2>, System<3>> of_dim_;
  std::tuple<Removed<2>, Removed<3>> removed_;
  int readers_ = 0;
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

/// Whether it is a NumPy array, and of no subclass, such as numpy.matrix.
inline bool is_plain_array(const py::object& object) {
  return Py_TYPE(object.ptr()) == reinterpret_cast<PyTypeObject*>(py::detail::npy_api::get().PyArray_Type_);
}

/// The input without its mask, of which NumPy would show the numbers beneath: masked entries become
/// `missing`, and are a TypeError that begins with `name` where there is none.
inline py::object unmasked(const py::object& object, const std::string& name,
                           std::optional<double> missing = {}) {
  if (is_plain_array(object)) return object;
  const py::module_ ma = py::module_::import("numpy.ma");
  const py::object type = ma.attr("MaskedArray");
  const auto has_masked = [&ma](const py::handle& array) { return ma.attr("is_masked")(array).cast<bool>(); };
  const auto require_missing = [&] {
    if (!missing) throw py::type_error(name + ": expected numbers, found masked ones");
  };
  py::object found = object;
  if (py::isinstance<py::list>(object) || py::isinstance<py::tuple>(object)) {
    for (const py::handle row : object) {
      if (!py::isinstance(row, type) || !has_masked(row)) continue;
      require_missing();
      found = ma.attr("asarray")(object);
      break;
    }
  }
  if (!py::isinstance(found, type)) return object;
  if (!has_masked(found)) return found.attr("data");
  require_missing();
  if (found.attr("dtype").attr("kind").cast<std::string>() != "f") found = found.attr("astype")("float64");
  return found.attr("filled")(*missing);
}

/// Input as an array of real numbers: lists, scalars, bools, integers and floats of any size are accepted;
/// anything else is a TypeError that begins with `name`; so are masked entries, see unmasked().
inline py::array real_numbers(const py::object& object, const std::string& name) {
  auto array = py::array::ensure(unmasked(object, name));
  if (array && std::string_view("biuf").find(array.dtype().kind()) != std::string_view::npos) return array;
  PyErr_Clear();
  const bool says_no_more = !py::isinstance<py::array>(object) && (!array || array.dtype().kind() == 'O');
  throw py::type_error(name + ": expected numbers, found " +
                       (says_no_more ? type_name(object) : py::str(array.dtype()).cast<std::string>()));
}

/// The same as a C-contiguous array of float64: the array itself if it is one, else a new one.
inline py::array_t<double> numbers(const py::object& object, const char* name) {
  using Numbers = py::array_t<double, py::array::c_style>;
  py::array array = real_numbers(object, name);
  if (!is_plain_array(array) || !py::isinstance<Numbers>(array))
    array = py::module_::import("numpy").attr("asarray")(array, "float64", py::arg("order") = "C");
  const auto result = py::reinterpret_borrow<Numbers>(array);
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

/// The same as an array of C++.
template <std::size_t Count>
std::array<double, Count> numbers(const py::object& object, const char* name) {
  std::array<double, Count> values;
  std::copy_n(numbers(object, name, {Count}).data(), Count, values.begin());
  return values;
}

/// Assigns numbers to all of an array, by NumPy's rules for shapes that differ; ValueError where they do not
/// fit.
inline void assign(const py::array& to, const py::object& values, const char* name) {
  const py::array from = numbers(values, name);
  try {
    to.attr("__setitem__")(py::ellipsis(), from);
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError)) throw;
    throw py::value_error(std::string(name) + ": expected shape " + text_of(shape_of(to)) + ", found " +
                          text_of(shape_of(from)));
  }
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
  unmasked(object, name);
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

/// Lets every protocol of pickle work as protocol 2: with the older ones, Python would make the object by
/// another class's __new__, which ends the process. Objects that cannot be pickled are a TypeError.
template <typename Class>
void def_reduce(Class& type) {
  type.def("__reduce_ex__", [](const py::object& self, int protocol) {
    const py::object object = py::module_::import("builtins").attr("object");
    return object.attr("__reduce_ex__")(self, std::max(protocol, 2));
  });
}

/// A wrong value, in a message of one line.
inline std::string shown(const py::handle& value) {
  return py::module_::import("asterism.names").attr("shown")(value).cast<std::string>();
}

/// The value of an option: a NumPy scalar, or an array of no dimensions, as the equivalent Python object
/// (numpy.bool_ is not a bool, nor numpy.float32 a float), anything else, and numpy.ma.masked, as it is.
inline py::object plain(const py::handle& value) {
  const bool is_numpys =
      py::isinstance<py::array>(value) || py::isinstance(value, py::module_::import("numpy").attr("generic"));
  const auto is_masked = [&value] {
    return py::hasattr(value, "mask") && py::bool_(value.attr("mask").attr("any")());
  };
  if (is_numpys && value.attr("ndim").cast<int>() == 0 && !is_masked()) return value.attr("item")();
  return py::reinterpret_borrow<py::object>(value);
}

}  // namespace asterism::python

/// The classes of the module; each source adds its own, by the member type BoundToPython where it is not the
/// library's.
template <typename T>
inline constexpr bool kIsBoundToPython = requires {
  typename T::BoundToPython;
};
template <>
inline constexpr bool kIsBoundToPython<asterism::Topology<>> = true;
template <>
inline constexpr bool kIsBoundToPython<asterism::Summary> = true;
template <>
inline constexpr bool kIsBoundToPython<asterism::BatchSummary> = true;
template <>
inline constexpr bool kIsBoundToPython<asterism::Certificate> = true;

/// An object of such a class that was made by __new__ alone, as a damaged pickle may do, has no value yet:
/// pybind11 would give out memory that nothing was written to.
template <typename T>
class pybind11::detail::type_caster<T, std::enable_if_t<kIsBoundToPython<T>>>
    : public pybind11::detail::type_caster_base<T> {
 public:
  bool load(handle source, bool convert) {
    if (!type_caster_base<T>::load(source, convert)) return false;
    if (source.is_none()) return true;
    auto* object = reinterpret_cast<instance*>(source.ptr());
    if (object->owned && !object->get_value_and_holder().holder_constructed()) {
      throw type_error(asterism::python::type_name(source) +
                       ": the object has no values; it was made by __new__ alone");
    }
    return true;
  }
};

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
