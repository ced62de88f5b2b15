#pragma once

#include <asterism/testing/random_system.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "measure.hpp"

namespace asterism::bench {

/// The bars that the solvers must reach: prints a line for each with the measured value, the bar, the aim
/// beyond it, and whether they are met.
class Bars {
 public:
  /// With `quick`, fewer systems; with `large`, also those that take minutes. Only the groups whose name
  /// contains `filter` are measured.
  Bars(bool quick, bool large, std::string filter)
      : quick_(quick), large_(large), filter_(std::move(filter)) {}

  bool quick() const { return quick_; }
  bool large() const { return large_; }
  bool wanted(std::string_view group) const { return group.find(filter_) != std::string_view::npos; }
  int missed() const { return missed_; }

  void line(const std::string& name, const std::string& measured, const std::string& bar,
            const std::string& aim, bool met, bool aim_met);
  /// A figure without a bar, such as a time, which depends on the machine.
  void information(const std::string& name, const std::string& measured) {
    line(name, measured, "-", "-", true, true);
  }
  /// A figure that has to be small; `pattern` is its format, "%.3g us" for instance.
  void at_most(const std::string& name, const char* pattern, double measured, double bar, double aim);
  /// A figure that has to be large.
  void at_least(const std::string& name, const char* pattern, double measured, double bar, double aim);
  /// A solver's time against another's in the same run: at least `bar`, and ideally `aim`, times faster.
  void times_faster(const std::string& name, double seconds, double other_seconds, double bar, double aim);

 private:
  bool quick_;
  bool large_;
  std::string filter_;
  int missed_ = 0;
};

/// `count` systems of a kind, all from one seed.
template <typename System>
std::vector<testing::RandomSystem<System>> samples(int count, const typename System::TopologyType& topology,
                                                   testing::Kind kind) {
  testing::Rng rng(1);
  std::vector<testing::RandomSystem<System>> result;
  result.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) result.push_back(testing::random_system<System>(rng, topology, kind));
  return result;
}

// The groups, one per file.
void small_bars(Bars& bars);
void dense_bars(Bars& bars);
void sparse_bars(Bars& bars);
void batch_bars(Bars& bars);
void robustness_bars(Bars& bars);
void proof_bars(Bars& bars);
void discrete_bars(Bars& bars);
void gradient_bars(Bars& bars);
void terms_bars(Bars& bars);

}  // namespace asterism::bench
