#pragma once

// The definitions of numerics.hpp, to be included by one source a dimension.

#include <asterism/solver.hpp>
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>

#include "numerics.hpp"
#ifdef ASTERISM_PYTHON_CHOLMOD
#include <asterism/solver/linear/cholmod.hpp>
#endif
#ifdef ASTERISM_PYTHON_CERES
#include <asterism/solver/reference/ceres.hpp>
#endif
#ifdef ASTERISM_PYTHON_LBFGS
#include <asterism/solver/reference/liblbfgs.hpp>
#endif

namespace asterism::python {

template <typename Solver, int Dim>
class SolverOf final : public AnySolver<Dim> {
 public:
  Summary solve(const System<Dim>& system, typename System<Dim>::Points& x,
                const std::atomic<bool>& stop) override {
    solver_.options.stop = &stop;
    const Summary summary = solver_.solve(system, x);
    solver_.options.stop = nullptr;
    return summary;
  }

  std::vector<Option> options() override {
    auto& o = solver_.options;
    std::vector<Option> all{{"tolerance", &o.tolerance},
                            {"max_iterations", &o.max_iterations},
                            {"ground_components", &o.ground_components}};
    if constexpr (requires { o.align; }) {
      all.insert(all.end(), {{"align", &o.align}, {"allow_reflection", &o.allow_reflection}});
    }
    if constexpr (requires { o.relaxation; }) all.push_back({"relaxation", &o.relaxation});
    if constexpr (requires { o.escape_saddles; }) all.push_back({"escape_saddles", &o.escape_saddles});
    if constexpr (requires { o.starts; }) {
      all.insert(all.end(), {{"starts", &o.starts}, {"spread", &o.spread}, {"seed", &o.seed}});
    }
    return all;
  }

 private:
  Solver solver_;
};

/// A method's name and what makes its solver.
template <int Dim>
struct Method {
  std::string_view name;
  std::unique_ptr<AnySolver<Dim>> (*make)();
};

template <int Dim>
const std::vector<Method<Dim>>& methods() {
  using S = System<Dim>;
  const auto method = []<typename Solver>(std::string_view name, std::type_identity<Solver>) {
    return Method<Dim>{
        name, +[]() -> std::unique_ptr<AnySolver<Dim>> { return std::make_unique<SolverOf<Solver, Dim>>(); }};
  };
#define ASTERISM_METHOD(name, ...) method(name, std::type_identity<__VA_ARGS__>())
  static const std::vector<Method<Dim>> all{
      ASTERISM_METHOD("auto", Auto<S>),
      ASTERISM_METHOD("ida", Ida<S>),
      ASTERISM_METHOD("ida-sparse", SparseIda<S>),
      ASTERISM_METHOD("newton", Newton<S>),
      ASTERISM_METHOD("newton-cg", NewtonCg<S>),
      ASTERISM_METHOD("newton-sparse", SparseNewton<S>),
      ASTERISM_METHOD("lbfgs", Lbfgs<S>),
      ASTERISM_METHOD("schwarz", Schwarz<S>),
      ASTERISM_METHOD("schwarz-direct", Schwarz<S, SparseNewton<S>>),
      ASTERISM_METHOD("multi-start", MultiStart<S, Auto<S>>),
      ASTERISM_METHOD("ncg", NonlinearCg<S>),
      ASTERISM_METHOD("ncg-forward", NonlinearCg<S, ForwardDifferences<S>>),
      ASTERISM_METHOD("ncg-central", NonlinearCg<S, CentralDifferences<S>>),
#ifdef ASTERISM_PYTHON_CHOLMOD
      ASTERISM_METHOD("ida-cholmod", CholmodIda<S>),
      ASTERISM_METHOD("newton-cholmod", SparseNewton<S, CholmodLlt<S>>),
#endif
#ifdef ASTERISM_PYTHON_CERES
      ASTERISM_METHOD("ceres-dense", reference::Ceres<S, reference::CeresMethod::LevenbergMarquardtDense>),
      ASTERISM_METHOD("ceres-sparse", reference::Ceres<S, reference::CeresMethod::LevenbergMarquardtSparse>),
      ASTERISM_METHOD("ceres-lbfgs", reference::Ceres<S, reference::CeresMethod::Lbfgs>),
      ASTERISM_METHOD("ceres-cg", reference::Ceres<S, reference::CeresMethod::NonlinearCg>),
#endif
#ifdef ASTERISM_PYTHON_LBFGS
      ASTERISM_METHOD("liblbfgs", reference::Liblbfgs<S>),
#endif
  };
#undef ASTERISM_METHOD
  return all;
}

template <int Dim>
std::unique_ptr<AnySolver<Dim>> make_solver(std::string_view name) {
  std::string known;
  for (const Method<Dim>& method : methods<Dim>()) {
    if (method.name == name) return method.make();
    known.append(known.empty() ? "" : ", ").append(method.name);
  }
  throw std::invalid_argument("unknown method '" + std::string(name) + "' (known: " + known + ")");
}

template <int Dim>
Covariance<System<Dim>> covariance_of(const System<Dim>& system, const typename System<Dim>::Points& x) {
  return covariance(system, x);
}

template <int Dim>
NodeCovariances<System<Dim>> node_covariances_of(const System<Dim>& system,
                                                 const typename System<Dim>::Points& x) {
  return node_covariances(system, x);
}

template <int Dim>
BatchSummary solve_batch(Batch<Dim>& batch, const NewtonOptions& options, Simd simd, int threads,
                         const std::function<bool()>& interrupted) {
  BatchNewton<Batch<Dim>> solver(batch, options);
  solver.simd = simd;
  std::atomic<bool> stop{false};
  solver.options.stop = &stop;
  return solver.solve(batch, [&](int task_count, auto&& work) {
    const std::thread::id caller = std::this_thread::get_id();
    ThreadExecutor{threads}(task_count, [&](int task) {
      work(task);
      if (!stop && std::this_thread::get_id() == caller && interrupted()) stop = true;
    });
  });
}

/// All of it, for one dimension.
#define ASTERISM_INSTANTIATE_NUMERICS(Dim)                                                                   \
  template std::unique_ptr<AnySolver<Dim>> make_solver<Dim>(std::string_view);                               \
  template Covariance<System<Dim>> covariance_of(const System<Dim>&, const System<Dim>::Points&);            \
  template NodeCovariances<System<Dim>> node_covariances_of(const System<Dim>&, const System<Dim>::Points&); \
  template BatchSummary solve_batch(Batch<Dim>&, const NewtonOptions&, Simd, int,                            \
                                    const std::function<bool()>&)

}  // namespace asterism::python
