// The solver behind the playground's page: a system of springs in the plane whose values the page writes into
// arrays, and the functions that it calls. Compiled to WebAssembly by emcc, and natively by the tests.
#include "playground.h"

#include <array>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/energy/covariance.hpp>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/lbfgs.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/method/nonlinear_cg.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace {

using System = asterism::SpringSystem<double, 2>;
using Points = System::Points;

// The names of asterism::make_solver, in the order of Playground::solve.
constexpr std::array<const char*, 5> kMethods = {"ida", "ncg", "lbfgs", "newton", "staircase"};

constexpr std::size_t kMaxPath = std::size_t{1} << 21;  // numbers, 16 MB

struct Staircase {
  asterism::StaircaseOptions options;
  asterism::Summary solve(const System& system, Points& x) const {
    return asterism::solve_staircase(system, x, options);
  }
};

class Playground {
 public:
  explicit Playground(const asterism::Topology<>& topology) : system(topology), x(2, topology.nodes()) {
    x.setZero();
  }

  void solve(int method, double tolerance, int max_iterations) {
    switch (method) {
      case 0:
        return solve_by(ida_, tolerance, max_iterations);
      case 1:
        return solve_by(nonlinear_cg_, tolerance, max_iterations);
      case 2:
        return solve_by(lbfgs_, tolerance, max_iterations);
      case 3:
        return solve_by(newton_, tolerance, max_iterations);
      default:
        return solve_by(staircase_, tolerance, max_iterations);
    }
  }

  void certify() {
    const asterism::Certificate result = certifier_.certify(system, x);
    certificate = {static_cast<double>(result.proof), result.energy, result.lower_bound,
                   result.least_eigenvalue, result.distance};
    message = std::string_view(result.reason);
  }

  void compute_covariances() {
    const auto result = asterism::node_covariances(system, x);
    covariance_status = static_cast<int>(result.status);
    message = std::string_view(result.message);
    covariances.assign(result.blocks.data(), result.blocks.data() + result.blocks.size());
  }

  // Computes E with one node at each point of a grid, row by row, and the others at x. Only the springs of
  // that node are evaluated at each point, as a system of their own; the rest of E is constant.
  void map_energy(int node, double left, double top, double step, int columns, int rows) {
    std::vector<asterism::Link> links;
    std::vector<int> springs, ends;
    for (int l = 0; l < system.link_count(); ++l) {
      const asterism::Link link = system.links()[static_cast<std::size_t>(l)];
      if (link.i != node && link.j != node) continue;
      springs.push_back(l);
      ends.push_back(link.i == node ? link.j : link.i);
      links.push_back({0, static_cast<int>(ends.size())});
    }
    const int count = static_cast<int>(ends.size());
    System own(asterism::Topology<>::from_links(count + 1, links));
    Points at(2, count + 1);
    own.anchors.setZero();
    own.anchor_stiffness.setZero();
    own.anchors.col(0) = system.anchors.col(node);
    own.anchor_stiffness[0] = system.anchor_stiffness[node];
    at.col(0) = x.col(node);
    for (int s = 0; s < count; ++s) {
      const auto k = static_cast<std::size_t>(s);
      own.rest_length[s] = system.rest_length[springs[k]];
      own.link_stiffness[s] = system.link_stiffness[springs[k]];
      at.col(s + 1) = x.col(ends[k]);
    }
    const double rest = asterism::energy(system, x) - asterism::energy(own, at);
    landscape.clear();
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        at.col(0) << left + step * column, top + step * row;
        landscape.push_back(rest + asterism::energy(own, at));
      }
    }
  }

  System system;
  Points x;                          // the start of a solve, then its result
  std::vector<double> energies;      // of each iteration: number, E, |dE/dx|
  std::vector<double> path;          // of each iteration, up to kMaxPath numbers: x
  std::array<double, 13> summary{};  // status, then Summary's members in their order
  std::array<double, 5> certificate{};
  std::vector<double> covariances;  // 2 x 2 blocks, one per node
  std::vector<double> landscape;
  std::string message, solver;
  int covariance_status = 0;

 private:
  template <typename Solver>
  void solve_by(Solver& method, double tolerance, int max_iterations) {
    energies.clear();
    path.clear();
    auto record = [this](const asterism::Iteration& at) {
      energies.insert(energies.end(), {static_cast<double>(at.number), at.energy, at.gradient_norm});
      if (path.size() + static_cast<std::size_t>(at.x.size()) <= kMaxPath)
        path.insert(path.end(), at.x.data(), at.x.data() + at.x.size());
      return true;
    };
    method.options.tolerance = tolerance;
    method.options.max_iterations = max_iterations;
    method.options.hold_floating = true;  // a part that nothing holds stays where it is
    method.options.measure_seconds = true;
    method.options.on_iteration = record;
    const asterism::Summary s = method.solve(system, x);
    method.options.on_iteration = nullptr;
    summary = {static_cast<double>(s.status),
               static_cast<double>(s.iterations),
               static_cast<double>(s.energy_evaluations),
               static_cast<double>(s.gradient_evaluations),
               static_cast<double>(s.linear_solves),
               static_cast<double>(s.factorizations),
               s.initial_energy,
               s.final_energy,
               s.lower_bound,
               s.gradient_norm,
               s.stationarity,
               s.positive_definite ? static_cast<double>(*s.positive_definite) : -1,
               s.seconds};
    message = std::string_view(s.message);
    solver = s.solver;
  }

  asterism::Ida<System> ida_;
  asterism::NonlinearCg<System> nonlinear_cg_;
  asterism::Lbfgs<System> lbfgs_;
  asterism::Newton<System> newton_;
  Staircase staircase_;
  asterism::Certifier<System> certifier_;
};

}  // namespace

