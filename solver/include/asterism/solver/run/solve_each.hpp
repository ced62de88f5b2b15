#pragma once

#include <algorithm>
#include <asterism/solver/detail/config.hpp>
#include <asterism/solver/detail/memory.hpp>
#include <asterism/solver/run/executor.hpp>
#include <asterism/solver/run/solver.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <concepts>
#include <cstddef>
#include <new>
#include <ranges>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Solves many systems of any sizes, each by a copy of `prototype` (a Solver; for one that cannot be copied,
/// such as Auto with its sparse factors, by a new one with the same options). systems[s] is solved from x[s]
/// into x[s], with its summary in summaries[s]. The three are contiguous ranges of the same length; if their
/// lengths differ, every summary gets Status::InvalidInput and nothing is solved. With a solver that does not
/// throw, this does not throw either, unless the executor does.
template <typename Solver_, std::ranges::contiguous_range Systems, std::ranges::contiguous_range Xs,
          std::ranges::contiguous_range Summaries, Executor E = SerialExecutor>
void solve_each(const Systems& systems, Xs&& x, Summaries&& summaries, const Solver_& prototype,
                E&& executor = {}) {
  static_assert(Solver<Solver_, std::ranges::range_value_t<Systems>>);
  const std::span all(std::ranges::data(systems), std::ranges::size(systems));
  const std::span points(std::ranges::data(x), std::ranges::size(x));
  const std::span results(std::ranges::data(summaries), std::ranges::size(summaries));
  if (points.size() != all.size() || results.size() != all.size()) {
    for (Summary& summary : results) {
      summary = Summary();
      summary.status = Status::InvalidInput;
      summary.message = "systems, x and summaries are not of one length";
    }
    return;
  }
  constexpr std::size_t kChunk = 64;
  executor(static_cast<int>((all.size() + kChunk - 1) / kChunk), [&](int task) {
    const std::size_t first = static_cast<std::size_t>(task) * kChunk;
    const std::size_t last = std::min(all.size(), first + kChunk);
    const auto solve_by = [&](Solver_& solver) {
      for (std::size_t s = first; s < last; ++s) results[s] = solver.solve(all[s], points[s]);
    };
    const auto solve = [&] {
      if constexpr (std::copy_constructible<Solver_>) {
        Solver_ solver = prototype;
        solve_by(solver);
      } else {
        Solver_ solver;
        solver.options = prototype.options;
        solve_by(solver);
      }
    };
    // By the copy: a solver catches its own.
    detail::attempt<std::bad_alloc>(solve, [&](const std::bad_alloc& error) {
      for (std::size_t s = first; s < last; ++s) {
        results[s] = Summary();
        results[s].status = Status::OutOfMemory;
        results[s].message = detail::memory_message(error);
      }
    });
  });
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
