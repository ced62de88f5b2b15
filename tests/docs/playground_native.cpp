// playground_native FILE METHOD TOLERANCE: the first system of a file, solved from its start as the
// playground does. Prints a JSON object: the system as the library writes it, x, status, energy and
// iterations.
#include <asterism/solver.hpp>
#include <asterism/solver/io/json.hpp>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <sstream>
#include <string>

using System = asterism::SpringSystem<double, 2>;

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: " << argv[0] << " FILE METHOD TOLERANCE\n";
    return 2;
  }
  try {
    const auto stored = asterism::read_systems<System>(argv[1]).at(0);
    std::ostringstream text;
    asterism::write_system(text, stored.system, stored.start, stored.name, stored.origin);
    auto solver = asterism::make_solver<System>(
        argv[2], {{"tolerance", std::atof(argv[3])}, {"ground_components", true}});
    System::Points x = stored.start;
    const asterism::Summary summary = solver.solve(stored.system, x);
    nlohmann::json result;
    result["system"] = nlohmann::json::parse(text.str());
    for (const double value : x.reshaped()) result["x"].push_back(value);
    result["status"] = std::string(to_string(summary.status));
    result["energy"] = summary.final_energy;
    result["iterations"] = summary.iterations;
    result["bound"] = asterism::certify(stored.system, x).lower_bound;
    std::cout << result << "\n";
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
