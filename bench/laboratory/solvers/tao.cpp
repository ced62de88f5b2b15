// The minimisers of TAO, a part of PETSc, on one process.
#include <petsctao.h>

#include <asterism/solver/distributed/petsc.hpp>
#include <new>

#include "../measure.hpp"
#include "objective.hpp"

namespace asterism::bench {
namespace {

/// What TAO calls back.
struct Run {
  Objective& objective;
  int max_iterations;
  PetscInt iteration = 0;
  int rejected = 0;  // steps since the last iteration
};

PetscErrorCode evaluate(Tao, Vec x, PetscReal* energy, Vec gradient, void* run) {
  PetscFunctionBeginUser;
  const double* from = nullptr;
  double* to = nullptr;
  PetscCall(VecGetArrayRead(x, &from));
  PetscCall(VecGetArrayWrite(gradient, &to));
  *energy = static_cast<Run*>(run)->objective(from, to);
  PetscCall(VecRestoreArrayWrite(gradient, &to));
  PetscCall(VecRestoreArrayRead(x, &from));
  PetscFunctionReturn(0);
}

PetscErrorCode hessian(Tao, Vec x, Mat matrix, Mat, void* run) {
  PetscFunctionBeginUser;
  const double* from = nullptr;
  double* to = nullptr;
  PetscCall(VecGetArrayRead(x, &from));
  PetscCall(MatDenseGetArrayWrite(matrix, &to));
  static_cast<Run*>(run)->objective.hessian(from, to);
  PetscCall(MatDenseRestoreArrayWrite(matrix, &to));
  PetscCall(VecRestoreArrayRead(x, &from));
  PetscCall(MatAssemblyBegin(matrix, MAT_FINAL_ASSEMBLY));
  PetscCall(MatAssemblyEnd(matrix, MAT_FINAL_ASSEMBLY));
  PetscFunctionReturn(0);
}

PetscErrorCode test(Tao tao, void* given) {
  PetscFunctionBeginUser;
  auto& run = *static_cast<Run*>(given);
  constexpr int kRejected = 60;  // a radius that shrinks for so long finds no step
  PetscInt iteration = 0;
  PetscCall(TaoGetIterationNumber(tao, &iteration));
  bool ends = run.objective.done();
  if (iteration > run.iteration) {
    ends = run.objective.iterated();
    run.iteration = iteration;
    run.rejected = 0;
  }
  TaoConvergedReason reason = TAO_CONTINUE_ITERATING;
  if (ends)
    reason = TAO_CONVERGED_USER;
  else if (iteration >= run.max_iterations)
    reason = TAO_DIVERGED_MAXITS;
  else if (++run.rejected > kRejected)
    reason = TAO_DIVERGED_TR_REDUCTION;
  PetscCall(TaoSetConvergedReason(tao, reason));
  PetscFunctionReturn(0);
}

template <int kMethod>
struct TaoMethod {
  static constexpr const char* kTypes[] = {TAOLMVM, TAOCG, TAONLS, TAONTR};
  static constexpr const char* kTitles[] = {"TAO, L-BFGS", "TAO, nonlinear CG", "TAO, Newton, line search",
                                            "TAO, Newton, trust region"};
  static constexpr bool kIsNewton = kMethod >= 2;

  static constexpr std::string_view name() { return kTitles[kMethod]; }

  static Status minimise(Objective& objective, const Points& start, int max_iterations, Summary& summary) {
    Run run{objective, max_iterations};
    Tao tao = nullptr;
    Vec x = nullptr;
    Mat matrix = nullptr;
    TaoConvergedReason reason = TAO_CONTINUE_ITERATING;
    const auto solve = [&]() -> PetscErrorCode {
      PetscFunctionBeginUser;
      PetscCall(VecCreateSeq(PETSC_COMM_SELF, objective.size(), &x));
      double* numbers = nullptr;
      PetscCall(VecGetArrayWrite(x, &numbers));
      objective.write(start, numbers);
      PetscCall(VecRestoreArrayWrite(x, &numbers));
      PetscCall(TaoCreate(PETSC_COMM_SELF, &tao));
      PetscCall(TaoSetType(tao, kTypes[kMethod]));
      PetscCall(TaoSetSolution(tao, x));
      PetscCall(TaoSetObjectiveAndGradient(tao, nullptr, evaluate, &run));
      if (kIsNewton) {
        PetscCall(MatCreateSeqDense(PETSC_COMM_SELF, objective.size(), objective.size(), nullptr, &matrix));
        PetscCall(TaoSetHessian(tao, matrix, matrix, hessian, &run));
      }
      PetscCall(TaoSetTolerances(tao, 0, 0, 0));
      PetscCall(TaoSetMaximumFunctionEvaluations(tao, PETSC_MAX_INT));
      PetscCall(TaoSetMaximumIterations(tao, max_iterations));
      PetscCall(TaoSetConvergenceTest(tao, test, &run));
      PetscCall(TaoSolve(tao));
      PetscCall(TaoGetConvergedReason(tao, &reason));
      PetscFunctionReturn(0);
    };
    PetscPushErrorHandler(PetscReturnErrorHandler, nullptr);
    const PetscErrorCode code = solve();
    TaoDestroy(&tao);
    MatDestroy(&matrix);
    VecDestroy(&x);
    PetscPopErrorHandler();
    if (code == PETSC_ERR_MEM) throw std::bad_alloc();
    summary.message.assign(code != 0 ? "an error of PETSc" : TaoConvergedReasons[reason]);
    return reason == TAO_DIVERGED_MAXITS ? Status::MaxIterations : Status::NoProgress;
  }
};

template <int kMethod>
SolverEntry entry(const std::string& name, int nodes) {
  using Solver = PeerSolver<TaoMethod<kMethod>>;
  const auto make = [](int n) {
    static char program[] = "asterism-bench";
    static char* arguments[] = {program, nullptr};
    static int argc = 1;
    static char** argv = arguments;
    static const PetscRuntime runtime(argc, argv);  // before the first solve is timed
    return make_runner<Solver>(n);
  };
  return {name,
          std::string(Solver::name()),
          format("PETSc %d.%d.%d", PETSC_VERSION_MAJOR, PETSC_VERSION_MINOR, PETSC_VERSION_SUBMINOR),
          nodes,
          0,
          make};
}

const Registration kLmvm(entry<0>("tao-lmvm", 1000));
const Registration kCg(entry<1>("tao-cg", 1000));
const Registration kLineSearch(entry<2>("tao-nls", 100));
const Registration kTrustRegion(entry<3>("tao-ntr", 100));

}  // namespace
}  // namespace asterism::bench
