#include "plugins.hpp"

#include <dlfcn.h>

#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/session.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "laboratory.hpp"
#include "solver_plugin.h"
#include "solvers/objective.hpp"

namespace asterism::bench {

namespace {

static_assert(sizeof(Link) == 2 * sizeof(int), "links are read as pairs of node numbers");

/// A solver of a shared library among the library's.
class PluginSolver {
 public:
  explicit PluginSolver(const asterism_solver* plugin) : plugin_(plugin) {}

  SolverOptions options;

  static constexpr std::string_view name() { return "plugin"; }

  Summary solve(const System& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      if (session_.done(x, session_.gradient(), 0)) return Status::Converged;
      if (options.max_iterations == 0) return Status::MaxIterations;
      Objective objective(system, x, session_, summary, Objective::Units::OfTheSystem);
      fixed_.assign(static_cast<std::size_t>(system.nodes()), 0);
      for (int i = 0; i < system.nodes(); ++i) fixed_[static_cast<std::size_t>(i)] = system.is_fixed(i);
      const Points start = x;
      const asterism_problem problem = {
          .nodes = system.nodes(),
          .links = system.link_count(),
          .start = start.data(),
          .anchors = system.anchors.data(),
          .anchor_stiffness = system.anchor_stiffness.data(),
          .ends = system.links().empty() ? nullptr : &system.links()[0].i,
          .rest_length = system.rest_length.data(),
          .link_stiffness = system.link_stiffness.data(),
          .rest_offset = system.has_offsets() ? system.rest_offset.data() : nullptr,
          .fixed = fixed_.data(),
          .max_iterations = options.max_iterations,
          .evaluate = [](const asterism_problem* of, const double* at,
                         double* gradient) { return (*static_cast<Objective*>(of->state))(at, gradient); },
          .iterated = [](const asterism_problem* of) -> int {
            return static_cast<Objective*>(of->state)->iterated();
          },
          .state = &objective};
      const int failed = plugin_->minimise(&problem, x.data());
      for (int i = 0; i < system.nodes(); ++i) {
        if (system.is_fixed(i)) x.col(i) = start.col(i);
      }
      if (x.allFinite() && x != objective.best()) {
        gradient_.resizeLike(x);
        objective(x.data(), gradient_.data());
      }
      x = objective.best();
      if (objective.done()) return Status::Converged;
      return failed != 0 ? Status::NoProgress : Status::MaxIterations;
    });
  }

 private:
  const asterism_solver* plugin_;
  Session<System> session_;
  std::vector<unsigned char> fixed_;
  Points gradient_;
};

}  // namespace

void load_plugin(const std::filesystem::path& library) {
  void* const loaded = dlopen(std::filesystem::absolute(library).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (loaded == nullptr) throw std::runtime_error(dlerror());
  const auto* const plugin = static_cast<const asterism_solver*>(dlsym(loaded, "asterism_solver_plugin"));
  if (plugin == nullptr)
    throw std::runtime_error(library.string() +
                             ": has no asterism_solver_plugin (bench/laboratory/solver_plugin.h)");
  if (plugin->version != ASTERISM_SOLVER_VERSION) {
    throw std::runtime_error(library.string() + ": made for version " + std::to_string(plugin->version) +
                             " of solver_plugin.h, not " + std::to_string(ASTERISM_SOLVER_VERSION));
  }
  if (plugin->name == nullptr || plugin->title == nullptr || plugin->minimise == nullptr)
    throw std::runtime_error(library.string() + ": asterism_solver_plugin lacks name, title or minimise");
  Registration({plugin->name, plugin->title, library.filename().string(), plugin->dense_nodes,
                plugin->sparse_nodes, [plugin](int) -> std::unique_ptr<Runner> {
                  return std::make_unique<RunnerOf<System>>(AnySolver<System>(PluginSolver(plugin)));
                }});
}

}  // namespace asterism::bench
