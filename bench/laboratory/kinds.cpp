// How the kinds of systems differ: stiffness, residuals, conditioning, iterations.
#include "kinds.hpp"

#include <Eigen/Eigenvalues>
#include <asterism/solver/energy/hessian.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

namespace asterism::bench {

namespace {

/// Figures of one system, all dimensionless.
std::vector<double> figures(const Problem& problem) {
  const System& system = problem.system;
  const int links = system.link_count();
  Points x = problem.start;
  const Summary summary = Newton<System>().solve(system, x);
  double strain = 0;
  for (int l = 0; const Link& link : system.links()) {
    const double length = system.link_stiffness[l] > 0 ? system.rest_length[l] : 0;
    ++l;
    if (length > 0) strain += std::pow((x.col(link.i) - x.col(link.j)).norm() / length - 1, 2);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(hessian(system, x), Eigen::EigenvaluesOnly);
  const double stiffest = modes.eigenvalues().tail<1>()[0];
  std::vector<double> k(system.link_stiffness.begin(), system.link_stiffness.end());
  return {system.anchor_stiffness.mean() / system.link_stiffness.mean(),
          system.link_stiffness.maxCoeff() / median(k),
          std::sqrt((problem.start - x).squaredNorm() / system.nodes()) / characteristic_length(system, x),
          std::sqrt(strain / std::max(1, links)),
          summary.final_energy / summary.initial_energy,
          stiffest / modes.eigenvalues()[0]};
}

const std::vector<std::string> kNames = {
    "anchors over links, mean k_i / mean k_ij",         "stiffest link over the median one",
    "start to minimum, over the characteristic length", "strain |r - mu| / mu at the minimum, rms",
    "energy at the minimum over that at the start",     "condition of the Hessian at the minimum"};

}  // namespace

void kinds(const Selection& selection) {
  std::vector<std::string> names = kNames;
  for (const SolverEntry& solver : selection.solvers) {
    names.push_back("iterations to a gap of 1e-6: " + solver.title);
  }
  std::map<std::string, std::vector<std::vector<double>>> by_group;
  for (const Chunk& chunk : chunks(selection)) {
    std::vector<std::unique_ptr<Runner>> runners;
    for (const SolverEntry& solver : selection.solvers) runners.push_back(solver.make(chunk.nodes));
    auto& columns = by_group[chunk.group];
    columns.resize(names.size());
    for (int index = chunk.first; index < chunk.first + chunk.count; ++index) {
      const Problem problem = chunk.problem(index);
      std::vector<double> row = figures(problem);
      for (const auto& runner : runners) {
        runner->load(problem);
        row.push_back(to_gap(*runner, 1e-6).iterations);
      }
      for (std::size_t c = 0; c < row.size(); ++c) columns[c].push_back(row[c]);
    }
  }
  std::printf("median (5 %% to 95 %%)\n");
  for (std::size_t c = 0; c < names.size(); ++c) {
    std::printf("\n%s\n", names[c].c_str());
    for (const std::string& group : groups(selection)) {
      const auto& values = by_group[group][c];
      std::printf("  %-10s %10.3g (%.3g to %.3g)\n", group.c_str(), median(values), percentile(values, 0.05),
                  percentile(values, 0.95));
    }
  }
}

}  // namespace asterism::bench
