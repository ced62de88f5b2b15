// Topology, SpringSystem, and the functions of a system and its points.

#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <limits>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>

#include "bindings.hpp"
#include "interrupts.hpp"
#include "pickling.hpp"
#include "refusal.hpp"

namespace asterism::python {

void require_valid(const Defect& defect) {
  if (defect) throw py::value_error(std::string(Message(defect)));
}

namespace {

Topology<> valid(Topology<> topology) {
  require_valid(topology.defect());
  return topology;
}

std::vector<Link> links_of(const py::object& object) {
  const py::array array = py::array::ensure(unmasked(object, "links"));
  if (!array) throw py::type_error("links: expected pairs of nodes");
  std::vector<Link> links;
  if (array.size() == 0) return links;
  if (array.dtype().kind() != 'i' && array.dtype().kind() != 'u') {
    throw py::type_error("links: expected integers, found " + py::str(array.dtype()).cast<std::string>());
  }
  if (array.ndim() != 2 || array.shape(1) != 2) {
    throw py::value_error("links: expected shape (count, 2), found " + text_of(shape_of(array)));
  }
  const py::array_t<std::int64_t, py::array::c_style | py::array::forcecast> pairs(array);
  const auto node = [&](py::ssize_t l, py::ssize_t end) {  // -1, which is invalid, if out of int's range
    const std::int64_t index = pairs.at(l, end);
    return index > std::numeric_limits<int>::max() || index < 0 ? -1 : static_cast<int>(index);
  };
  links.reserve(static_cast<std::size_t>(pairs.shape(0)));
  for (py::ssize_t l = 0; l < pairs.shape(0); ++l) links.push_back({node(l, 0), node(l, 1)});
  return links;
}

/// Points of any number and of 2 or 3 dimensions.
template <typename F>
decltype(auto) with_points(const py::object& object, const char* name, F&& f) {
  const py::array_t<double> points = numbers(object, name);
  const py::ssize_t dim = points.ndim() == 2 && points.shape(1) == 3 ? 3 : 2;
  if (points.ndim() != 2 || points.shape(1) != dim) {
    throw py::value_error(std::string(name) + ": expected shape (N, 2) or (N, 3), found " +
                          text_of(shape_of(points)));
  }
  return dim == 3 ? f(map_points<3>(points)) : f(map_points<2>(points));
}

AnySystem make_system(const Topology<>& topology, int dim) {
  if (dim == 2) return {System<2>(topology)};
  if (dim == 3) return {System<3>(topology)};
  throw py::value_error("dim: expected 2 or 3, found " + std::to_string(dim));
}

/// A property that reads as a view of the system's memory, and is set by copying into it.
template <typename Member>
void def_values(py::class_<AnySystem>& type, const char* name, Member member, const char* doc) {
  const auto view = [member](const py::object& self) {
    return self.cast<AnySystem&>().visit([&](auto& system) -> py::array {
      auto& values = member(system);
      Shape shape{values.cols(), values.rows()};
      if (values.cols() == 1 && std::decay_t<decltype(values)>::ColsAtCompileTime == 1)
        shape = {values.rows()};
      return py::array_t<double>(shape, values.data(), self);
    });
  };
  const auto set = [view, name](const py::object& self, const py::object& values) {
    self.cast<AnySystem&>().change([](auto&) {});
    assign(view(self), values, name);
  };
  type.def_property(name, view, set, doc);
}

/// The array, which has its memory back where it was removed.
template <typename Matrix>
Matrix& restored(Matrix& values, Matrix& removed) {
  if (values.cols() == 0) values.swap(removed);
  return values;
}

/// The same for an array of `count(system)` points that a system need not have: None while it has not.
template <typename Member, typename Count>
void def_optional_points(py::class_<AnySystem>& type, const char* name, Member member, Count count,
                         const char* doc) {
  const auto get = [member](const py::object& self) {
    return self.cast<AnySystem&>().visit([&](auto& system) -> py::object {
      auto& values = member(system);
      if (values.cols() == 0) return py::none();
      return py::array_t<double>(Shape{values.cols(), system.kDim}, values.data(), self);
    });
  };
  const auto set = [member, count, name](AnySystem& self, const py::object& given) {
    self.change([&]<int Dim>(System<Dim>& system) {
      auto &values = member(system), &removed = member(self.removed<Dim>());
      if (!given.is_none()) {
        const auto points = numbers(given, name, {count(system), Dim});
        restored(values, removed) = map_points<Dim>(points);
      } else if (values.cols() > 0) {
        values.swap(removed);
      }
    });
  };
  type.def_property(name, get, set, doc);
}

int checked_node(AnySystem& self, int node) {
  const int nodes = self.visit([](auto& system) { return system.nodes(); });
  if (node >= 0 && node < nodes) return node;
  throw py::index_error("node " + std::to_string(node) + " is out of range (" +
                        detail::counted(nodes, "node") + ")");
}

/// f(system, x) without the GIL; ValueError for values that a solver would refuse.
template <typename F>
auto evaluated(AnySystem& self, const py::object& x, F&& f) {
  return self.visit([&]<int Dim>(System<Dim>& system) {
    const auto points = points_of<Dim>(system, x);
    if (const Defect defect = detail::validate_values(system, points))
      refuse_value(Message(defect), py::cast(&self, py::return_value_policy::reference), x);
    return self.without_gil([&] { return f(system, points); });
  });
}

/// A UserWarning where x is far from every stationary point, as the start of a solve is: Laplace's
/// approximation is one about a minimum.
template <int Dim>
void warn_unless_solved(const System<Dim>& system, const typename System<Dim>::Points& x) {
  constexpr double kFar = 0.05;  // starts have some tenths, solutions less than their tolerance
  if (detail::validate_values(system, x)) return;  // which is refused
  const double found = stationarity(system, x);
  if (!(found > kFar)) return;
  const std::string text = "x: expected the solution of the system, found a stationarity of " +
                           py::repr(py::float_(found)).cast<std::string>() +
                           ": a covariance holds at a minimum only, so solve first";
  if (PyErr_WarnEx(PyExc_UserWarning, text.c_str(), 1) != 0) throw py::error_already_set();
}

/// Whether a factorisation for this system may take tenths of a second or more.
template <int Dim>
bool is_large(const System<Dim>& system) {
  return system.nodes() + system.link_count() > 1000;
}

[[noreturn]] void refuse_covariance(CovarianceStatus status, const Message& message) {
  const std::string text(message);
  if (status == CovarianceStatus::InvalidInput) throw py::value_error(text);
  const bool out_of_memory = status == CovarianceStatus::OutOfMemory;
  const py::object type = py::module_::import(out_of_memory ? "builtins" : "numpy.linalg")
                              .attr(out_of_memory ? "MemoryError" : "LinAlgError");
  PyErr_SetString(type.ptr(), text.c_str());
  throw py::error_already_set();
}

[[noreturn]] void refuse_sensitivity(SensitivityStatus status, const Message& message) {
  const CovarianceStatus kind = status == SensitivityStatus::InvalidInput ? CovarianceStatus::InvalidInput
                                : status == SensitivityStatus::OutOfMemory
                                    ? CovarianceStatus::OutOfMemory
                                    : CovarianceStatus::NotPositiveDefinite;
  refuse_covariance(kind, message);
}

SensitivityOptions sensitivity_options(double stationarity) {
  const SensitivityOptions options{stationarity};
  if (const char* problem = options.problem()) throw py::value_error(problem);
  return options;
}

}  // namespace

void bind_systems(py::module_& m) {
  m.def(
      "_numbers",
      [](const py::object& values, const std::string& name, const std::optional<Shape>& shape,
         std::optional<double> missing) {
        const py::object known = unmasked(values, name, missing);
        return shape ? numbers(known, name.c_str(), *shape) : numbers(known, name.c_str());
      },
      py::arg("values"), py::arg("name"), py::arg("shape") = py::none(), py::arg("missing") = py::none(),
      "The input as an array of float64, as every function of the module takes it.");
  py::class_<Topology<>> topologies(
      m, "Topology",
      "Which nodes are linked: an immutable list of links between nodes 0 .. nodes - 1.\n\n"
      "Duplicated links act as springs in parallel. ValueError names an invalid link.");
  def_copy(topologies);
  topologies
      .def_static(
          "full", [](int nodes) { return valid(Topology<>::full(nodes)); }, py::arg("nodes").noconvert(),
          "Every pair, in the order (0, 1), (0, 2), ..., (1, 2), ...")
      .def_static(
          "star", [](int nodes, int centre) { return valid(Topology<>::star(nodes, centre)); },
          py::arg("nodes").noconvert(), py::arg("centre").noconvert(),
          "Node `centre` linked to each of the others.")
      .def_static(
          "k_nearest",
          [](const py::object& points, int k) {
            return with_points(points, "points", [k](const auto& map) {
              return interruptible_copy(map.cols() > 10000, [copy = map.eval(), k] {
                return valid(Topology<>::k_nearest(copy, k));
              });
            });
          },
          py::arg("points"), py::arg("k").noconvert(),
          "Nodes are linked if one is among the k nearest of the other. points: (N, 2) or (N, 3).")
      .def_static(
          "from_links",
          [](int nodes, const py::object& links) {
            const auto topology = Topology<>::from_links(nodes, links_of(links));
            const Defect& defect = topology.defect();
            if (defect && defect.index >= 0 && nodes >= 0) {  // with the pair, of numbers of any size
              const py::object pair = py::array(py::array::ensure(links))[py::int_(defect.index)];
              throw py::value_error(std::string(Message(defect)) + ": " +
                                    py::str(pair.attr("tolist")()).cast<std::string>() + ", of " +
                                    detail::counted(nodes, "node"));
            }
            return valid(topology);
          },
          py::arg("nodes").noconvert(), py::arg("links"),
          "The given links: pairs of nodes, or an array (L, 2).")
      .def_property_readonly("nodes", &Topology<>::nodes, "Number of nodes N.")
      .def_property_readonly("link_count", &Topology<>::link_count, "Number of links L.")
      .def_property_readonly(
          "links",
          [](const py::object& self) {
            const auto& topology = self.cast<const Topology<>&>();
            static_assert(sizeof(Link) == 2 * sizeof(int));
            const py::array_t<int> view(Shape{topology.link_count(), 2}, &topology.links().data()->i, self);
            view.attr("setflags")(py::arg("write") = false);
            return view;
          },
          "The links, (L, 2), read-only.")
      .def(py::pickle(
          [](const py::object& self) {
            return py::make_tuple(self.attr("nodes"), self.attr("links").attr("copy")());
          },
          [](const py::tuple& state) {
            const Fields fields(state, 2);
            return valid(Topology<>::from_links(fields[0].cast<int>(), links_of(fields[1])));
          }))
      .def("__repr__", [](const Topology<>& self) {
        return "<asterism.Topology: " + detail::counted(self.nodes(), "node") + ", " +
               detail::counted(self.link_count(), "link") + ">";
      });

  py::class_<AnySystem> type(
      m, "SpringSystem",
      "A constellation as a spring system: a spring of stiffness k_i ties node i to its anchor, and springs\n"
      "of stiffness k_ij and rest length mu_ij join linked nodes. Its energy is\n"
      "E(x) = 1/2 sum_i k_i |x_i - a_i|^2 + 1/2 sum_ij k_ij (mu_ij - |x_i - x_j|)^2. With rest_offset,\n"
      "x_i - x_j is less the link's offset m_ij; with loads, the energy is less sum_i f_i . x_i.\n\n"
      "The arrays are the system's own memory: assign to them in place. They start as NaN, so that a\n"
      "forgotten value is an error. A system cannot be changed while it is solved or evaluated: its "
      "methods,\n"
      "and assignment to its attributes, are a RuntimeError then. Do not write into its arrays meanwhile.");
  type.def(py::init(&make_system), py::arg("topology"), py::arg("dim").noconvert() = 2,
           "dim: coordinates of a point, 2 or 3.");
  static constexpr const char* kArrays[] = {"anchors", "anchor_stiffness", "rest_length", "link_stiffness"};
  type.def(py::pickle(
      [](const py::object& self) {
        py::list state, fixed;
        state.append(self.attr("topology"));
        state.append(self.attr("dim"));
        for (const char* name : kArrays) state.append(self.attr(name).attr("copy")());
        self.cast<AnySystem&>().visit([&](auto& s) {
          for (int i = 0; i < s.nodes(); ++i) {
            if (s.is_fixed(i)) fixed.append(i);
          }
        });
        state.append(fixed);
        state.append(self.attr("rest_offset"));
        state.append(self.attr("loads"));
        return py::tuple(state);
      },
      [](const py::tuple& state) {
        const Fields fields(state, 9);
        const auto& topology = fields[0].cast<const Topology<>&>();
        const int dim = fields[1].cast<int>();
        numbers(fields[2], kArrays[0], {topology.nodes(), dim});  // before memory for that many is allocated
        AnySystem made = make_system(topology, dim);
        const py::object view = py::cast(&made, py::return_value_policy::reference);
        for (std::size_t i = 0; i < 4; ++i) view.attr(kArrays[i]) = fields[i + 2];
        for (const py::handle node : py::list(fields[6])) view.attr("fix")(node);
        view.attr("rest_offset") = fields[7];
        view.attr("loads") = fields[8];
        return made;
      }));
  def_copy(type);
  def_values(
      type, "anchors", [](auto& s) -> auto& { return s.anchors; }, "a_i, (N, dim) [px].");
  def_values(
      type, "anchor_stiffness", [](auto& s) -> auto& { return s.anchor_stiffness; },
      "k_i >= 0, (N,); at least one > 0 in each connected component.");
  def_values(
      type, "rest_length", [](auto& s) -> auto& { return s.rest_length; },
      "mu_ij >= 0, (L,), in the order of the topology's links [px].");
  def_values(
      type, "link_stiffness", [](auto& s) -> auto& { return s.link_stiffness; },
      "k_ij >= 0, (L,), in the order of the topology's links.");
  def_optional_points(
      type, "rest_offset", [](auto& s) -> auto& { return s.rest_offset; },
      [](auto& s) { return s.link_count(); },
      "m_ij, (L, dim) [px]: link (i, j) prefers that x_i - x_j is this vector (rest length 0), or at\n"
      "the distance rest_length of it. None, as at first: no link has one.");
  def_optional_points(
      type, "loads", [](auto& s) -> auto& { return s.loads; }, [](auto& s) { return s.nodes(); },
      "f_i, (N, dim) [stiffness x px]: a constant force on each node, such as its weight. None, as at\n"
      "first: no node has one.");
  type.def(
          "set_rest_offsets",
          [](AnySystem& self, const py::object& points) {
            self.change([&]<int Dim>(System<Dim>& system) {
              const auto given = numbers(points, "points", {system.nodes(), Dim});
              restored(system.rest_offset, self.removed<Dim>().rest_offset);
              system.set_rest_offsets(map_points<Dim>(given));
            });
          },
          py::arg("points"),
          "Sets every offset to the difference of its two nodes in points (N, dim), and every rest\n"
          "length to 0.")
      .def(
          "set_rest_lengths",
          [](AnySystem& self, const py::object& points) {
            self.change([&]<int Dim>(System<Dim>& system) {
              system.set_rest_lengths(map_points<Dim>(numbers(points, "points", {system.nodes(), Dim})));
            });
          },
          py::arg("points"), "Sets every rest length to the distance of its two nodes in points (N, dim).")
      .def(
          "fix",
          [](AnySystem& self, int node) {
            self.change([n = checked_node(self, node)](auto& system) { system.fix(n); });
          },
          py::arg("node").noconvert(),
          "Holds a node where the start of a solve has it. IndexError if it is out of range.")
      .def(
          "release",
          [](AnySystem& self, int node) {
            self.change([n = checked_node(self, node)](auto& system) { system.release(n); });
          },
          py::arg("node").noconvert(), "Lets a node move again.")
      .def(
          "is_fixed",
          [](AnySystem& self, int node) {
            return self.visit([n = checked_node(self, node)](auto& system) { return system.is_fixed(n); });
          },
          py::arg("node").noconvert(), "Whether a node is held.")
      .def_property_readonly(
          "topology", [](AnySystem& self) { return self.visit([](auto& s) { return s.topology(); }); },
          "A copy of the topology.")
      .def_property_readonly(
          "dim", [](AnySystem& self) { return self.visit([](auto& s) { return s.kDim; }); },
          "Coordinates of a point.")
      .def_property_readonly(
          "nodes", [](AnySystem& self) { return self.visit([](auto& s) { return s.nodes(); }); },
          "Number of nodes N.")
      .def_property_readonly(
          "link_count", [](AnySystem& self) { return self.visit([](auto& s) { return s.link_count(); }); },
          "Number of links L.")
      .def("__repr__", [](AnySystem& self) {
        return self.visit([](auto& s) {
          return "<asterism.SpringSystem: " + detail::counted(s.nodes(), "node") + ", " +
                 detail::counted(s.link_count(), "link") + ", dim " + std::to_string(s.kDim) + ">";
        });
      });

  // In the functions below x is (N, dim), and values that a solver would refuse are a ValueError.
  m.def(
      "energy",
      [](AnySystem& system, const py::object& x) {
        return evaluated(system, x, [](const auto& s, const auto& points) { return energy(s, points); });
      },
      py::arg("system"), py::arg("x"), "E(x).");
  m.def(
      "gradient",
      [](AnySystem& system, const py::object& x) {
        const Shape shape = system.visit([](auto& s) { return Shape{s.nodes(), s.kDim}; });
        return owned(
            evaluated(system, x,
                      [](const auto& s, const auto& points) {
                        return Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic>(gradient(s, points));
                      }),
            shape);
      },
      py::arg("system"), py::arg("x"), "dE/dx, (N, dim); zero for fixed nodes.");
  m.def(
      "hessian",
      [](AnySystem& system, const py::object& x) {
        const Eigen::Index size = system.visit([](auto& s) { return s.nodes() * s.kDim; });
        return owned(
            evaluated(system, x, [](const auto& s, const auto& points) { return hessian(s, points); }),
            {size, size});
      },
      py::arg("system"), py::arg("x"),
      "d2E/dx2, (dim N, dim N), symmetric; coordinate d of node i is row dim i + d. Fixed nodes are not\n"
      "coupled to others.");
  m.def(
      "sparse_hessian",
      [](AnySystem& system, const py::object& x) {
        return evaluated(system, x,
                         [](const auto& s, const auto& points) { return sparse_hessian(s, points); });
      },
      py::arg("system"), py::arg("x"), "The same as a scipy.sparse.csc_matrix; needs SciPy.");
  m.def(
      "stationarity",
      [](AnySystem& system, const py::object& x) {
        return evaluated(system, x,
                         [](const auto& s, const auto& points) { return stationarity(s, points); });
      },
      py::arg("system"), py::arg("x"),
      "How far x is from a stationary point, without units. The solvers' tolerance applies to it.");
  py::class_<Certificate> certificate(
      m, "Certificate",
      "The result of certify() for a placement. Every number is rigorous: the rounding of its\n"
      "computation is accounted for.");
  def_copy(certificate);
  certificate
      .def_property_readonly("certified", &Certificate::certified, "x is proven to be a global minimum.")
      .def_property_readonly(
          "unique", [](const Certificate& c) { return c.proof == Proof::UniqueGlobalMinimum; },
          "It is also proven to be the only one.")
      .def_property_readonly(
          "proof", [](const Certificate& c) { return std::string(to_string(c.proof)); },
          "The verdict: 'unique global minimum', 'global minimum', 'not certified' or 'not applicable'.")
      .def_property_readonly(
          "reason", [](const Certificate& c) { return std::string(c.reason); },
          "Why no more is proven, or empty.")
      .def_readonly("energy", &Certificate::energy, "E(x).")
      .def_readonly("lower_bound", &Certificate::lower_bound, "No placement has less energy.")
      .def_property_readonly("gap", &Certificate::gap, "(energy - lower_bound) / energy.")
      .def_readonly("least_eigenvalue", &Certificate::least_eigenvalue,
                    "A bound of W's least eigenvalue: from below if W is positive definite, otherwise\n"
                    "from above; NaN if unknown.")
      .def_readonly("distance", &Certificate::distance,
                    "No global minimum has a node farther from x [px]; inf if unknown.")
      .def("__bool__", &Certificate::certified, "`certified`.")
      .def(pickled<Certificate>([](auto& c, auto&& field) {
        field(c.proof);
        field(c.reason);
        field(c.energy);
        field(c.lower_bound);
        field(c.least_eigenvalue);
        field(c.distance);
      }))
      .def("__repr__", [](const Certificate& self) {
        std::ostringstream text;
        text << "<asterism.Certificate: " << self << ">";
        return text.str();
      });
  m.def(
      "certify",
      [](AnySystem& system, const py::object& x, double gap) {
        const CertifyOptions options{gap};
        if (const char* problem = options.problem()) throw py::value_error(problem);
        return system.visit([&]<int Dim>(System<Dim>& s) {
          return interruptible_copy(is_large(s), [s = s, points = points_of<Dim>(s, x), options] {
            return certify(s, points, options);
          });
        });
      },
      py::arg("system"), py::arg("x"), py::arg("gap") = CertifyOptions().gap,
      "Whether x (N, dim) is proven to be a global minimum of the energy, and a lower bound of the energy.\n"
      "x need not come from a solver. gap: a global minimum may lie below E(x) by this share of it.");
  m.def(
      "covariance",
      [](AnySystem& system, const py::object& x) {
        return system.visit([&]<int Dim>(System<Dim>& s) {
          const auto points = points_of<Dim>(s, x);
          warn_unless_solved<Dim>(s, points);
          auto result = interruptible_copy(is_large(s), [s = s, points] { return covariance(s, points); });
          if (!result) refuse_covariance(result.status, result.message);
          return owned(std::move(result.matrix), {Dim * s.nodes(), Dim * s.nodes()});
        });
      },
      py::arg("system"), py::arg("x"),
      "The covariance of the solution x by Laplace's approximation, (dim N, dim N) [px^2 for stiffness in\n"
      "1/px^2]. numpy.linalg.LinAlgError if x is not a strict local minimum; it names a free rotation or\n"
      "translation. ValueError for values that a solver would refuse, MemoryError if memory runs out. A\n"
      "UserWarning if x is far from a solution (a stationarity above 0.05).");
  m.def(
      "node_covariances",
      [](AnySystem& system, const py::object& x) {
        return system.visit([&]<int Dim>(System<Dim>& s) {
          const auto points = points_of<Dim>(s, x);
          warn_unless_solved<Dim>(s, points);
          auto result =
              interruptible_copy(is_large(s), [s = s, points] { return node_covariances(s, points); });
          if (!result) refuse_covariance(result.status, result.message);
          return owned(std::move(result.blocks), {s.nodes(), Dim, Dim});
        });
      },
      py::arg("system"), py::arg("x"),
      "Each node's own covariance, (N, dim, dim): the diagonal blocks of covariance(), also for large\n"
      "sparse systems.");
  m.def(
      "_sensitivity",
      [](AnySystem& system, const py::object& x, const py::object& grad_x, double stationarity) {
        const SensitivityOptions options = sensitivity_options(stationarity);
        return system.visit([&]<int Dim>(System<Dim>& s) {
          const auto points = points_of<Dim>(s, x);
          const typename System<Dim>::Points grad =
              map_points<Dim>(numbers(grad_x, "grad_x", {s.nodes(), Dim}));
          auto result = interruptible_copy(
              is_large(s), [s = s, points, grad, options] { return sensitivity(s, points, grad, options); });
          if (!result) refuse_sensitivity(result.status, result.message);
          return py::make_tuple(owned(std::move(result.anchors), {s.nodes(), Dim}),
                                owned(std::move(result.anchor_stiffness), {s.nodes()}),
                                owned(std::move(result.rest_length), {s.link_count()}),
                                owned(std::move(result.link_stiffness), {s.link_count()}),
                                s.has_offsets()
                                    ? py::object(owned(std::move(result.rest_offset), {s.link_count(), Dim}))
                                    : py::object(py::none()),
                                s.has_loads() ? py::object(owned(std::move(result.loads), {s.nodes(), Dim}))
                                              : py::object(py::none()));
        });
      },
      py::arg("system"), py::arg("x"), py::arg("grad_x"), py::arg("stationarity"),
      "The arrays of asterism.sensitivity().");
  m.def(
      "solution_tangent",
      [](AnySystem& system, const py::object& x, const py::object& anchors,
         const py::object& anchor_stiffness, const py::object& rest_length, const py::object& link_stiffness,
         const py::object& rest_offset, const py::object& forces, double stationarity) {
        const SensitivityOptions options = sensitivity_options(stationarity);
        return system.visit([&]<int Dim>(System<Dim>& s) {
          const auto points = points_of<Dim>(s, x);
          SystemTangent<System<Dim>> tangent(s);
          if (!anchors.is_none())
            tangent.anchors = map_points<Dim>(numbers(anchors, "anchors", {s.nodes(), Dim}));
          const auto set = [](auto& values, const py::object& given, const char* name) {
            if (given.is_none()) return;
            const auto array = numbers(given, name, {values.size()});
            std::copy_n(array.data(), values.size(), values.data());
          };
          set(tangent.anchor_stiffness, anchor_stiffness, "anchor_stiffness");
          set(tangent.rest_length, rest_length, "rest_length");
          set(tangent.link_stiffness, link_stiffness, "link_stiffness");
          if (!rest_offset.is_none()) {
            tangent.rest_offset =
                map_points<Dim>(numbers(rest_offset, "rest_offset", {s.rest_offset.cols(), Dim}));
          }
          if (!forces.is_none())
            tangent.loads = map_points<Dim>(numbers(forces, "loads", {s.loads.cols(), Dim}));
          auto result = interruptible_copy(is_large(s), [s = s, points, tangent, options] {
            return solution_tangent(s, points, tangent, options);
          });
          if (!result) refuse_sensitivity(result.status, result.message);
          return owned(std::move(result.x), {s.nodes(), Dim});
        });
      },
      py::arg("system"), py::arg("x"), py::kw_only(), py::arg("anchors") = py::none(),
      py::arg("anchor_stiffness") = py::none(), py::arg("rest_length") = py::none(),
      py::arg("link_stiffness") = py::none(), py::arg("rest_offset") = py::none(),
      py::arg("loads") = py::none(), py::arg("stationarity") = SensitivityOptions().stationarity,
      "How the solution x moves, (N, dim), per unit of a parameter theta, for the derivatives by theta of "
      "the\n"
      "system's arrays, of their shapes; one that is left out does not change. Errors as of sensitivity().");
}

}  // namespace asterism::python
