#include <asterism/system.hpp>
#include <cmath>
#include <cstddef>
#include <iostream>

// A spring whose force has a limit: phi = log cosh (r - mu).
void log_cosh(std::size_t count, const double* length, const double* rest_length, double* value,
              double* first, double* second) {
  for (std::size_t l = 0; l < count; ++l) {
    const double s = std::abs(length[l] - rest_length[l]), t = std::tanh(length[l] - rest_length[l]);
    value[l] = s + std::log1p(std::exp(-2 * s)) - std::log(2.0);  // without overflow
    first[l] = t;
    second[l] = 1 - t * t;
  }
}

int main() {
  asterism::add_link_law("log-cosh", log_cosh);

  Eigen::MatrixXd x(2, 3);
  x << 0, 10, 50, 0, 0, 30;
  asterism::System system(3, 2);
  system.add_anchors(x, asterism::System::all(0.5));
  system.add_links(asterism::all_pairs(3), asterism::System::all(20), asterism::System::all(1))
      .choose("law", "log-cosh");
  for (const std::string_view method : asterism::system_methods()) {
    Eigen::MatrixXd placed = x;
    const asterism::Summary summary = asterism::solve(method, system, placed);
    std::cout << method << ": " << summary.status << ", energy " << summary.final_energy << "\n";
  }
}
