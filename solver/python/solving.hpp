#pragma once

// What the classes that solve share: options by name, on_iteration, and a solve that Ctrl-C ends.

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <cstdint>
#include <exception>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "bindings.hpp"
#include "interrupts.hpp"

namespace asterism::python {

/// Collects the options' values by name.
class OptionLister final : public OptionVisitor {
 public:
  py::dict values;

  using OptionVisitor::operator();
  void operator()(std::string_view name, double& value, const OptionRange&) override { list(name, value); }
  void operator()(std::string_view name, int& value, const OptionRange&) override { list(name, value); }
  void operator()(std::string_view name, bool& value) override { list(name, value); }
  void operator()(std::string_view name, std::uint64_t& value) override { list(name, value); }

 private:
  template <typename T>
  void list(std::string_view name, T value) {
    values[py::str(name)] = py::cast(value);
  }
};

/// Sets one option to a Python value.
class OptionSetter final : public OptionVisitor {
 public:
  OptionSetter(std::string name, py::handle given) : name_(std::move(name)), given_(given) {}

  using OptionVisitor::operator();
  void operator()(std::string_view name, double& value, const OptionRange&) override { set(name, value); }
  void operator()(std::string_view name, int& value, const OptionRange&) override { set(name, value); }
  void operator()(std::string_view name, bool& value) override { set(name, value); }
  void operator()(std::string_view name, std::uint64_t& value) override { set(name, value); }

  void check_found(const std::string& method) const {
    if (found_) return;
    const std::string of = (method == "auto" ? "the default method '" : "method '") + method + "'";
    throw py::type_error(py::module_::import("asterism.names")
                             .attr("no_option")(of, name_, names_)
                             .template cast<std::string>());
  }

 private:
  template <typename T>
  void set(std::string_view name, T& target) {
    names_.append(py::str(std::string(name)));
    if (name != name_) return;
    found_ = true;
    constexpr bool kBool = std::is_same_v<T, bool>;
    const py::object value = plain(given_);
    // True is not accepted as a number, 2.5 not as an integer, and an array of one number as neither.
    const bool is_one = kBool == py::isinstance<py::bool_>(value) && !py::isinstance<py::array>(value) &&
                        (kBool || std::is_same_v<T, double> || PyIndex_Check(value.ptr()) != 0);
    try {
      if (is_one) {
        target = value.cast<T>();
        return;
      }
    } catch (const py::cast_error&) {
      if constexpr (std::is_integral_v<T> && !kBool)
        throw py::value_error("option " + name_ + ": expected an integer from " +
                              std::to_string(std::numeric_limits<T>::min()) + " to " +
                              std::to_string(std::numeric_limits<T>::max()) + ", found " + shown(given_));
    }
    const char* expected = kBool ? "a bool" : std::is_same_v<T, double> ? "a number" : "an integer";
    throw py::type_error("option " + name_ + ": expected " + expected + ", found " + shown(given_));
  }

  std::string name_;
  py::handle given_;
  py::list names_;
  bool found_ = false;
};

template <typename S>
py::dict options_of(AnySolver<S>& solver) {
  OptionLister list;
  solver.visit_options(list);
  return list.values;
}

/// What a solve returns to Python: for `check`, ValueError for input that the method refused, with the
/// summary's message, and MemoryError if memory ran out.
inline const Summary& checked(const Summary& summary, bool check) {
  if (check && summary.status == Status::InvalidInput) throw py::value_error(std::string(summary.message));
  if (check && summary.status == Status::OutOfMemory) {
    PyErr_SetString(PyExc_MemoryError, std::string(summary.message).c_str());
    throw py::error_already_set();
  }
  return summary;
}

/// TypeError that names the option.
template <typename S>
void set_options(AnySolver<S>& solver, const std::string& method, const py::kwargs& options) {
  for (const auto& [key, given] : options) {
    OptionSetter set(py::cast<std::string>(key), given);
    solver.visit_options(set);
    set.check_found(method);
  }
}

/// Iterations of the method, of all of its starts and of all nodes of its tree.
inline double most_rounds(const py::dict& options) {
  double most = 1;
  for (const char* limit : {"max_iterations", "starts", "max_nodes"}) {
    if (options.contains(limit)) most *= std::max(1.0, py::cast<double>(options[limit]));
  }
  return most;
}

/// Whether the limits of the options allow a solve of tenths of a second or more.
inline bool may_be_long(int elements, double most_rounds) {
  return std::max(elements, 1) * most_rounds > 2e7;
}

/// Calls Python's on_iteration from threads that do not hold the GIL. An exception ends the solve and is
/// kept; so does a system that the callable has changed: the solver could not answer for its result.
template <typename IsUnchanged>
class PythonCallback {
 public:
  PythonCallback(py::object callable, IsUnchanged is_unchanged)
      : callable_(std::move(callable)), is_unchanged_(std::move(is_unchanged)) {}

  bool operator()(const Iteration& at) {
    const py::gil_scoped_acquire acquire;
    try {
      // A copy of x, with one row per node.
      py::array_t<double> x({at.x.cols(), at.x.rows()});
      std::copy_n(at.x.data(), at.x.size(), x.mutable_data());
      const py::object result = callable_(at.number, x, at.energy, at.gradient_norm);
      if (!is_unchanged_()) throw std::runtime_error("on_iteration changed the system that is solved");
      const int goes_on = result.is_none() ? 1 : PyObject_IsTrue(result.ptr());
      if (goes_on < 0) throw py::error_already_set();
      return goes_on > 0;
    } catch (...) {
      raised_ = std::current_exception();
      return false;
    }
  }
  void rethrow() const {
    if (raised_) std::rethrow_exception(raised_);
  }

 private:
  py::object callable_;
  IsUnchanged is_unchanged_;
  std::exception_ptr raised_;
};

/// Solves without the GIL. Throws what on_iteration, or a handler of a signal, raised.
template <typename S, typename IsUnchanged>
Summary run(AnySolver<S>& solver, const S& system, typename S::Points& x, const py::object& on_iteration,
            bool is_long, IsUnchanged is_unchanged) {
  std::optional<PythonCallback<IsUnchanged>> callback;
  if (!on_iteration.is_none() && PyCallable_Check(on_iteration.ptr()) == 0)
    throw py::type_error("on_iteration: expected a function, found " + type_name(on_iteration));
  if (!on_iteration.is_none()) callback.emplace(on_iteration, std::move(is_unchanged));
  const auto work = [&](const std::atomic<bool>& stop) {
    SolverOptions& common = solver.options();
    common.stop = &stop;
    common.on_iteration = callback ? IterationCallback(*callback) : IterationCallback();
    const Summary result = solver.solve(system, x);
    common.stop = nullptr;
    common.on_iteration = {};
    return result;
  };
  const Summary summary = [&] {
    if (is_long) return interruptible(work);
    const py::gil_scoped_release release;
    return work(std::atomic<bool>(false));
  }();
  if (callback) callback->rethrow();
  return summary;
}

}  // namespace asterism::python
