// Arguments and results: NumPy arrays, shapes, and the messages about them, for all sources of the module.

#include "bindings.hpp"

#include <cstdint>

namespace asterism::python {

std::string text_of(const Shape& shape) {
  std::string text = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) text += (i > 0 ? ", " : "") + std::to_string(shape[i]);
  return text + (shape.size() == 1 ? ",)" : ")");
}

Shape shape_of(const py::array& array) { return {array.shape(), array.shape() + array.ndim()}; }

std::string type_name(const py::handle& object) {
  return py::str(py::type::handle_of(object).attr("__name__")).cast<std::string>();
}

bool is_plain_array(const py::object& object) {
  return Py_TYPE(object.ptr()) == reinterpret_cast<PyTypeObject*>(py::detail::npy_api::get().PyArray_Type_);
}

py::object unmasked(const py::object& object, const std::string& name, std::optional<double> missing) {
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

py::array real_numbers(const py::object& object, const std::string& name) {
  auto array = py::array::ensure(unmasked(object, name));
  if (array && std::string_view("biuf").find(array.dtype().kind()) != std::string_view::npos) return array;
  PyErr_Clear();
  const bool says_no_more = !py::isinstance<py::array>(object) && (!array || array.dtype().kind() == 'O');
  const bool is_convertible = array && array.dtype().kind() == 'O' && py::hasattr(object, "astype");
  throw py::type_error(name + ": expected numbers, found " +
                       (says_no_more ? type_name(object) : py::str(array.dtype()).cast<std::string>()) +
                       (is_convertible ? "; convert it, such as by .astype(float)" : ""));
}

py::array_t<double> numbers(const py::object& object, const char* name) {
  using Numbers = py::array_t<double, py::array::c_style>;
  py::array array = real_numbers(object, name);
  if (!is_plain_array(array) || !py::isinstance<Numbers>(array))
    array = py::module_::import("numpy").attr("asarray")(array, "float64", py::arg("order") = "C");
  const auto result = py::reinterpret_borrow<Numbers>(array);
  if (reinterpret_cast<std::uintptr_t>(result.data()) % alignof(double) == 0) return result;
  return result.attr("copy")();
}

py::array_t<double> numbers(const py::object& object, const char* name, const Shape& shape) {
  auto array = numbers(object, name);
  if (const Shape found = shape_of(array); found != shape) {
    throw py::value_error(std::string(name) + ": expected shape " + text_of(shape) + ", found " +
                          text_of(found));
  }
  return array;
}

void assign(const py::array& to, const py::object& values, const char* name) {
  const py::array from = numbers(values, name);
  try {
    to.attr("__setitem__")(py::ellipsis(), from);
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError)) throw;
    throw py::value_error(std::string(name) + ": expected shape " + text_of(shape_of(to)) + ", found " +
                          text_of(shape_of(from)));
  }
}

py::array_t<double> output(const py::object& object, const char* name, const Shape& shape) {
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

std::string shown(const py::handle& value) {
  return py::module_::import("asterism.names").attr("shown")(value).cast<std::string>();
}

py::object plain(const py::handle& value) {
  const bool is_numpys =
      py::isinstance<py::array>(value) || py::isinstance(value, py::module_::import("numpy").attr("generic"));
  const auto is_masked = [&value] {
    return py::hasattr(value, "mask") && py::bool_(value.attr("mask").attr("any")());
  };
  if (is_numpys && value.attr("ndim").cast<int>() == 0 && !is_masked()) return value.attr("item")();
  return py::reinterpret_borrow<py::object>(value);
}

}  // namespace asterism::python
