#pragma once

// The solver room: all of asterism::solver. The adapters <asterism/solver/cholmod.hpp>,
// <asterism/solver/ceres.hpp> and <asterism/solver/liblbfgs.hpp> belong to targets of their own.
#include <asterism/solver/align.hpp>
#include <asterism/solver/auto.hpp>
#include <asterism/solver/covariance.hpp>
#include <asterism/solver/descent.hpp>
#include <asterism/solver/energy.hpp>
#include <asterism/solver/ida.hpp>
#include <asterism/solver/lbfgs.hpp>
#include <asterism/solver/model.hpp>
#include <asterism/solver/multi_start.hpp>
#include <asterism/solver/newton.hpp>
#include <asterism/solver/newton_cg.hpp>
#include <asterism/solver/nonlinear_cg.hpp>
#include <asterism/solver/schwarz.hpp>
#include <asterism/solver/sparse_newton.hpp>
#include <asterism/solver/spring_system.hpp>
#include <asterism/solver/stationarity.hpp>
#include <asterism/solver/summary.hpp>
#include <asterism/solver/validate.hpp>
