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

std::string text_of(const Shape& shape);

Shape shape_of(const py::array& array);

std::string type_name(const py::handle& object);

/// Whether it is a NumPy array, and of no subclass, such as numpy.matrix.
bool is_plain_array(const py::object& object);

/// The input without its mask, of which NumPy would show the numbers beneath: masked entries become
/// `missing`, and are a TypeError that begins with `name` where there is none.
py::object unmasked(const py::object& object, const std::string& name, std::optional<double> missing = {});

/// Input as an array of real numbers: lists, scalars, bools, integers and floats of any size are accepted;
/// anything else is a TypeError that begins with `name`; so are masked entries, see unmasked().
py::array real_numbers(const py::object& object, const std::string& name);

/// The same as a C-contiguous array of float64: the array itself if it is one, else a new one.
py::array_t<double> numbers(const py::object& object, const char* name);

/// The same; ValueError for any other shape.
py::array_t<double> numbers(const py::object& object, const char* name, const Shape& shape);

/// The same as an array of C++.
template <std::size_t Count>
std::array<double, Count> numbers(const py::object& object, const char* name) {
  std::array<double, Count> values;
  std::copy_n(numbers(object, name, {Count}).data(), Count, values.begin());
  return values;
}

/// Assigns numbers to all of an array, by NumPy's rules for shapes that differ; ValueError where they do not
/// fit.
void assign(const py::array& to, const py::object& values, const char* name);

/// The given array, for a result to be written into. TypeError or ValueError, which describes what is
/// expected, if that cannot be done without a copy.
py::array_t<double> output(const py::object& object, const char* name, const Shape& shape);

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
std::string shown(const py::handle& value);

/// The value of an option: a NumPy scalar, or an array of no dimensions, as the equivalent Python object
/// (numpy.bool_ is not a bool, nor numpy.float32 a float), anything else, and numpy.ma.masked, as it is.
py::object plain(const py::handle& value);

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
