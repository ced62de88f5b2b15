#include <asterism/solver/ranges/locate.hpp>
#include <cmath>
#include <iostream>
#include <vector>

int main() {
  // Five beacons under the ceiling of a hall, and the ranges that a tag has measured, to 5 cm [m].
  const std::vector<double> beacons{0, 0, 4, 20, 0, 4, 20, 12, 4, 0, 12, 4, 10, 6, 4};
  const std::vector<double> ranges{7.87, 16.12, 17.23, 9.92, 6.14};
  const std::vector<double> sigma(5, 0.05);
  const asterism::PositionFix<3> fix = asterism::locate<3>(beacons, ranges, sigma);
  if (fix.status != asterism::Status::Converged) {
    std::cerr << fix.message << "\n";
    return 1;
  }
  std::cout.precision(2);
  std::cout << std::fixed;
  for (int i = 0; i < fix.count; ++i) {
    const asterism::PositionMinimum<3>& place = fix.minima[static_cast<std::size_t>(i)];
    std::cout << "(" << place.x[0] << ", " << place.x[1] << ", " << place.x[2] << "), height +-"
              << std::sqrt(place.covariance[8]) << ", weight " << place.weight << "\n";
  }
  std::cout << (fix.proven ? "proven" : "not proven") << "; " << fix.message << "\n";
}
