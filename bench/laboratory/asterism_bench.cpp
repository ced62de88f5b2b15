// asterism-bench: the solver laboratory.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include "bars.hpp"
#include "command_line.hpp"
#include "crossovers.hpp"
#ifdef ASTERISM_BENCH_PETSC
#include "distributed.hpp"
#endif
#include "experiments.hpp"
#include "kinds.hpp"
#include "parts_bench.hpp"
#include "plugins.hpp"
#include "problems.hpp"
#include "process.hpp"
#include "solve.hpp"

namespace {

using namespace asterism::bench;

int run_bars(bool quick, bool large, const std::string& group) {
  Bars bars(quick, large, group);
  std::printf("%-46s %-42s %-22s %s\n", "", "measured", "target", "goal");
  small_bars(bars);
  dense_bars(bars);
  sparse_bars(bars);
  batch_bars(bars);
  robustness_bars(bars);
  proof_bars(bars);
  discrete_bars(bars);
  gradient_bars(bars);
  terms_bars(bars);
  std::printf("%d not met\n", bars.missed());
  return 0;
}

/// A subcommand's options for systems and solvers, with its own defaults.
struct SelectionOptions {
  std::vector<std::string> kinds = {"lit"};
  std::vector<int> sizes;
  std::vector<int> sparse_sizes;
  std::string solvers;
  int systems;
  std::string recorded;

  SelectionOptions(CLI::App& app, std::vector<int> default_sizes, std::string default_solvers,
                   int default_systems)
      : sizes(std::move(default_sizes)), solvers(std::move(default_solvers)), systems(default_systems) {
    std::vector<std::string> known;
    for (const asterism::testing::Kind kind : asterism::testing::kKinds) known.emplace_back(to_string(kind));
    app.add_option("--kinds", kinds, "random systems: lit, orig, disp, track")
        ->delimiter(',')
        ->check(CLI::IsMember(known))
        ->capture_default_str();
    app.add_option("--sizes", sizes, "numbers of nodes of the fully connected systems")
        ->delimiter(',')
        ->check(CLI::Range(1, 10000))
        ->capture_default_str();
    app.add_option("--sparse", sparse_sizes,
                   "also systems with local links only, with these numbers of nodes")
        ->delimiter(',')
        ->check(CLI::Range(10, 10000000));
    app.add_option("--solvers", solvers, "names as `asterism-bench solvers` lists them, or all")
        ->capture_default_str();
    app.add_option("--systems", systems,
                   "number of systems of each kind and size; a tenth of it beyond 100 nodes")
        ->check(CLI::Range(1, 100000000))
        ->capture_default_str();
    app.add_option("--recorded", recorded,
                   "file of systems from asterism-track --record-systems; adds the kind real");
  }

  Selection selection() const {
    Selection result;
    for (const asterism::testing::Kind kind : asterism::testing::kKinds) {
      if (std::find(kinds.begin(), kinds.end(), to_string(kind)) != kinds.end()) result.kinds.push_back(kind);
    }
    result.sizes = sizes;
    result.sparse_sizes = sparse_sizes;
    result.solvers = solvers_named(solvers);
    result.systems = systems;
    if (!recorded.empty()) {
      result.recorded = std::make_shared<const std::vector<Problem>>(read_problems(recorded));
      std::ifstream file(recorded, std::ios::binary);
      result.recorded_digest = digest(std::string(std::istreambuf_iterator<char>(file), {}));
    }
    return result;
  }
};

/// An experiment as a subcommand.
struct ExperimentCommand {
  Experiment (*make)(const Selection&);
  CLI::App* app;
  SelectionOptions options;
  std::string folder = "results";

  ExperimentCommand(CLI::App& parent, const char* name, const char* what,
                    Experiment (*experiment)(const Selection&), std::vector<int> sizes, std::string solvers,
                    int systems)
      : make(experiment),
        app(parent.add_subcommand(name, what)),
        options(*app, std::move(sizes), std::move(solvers), systems) {
    app->add_option("--results", folder, "folder of the results; results in it are kept, not measured again")
        ->capture_default_str();
  }

