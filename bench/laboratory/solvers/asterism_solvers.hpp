#pragma once

#include <memory>
#include <string>

#include "../laboratory.hpp"

namespace asterism::bench {

inline const std::string kOurs = "Asterism " ASTERISM_VERSION;

/// Solvers of the library, compiled for four nodes where a problem has four, as a user would.
template <template <typename...> typename Solver>
SolverEntry ours(const std::string& name, int dense_nodes, int sparse_nodes) {
  return {name,
          std::string(Solver<System>::name()),
          kOurs,
          dense_nodes,
          sparse_nodes,
          [](int nodes) -> std::unique_ptr<Runner> {
            using Fixed = SpringSystem<double, 2, 4>;
            if (nodes == 4) return std::make_unique<RunnerOf<Solver<Fixed>, Fixed>>();
            return std::make_unique<RunnerOf<Solver<System>>>();
          }};
}

}  // namespace asterism::bench
