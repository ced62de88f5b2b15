#pragma once

#include <asterism/solver/base/config.hpp>
#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <chrono>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A limit of the time of several solves in a row: it ends each of them by SolverOptions::on_iteration, as if
/// the caller had asked to stop. It must stay where it is while they run.
class TimeLimit {
 public:
  /// From now on; the caller's on_iteration is that of the options.
  TimeLimit(double seconds, const SolverOptions& options) : seconds_(seconds), given_(options.on_iteration) {}
  TimeLimit(const TimeLimit&) = delete;
  TimeLimit& operator=(const TimeLimit&) = delete;

  bool is_over() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count() > seconds_;
  }
  /// For solves that the caller observes, and for those that are hidden from the caller.
  IterationCallback observed() const { return observed_; }
  IterationCallback hidden() const { return hidden_; }

  /// Says in the summary that the limit, and not the caller, has stopped a solve, if that is so.
  void explain(Summary& summary) const {
    if (summary.status != Status::Interrupted || is_stopped_ || !is_over()) return;
    summary.status = Status::MaxIterations;
    summary.message = kMessage;
  }

  static constexpr std::string_view kMessage = "the limit of time was reached before the gap";

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  double seconds_;
  IterationCallback given_;
  bool is_stopped_ = false;  // by the caller
  struct Observed {
    TimeLimit* limit;
    bool operator()(const Iteration& at) const {
      if (limit->is_over()) return false;
      if (limit->given_ && !limit->given_(at)) limit->is_stopped_ = true;
      return !limit->is_stopped_;
    }
  } observed_{this};
  struct Hidden {
    const TimeLimit* limit;
    bool operator()(const Iteration&) const { return !limit->is_over(); }
  } hidden_{this};
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