  int run(const Processes& processes, const std::string& command) const {
    const Experiment experiment = make(options.selection());
    const Results results = run_cells(experiment.name, experiment.cells,
                                      {folder, command, processes.shard(), processes.barrier()});
    if (stop_signal() != 0) return 128 + stop_signal();
    if (processes.shard().index == 0) experiment.report(results);
    return 0;
  }
};

int list_solvers() {
  for (const SolverEntry& entry : solvers()) {
    std::printf("%-16s %-22s %s\n", entry.name.c_str(), entry.package.c_str(), entry.title.c_str());
  }
  return 0;
}

int run_command_line(const Processes& processes, int argc, char** argv) {
  std::string command = "asterism-bench";
  for (int a = 1; a < argc; ++a) command += std::string(" ") + argv[a];

  CLI::App app("The solver laboratory: measures and compares solvers.", "asterism-bench");
  app.require_subcommand(1);
  std::vector<std::filesystem::path> plugins;
  app.add_option("--plugin", plugins, "a shared library with a solver of your own (docs/laboratory.md)")
      ->expected(1)
      ->check(CLI::ExistingFile);

  bool quick = false, large = false;
  std::string group;
  CLI::App* bars =
      app.add_subcommand("bars", "measures the solvers against their targets, one line for each target");
  bars->add_flag("--quick", quick, "fewer and smaller systems");
  bars->add_flag("--large", large, "also systems that take minutes");
  bars->add_option("--group", group, "one group only")
      ->check(CLI::IsMember(
          {"small", "dense", "sparse", "batch", "robustness", "proof", "discrete", "gradient", "terms"}));

  CLI::App* crossovers = app.add_subcommand(
      "crossovers", "times the methods that Auto chooses from, by size, linking and strength of the anchors");
  bool dense = false, sparse = false;
  crossovers->add_flag("--quick", quick, "sparse systems of up to 1e4 nodes");
  crossovers->add_flag("--dense", dense, "fully connected systems only");
  crossovers->add_flag("--sparse", sparse, "sparse systems only");

#ifdef ASTERISM_BENCH_PARTS
  CLI::App* parts = app.add_subcommand("parts",
                                       "times the stages of a part, and the parts of a constellation, beside "
                                       "dlib's fHOG and OpenCV's tracker");
  parts->add_flag("--quick", quick, "fewer rounds");
#endif

  CLI::App* solver_list = app.add_subcommand("solvers", "lists the solvers for --solvers");

  CLI::App* solve =
      app.add_subcommand("solve", "runs solvers on the systems of a file; prints a table for each system");
  std::string file, chosen = "all";
  Limits limits;
  solve->add_option("FILE", file, "JSON as in docs/system-json.md")->required();
  solve
      ->add_option(
          "--solver,--solvers", chosen,
          "names, separated by commas, or all; for systems of terms: auto, newton, newton-cg, lbfgs, ncg, "
          "ida, schwarz, schwarz-direct, multi-start, staircase, graduated")
      ->capture_default_str();
  solve->add_option("--tolerance", limits.tolerance, "tolerance of the stopping rule")->capture_default_str();
  solve->add_option("--iterations", limits.iterations, "maximum number of iterations")->capture_default_str();

#ifdef ASTERISM_BENCH_PETSC
  DistributedRun distributed{{}, {}, distributed_methods()[0], distributed_preconditioners()[0], true, {}};
  bool is_distributed = false;
  solve->add_flag("--distributed", is_distributed,
                  "solve the file's system on the processes of mpirun, by PETSc; the file may be in PETSc's "
                  "format (docs/distributed.md)");
  solve->add_option("--method", distributed.method, "with --distributed: PETSc's method")
      ->needs("--distributed")
      ->check(CLI::IsMember(distributed_methods()))
      ->capture_default_str();
  solve
      ->add_option("--preconditioner", distributed.preconditioner,
                   "with --distributed: of Newton's equations")
      ->needs("--distributed")
      ->check(CLI::IsMember(distributed_preconditioners()))
      ->capture_default_str();
  solve
      ->add_flag("!--petsc-only", distributed.schwarz_first,
                 "with --distributed: without Schwarz on each process first")
      ->needs("--distributed");
  solve
      ->add_option("--save", distributed.save,
                   "with --distributed: writes the solved system, in PETSc's format")
      ->needs("--distributed");

  CLI::App* petsc_file = app.add_subcommand(
      "petsc-file", "writes a system to a file in PETSc's format, which processes read together");
  std::string petsc_path, json_path;
  int petsc_nodes = 1000, petsc_dim = 2, petsc_seed = 1;
  petsc_file->add_option("FILE", petsc_path, "the file to write")->required();
  CLI::Option* const from_json =
      petsc_file->add_option("--json", json_path, "the first system of this file, as in docs/system-json.md");
  petsc_file->add_option("--sparse", petsc_nodes, "instead a random system of so many nodes with local links")
      ->excludes(from_json)
      ->check(CLI::Range(10, 100000000))
      ->capture_default_str();
  petsc_file->add_option("--dim", petsc_dim, "with --sparse: coordinates of a point")
      ->check(CLI::Range(2, 3))
      ->capture_default_str();
  petsc_file->add_option("--seed", petsc_seed, "with --sparse: of the random system")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
#endif

  CLI::App* problems = app.add_subcommand(
      "problems", "scores solvers on the problem set, systems whose least energy is known");
  std::string set = "bench/problems";
  int written = 0;
  std::vector<std::filesystem::path> recorded;
  problems->add_option("--set", set, "folder of the problem set")->capture_default_str();
  problems->add_option("--solvers", chosen, "names, separated by commas, or all")->capture_default_str();
  problems->add_option("--tolerance", limits.tolerance, "tolerance of the stopping rule")
      ->capture_default_str();
  problems->add_option("--iterations", limits.iterations, "maximum number of iterations")
      ->capture_default_str();
  problems
      ->add_option("--make", written,
                   "makes the set, with so many problems a family, instead of scoring on it")
      ->check(CLI::Range(1, 1000));
  problems
      ->add_option("--recorded", recorded,
                   "with --make: files of asterism-track --record-systems, as a family")
      ->needs("--make");

  CLI::App* kind_table = app.add_subcommand("kinds", "prints how the kinds of systems differ");
  const SelectionOptions of_kinds(*kind_table, {4}, "ida,newton", 1000);

  // The paper's comparisons come first. By default, solvers that take too long for the sizes are left out.
  const ExperimentCommand experiments[] = {
      {app,
       "convergence",
       "energy that remains after each iteration (the paper's Figure 7)",
       convergence,
       {4, 16, 64},
       "ida,ncg,ncg-forward,newton,lbfgs,liblbfgs,ceres-dense",
       10000},
      {app,
       "scaling",
       "iterations and time against the number of parts (Figure 9)",
       scaling,
       {4, 9, 16, 25, 36, 64, 100, 200, 400, 1000},
       "ida,ncg,newton,lbfgs,newton-cg,auto,schwarz,liblbfgs",
       100},
      {app,
       "hard",
       "near-coincident pairs, weak anchors, stiff pairs, saddles (Figure 8)",
       hard,
       {4},
       "all",
       100},
      {app,
       "minima",
       "how often solvers and starts end in different minima",
       minima,
       {4, 9, 16},
       "ida,ida-relaxed,newton,lbfgs,ncg,ceres-dense",
       300},
      {app,
       "starts",
       "how often a system's own start, the anchors and their mirror image end above the lowest minimum",
       starts,
       {4, 9, 16, 36},
       "auto,multi-start,staircase",
       200},
      {app,
       "proof",
       "how often a solution is proven to be the global minimum, and what that costs",
       proof,
       {4, 9, 16, 36, 100},
       "auto,multi-start,staircase",
       200},
      {app, "pareto", "accuracy against time", pareto, {4, 16, 64}, "all", 20}};

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);
    std::fprintf(stderr, "asterism-bench: %s\n", asterism::tools::problem_with(app, e).c_str());
    return 2;
  }
  for (const std::filesystem::path& plugin : plugins) load_plugin(plugin);
  if (bars->parsed()) return run_bars(quick, large, group);
  if (crossovers->parsed()) {
    if (dense || !sparse) dense_crossovers();
    if (sparse || !dense) sparse_crossovers(quick);
    return 0;
  }
