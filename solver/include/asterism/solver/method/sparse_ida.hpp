#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/run/compiled.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Ida with a sparse factorisation.
template <typename System>
using SparseIda = Ida<System, SparseCholesky<System>>;

ASTERISM_COMPILED_SPARSE_SOLVER(SparseIda)

}  // namespace ASTERISM_ABI
}  // namespace asterism
