#include <algorithm>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/trackers/constellation/mode_search.hpp>
#include <cmath>
#include <cstddef>
#include <vector>

#include "solver_workspace.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

struct detail::ModeMaps {
  std::vector<std::vector<float>> costs;  // of each part, and of the constellation, which has none of its own
  std::vector<MapView<const float>> views;
  std::vector<Joint> joints;
  PictorialStructure structure;
  PartPlacement best;
  ResponseMap mode;  // a response without its other maxima
};
template class detail::SolverWorkspace<detail::ModeMaps>;

namespace {

struct Cell {
  Eigen::Index row, col;
};

// The neighbour of a cell, if there is one.
bool move(const ResponseMap& response, Cell& cell, Eigen::Index down, Eigen::Index right) {
  const Eigen::Index rows = response.values.rows(), cols = response.values.cols();
  cell.row += down;
  cell.col += right;
  if (response.periodic) {
    cell.row = (cell.row + rows) % rows;
    cell.col = (cell.col + cols) % cols;
  }
  return 0 <= cell.row && cell.row < rows && 0 <= cell.col && cell.col < cols;
}

template <typename Use>
void for_each_neighbour(const ResponseMap& response, const Cell& cell, Use&& use) {
  for (Eigen::Index down = -1; down <= 1; ++down) {
    for (Eigen::Index right = -1; right <= 1; ++right) {
      Cell neighbour = cell;
      if (move(response, neighbour, down, right)) use(neighbour);
    }
  }
}

// The maximum that the steepest climb from a position reaches.
Cell climb(const ResponseMap& response, const Point2& from) {
  const auto& r = response.values;
  const Point2 grid = (from - response.origin).cwiseQuotient(response.spacing);
  const auto nearest = [](double at, Eigen::Index count) {
    return std::clamp(static_cast<Eigen::Index>(std::lround(at)), Eigen::Index{0}, count - 1);
  };
  Cell top{nearest(grid.y(), r.rows()), nearest(grid.x(), r.cols())};
  while (true) {
    const Cell from_here = top;
    for_each_neighbour(response, from_here, [&](const Cell& neighbour) {
      if (r(neighbour.row, neighbour.col) > r(top.row, top.col)) top = neighbour;
    });
    if (top.row == from_here.row && top.col == from_here.col) return top;
  }
}

}  // namespace

void ModeSearch::choose(std::span<const AnyPart> parts, const DptSystem::Points& x,
                        std::span<const double> stiffness, std::span<Evidence> evidence) {
  const auto dense = std::find_if(parts.begin(), parts.end(), [](const AnyPart& part) {
    return part.response() != nullptr && part.response()->values.size() > 0;
  });
  if (dense == parts.end()) return;
  detail::ModeMaps& maps = *workspace_;
  const Size2 cell = dense->response()->spacing;
  const auto width = static_cast<int>(dense->response()->values.cols()),
             height = static_cast<int>(dense->response()->values.rows());
  const auto displacement = [&](int col, int row) -> Point2 {
    return cell.cwiseProduct(Point2(col - width / 2, row - height / 2));
  };

  // The last map is that of the constellation.
  const auto hub = static_cast<int>(parts.size());
  maps.costs.resize(parts.size() + 1);
  maps.views.clear();
  maps.joints.clear();
  for (int i = 0; i <= hub; ++i) {
    auto& costs = maps.costs[static_cast<std::size_t>(i)];
    costs.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0.0F);
    maps.views.emplace_back(costs.data(), width, height);
    if (i == hub) continue;
    const AnyPart& part = parts[static_cast<std::size_t>(i)];
    float* cost = costs.data();
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        *cost++ = static_cast<float>(-0.5 * part.similarity_at(x.col(i) + displacement(col, row)));
      }
    }
    const double half = stiffness[static_cast<std::size_t>(i)] / 2;
    maps.joints.push_back({hub,
                           i,
                           {AxisCost::quadratic(half * cell.x() * cell.x(), 0),
                            AxisCost::quadratic(half * cell.y() * cell.y(), 0)}});
  }
  if (!maps.structure.solve(maps.joints, maps.views, maps.best).usable()) return;

  for (int i = 0; i < hub; ++i) {
    const ResponseMap* const response = parts[static_cast<std::size_t>(i)].response();
    if (response == nullptr || response->values.size() == 0) continue;
    const Point2 place = x.col(i) + displacement(maps.best.positions(0, i), maps.best.positions(1, i));
    const Cell top = climb(*response, place);
    const float peak = response->values(top.row, top.col);
    if (peak >= response->values.maxCoeff()) continue;  // what the evidence is of
    Evidence& found = evidence[static_cast<std::size_t>(i)];
    if (!(peak > 0)) {
      found.position = place;
      found.peak = 0;
      continue;
    }
    maps.mode = *response;
    maps.mode.values.setZero();
    for_each_neighbour(*response, top, [&](const Cell& neighbour) {
      maps.mode.values(neighbour.row, neighbour.col) = response->values(neighbour.row, neighbour.col);
    });
    found = evidence_of(maps.mode, *response);
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
