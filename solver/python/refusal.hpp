#pragma once

// ValueErrors with the value that is wrong, which the library's messages do not have.

#include <pybind11/pybind11.h>

#include <string>
#include <string_view>

namespace asterism::python {

/// Raises a ValueError with the message and the value that it speaks of: one of `options`, or an entry of an
/// array of the system or of x. None for a system whose arrays have been checked before.
[[noreturn]] inline void refuse_value(std::string_view message, const pybind11::object& system,
                                      const pybind11::object& x, const pybind11::dict& options = {}) {
  const pybind11::object text = pybind11::module_::import("asterism.names")
                                    .attr("with_value")(std::string(message), system, x, options);
  throw pybind11::value_error(text.cast<std::string>());
}

}  // namespace asterism::python
