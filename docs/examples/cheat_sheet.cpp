#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/system.hpp>
#include <iostream>

int main() {
  // Any number of nodes and terms, chosen at run time; compiles in seconds.
  const Eigen::MatrixXd seen{{0, 40, 0, 70}, {0, 0, 40, 55}};  // one column per node
  const Eigen::Matrix2Xi pairs = asterism::all_pairs(4);
  const Eigen::MatrixXd shape{{0, 40, 0, 40}, {0, 0, 40, 40}};
  asterism::System system(4, 2);
  system.add_links(pairs, asterism::lengths_at(shape, pairs), asterism::System::all(1));
  system.add_anchors(seen, Eigen::Vector4d(0.5, 0.5, 0.5, 0.05));

  Eigen::MatrixXd x = seen;                                      // the start, then the result
  const asterism::Summary summary = asterism::solve(system, x);  // or solve("lbfgs", system, x)
  std::cout << summary.status << ", energy " << summary.final_energy << "\n";
  const asterism::Solution solution(system, x);
  if (solution) std::cout << "variance " << solution.covariance(3).trace() << "\n";

  // Fixed sizes: no heap, microseconds; and thousands of them in the lanes of the processor.
  using Springs = asterism::SpringSystem<double, 2, 4>;
  Springs springs(asterism::Topology<4>::full());
  springs.anchors = seen;
  springs.anchor_stiffness << 0.5, 0.5, 0.5, 0.05;
  springs.set_rest_lengths(Springs::Points(shape));
  springs.link_stiffness.setConstant(1);
  asterism::SpringBatch<double, 2, 4> batch(asterism::Topology<4>::full(), 1000);
  for (int s = 0; s < 1000; ++s) batch.set(s, springs, springs.anchors);
  asterism::BatchNewton<asterism::SpringBatch<double, 2, 4>> newton;
  newton.solve(batch, asterism::ThreadExecutor{2});
  std::cout << batch.status(999) << ", energy " << batch.final_energy(999) << "\n";
}
