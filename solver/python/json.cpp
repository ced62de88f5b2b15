// Spring systems as JSON; asterism/stored.py wraps it for users.

#include <asterism/solver/io/json.hpp>

#include "bindings.hpp"

namespace asterism::python {

namespace {

// ValueError; a message may quote bytes that are not UTF-8.
[[noreturn]] void refuse(const std::string& message) {
  const auto text = py::reinterpret_steal<py::object>(
      PyUnicode_DecodeUTF8(message.data(), static_cast<py::ssize_t>(message.size()), "backslashreplace"));
  PyErr_SetObject(PyExc_ValueError, text.ptr());
  throw py::error_already_set();
}

}  // namespace

void bind_json(py::module_& m) {
  m.def(
      "_parse_systems",
      [](const std::string& text, const std::string& source) {
        std::vector<AnyStoredSystem> systems;
        try {
          const py::gil_scoped_release release;
          systems = parse_systems(text, source);
        } catch (const std::runtime_error& error) {
          refuse(error.what());
        }
        py::list result;
        for (AnyStoredSystem& any : systems) {
          std::visit(
              [&]<typename S>(StoredSystem<S>& stored) {
                const Shape shape{stored.system.nodes(), S::kDim};
                result.append(py::make_tuple(AnySystem{std::move(stored.system)},
                                             owned(std::move(stored.start), shape), stored.name,
                                             stored.origin.dump()));
              },
              any);
        }
        return result;
      },
      py::arg("text"), py::arg("source"));
  m.def(
      "_system_to_json",
      [](AnySystem& system, const py::object& start, const std::string& name, const std::string& origin) {
        return system.visit([&]<int Dim>(System<Dim>& s) {
          const auto points = map_points<Dim>(numbers(start, "start", {s.nodes(), Dim}));
          try {
            const auto parsed =
                detail::stored::parse(origin, "the system cannot be written: its origin", 1, true);
            return system_to_json(s, points, name, parsed).dump();
          } catch (const std::runtime_error& error) {
            refuse(error.what());
          }
        });
      },
      py::arg("system"), py::arg("start"), py::arg("name"), py::arg("origin"));
}

}  // namespace asterism::python
