#include <asterism/system.hpp>
#include <iostream>

int main() {
  // Four parts in a square of 40 px, each linked to all others.
  Eigen::MatrixXd seen(2, 4);
  seen << 0, 40, 0, 40, /* x */ 0, 0, 40, 40; /* y */
  const auto pairs = asterism::all_pairs(4);
  const auto lengths = asterism::lengths_at(seen, pairs);
  seen.col(3) << 70, 55;  // the last part was seen far off

  asterism::System system(4, 2);
  system.add_links(pairs, lengths, asterism::System::all(1));
  system.add_anchors(seen, Eigen::Vector4d(0.5, 0.5, 0.5, 0.05));
  Eigen::MatrixXd x = seen;  // the start, then the result: one column per part
  const asterism::Summary summary = asterism::solve(system, x);
  std::cout << x << "\n" << summary.status << ", energy " << summary.final_energy << "\n";

  const asterism::Solution solution(system, x);
  if (solution) std::cout << "covariance of the last part\n" << solution.covariance(3) << "\n";
  std::cout << asterism::certify(system, x).proof << "\n";
}