#ifdef ASTERISM_BENCH_PARTS
  if (parts->parsed()) {
    parts_bench(quick);
    return 0;
  }
#endif
  if (solver_list->parsed()) return list_solvers();
#ifdef ASTERISM_BENCH_PETSC
  if (solve->parsed() && is_distributed) {
    distributed.file = file;
    distributed.limits = limits;
    return solve_distributed(distributed);
  }
  if (solve->parsed() && is_petsc_file(file)) return solve_petsc_file(file, solvers_named(chosen), limits);
  if (petsc_file->parsed())
    return write_distributed(petsc_path, json_path, petsc_nodes, petsc_dim,
                             static_cast<std::uint64_t>(petsc_seed));
#endif
  if (solve->parsed()) {
    solve_file(file, chosen, limits);
    return 0;
  }
  if (problems->parsed()) {
    if (written > 0) {
      write_problem_set(set, written, recorded);
    } else {
      score_problem_set(set, solvers_named(chosen), limits);
    }
    return 0;
  }
  if (kind_table->parsed()) {
    kinds(of_kinds.selection());
    return 0;
  }
  for (const ExperimentCommand& experiment : experiments) {
    if (experiment.app->parsed()) return experiment.run(processes, command);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const Processes processes(argc, argv);
  try {
    const int code = run_command_line(processes, argc, argv);
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0)
      throw std::runtime_error("standard output cannot be written");
    return code;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "asterism-bench: %s\n", e.what());
    processes.abort();
    return 1;
  }
}
