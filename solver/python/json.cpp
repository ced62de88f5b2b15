// Systems as JSON; asterism/stored.py wraps it for users.

#include <asterism/solver/io/json.hpp>

#include "bindings.hpp"
#include "term_system.hpp"

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
        std::vector<std::variant<AnyStoredSystem, StoredTerms>> systems;
        try {
          const py::gil_scoped_release release;
          detail::for_each_stored(text, source,
                                  {0, false,
                                   [&](detail::StoredSprings&& springs) {
                                     systems.emplace_back(detail::any_from_stored(std::move(springs)));
                                   },
                                   [&](StoredTerms&& terms) { systems.emplace_back(std::move(terms)); }});
        } catch (const std::runtime_error& error) {
          refuse(error.what());
        }
        py::list result;
        for (auto& each : systems) {
          if (auto* const terms = std::get_if<StoredTerms>(&each)) {
            const Shape shape{terms->system.nodes(), terms->system.dim()};
            result.append(py::make_tuple(to_python(std::move(terms->system)),
                                         owned(std::move(terms->start), shape), terms->name, terms->origin));
            continue;
          }
          std::visit(
              [&]<typename S>(StoredSystem<S>& stored) {
                const Shape shape{stored.system.nodes(), S::kDim};
                result.append(py::make_tuple(AnySystem{std::move(stored.system)},
                                             owned(std::move(stored.start), shape), stored.name,
                                             stored.origin));
              },
              std::get<AnyStoredSystem>(each));
        }
        return result;
      },
      py::arg("text"), py::arg("source"));
  m.def(
      "_system_to_json",
      [](const py::object& given, const py::object& start, const std::string& name,
         const std::string& origin) -> std::string {
        try {
          if (const asterism::System* const system = system_in(given)) {
            const auto points = numbers(start, "start", {system->nodes(), system->dim()});
            return to_json({*system,
                            Eigen::Map<const Eigen::MatrixXd>(points.data(), system->dim(), system->nodes()),
                            name, origin});
          }
          if (!py::isinstance<AnySystem>(given)) {
            throw py::type_error("system: expected a SpringSystem or a System, found " + type_name(given));
          }
          return given.cast<AnySystem&>().visit([&]<int Dim>(System<Dim>& s) {
            const auto points = map_points<Dim>(numbers(start, "start", {s.nodes(), Dim}));
            return to_json(StoredSystem<System<Dim>>{s, points, name, origin});
          });
        } catch (const py::builtin_exception&) {
          throw;
        } catch (const py::error_already_set&) {
          throw;
        } catch (const std::runtime_error& error) {
          refuse(error.what());
        }
      },
      py::arg("system"), py::arg("start"), py::arg("name"), py::arg("origin"));
}

}  // namespace asterism::python
