#pragma once

// All kernels of this folder, for the sources of each instruction set.
#include "dense_factor_kernel.hpp"
#include "link_rows_kernel.hpp"
#include "newton_kernel.hpp"
#include "placed_points_kernel.hpp"
#include "spring_tiles_kernel.hpp"
#include "vector_kernel.hpp"

// run(Result, function, Task) for each kernel: `function` runs a Task by the widest instructions of the
// machine.
#define ASTERISM_FOR_EACH_KERNEL(run)                                                                     \
  run(double, sum, LinkRows) run(void, place, PlacedPoints)                                               \
      run(std::ptrdiff_t, factorize, SymmetricMatrix<double>)                                             \
          run(std::ptrdiff_t, factorize, SymmetricMatrix<float>) run(void, solve, RightHandSides<double>) \
              run(void, solve, RightHandSides<float>) run(void, multiply, MatrixProduct)                  \
                  run(void, invert, InverseDiagonal) run(void, invert, Inverse<double>)                   \
                      run(void, invert, Inverse<float>) run(double, differentiate, SpringHessian)         \
                          run(EnergyAlong, differentiate, SpringTiles)                                    \
                              run(Pivots, eliminate, NewtonEquations) run(double, substitute, NewtonStep) \
                                  run(double, update, DescentPair) run(double, add, ColumnSum)            \
                                      run(bool, invert, MatrixInverse)                                    \
                                          run(void, subtract, PointsLessProduct)
