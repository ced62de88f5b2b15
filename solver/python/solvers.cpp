// Summary, Solver and solve.

#include <pybind11/stl.h>

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <cstring>
#include <limits>
#include <optional>
#include <sstream>

#include "bindings.hpp"
#include "pickling.hpp"
#include "refusal.hpp"
#include "solving.hpp"

namespace asterism::python {

namespace {

template <int Dim>
bool same_values(const System<Dim>& a, const System<Dim>& b) {
  const auto same = [](const auto& one, const auto& other) {
    const auto bytes = static_cast<std::size_t>(one.size()) * sizeof(double);
    return one.size() == other.size() && (bytes == 0 || std::memcmp(one.data(), other.data(), bytes) == 0);
  };
  return same(a.anchors, b.anchors) && same(a.anchor_stiffness, b.anchor_stiffness) &&
         same(a.rest_length, b.rest_length) && same(a.link_stiffness, b.link_stiffness) &&
         same(a.rest_offset, b.rest_offset) && same(a.loads, b.loads);
}

/// asterism.Solver: a method for systems of both dimensions, which keeps its memory between solves.
class Solver {
 public:
  using BoundToPython = void;

  Solver(const std::string& method, const py::kwargs& options)
      : method_(method), of_2_(solvers<2>().make(method)), of_3_(solvers<3>().make(method)) {
    set_options(of_2_, method, options);
    set_options(of_3_, method, options);
    most_rounds_ = most_rounds(this->options());
  }

  const std::string& method() const { return method_; }

  py::dict options() { return options_of(of_2_); }

  Summary solve(AnySystem& system, const py::object& x, const py::object& on_iteration, bool check) {
    const Exclusive use(busy_, "this asterism.Solver");
    return system.visit([&]<int Dim>(System<Dim>& s) {
      py::array_t<double> array = output(x, "x", {s.nodes(), Dim});
      if (detail::shares_memory(s, array.data(), array.size())) {  // the solver, given a copy, cannot tell
        return checked(detail::refused(solver<Dim>().name(), detail::kSharesMemory), check);
      }
      auto& points = workspace<Dim>();
      points = map_points<Dim>(array);
      const AnySystem::Reading reading(system);
      const std::optional<System<Dim>> given =
          on_iteration.is_none() ? std::nullopt : std::optional<System<Dim>>(s);
      const Summary summary =
          run(solver<Dim>(), s, points, on_iteration, may_be_long(s.link_count(), most_rounds_),
              [&] { return same_values(s, *given); });
      if (summary.usable()) std::copy_n(points.data(), points.size(), array.mutable_data());
      if (check && summary.status == Status::InvalidInput)
        refuse_value(summary.message, py::cast(&system, py::return_value_policy::reference), x, options());
      return checked(summary, check);
    });
  }

 private:
  template <int Dim>
  AnySolver<System<Dim>>& solver() {
    if constexpr (Dim == 2) {
      return of_2_;
    } else {
      return of_3_;
    }
  }

  template <int Dim>
  typename System<Dim>::Points& workspace() {
    if constexpr (Dim == 2) {
      return x_2_;
    } else {
      return x_3_;
    }
  }

