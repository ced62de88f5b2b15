#pragma once

// What of the solver room takes long to compile, for systems of 2 and of 3 dimensions; no Python in here.

#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string_view>
#include <variant>
#include <vector>

namespace asterism::python {

template <int Dim>
using System = SpringSystem<double, Dim>;
template <int Dim>
using Batch = SpringBatch<double, Dim>;

/// An option of a solver, by name; the value is the solver's own.
struct Option {
  const char* name;
  std::variant<bool*, int*, double*, std::uint64_t*> value;
};

/// Any solver, chosen at run time.
template <int Dim>
class AnySolver {
 public:
  virtual ~AnySolver() = default;
  /// Ends early once `stop` is true.
  virtual Summary solve(const System<Dim>& system, typename System<Dim>::Points& x,
                        const std::atomic<bool>& stop) = 0;
  virtual std::vector<Option> options() = 0;
};

/// The methods of this build, as asterism-bench names them.
std::vector<std::string_view> method_names();

/// Throws std::invalid_argument that lists the known methods for any other.
template <int Dim>
std::unique_ptr<AnySolver<Dim>> make_solver(std::string_view method);

template <int Dim>
Covariance<System<Dim>> covariance_of(const System<Dim>& system, const typename System<Dim>::Points& x);
template <int Dim>
NodeCovariances<System<Dim>> node_covariances_of(const System<Dim>& system,
                                                 const typename System<Dim>::Points& x);

/// BatchNewton on `threads`. The calling thread asks `interrupted` after each of its tasks; once it is, what
/// has not been begun is left as it was.
template <int Dim>
BatchSummary solve_batch(Batch<Dim>& batch, const NewtonOptions& options, Simd simd, int threads,
                         const std::function<bool()>& interrupted);

}  // namespace asterism::python
