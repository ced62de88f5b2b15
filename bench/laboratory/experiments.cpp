#include "experiments.hpp"

#include <asterism/testing/sparse_system.hpp>
#include <cstdio>
#include <map>

#include "measure.hpp"

namespace asterism::bench {

namespace {

// Small enough that a cell takes about a second with the slower solvers.
int chunk_size(int nodes) {
  if (nodes <= 16) return 100;
  if (nodes <= 100) return 10;
  return 1;
}

}  // namespace

std::vector<Chunk> chunks(const Selection& selection) {
  std::vector<std::vector<Chunk>> by_group;
  const auto add = [&](const std::string& group, int nodes, bool is_sparse, int count,
                       std::function<Problem(int)> problem) {
    auto& result = by_group.emplace_back();
    const int size = chunk_size(nodes);
    for (int first = 0; first < count; first += size) {
      result.push_back({group, nodes, is_sparse, first, std::min(size, count - first), problem});
    }
  };
  for (const testing::Kind kind : selection.kinds) {
    for (const int n : selection.sizes) {
      // Fewer large systems are enough, as they vary less.
      const int count = n <= 100 ? selection.systems : std::max(1, selection.systems / 10);
      add(std::string(to_string(kind)) + "/" + std::to_string(n), n, false, count, [kind, n](int index) {
        return testing::numbered_system<System>(kind, Topology<>::full(n), static_cast<std::uint64_t>(index));
      });
    }
  }
  for (const int n : selection.sparse_sizes) {
    add("sparse/" + std::to_string(n), n, true, std::clamp(selection.systems / 10, 1, 1000000 / n + 1),
        [n](int index) { return testing::sparse_system<System>(static_cast<std::uint64_t>(index) + 1, n); });
  }
  std::map<int, std::vector<int>> recorded;
  for (std::size_t i = 0; i < selection.recorded->size(); ++i) {
    recorded[(*selection.recorded)[i].system.nodes()].push_back(static_cast<int>(i));
  }
  for (const auto& [n, indices] : recorded) {
    const auto count = static_cast<int>(indices.size());
    add("real/" + std::to_string(n), n, false, count,
        [all = selection.recorded, indices = indices](int index) {
          return (*all)[static_cast<std::size_t>(indices[static_cast<std::size_t>(index)])];
        });
    for (Chunk& chunk : by_group.back()) chunk.digest = selection.recorded_digest;
  }

  std::vector<Chunk> result;
  for (std::size_t round = 0, more = 1; more != 0; ++round) {
    more = 0;
    for (const auto& group : by_group) {
      if (round >= group.size()) continue;
      result.push_back(group[round]);
      ++more;
    }
  }
  return result;
}

std::vector<Cell> cells_of(const Selection& selection,
                           const std::function<Json(Runner&, const Chunk&)>& measure) {
  std::vector<Cell> cells;
  for (const Chunk& chunk : chunks(selection)) {
    for (const SolverEntry& solver : selection.solvers) {
      if (chunk.nodes > (chunk.is_sparse ? solver.sparse_nodes : solver.dense_nodes)) continue;
      const std::string problems = chunk.digest.empty() ? chunk.group : chunk.group + "/" + chunk.digest;
      cells.push_back({problems + "/" + std::to_string(chunk.first) + "+" + std::to_string(chunk.count) +
                           "/" + solver.name,
                       [chunk, solver, measure] {
                         const auto runner = solver.make(chunk.nodes);
                         Json json{{"group", chunk.group}, {"solver", solver.name}, {"systems", chunk.count}};
                         json.update(measure(*runner, chunk));
                         return json;
                       }});
    }
  }
  return cells;
}

std::vector<Cell> cells_by_weakness(const Selection& selection, const std::vector<double>& weaknesses,
                                    const std::function<Json(Runner&, const Chunk&, double)>& measure) {
  std::vector<Cell> cells;
  for (const double weakness : weaknesses) {
    const auto measure_cell = [=](Runner& runner, const Chunk& chunk) {
      return measure(runner, chunk, weakness);
    };
    for (Cell& cell : cells_of(selection, measure_cell)) {
      cell.key = format("anchors x %g/", weakness) + cell.key;
      cells.push_back(std::move(cell));
    }
  }
  return cells;
}

std::vector<const Json*> cells_with(const Results& results, const std::string& group,
                                    const std::string& solver) {
  std::vector<const Json*> found;
  for (const auto& [key, cell] : results) {
    if (cell["group"] == group && cell["solver"] == solver) found.push_back(&cell);
  }
  return found;
}

std::vector<std::string> groups(const Selection& selection) {
  std::vector<std::string> result;
  for (const Chunk& chunk : chunks(selection)) {
    if (std::find(result.begin(), result.end(), chunk.group) == result.end()) result.push_back(chunk.group);
  }
  return result;
}

Json coordinates(const Points& x) {
  Json result = Json::array();
  for (const auto& column : x.colwise()) result.push_back({column[0], column[1]});
  return result;
}

void claim(const char* text, bool reproduced, const std::string& evidence) {
  std::printf("  %s: %s\n    %s\n", reproduced ? "reproduced" : "NOT reproduced", text, evidence.c_str());
}

}  // namespace asterism::bench
