#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/batch/simd.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <memory>
#include <mutex>
#include <new>
#include <ranges>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Why nothing can be computed of a batch with these options and instructions; empty if it can.
template <typename Batch, typename Options>
Message batch_problem(const Batch& batch, const Options& options, Simd simd) {
  if (const Defect& defect = batch.topology().defect()) return defect;
  if (const char* problem = options.problem()) return problem;
  return is_available(simd) ? "" : "the instructions asked for are not available";
}

/// Calls work(first, last) for ranges of the systems of a batch, cut by its size alone; whole numbers of
/// lanes.
template <typename Executor, typename Work>
void for_each_chunk(Executor& executor, int count, bool in_lanes, Work&& work) {
  const int chunk = in_lanes ? std::clamp((count / 32 + 31) / 32 * 32, 512, 4096) : 64;
  executor((count + chunk - 1) / chunk,
           [&](int task) { work(task * chunk, std::min(count, (task + 1) * chunk)); });
}

/// Workspaces that are not in use, of tasks that solve systems of a batch one by one: made from a batch, with
/// a `system` of its topology.
template <typename Workspace>
class Pool {
 public:
  /// One of the topology of `batch`. Throws std::bad_alloc if memory runs out.
  template <typename Batch>
  std::unique_ptr<Workspace> take(const Batch& batch) {
    std::unique_ptr<Workspace> workspace;
    {
      const std::scoped_lock lock(mutex_);
      if (!free_.empty()) {
        workspace = std::move(free_.back());
        free_.pop_back();
      }
    }
    if (!workspace || workspace->system.nodes() != batch.nodes() ||
        !std::ranges::equal(workspace->system.links(), batch.topology().links()))
      workspace = std::make_unique<Workspace>(batch);
    return workspace;
  }

  void put_back(std::unique_ptr<Workspace> workspace) {
    const std::scoped_lock lock(mutex_);
    const auto keep = [&] { free_.push_back(std::move(workspace)); };
    attempt<std::bad_alloc>(keep, [](const std::bad_alloc&) {});  // made again next time
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<Workspace>> free_;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