struct asterism_playground : Playground {
  using Playground::Playground;
};

asterism_playground* asterism_playground_new(int nodes, int links, const int* ends) {
  std::vector<asterism::Link> list;
  for (int l = 0; l < links; ++l) list.push_back({ends[2 * l], ends[2 * l + 1]});
  return new asterism_playground(asterism::Topology<>::from_links(nodes, list));
}

void asterism_playground_delete(asterism_playground* p) { delete p; }

double* asterism_playground_array(asterism_playground* p, int which) {
  switch (which) {
    case 0:
      return p->system.anchors.data();
    case 1:
      return p->system.anchor_stiffness.data();
    case 2:
      return p->system.rest_length.data();
    case 3:
      return p->system.link_stiffness.data();
    case 4:
      return p->x.data();
    case 5:
      return p->energies.data();
    case 6:
      return p->path.data();
    case 7:
      return p->summary.data();
    case 8:
      return p->certificate.data();
    case 9:
      return p->covariances.data();
    case 10:
      return p->landscape.data();
    default:
      return nullptr;
  }
}

int asterism_playground_count(const asterism_playground* p, int which) {
  const auto count = [](const auto& values) { return static_cast<int>(values.size()); };
  switch (which) {
    case 0:
      return count(p->system.anchors);
    case 1:
      return count(p->system.anchor_stiffness);
    case 2:
      return count(p->system.rest_length);
    case 3:
      return count(p->system.link_stiffness);
    case 4:
      return count(p->x);
    case 5:
      return count(p->energies);
    case 6:
      return count(p->path);
    case 7:
      return count(p->summary);
    case 8:
      return count(p->certificate);
    case 9:
      return count(p->covariances);
    case 10:
      return count(p->landscape);
    default:
      return 0;
  }
}

void asterism_playground_fix(asterism_playground* p, int node, int is_fixed) {
  if (is_fixed != 0) {
    p->system.fix(node);
  } else {
    p->system.release(node);
  }
}

int asterism_playground_solve(asterism_playground* p, int method, double tolerance, int max_iterations) {
  p->solve(method, tolerance, max_iterations);
  return static_cast<int>(p->summary[0]);
}

int asterism_playground_certify(asterism_playground* p) {
  p->certify();
  return static_cast<int>(p->certificate[0]);
}

int asterism_playground_covariances(asterism_playground* p) {
  p->compute_covariances();
  return p->covariance_status;
}

double asterism_playground_energy(const asterism_playground* p) { return asterism::energy(p->system, p->x); }

void asterism_playground_landscape(asterism_playground* p, int node, double left, double top, double step,
                                   int columns, int rows) {
  p->map_energy(node, left, top, step, columns, rows);
}

const char* asterism_playground_message(const asterism_playground* p) { return p->message.c_str(); }

const char* asterism_playground_solver(const asterism_playground* p) { return p->solver.c_str(); }

const char* asterism_playground_method(int index) {
  return 0 <= index && index < static_cast<int>(kMethods.size()) ? kMethods[static_cast<std::size_t>(index)]
                                                                 : nullptr;
}

// to_string returns views of literals, which are null-terminated.
const char* asterism_playground_status(int status) {
  return asterism::to_string(static_cast<asterism::Status>(status)).data();
}

const char* asterism_playground_proof(int proof) {
  return asterism::to_string(static_cast<asterism::Proof>(proof)).data();
}
