#pragma once

// The solver templates that take long to compile, for systems of 2 and 3 dimensions. No Python headers here.

#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/batch_sensitivity.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/batch/spring_batch.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/energy/sensitivity.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/summary.hpp>
#include <functional>

namespace asterism::python {

template <int Dim>
using System = SpringSystem<double, Dim>;
template <int Dim>
using Batch = SpringBatch<double, Dim>;

/// The solvers of this build, as asterism-bench names them.
template <int Dim>
const SolverRegistry<System<Dim>>& solvers();

/// BatchNewton on `threads`. The calling thread calls `interrupted` after each of its tasks; once that
/// returns true, the systems of tasks that have not begun are left as they were.
template <int Dim>
BatchSummary solve_batch(Batch<Dim>& batch, const NewtonOptions& options, Simd simd, int threads,
                         const std::function<bool()>& interrupted);

/// BatchSensitivity on `threads`, likewise; once `interrupted` returns true, results are of no use.
template <int Dim>
BatchGradientSummary gradients_of_batch(const Batch<Dim>& batch, BatchGradient<Batch<Dim>>& gradient,
                                        const SensitivityOptions& options, Simd simd, int threads,
                                        const std::function<bool()>& interrupted);

}  // namespace asterism::python

/// Instantiates what takes long to compile, of the library and of this file, for one dimension. `specifier`:
/// extern where others do that.
#define ASTERISM_PYTHON_NUMERICS(specifier, Dim)                                                            \
  namespace asterism {                                                                                      \
  inline namespace ASTERISM_ABI {                                                                           \
  specifier template Covariance<python::System<Dim>> covariance(const python::System<Dim>&,                 \
                                                                const python::System<Dim>::Points&);        \
  specifier template NodeCovariances<python::System<Dim>> node_covariances(                                 \
      const python::System<Dim>&, const python::System<Dim>::Points&);                                      \
  specifier template Certificate certify(const python::System<Dim>&, const python::System<Dim>::Points&,    \
                                         const CertifyOptions&);                                            \
  specifier template SystemGradient<python::System<Dim>> sensitivity(const python::System<Dim>&,            \
                                                                     const python::System<Dim>::Points&,    \
                                                                     const python::System<Dim>::Points&,    \
                                                                     const SensitivityOptions&);            \
  specifier template SolutionTangent<python::System<Dim>> solution_tangent(                                 \
      const python::System<Dim>&, const python::System<Dim>::Points&,                                       \
      const SystemTangent<python::System<Dim>>&, const SensitivityOptions&);                                \
  }                                                                                                         \
  namespace python {                                                                                        \
  specifier template const SolverRegistry<System<Dim>>& solvers<Dim>();                                     \
  specifier template BatchSummary solve_batch(Batch<Dim>&, const NewtonOptions&, Simd, int,                 \
                                              const std::function<bool()>&);                                \
  specifier template BatchGradientSummary gradients_of_batch(const Batch<Dim>&, BatchGradient<Batch<Dim>>&, \
                                                             const SensitivityOptions&, Simd, int,          \
                                                             const std::function<bool()>&);                 \
  }                                                                                                         \
  }

ASTERISM_PYTHON_NUMERICS(extern, 2)
ASTERISM_PYTHON_NUMERICS(extern, 3)
