#pragma once

// The solver room: all of asterism::solver. What needs another package or is compiled belongs to targets of
// its own, and is included by itself: <asterism/solver/method/cholmod.hpp>, the headers of reference/, io/
// and batch/.
#include <asterism/solver/energy/align.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/linear/dense_cholesky.hpp>
#include <asterism/solver/linear/jacobi_metric.hpp>
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/nonlinear_cg.hpp>
#include <asterism/solver/method/sparse_ida.hpp>
#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/option_visitor.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/solver.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#ifdef ASTERISM_SOLVER_COMPILED
#include <asterism/solver/method/branch_and_bound.hpp>
#include <asterism/solver/method/solve_global.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#endif
