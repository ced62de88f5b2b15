// Calls with arguments that do not fit: an error that names the wrong one, for all functions of the module.

#include <string>

#include "bindings.hpp"

namespace asterism::python {

namespace {

PyCFunctionWithKeywords dispatcher = nullptr;  // pybind11's, the same for all functions

PyCFunctionWithKeywords with_keywords(PyCFunction function) {
  return reinterpret_cast<PyCFunctionWithKeywords>(reinterpret_cast<void (*)()>(function));
}

/// Puts the error of asterism.names.wrong_arguments() in the place of pybind11's list of signatures.
void explain(PyObject* arguments, PyObject* named) {
  py::error_already_set error;
  try {
    const std::string text = py::str(error.value());
    if (text.find("(): incompatible ") == std::string::npos) return error.restore();
    const py::object better =
        py::module_::import("asterism.names")
            .attr("wrong_arguments")(text, py::handle(arguments),
                                     named ? py::reinterpret_borrow<py::dict>(named) : py::dict());
    PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(better.ptr())), better.ptr());
  } catch (py::error_already_set& other) {
    other.restore();
  }
}

PyObject* call(PyObject* self, PyObject* arguments, PyObject* named) {
  PyObject* const result = dispatcher(self, arguments, named);
  if (!result && PyErr_ExceptionMatches(PyExc_TypeError)) explain(arguments, named);
  return result;
}

/// Lets a function go through call(), if it is one of pybind11's.
void reroute(PyObject* object) {
  if (object && PyInstanceMethod_Check(object)) object = PyInstanceMethod_GET_FUNCTION(object);
  if (!object || !PyCFunction_CheckExact(object)) return;
  PyMethodDef* const method = reinterpret_cast<PyCFunctionObject*>(object)->m_ml;
  if (method->ml_flags != (METH_VARARGS | METH_KEYWORDS)) return;
  if (with_keywords(method->ml_meth) == dispatcher)
    method->ml_meth = reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(call));
}

void reroute_members(const py::handle& object) {
  const py::dict members = object.attr("__dict__");
  for (const auto& [name, member] : members) {
    if (py::isinstance<py::staticmethod>(member)) {
      reroute(member.attr("__func__").ptr());
    } else if (PyObject_TypeCheck(member.ptr(), &PyProperty_Type)) {
      for (const char* part : {"fget", "fset"}) reroute(member.attr(part).ptr());
    } else {
      reroute(member.ptr());
    }
  }
}

}  // namespace

void explain_arguments(py::module_& m) {
  dispatcher = with_keywords(
      reinterpret_cast<PyCFunctionObject*>(py::object(m.attr("_numbers")).ptr())->m_ml->ml_meth);
  for (const auto& [name, member] : py::dict(m.attr("__dict__"))) {
    if (py::isinstance<py::type>(member)) reroute_members(member);
  }
  reroute_members(m);
}

}  // namespace asterism::python