  std::string method_;
  AnySolver<System<2>> of_2_;
  AnySolver<System<3>> of_3_;
  System<2>::Points x_2_;
  System<3>::Points x_3_;
  double most_rounds_ = 0;
  bool busy_ = false;
};

std::string text_of(std::string_view text) { return std::string(text); }

py::object definite(const Summary& summary) {
  if (!summary.positive_definite) return py::none();
  return py::bool_(*summary.positive_definite);
}

constexpr const char* kSolve =
    "Moves x (N, dim), the start, to a stationary point of the system's energy and writes it back into x, a\n"
    "float64, C-contiguous, writeable array (otherwise TypeError or ValueError). The Summary says how the\n"
    "solve ended. If `usable` is false, x is unchanged. The GIL is released during the solve;\n"
    "KeyboardInterrupt ends a solve that takes long, and leaves x unchanged.\n\n"
    "ValueError for input that the method refuses: a value that is not finite or out of range, or an x that\n"
    "shares the system's memory, such as its anchors (pass a copy); MemoryError if memory runs out. With\n"
    "check=False, the Summary says so instead, and nothing is raised.\n\n"
    "on_iteration(iteration, x, energy, gradient_norm), if given, is called at the start and after each\n"
    "iteration, with a copy of x; False ends the solve, with Status.INTERRUPTED, and so does an exception,\n"
    "which is raised. RuntimeError if it changes the system, which no other thread may do either.";

void bind_status(py::module_& m) {
  py::dict members;
  std::string doc = "Why a solver stopped, and what x is then; an int to NumPy.\n";
  const auto add = [&](const char* name, Status status, const char* text) {
    members[name] = static_cast<int>(status);
    doc.append("\n").append(name).append(": ").append(text);
  };
  add("NOT_RUN", Status::NotRun, "solve was not called");
  add("CONVERGED", Status::Converged, "x is a stationary point within the tolerance");
  add("MAX_ITERATIONS", Status::MaxIterations, "the iterations ran out; x is the last iterate");
  add("NO_PROGRESS", Status::NoProgress, "the solver could not go on; x is its best iterate");
  add("NUMERICAL_FAILURE", Status::NumericalFailure,
      "overflow, or stiffness ratios beyond float64's digits; x is unchanged");
  add("INVALID_INPUT", Status::InvalidInput, "the message names the offending value; x is unchanged");
  add("OUT_OF_MEMORY", Status::OutOfMemory, "a workspace could not be allocated; x is unchanged");
  add("INTERRUPTED", Status::Interrupted, "on request; x is the last iterate or, in a batch, unchanged");
  const py::module_ enums = py::module_::import("enum");
  const py::object type = enums.attr("IntEnum")("Status", members, py::arg("module") = m.attr("__name__"));
  type.attr("__doc__") = doc;
  // An IntEnum would be printed as its number, which says less.
  for (const char* name : {"__str__", "__format__"}) py::setattr(type, name, enums.attr("Enum").attr(name));
  m.attr("Status") = type;
}

}  // namespace

void bind_solvers(py::module_& m) {
  bind_status(m);

  py::class_<Summary> summary(m, "Summary", "The result of a solver. Numbers are -1 until they are known.");
  def_copy(summary);
  summary.def_readonly("status", &Summary::status, "Why it stopped.")
      .def_property_readonly(
          "message", [](const Summary& s) { return text_of(s.message); }, "The reason in words.")
      .def_property_readonly(
          "solver", [](const Summary& s) { return text_of(s.solver); }, "The solver's name.")
      .def_readonly("iterations", &Summary::iterations, "Updates of x.")
      .def_readonly("energy_evaluations", &Summary::energy_evaluations, "Made by the method.")
      .def_readonly("gradient_evaluations", &Summary::gradient_evaluations, "Made by the method.")
      .def_readonly("linear_solves", &Summary::linear_solves,
                    "All dimensions as right-hand sides count once.")
      .def_readonly("factorizations", &Summary::factorizations, "Of a matrix.")
      .def_readonly("initial_energy", &Summary::initial_energy, "E at the x given.")
      .def_readonly("final_energy", &Summary::final_energy, "E at the x returned.")
      .def_property_readonly(
          "lower_bound",
          [](const Summary& s) {
            return s.lower_bound < 0 ? std::numeric_limits<double>::quiet_NaN() : s.lower_bound;
          },
          "No x has less energy; NaN where no such bound is known, as without the option gap.")
      .def_readonly("gradient_norm", &Summary::gradient_norm, "|dE/dx| at the x returned.")
      .def_readonly("stationarity", &Summary::stationarity, "At the x returned; see stationarity().")
      .def_property_readonly(
          "positive_definite", &definite,
          "Whether the Hessian at the x returned is positive definite; also False if a component is free to\n"
          "turn or slide; None if the method did not test it.")
      .def_property_readonly(
          "seconds",
          [](const Summary& s) {
            return s.seconds < 0 ? py::object(py::none()) : py::object(py::float_(s.seconds));
          },
          "Wall-clock time of the solve; None if it was not measured, see the option measure_seconds.")
      .def_property_readonly("usable", &Summary::usable, "x is finite and at least as good as the start.")
      .def("__bool__", &Summary::usable, "`usable`, so that `if not solve(...)` sees a failure.")
      .def(pickled<Summary>([](auto& s, auto&& field) {
        field(s.status);
        field(s.message);
        field(s.solver);
        for (auto* count : {&s.iterations, &s.energy_evaluations, &s.gradient_evaluations, &s.linear_solves,
                            &s.factorizations})
          field(*count);
        field(s.positive_definite);
        for (auto* number : {&s.initial_energy, &s.final_energy, &s.lower_bound, &s.gradient_norm,
                             &s.stationarity, &s.seconds})
          field(*number);
      }))
      .def(
          "as_dict",
          [](const py::object& self) {
            py::dict result;
            for (const char* name :
                 {"solver", "status", "message", "iterations", "energy_evaluations", "gradient_evaluations",
                  "linear_solves", "factorizations", "initial_energy", "final_energy", "lower_bound",
                  "gradient_norm", "stationarity", "positive_definite", "seconds", "usable"}) {
              result[name] = self.attr(name);
            }
            return result;
          },
          "All attributes in a dict.")
      .def("__repr__",
           [](const Summary& self) {
             std::ostringstream text;
             text << "<asterism.Summary: " << self.status;
             if (self.usable())
               text << ", " << detail::counted(self.iterations, "iteration") << ", energy "
                    << self.final_energy << ">";
             else
               text << ": " << self.message << ">";
             return text.str();
           })
      .def(
          "__str__",
          [](const Summary& self) {
            std::ostringstream text;
            text << self;
            return text.str();
          },
          "All of it in a line.");

  m.def(
      "methods", [] { return solvers<2>().names(); }, "The methods of this build, for solve and Solver.");

  py::class_<Solver> solver(
      m, "Solver",
      "A method that keeps its memory between solves, for systems of any size and dimension. RuntimeError\n"
      "if two threads use it at once. A copy has the method and its options, and memory of its own.");
  def_copy(solver);
  solver
      .def(py::init<const std::string&, const py::kwargs&>(), py::arg("method") = "auto",
           "method: one of methods(), otherwise ValueError. options: those that `options` lists, otherwise "
           "TypeError.")
      .def("solve", &Solver::solve, py::arg("system"), py::arg("x"), py::arg("on_iteration") = py::none(),
           py::arg("check") = true, kSolve)
      .def_property_readonly("method", &Solver::method, "The method's name.")
      .def_property_readonly("options", &Solver::options, "The options, a copy.")
      .def(py::pickle([](Solver& self) { return py::make_tuple(self.method(), self.options()); },
                      [](const py::tuple& state) {
                        const Fields fields(state, 2);
                        return std::make_unique<Solver>(fields[0].cast<std::string>(), py::kwargs(fields[1]));
                      }))
      .def("__repr__", [](const Solver& self) { return "<asterism.Solver: " + self.method() + ">"; });

  const std::string doc = std::string(kSolve) +
                          "\n\nmethod: one of methods(). options: those of Solver(method).options.\n"
                          "For repeated solves, keep a Solver.";
  m.def(
      "solve",
      [](AnySystem& system, const py::object& x, const std::string& method, const py::object& on_iteration,
         bool check,
         const py::kwargs& options) { return Solver(method, options).solve(system, x, on_iteration, check); },
      py::arg("system"), py::arg("x"), py::arg("method") = "auto", py::arg("on_iteration") = py::none(),
      py::arg("check") = true, doc.c_str());
}

}  // namespace asterism::python
