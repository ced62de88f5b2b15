// playground_native FILE METHOD TOLERANCE: solves the first system of a file from its start, as the
// playground does. Prints a JSON object: the system as the library writes it, x, status, energy, iterations
// and lower bound.
#include <asterism/solver/terms/registry.hpp>
#include <asterism/system.hpp>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "playground_file.hpp"

Eigen::MatrixXd points_of(const std::vector<double>& numbers, int dim) {
  return Eigen::Map<const Eigen::MatrixXd>(numbers.data(), dim,
                                           static_cast<Eigen::Index>(numbers.size()) / dim);
}

Eigen::VectorXd vector_of(const std::vector<double>& numbers) {
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(numbers.size()));
}

asterism::System system_of(const PlaygroundFile& file) {
  asterism::System system(static_cast<int>(file.anchor_stiffness.size()), file.dim);
  system.add_anchors(points_of(file.anchors, file.dim), vector_of(file.anchor_stiffness));
  const Eigen::Map<const Eigen::Matrix2Xi> ends(file.ends.data(), 2,
                                                static_cast<Eigen::Index>(file.ends.size()) / 2);
  system.add_links(ends, vector_of(file.rest_length), vector_of(file.link_stiffness));
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
    const asterism::System system = system_of(file);
    Eigen::MatrixXd x = points_of(file.start, file.dim);
    auto solver = asterism::system_solvers().make(argv[2], {{"hold_floating", true}});
    solver.options().tolerance = std::atof(argv[3]);
    const asterism::Summary summary = solver.solve(system, x);
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
