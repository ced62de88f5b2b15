#pragma once

// Parts with maps of costs, and joints between them; shared by the tests of trees and of graphs with loops.

#include <Eigen/Core>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <cstddef>
#include <vector>

namespace asterism::testing {

struct MapProblem {
  std::vector<std::vector<float>> numbers;
  std::vector<MapView<const float>> maps;
  std::vector<Joint> joints;

  double energy(const Eigen::Matrix2Xi& x) const {
    double sum = 0;
    for (std::size_t i = 0; i < maps.size(); ++i) {
      sum += static_cast<double>(maps[i](x(0, static_cast<int>(i)), x(1, static_cast<int>(i))));
    }
    for (const Joint& joint : joints) {
      const Eigen::Vector2i d = x.col(joint.child) - x.col(joint.parent);
      sum += joint.cost(d.x(), d.y());
    }
    return sum;
  }
};

}  // namespace asterism::testing
