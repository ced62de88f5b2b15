#include <asterism/system.hpp>
#include <iostream>

int main() {
  // Five joints of a chain, as they were seen; the fourth is a wrong match.
  const Eigen::MatrixXd seen{{0, 31, 60, 140, 119}, {1, -1, 0, 60, 1}};
  asterism::System system(5, 2);
  system.add_anchors(seen, asterism::System::all(0.5)).set_loss(asterism::Loss::GemanMcClure, 4);
  const Eigen::Matrix2Xi limbs{{0, 1, 2, 3}, {1, 2, 3, 4}};
  asterism::CommonLength& length = system.add_common_length(limbs, asterism::System::all(1));
  system.add_differences(Eigen::Matrix3Xi{{0, 1, 2}, {1, 2, 3}, {2, 3, 4}}, asterism::System::all(0.1));

  Eigen::MatrixXd x = seen;
  std::cout << asterism::solve("graduated", system, x).status << ", limbs of " << length.estimate(x)
            << " px\n"
            << x << "\n";
  const asterism::Solution solution(system, x);
  if (solution) std::cout << "covariance of the fourth\n" << solution.covariance(3) << "\n";
}
