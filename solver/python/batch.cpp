// SpringBatch: many systems of one topology, as arrays over its planes.

#include <pybind11/stl.h>

#include <asterism/solver/base/counted.hpp>
#include <limits>
#include <optional>

#include "bindings.hpp"
#include "pickling.hpp"

namespace asterism::python {

namespace {

/// asterism.SpringBatch.
struct AnyBatch {
  using BoundToPython = void;

  std::variant<Batch<2>, Batch<3>> of_dim;
  bool busy = false;

  template <typename F>
  decltype(auto) visit(F&& f) {
    return std::visit(std::forward<F>(f), of_dim);
  }
};

AnyBatch make_batch(const Topology<>& topology, int count, int dim) {
  if (count < 0) throw py::value_error("count: expected 0 or more, found " + std::to_string(count));
  if (dim == 2) return {Batch<2>(topology, count)};
  if (dim == 3) return {Batch<3>(topology, count)};
  throw py::value_error("dim: expected 2 or 3, found " + std::to_string(dim));
}

/// An array over `items` adjacent planes, each with one number of every system: (M, items), or for points
/// (M, items / dim, dim). `plane(p)` points to the first number of plane p.
template <typename Plane>
py::array planes(const py::object& owner, int count, int items, int dim, Plane&& plane) {
  constexpr auto kNumber = static_cast<py::ssize_t>(sizeof(double));
  double* const first = items > 0 ? plane(0) : nullptr;
  const py::ssize_t step = items > 1 ? kNumber * (plane(1) - first) : 0;
  Shape shape{count, items}, strides{kNumber, step};
  if (dim > 0) shape = {count, items / dim, dim}, strides = {kNumber, dim * step, step};
  if (first == nullptr) return py::array_t<double>(shape);
  return py::array_t<double>(shape, strides, first, owner);
}

template <typename View>
void def_values(py::class_<AnyBatch>& type, const char* name, View view, const char* doc) {
  type.def_property(
      name, [view](const py::object& self) { return view(self); },
      [view, name](const py::object& self, const py::object& values) {
        const Exclusive use(self.cast<AnyBatch&>().busy, "this asterism.SpringBatch");
        assign(view(self), values, name);
      },
      doc);
}

/// A property with one result of the last solve for every system.
template <typename T, typename F>
void def_verdict(py::class_<AnyBatch>& type, const char* name, F verdict, const char* doc) {
  type.def_property_readonly(
      name,
      [verdict](AnyBatch& self) {
        return self.visit([&](auto& batch) {
          py::array_t<T> result(batch.size());
          for (int i = 0; i < batch.size(); ++i) result.mutable_at(i) = verdict(batch, i);
          return result;
        });
      },
      doc);
}

Simd simd_of(const std::string& name) {
  if (name == "auto") return Simd::Auto;
  if (name == "portable") return Simd::Portable;
  if (name == "avx2") return Simd::Avx2;
  if (name == "avx512") return Simd::Avx512;
  throw py::value_error("simd: expected auto, portable, avx2 or avx512, found '" + name + "'");
}

void check_threads(int threads) {
  if (threads < 0) throw py::value_error("threads: expected 0 or more, found " + std::to_string(threads));
}

/// Whether a signal is to end what runs without the GIL.
bool is_signalled() {
  const py::gil_scoped_acquire acquire;
  return PyErr_CheckSignals() != 0;
}

BatchSummary solve(AnyBatch& self, int threads, const std::string& simd, const NewtonOptions& options) {
  check_threads(threads);
  const Simd instructions = simd_of(simd);
  const Exclusive use(self.busy, "this asterism.SpringBatch");
  bool interrupted = false;
  const BatchSummary summary = self.visit([&]<int Dim>(Batch<Dim>& batch) {
    const py::gil_scoped_release release;
    return solve_batch<Dim>(batch, options, instructions, threads,
                            [&interrupted] { return interrupted = is_signalled(); });
  });
  if (interrupted) throw py::error_already_set();
  return summary;
}

/// An asterism.Sensitivity, whose arrays are views of the planes of a BatchGradient.
template <int Dim>
py::object sensitivity(Batch<Dim>& batch, const py::object& grad_x, const SensitivityOptions& options,
                       Simd simd, int threads) {
  using Gradient = BatchGradient<Batch<Dim>>;
  auto* gradient = new Gradient(batch);
  const py::capsule owner(gradient, [](void* pointer) { delete static_cast<Gradient*>(pointer); });
  const int count = batch.size(), n = batch.nodes(), links = batch.link_count();
  const auto array = numbers(grad_x, "grad_x", {count, n, Dim});
  const double* number = array.data();
  for (int s = 0; s < count; ++s) {
    for (int c = 0; c < Dim * n; ++c) gradient->grad_x(c / Dim, c % Dim)[s] = *number++;
  }
  bool interrupted = false;
  const BatchGradientSummary summary = [&] {
    const py::gil_scoped_release release;
    return gradients_of_batch<Dim>(batch, *gradient, options, simd, threads,
                                   [&interrupted] { return interrupted = is_signalled(); });
  }();
  if (interrupted) throw py::error_already_set();
  if (summary.first_failure < 0 && !summary) throw py::value_error(std::string(summary.message));
  py::array_t<int> status(count);
  for (int s = 0; s < count; ++s) status.mutable_at(s) = static_cast<int>(gradient->status(s));
  return py::module_::import("asterism.gradients")
      .attr("Sensitivity")(
          planes(owner, count, Dim * n, Dim,
                 [&](int p) { return gradient->anchors(p / Dim, p % Dim).data(); }),
          planes(owner, count, n, 0, [&](int p) { return gradient->anchor_stiffness(p).data(); }),
          planes(owner, count, links, 0, [&](int p) { return gradient->rest_length(p).data(); }),
          planes(owner, count, links, 0, [&](int p) { return gradient->link_stiffness(p).data(); }),
          py::arg("status") = status);
}

}  // namespace

void bind_batch(py::module_& m) {
  py::class_<BatchSummary> summary(m, "BatchSummary", "The result of a batch as a whole.");
  def_copy(summary);
  summary
      .def_readonly("status", &BatchSummary::status,
                    "CONVERGED if every system has converged, otherwise the first other status of a system.")
      .def_property_readonly(
          "message", [](const BatchSummary& s) { return std::string(s.message); }, "The reason in words.")
      .def_readonly("first_failure", &BatchSummary::first_failure,
                    "The index of the system with `status`, or -1.")
      .def_readonly("converged", &BatchSummary::converged, "Number of systems that have converged.")
      .def_readonly("by_scalar", &BatchSummary::by_scalar,
                    "Number of systems that the lanes left to the scalar solver.")
      .def_property_readonly(
          "simd", [](const BatchSummary& s) { return std::string(to_string(s.simd)); }, "Instructions used.")
      .def_readonly("seconds", &BatchSummary::seconds, "Wall-clock time of the solve.")
      .def(
          "__bool__", [](const BatchSummary& s) { return s.status == Status::Converged; },
          "Whether every system has converged.")
      .def(pickled<BatchSummary>([](auto& s, auto&& field) {
        field(s.status);
        field(s.message);
        for (auto* count : {&s.first_failure, &s.converged, &s.by_scalar}) field(*count);
        field(s.simd);
        field(s.seconds);
      }))
      .def("__repr__", [](const BatchSummary& s) {
        return "<asterism.BatchSummary: " + std::to_string(s.converged) + " converged (" +
               std::string(s.message) + ")>";
      });

  py::class_<AnyBatch> type(
      m, "SpringBatch",
      "M spring systems of one topology with their points, solved in SIMD lanes. The arrays are the\n"
      "batch's own memory, views of planes of M numbers: assign to them in place. They start as NaN. A\n"
      "copy has the values and x, but not what the last solve reported.");
  def_copy(type);
  constexpr const char* kArrays[] = {"anchors", "anchor_stiffness", "rest_length", "link_stiffness", "x"};
  type.def(py::pickle(
      [kArrays](const py::object& self) {
        auto& batch = self.cast<AnyBatch&>();
        const Exclusive use(batch.busy, "this asterism.SpringBatch");
        py::list state;
        batch.visit([&state](auto& b) {
          state.append(py::cast(b.topology()));
          state.append(b.size());
          state.append(b.kDim);
        });
        for (const char* name : kArrays) state.append(self.attr(name).attr("copy")());
        return py::tuple(state);
      },
      [kArrays](const py::tuple& state) {
        const Fields fields(state, 8);
        const auto& topology = fields[0].cast<const Topology<>&>();
        const int count = fields[1].cast<int>(), dim = fields[2].cast<int>();
        asterism::python::numbers(
            fields[3], kArrays[0],
            {count, topology.nodes(), dim});  // before memory for that many is allocated
        AnyBatch made = make_batch(topology, count, dim);
        const py::object view = py::cast(&made, py::return_value_policy::reference);
        for (std::size_t i = 0; i < 5; ++i) view.attr(kArrays[i]) = fields[i + 3];
        return made;
      }));
  type.def(py::init(&make_batch), py::arg("topology"), py::arg("count").noconvert(),
           py::arg("dim").noconvert() = 2, "count: number of systems M. dim: 2 or 3.");
  const auto points = [](auto plane_of) {
    return [plane_of](const py::object& self) {
      return self.cast<AnyBatch&>().visit([&]<int Dim>(Batch<Dim>& b) {
        return planes(self, b.size(), Dim * b.nodes(), Dim,
                      [&](int p) { return plane_of(b, p / Dim, p % Dim).data(); });
      });
    };
  };
  const auto numbers = [](auto count_of, auto plane_of) {
    return [count_of, plane_of](const py::object& self) {
      return self.cast<AnyBatch&>().visit([&](auto& b) {
        return planes(self, b.size(), count_of(b), 0, [&](int p) { return plane_of(b, p).data(); });
      });
    };
  };
  const auto nodes = [](auto& b) { return b.nodes(); };
  const auto links = [](auto& b) { return b.link_count(); };
  def_values(type, "anchors", points([](auto& b, int node, int axis) { return b.anchors(node, axis); }),
             "(M, N, dim) [px].");
  def_values(type, "anchor_stiffness",
             numbers(nodes, [](auto& b, int node) { return b.anchor_stiffness(node); }), "(M, N), >= 0.");
  def_values(type, "rest_length", numbers(links, [](auto& b, int link) { return b.rest_length(link); }),
             "(M, L), >= 0 [px].");
  def_values(type, "link_stiffness", numbers(links, [](auto& b, int link) { return b.link_stiffness(link); }),
             "(M, L), >= 0.");
  def_values(type, "x", points([](auto& b, int node, int axis) { return b.x(node, axis); }),
             "(M, N, dim): the starts before a solve, the minima after.");
  type.def(
          "solve",
          [](AnyBatch& self, int threads, const std::string& simd, double tolerance, int max_iterations,
             bool align, bool allow_reflection, bool escape_saddles, double gap) {
            NewtonOptions options;
            options.tolerance = tolerance;
            options.max_iterations = max_iterations;
            options.align = align;
            options.allow_reflection = allow_reflection;
            options.escape_saddles = escape_saddles;
            options.gap = gap;
            return solve(self, threads, simd, options);
          },
          py::arg("threads").noconvert() = 1, py::arg("simd") = "auto",
          py::arg("tolerance") = NewtonOptions().tolerance,
          py::arg("max_iterations").noconvert() = NewtonOptions().max_iterations, py::arg("align") = true,
          py::arg("allow_reflection") = false, py::arg("escape_saddles") = true,
          py::arg("gap") = NewtonOptions().gap,
          "Moves x of every system to a local minimum by Newton's method. threads: 0 for as many as the\n"
          "machine runs at once. simd: auto, portable, avx2 or avx512. gap: if above 0, a lower_bound is\n"
          "proven for each system. The GIL is released during the solve; signals are handled every few\n"
          "hundred systems, and after a KeyboardInterrupt only some of them are solved. RuntimeError if\n"
          "two threads use the batch at once.")
      .def(
          "sensitivity",
          [](AnyBatch& self, const py::object& grad_x, double stationarity, int threads,
             const std::string& simd) {
            check_threads(threads);
            const Simd instructions = simd_of(simd);
            const Exclusive use(self.busy, "this asterism.SpringBatch");
            return self.visit([&](auto& batch) {
              return sensitivity(batch, grad_x, SensitivityOptions{stationarity}, instructions, threads);
            });
          },
          py::arg("grad_x"), py::arg("stationarity") = SensitivityOptions().stationarity,
          py::arg("threads").noconvert() = 1, py::arg("simd") = "auto",
          "The derivatives of a function L of the solutions x by the values of every system, for grad_x =\n"
          "dL/dx (M, N, dim): an asterism.Sensitivity whose arrays have a first axis of M. Its `status`\n"
          "(M,) has values of SensitivityStatus; where that is not COMPUTED, the system's numbers are NaN,\n"
          "for the reasons that asterism.sensitivity() raises errors for. threads, simd: as of solve().\n"
          "ValueError for options that are out of range, or instructions that are not available.")
      .def_property_readonly(
          "size", [](AnyBatch& self) { return self.visit([](auto& b) { return b.size(); }); },
          "Number of systems M.")
      .def("__repr__", [](AnyBatch& self) {
        return self.visit([](auto& b) {
          return "<asterism.SpringBatch: " + detail::counted(b.size(), "system") + " of " +
                 detail::counted(b.nodes(), "node") + ", dim " + std::to_string(b.kDim) + ">";
        });
      });
  def_verdict<int>(
      type, "status", [](auto& b, int i) { return static_cast<int>(b.status(i)); },
      "(M,), values of Status: `status == Status.CONVERGED`.");
  def_verdict<int>(
      type, "iterations", [](auto& b, int i) { return b.iterations(i); }, "(M,), -1 until known.");
  type.def_property_readonly(
      "positive_definite",
      [](AnyBatch& self) {
        return self.visit([](auto& batch) {
          py::array result(py::dtype("O"), batch.size());
          for (int i = 0; i < batch.size(); ++i) result[py::int_(i)] = batch.positive_definite(i);
          return result;
        });
      },
      "(M,), objects: True if the Hessian is positive definite, False if not, None if it was not tested.");
  def_verdict<double>(
      type, "initial_energy", [](auto& b, int i) { return b.initial_energy(i); }, "(M,), -1 until known.");
  def_verdict<double>(
      type, "final_energy", [](auto& b, int i) { return b.final_energy(i); }, "(M,), -1 until known.");
  def_verdict<double>(
      type, "stationarity", [](auto& b, int i) { return b.stationarity(i); }, "(M,), -1 until known.");
  def_verdict<double>(
      type, "lower_bound",
      [](auto& b, int i) {
        return b.lower_bound(i) < 0 ? std::numeric_limits<double>::quiet_NaN() : b.lower_bound(i);
      },
      "(M,), lower bounds of the least energies; NaN without the option gap.");
}

}  // namespace asterism::python
