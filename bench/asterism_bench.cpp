// asterism-bench: the solver laboratory.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "bars.hpp"
#include "crossovers.hpp"

namespace {

int run_bars(bool quick, const std::string& group) {
  using namespace asterism::bench;
  Bars bars(quick, group);
  std::printf("%-46s %-42s %-22s %s\n", "", "measured", "bar", "aim");
  small_bars(bars);
  dense_bars(bars);
  sparse_bars(bars);
  batch_bars(bars);
  robustness_bars(bars);
  std::printf("%d not met\n", bars.missed());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("The solver laboratory: what the solvers are measured by.", "asterism-bench");
  app.require_subcommand(1);

  bool quick = false;
  std::string group;
  CLI::App* bars =
      app.add_subcommand("bars", "measures the solvers against what they ought to reach: a line a bar");
  bars->add_flag("--quick", quick, "fewer and smaller systems");
  bars->add_option("--group", group, "one group alone")
      ->check(CLI::IsMember({"small", "dense", "sparse", "batch", "robustness"}));

  CLI::App* crossovers = app.add_subcommand(
      "crossovers", "times what Auto chooses from, against size, linking and strength of the anchors");
  bool dense = false, sparse = false;
  crossovers->add_flag("--quick", quick, "sparse systems of up to 1e4 nodes");
  crossovers->add_flag("--dense", dense, "fully connected systems alone");
  crossovers->add_flag("--sparse", sparse, "sparse systems alone");

  CLI11_PARSE(app, argc, argv);
  if (bars->parsed()) return run_bars(quick, group);
  if (dense || !sparse) asterism::bench::dense_crossovers();
  if (sparse || !dense) asterism::bench::sparse_crossovers(quick);
  return 0;
}
