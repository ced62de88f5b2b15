#pragma once

// asterism.System, for the sources of the module that do not bind it.

#include <pybind11/pybind11.h>

#include <asterism/solver/terms/system.hpp>

namespace asterism::python {

namespace py = pybind11;

/// An asterism.System of a system without functions of a user's own.
py::object to_python(asterism::System system);
/// The system in an asterism.System; null for any other object.
const asterism::System* system_in(const py::handle& object);

}  // namespace asterism::python
