#include "bindings.hpp"

PYBIND11_MODULE(_asterism, m) {
  using namespace asterism::python;
  m.doc() = "Asterism, compiled: what the package `asterism` shows.";
  // Signatures, help and pickles then name classes and functions by the package.
  const py::object name = m.attr("__name__");
  m.attr("__name__") = "asterism";
  m.attr("__version__") = ASTERISM_VERSION;
  bind_systems(m);
  bind_random(m);
  bind_solvers(m);
  bind_system(m);
  bind_batch(m);
  bind_discrete(m);
  bind_graph(m);
  bind_ranges(m);
  bind_placement(m);
  bind_pose(m);
#ifdef ASTERISM_PYTHON_JSON
  bind_json(m);
#endif
#ifdef ASTERISM_PYTHON_TRACKERS
  bind_trackers(m);
#endif
  explain_arguments(m);
  m.attr("__name__") = name;
}
