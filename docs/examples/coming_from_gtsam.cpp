#include <asterism/solver.hpp>
#include <iostream>

int main() {
  // Ranges between three beacons (nodes 0 to 2) and two unknown points (nodes 3 and 4).
  const asterism::Link links[] = {{0, 3}, {1, 3}, {2, 3}, {2, 4}, {3, 4}};
  asterism::SpringSystem<double, 2> graph(asterism::Topology<>::from_links(5, links));
  graph.rest_length << 7.1, 6.9, 5.2, 4.1, 3.9;            // RangeFactor: the measured ranges [m]
  graph.link_stiffness.setConstant(1 / (0.1 * 0.1));       // noise model: 1 / sigma^2
  graph.anchors << 0, 10, 5, 5, 8, /* x */ 0, 0, 10, 5, 7; /* y */
  graph.anchor_stiffness << 1, 1, 1, 0, 1 / (2.0 * 2.0);   // PriorFactor: 1 / sigma^2, 0 without a prior
  for (int beacon = 0; beacon < 3; ++beacon) graph.fix(beacon);  // NonlinearEquality

  auto x = graph.anchors;  // Values: the initial estimate, then the result
  const asterism::Summary summary = asterism::solve(graph, x);
  const auto marginals = asterism::node_covariances(graph, x);
  std::cout << summary.status << ", node 3 at " << x.col(3).transpose() << ", node 4 at "
            << x.col(4).transpose() << "\n";
  return summary.usable() && marginals ? 0 : 1;
}
