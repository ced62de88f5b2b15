// The solver behind the playground's page: a system of springs in the plane or in space whose values the page
// writes into arrays, and the functions that it calls. Compiled to WebAssembly by emcc, and natively by the
// tests.
#include "playground.h"

#include <array>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/system.hpp>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace {

constexpr std::array<const char*, 5> kMethods = {"ida", "ncg", "lbfgs", "newton", "staircase"};

constexpr std::size_t kMaxPath = std::size_t{1} << 21;  // numbers, 16 MB

}  // namespace

struct asterism_playground {
  asterism_playground(int dim, const Eigen::Matrix2Xi& pairs, int nodes)
      : system(nodes, dim),
        anchors(&system.add_anchors(Eigen::MatrixXd::Zero(dim, nodes), Eigen::VectorXd::Zero(nodes))),
        links(&system.add_links(pairs, Eigen::VectorXd::Zero(pairs.cols()),
                                Eigen::VectorXd::Zero(pairs.cols()))),
        x(Eigen::MatrixXd::Zero(dim, nodes)),
        grid(Eigen::MatrixXd::Zero(dim, 3)) {}

  void solve(const char* method, double tolerance, int max_iterations) {
    energies.clear();
    path.clear();
    auto record = [this](const asterism::Iteration& at) {
      energies.insert(energies.end(), {static_cast<double>(at.number), at.energy, at.gradient_norm});
      if (path.size() + static_cast<std::size_t>(at.x.size()) <= kMaxPath)
        path.insert(path.end(), at.x.data(), at.x.data() + at.x.size());
      return true;
    };
    asterism::AnySolver<asterism::System> solver = asterism::system_solvers().make(method);
    asterism::SolverOptions& options = solver.options();
    options.tolerance = tolerance;
    options.max_iterations = max_iterations;
    options.hold_floating = true;  // a part that nothing holds stays where it is
    options.on_iteration = record;
    const asterism::Summary s = solver.solve(system, x);
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
    solver_name = s.solver;
  }

  void certify() {
    const asterism::Certificate result = asterism::certify(system, x);
    certificate = {static_cast<double>(result.proof), result.energy, result.lower_bound,
                   result.least_eigenvalue, result.distance};
    message = std::string_view(result.reason);
  }

  bool compute_covariances() {
    const asterism::Solution solution(system, x);
    message = solution.problem();
    covariances = solution ? solution.covariances() : Eigen::MatrixXd();
    return static_cast<bool>(solution);
  }

  // Computes E with one node at each point of the grid, row by row, and the others at x. Only the terms of
  // that node are evaluated at each point, as a system of their own; the rest of E is constant.
  void map_energy(int node, int columns, int rows) {
    std::vector<int> springs, ends;
    for (int l = 0; l < links->size(); ++l) {
      const auto pair = links->nodes().col(l);
      if (pair[0] != node && pair[1] != node) continue;
      springs.push_back(l);
      ends.push_back(pair[0] == node ? pair[1] : pair[0]);
    }
    const auto count = static_cast<int>(ends.size());
    Eigen::Matrix2Xi pairs(2, count);
    for (int s = 0; s < count; ++s) pairs.col(s) << 0, s + 1;
    asterism::System own(count + 1, system.dim());
    Eigen::RowVectorXi first(1);
    first << 0;
    own.add_anchors(first, anchors->values("position").col(node), anchors->values("stiffness").col(node));
    own.add_links(pairs, links->values("length")(0, springs).transpose(),
                  links->values("stiffness")(0, springs).transpose());
    Eigen::MatrixXd at(system.dim(), count + 1);
    at.col(0) = x.col(node);
    at.rightCols(count) = x(Eigen::all, ends);
    const double rest = asterism::energy(system, x) - asterism::energy(own, at);
    landscape.clear();
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        at.col(0) = grid.col(0) + column * grid.col(1) + row * grid.col(2);
        landscape.push_back(rest + asterism::energy(own, at));
      }
    }
  }

  std::span<double> array(int which) {
    const auto all_of = [](auto& values) {
      return std::span<double>(values.data(), static_cast<std::size_t>(values.size()));
    };
    switch (which) {
      case 0:
        return all_of(anchors->values("position"));
      case 1:
        return all_of(anchors->values("stiffness"));
      case 2:
        return all_of(links->values("length"));
      case 3:
        return all_of(links->values("stiffness"));
      case 4:
        return all_of(x);
      case 5:
        return all_of(energies);
      case 6:
        return all_of(path);
      case 7:
        return all_of(summary);
      case 8:
        return all_of(certificate);
      case 9:
        return all_of(covariances);
      case 10:
        return all_of(landscape);
      case 11:
        return all_of(grid);
      default:
        return {};
    }
  }

  asterism::System system;
  asterism::Anchors* anchors;
  asterism::Links* links;
  Eigen::MatrixXd x;                 // the start of a solve, then its result
  std::vector<double> energies;      // of each iteration: number, E, |dE/dx|
  std::vector<double> path;          // of each iteration, up to kMaxPath numbers: x
  std::array<double, 13> summary{};  // status, then Summary's members in their order
  std::array<double, 5> certificate{};
  Eigen::MatrixXd covariances;  // dim x dim blocks, one per node
  Eigen::MatrixXd grid;         // of the landscape: first point, step to the next column and row
  std::vector<double> landscape;
  std::string message, solver_name;
};

asterism_playground* asterism_playground_new(int dim, int nodes, int links, const int* ends) {
  return new asterism_playground(dim, Eigen::Map<const Eigen::Matrix2Xi>(ends, 2, links), nodes);
}

void asterism_playground_delete(asterism_playground* p) { delete p; }

double* asterism_playground_array(asterism_playground* p, int which) { return p->array(which).data(); }

int asterism_playground_count(asterism_playground* p, int which) {
  return static_cast<int>(p->array(which).size());
}

void asterism_playground_fix(asterism_playground* p, int node, int is_fixed) {
  if (is_fixed != 0) {
    p->system.fix(node);
  } else {
    p->system.unfix(node);
  }
}

int asterism_playground_solve(asterism_playground* p, int method, double tolerance, int max_iterations) {
  p->solve(asterism_playground_method(method), tolerance, max_iterations);
  return static_cast<int>(p->summary[0]);
}

int asterism_playground_certify(asterism_playground* p) {
  p->certify();
  return static_cast<int>(p->certificate[0]);
}

int asterism_playground_covariances(asterism_playground* p) { return p->compute_covariances(); }

double asterism_playground_energy(const asterism_playground* p) { return asterism::energy(p->system, p->x); }

void asterism_playground_landscape(asterism_playground* p, int node, int columns, int rows) {
  p->map_energy(node, columns, rows);
}

const char* asterism_playground_message(const asterism_playground* p) { return p->message.c_str(); }

const char* asterism_playground_solver(const asterism_playground* p) { return p->solver_name.c_str(); }

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
