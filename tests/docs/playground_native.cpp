// playground_native FILE METHOD TOLERANCE: solves the first system of a file from its start, as the
// playground does. Prints a JSON object: the system as the library writes it, x, status, energy and
// iterations.
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/nonlinear_cg.hpp>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "playground_file.hpp"

using System = asterism::SpringSystem<double, 2>;

template <typename Solver>
asterism::Summary solve(const System& system, System::Points& x, double tolerance) {
  Solver solver;
  solver.options.tolerance = tolerance;
  solver.options.hold_floating = true;
  return solver.solve(system, x);
}

asterism::Summary solve(const std::string& method, const System& system, System::Points& x,
                        double tolerance) {
  if (method == "ida") return solve<asterism::Ida<System>>(system, x, tolerance);
  if (method == "ncg") return solve<asterism::NonlinearCg<System>>(system, x, tolerance);
  if (method == "lbfgs") return solve<asterism::Lbfgs<System>>(system, x, tolerance);
  if (method == "newton") return solve<asterism::Newton<System>>(system, x, tolerance);
  throw std::runtime_error("unknown method " + method);
}

System::Points points_of(const std::vector<double>& numbers) {
  return Eigen::Map<const System::Points>(numbers.data(), 2, static_cast<Eigen::Index>(numbers.size() / 2));
}

System system_of(const PlaygroundFile& file) {
  std::vector<asterism::Link> links;
  for (const auto& [i, j] : file.links) links.push_back({i, j});
  System system(asterism::Topology<>::from_links(static_cast<int>(file.anchors.size() / 2), links));
  const auto vector_of = [](const std::vector<double>& numbers) {
    return Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(numbers.size()));
  };
  system.anchors = points_of(file.anchors);
  system.anchor_stiffness = vector_of(file.anchor_stiffness);
  system.rest_length = vector_of(file.rest_length);
  system.link_stiffness = vector_of(file.link_stiffness);
  for (const int node : file.fixed) system.fix(node);
  return system;
}

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: " << argv[0] << " FILE METHOD TOLERANCE\n";
    return 2;
  }
  try {
    const PlaygroundFile file = read_playground_file(argv[1]);
    const System system = system_of(file);
    System::Points x = points_of(file.start);
    const asterism::Summary summary = solve(argv[2], system, x, std::atof(argv[3]));
    nlohmann::json result;
    result["system"] = nlohmann::json::parse(file.written);
    for (const double value : x.reshaped()) result["x"].push_back(value);
    result["status"] = std::string(to_string(summary.status));
    result["energy"] = summary.final_energy;
    result["iterations"] = summary.iterations;
    result["bound"] = asterism::certify(system, x).lower_bound;
    std::cout << result << "\n";
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
