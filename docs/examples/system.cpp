#include <asterism/system.hpp>
#include <iostream>

int main() {
  // Four parts in a square of 40 px, each linked to all others.
  Eigen::MatrixXd seen{{0, 40, 0, 40}, {0, 0, 40, 40}};  // x, y
  asterism::System system(4, 2);
  const Eigen::Matrix2Xi pairs = asterism::all_pairs(4);
  system.add_links(pairs, asterism::lengths_at(seen, pairs), asterism::System::all(1));
  seen.col(3) << 70, 55;  // the last part was seen far off, with little certainty
  system.add_anchors(seen, Eigen::Vector4d(0.5, 0.5, 0.5, 0.05));
  Eigen::MatrixXd x = seen;  // the start, then the result: one column per part
  const asterism::Summary summary = asterism::solve(system, x);
  std::cout << x << "\n" << summary.status << ", energy " << summary.final_energy << "\n";
}
