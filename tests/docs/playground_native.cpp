// playground_native FILE METHOD TOLERANCE: solves the first system of a file from its start, as the
// playground does. Prints a JSON object: the system as the library writes it, x, status, energy and
// iterations.
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/io/json.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/nonlinear_cg.hpp>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>

using System = asterism::SpringSystem<double, 2>;

template <typename Solver>
asterism::Summary solve(const System& system, System::Points& x, double tolerance) {
  Solver solver;
  solver.options.tolerance = tolerance;
  solver.options.ground_components = true;
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

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: " << argv[0] << " FILE METHOD TOLERANCE\n";
    return 2;
  }
  try {
    const auto stored = asterism::read_systems<System>(argv[1]).at(0);
    std::ostringstream text;
    asterism::write_system(text, stored.system, stored.start, stored.name, stored.origin);
    System::Points x = stored.start;
    const asterism::Summary summary = solve(argv[2], stored.system, x, std::atof(argv[3]));
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
