#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/discrete/distance_transform.hpp>
#include <asterism/solver/discrete/joint.hpp>
#include <asterism/solver/discrete/map_search.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <limits>
#include <new>
#include <ostream>
#include <span>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of LoopyStructure.
struct LoopyOptions {
  /// Stops when the energy is proven to be within this of the least [units of the maps].
  double tolerance = 1e-3;
  /// Stops when ten iterations raise the lower bound by less than this share of its distance from the energy.
  double progress = 0.01;
  int max_iterations = 200;
  /// If given, tested at every part in every pass: once another thread has set it to true, the solve ends
  /// with Status::Interrupted.
  const std::atomic<bool>* stop = nullptr;

  /// The first problem of the options, or nullptr if there is none.
  const char* problem() const {
    if (!detail::is_finite(tolerance) || tolerance < 0) return "option tolerance is negative or not finite";
    if (!detail::is_finite(progress) || progress < 0) return "option progress is negative or not finite";
    return max_iterations < 1 ? "option max_iterations is below 1" : nullptr;
  }
};

/// The result of a solve of a loopy structure.
struct LoopySummary {
  /// Converged: the energy is within LoopyOptions::tolerance of the lower bound. NoProgress or MaxIterations:
  /// it is not, so that the placement may or may not be the best one, or none was found in the windows of
  /// costs of a length. InvalidInput, also if it is proven that every placement is forbidden; OutOfMemory;
  /// Interrupted, without a placement.
  Status status = Status::NotRun;
  Message message;
  int iterations = 0;
  double energy = std::numeric_limits<double>::quiet_NaN();  ///< of the placement; infinity for none
  /// No placement has a lower energy than this, up to the rounding of floats.
  double lower_bound = -std::numeric_limits<double>::infinity();

  /// Whether there is a placement.
  bool usable() const {
    return (status == Status::Converged || status == Status::NoProgress || status == Status::MaxIterations) &&
           energy < std::numeric_limits<double>::infinity();
  }
};

inline std::ostream& operator<<(std::ostream& out, const LoopySummary& summary) {
  out << summary.status;
  if (summary.usable()) {
    out << " after " << detail::counted(summary.iterations, "iteration") << ", energy " << summary.energy
        << ", lower bound " << summary.lower_bound;
  }
  if (!summary.message.empty()) out << ": " << summary.message;
  return out;
}

/// A good placement of parts that each have a map of costs, linked by costs of displacement in any graph,
/// with cycles, and a lower bound of the energy of all placements. The energy is that of PictorialStructure.
///
/// Sequential tree-reweighted message passing (TRW-S; Kolmogorov, PAMI 2006): each iteration passes messages
/// over all joints forwards and backwards, by a distance transform each, and never lowers the bound, up to
/// rounding. The placement is the best of those that the iterations read from their messages. On a tree it is
/// as good as PictorialStructure's, which is faster; with cycles, the bound may stay below the energy however
/// long it iterates. With costs of a length, which forbid displacements, no placement may be found.
///
/// An object holds its workspace: reuse it to solve without allocation while the joints' ends and the sizes
/// of the maps stay the same, one thread at a time.
class LoopyStructure {
 public:
  LoopyOptions options;

  /// `joints` are any edges between parts. For bad input the status is InvalidInput, the message names the
  /// joint or the map, and `best` stays as it was.
  LoopySummary solve(std::span<const Joint> joints, std::span<const MapView<const float>> maps,
                     PartPlacement& best) {
    if (const char* problem = options.problem()) return refused(problem);
    if (const Defect defect = find_defect(joints, maps)) return refused(defect);
    return detail::within_memory<LoopySummary>([&] {
      plan(joints, maps);
      return iterate(best);
    });
  }

 private:
  // A joint as seen from one of its ends: the message to this end, and the transform that makes it.
  struct End {
    int other = 0;          // the part at the other end
    std::size_t back = 0;   // the other end's number in ends_[other]
    DisplacementCost cost;  // of the position here, from the other part's
    std::vector<float> message;
    DistanceTransform transform;  // of the other part's map, to this one
  };
  struct Part {
    MapView<const float> map;
    std::vector<End> ends;
    double share = 1;  // of its costs that goes to each joint
    int before = 0, after = 0;
  };

  static constexpr float kInfinity = std::numeric_limits<float>::infinity();

  static LoopySummary refused(const Message& why) {
    return detail::without_placement<LoopySummary>(Status::InvalidInput, why);
  }
  static Defect find_defect(std::span<const Joint> joints, std::span<const MapView<const float>> maps);
  void plan(std::span<const Joint> joints, std::span<const MapView<const float>> maps);
  LoopySummary iterate(PartPlacement& best);
  double pass(bool forward);
  void read_placement();
  double energy_of(const Eigen::Matrix2Xi& positions) const;
  Defect no_placement() const;
  static std::size_t pixels(const Part& part) {
    return static_cast<std::size_t>(part.map.width) * static_cast<std::size_t>(part.map.height);
  }
  // The map's costs, without gaps.
  void copy(const Part& part) {
    detail::copy_map(part.map, MapView<float>(sum_.data(), part.map.width, part.map.height));
  }
  void add_message(const End& end, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) sum_[i] += end.message[i];
  }

  std::vector<Part> parts_;
  std::vector<float> sum_, outgoing_;
  std::vector<double> along_x_;
  Eigen::Matrix2Xi positions_, best_positions_;
};

inline Defect LoopyStructure::find_defect(std::span<const Joint> joints,
                                          std::span<const MapView<const float>> maps) {
  if (maps.empty()) return {"maps", Defect::kNoIndex, "are none"};
  if (maps.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()) ||
      joints.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()))
    return {"maps", Defect::kNoIndex, "or joints are more than can be counted"};
  const auto parts = static_cast<int>(maps.size());
  detail::EnergyRange range;
  for (int i = 0; i < parts; ++i) {
    const MapView<const float>& map = maps[static_cast<std::size_t>(i)];
    float least = 0;
    if (const char* problem = detail::map_problem(map, least)) return {"map", i, problem};
    range.add_least(least);
    bool has_place = false;
    for (int y = 0; y < map.height && !has_place; ++y) {
      for (int x = 0; x < map.width && !has_place; ++x) has_place = map(x, y) < kInfinity;
    }
    if (!has_place) return {"map", i, "forbids every position"};
  }
  if (range.is_below_floats()) return {"maps", Defect::kNoIndex, detail::kBelowFloats};
  for (std::size_t k = 0; k < joints.size(); ++k) {
    if (const char* problem = detail::joint_problem(joints[k], parts))
      return {"joint", static_cast<int>(k), problem};
  }
  return {};
}

inline void LoopyStructure::plan(std::span<const Joint> joints, std::span<const MapView<const float>> maps) {
  if (parts_.size() != maps.size()) parts_.resize(maps.size());
  std::size_t most = 0, widest = 0;
  double bytes = 0;
  for (std::size_t i = 0; i < maps.size(); ++i) {
    parts_[i].map = maps[i];
    parts_[i].before = parts_[i].after = 0;
    most = std::max(most, pixels(parts_[i]));
    widest = std::max(widest, static_cast<std::size_t>(maps[i].width));
  }
  // Ends keep their workspaces from solve to solve.
  for (const Joint& joint : joints) {
    ++parts_[static_cast<std::size_t>(joint.parent)].before;  // counts ends for now
    ++parts_[static_cast<std::size_t>(joint.child)].before;
    bytes += 2 * sizeof(float) *
             static_cast<double>(pixels(parts_[static_cast<std::size_t>(joint.parent)]) +
                                 pixels(parts_[static_cast<std::size_t>(joint.child)]));
  }
  detail::require_memory(bytes);
  for (Part& part : parts_) {
    if (part.ends.size() != static_cast<std::size_t>(part.before)) {
      part.ends.resize(static_cast<std::size_t>(part.before));
    }
    part.before = 0;
  }
  for (const Joint& joint : joints) {
    Part& parent = parts_[static_cast<std::size_t>(joint.parent)];
    Part& child = parts_[static_cast<std::size_t>(joint.child)];
    const auto at_parent = static_cast<std::size_t>(parent.before + parent.after);
    const auto at_child = static_cast<std::size_t>(child.before + child.after);
    const auto set = [](Part& part, std::size_t at, int other, std::size_t back, const DisplacementCost& cost,
                        const Part& from) {
      End& end = part.ends[at];
      end.other = other;
      end.back = back;
      end.cost = cost;
      end.message.assign(pixels(part), 0.0F);
      // The transform's displacement is from the place here to the other one.
      end.transform.reserve(from.map.width, from.map.height, cost.reversed(), part.map.width,
                            part.map.height);
    };
    set(parent, at_parent, joint.child, at_child, joint.cost.reversed(), child);
    set(child, at_child, joint.parent, at_parent, joint.cost, parent);
    ++(joint.child < joint.parent ? parent.before : parent.after);
    ++(joint.parent < joint.child ? child.before : child.after);
  }
  for (Part& part : parts_) part.share = 1.0 / std::max({1, part.before, part.after});
  if (sum_.size() < most) sum_.resize(most);
  if (outgoing_.size() < most) outgoing_.resize(most);
  if (along_x_.size() < widest) along_x_.resize(widest);
  const auto count = static_cast<Eigen::Index>(parts_.size());
  if (positions_.cols() != count) positions_.resize(2, count);
}

// Messages from each part to those after it in this direction; returns the lower bound. A part's costs with
// all its messages are shared out to the joints to later parts, and what is left is bounded by its least; a
// message is what it adds to the least of its joint.
inline double LoopyStructure::pass(bool forward) {
  double bound = 0;
  const auto count = static_cast<int>(parts_.size());
  for (int k = 0; k < count; ++k) {
    if (detail::is_set(options.stop)) return bound;
    const int i = forward ? k : count - 1 - k;
    Part& part = parts_[static_cast<std::size_t>(i)];
    const std::size_t size = pixels(part);
    copy(part);
    for (const End& end : part.ends) add_message(end, size);
    const float least = detail::least_of(sum_.data(), static_cast<std::ptrdiff_t>(size));
    if (!(least < kInfinity)) return std::numeric_limits<double>::infinity();
    const int onwards = forward ? part.after : part.before;
    bound += (1 - onwards * part.share) * static_cast<double>(least);
    const auto share = static_cast<float>(part.share);
    for (const End& end : part.ends) {
      if (forward ? end.other < i : end.other > i) continue;
      for (std::size_t p = 0; p < size; ++p) {
        outgoing_[p] = sum_[p] < kInfinity ? share * sum_[p] - end.message[p] : kInfinity;
      }
      Part& other = parts_[static_cast<std::size_t>(end.other)];
      End& there = other.ends[end.back];
      const MapView<float> message(there.message.data(), other.map.width, other.map.height);
      there.transform.write<false>(MapView<float>(outgoing_.data(), part.map.width, part.map.height),
                                   message);
      const float shift =
          detail::least_of(there.message.data(), static_cast<std::ptrdiff_t>(there.message.size()));
      if (!(shift < kInfinity)) return std::numeric_limits<double>::infinity();
      for (float& value : there.message) value -= shift;
      bound += static_cast<double>(shift);
    }
  }
  return bound;
}

// Parts in order, each at its best place for those before it and the messages of those after it.
inline void LoopyStructure::read_placement() {
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Part& part = parts_[i];
    copy(part);
    for (const End& end : part.ends) {
      if (end.other > static_cast<int>(i)) {
        add_message(end, pixels(part));
        continue;
      }
      const Eigen::Vector2i at = positions_.col(end.other);
      if (end.cost.has_window()) {
        float* to = sum_.data();
        for (int y = 0; y < part.map.height; ++y) {
          for (int x = 0; x < part.map.width; ++x) {
            *to++ += static_cast<float>(end.cost(x - at.x(), y - at.y()));
          }
        }
        continue;
      }
      for (int x = 0; x < part.map.width; ++x) {
        along_x_[static_cast<std::size_t>(x)] = end.cost.x(x - at.x());
      }
      float* to = sum_.data();
      for (int y = 0; y < part.map.height; ++y) {
        const double along_y = end.cost.y(y - at.y());
        for (int x = 0; x < part.map.width; ++x) {
          *to++ += static_cast<float>(along_x_[static_cast<std::size_t>(x)] + along_y);
        }
      }
    }
    const float least = detail::least_of(sum_.data(), static_cast<std::ptrdiff_t>(pixels(part)));
    const auto place = static_cast<int>(std::find(sum_.begin(), sum_.end(), least) - sum_.begin());
    positions_.col(static_cast<Eigen::Index>(i)) << place % part.map.width, place / part.map.width;
  }
}

inline Defect LoopyStructure::no_placement() const {
  detail::EnergyRange range;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    range.add(parts_[i].map);
    for (const End& end : parts_[i].ends) {
      if (end.other < static_cast<int>(i))
        range.add(end.cost, parts_[static_cast<std::size_t>(end.other)].map, parts_[i].map);
    }
  }
  return range.no_placement();
}

inline double LoopyStructure::energy_of(const Eigen::Matrix2Xi& positions) const {
  double energy = 0;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Eigen::Vector2i at = positions.col(static_cast<Eigen::Index>(i));
    energy += static_cast<double>(parts_[i].map(at.x(), at.y()));
    for (const End& end : parts_[i].ends) {
      if (end.other > static_cast<int>(i)) continue;
      const Eigen::Vector2i d = at - positions.col(end.other);
      energy += end.cost(d.x(), d.y());
    }
  }
  return energy;
}

inline LoopySummary LoopyStructure::iterate(PartPlacement& best) {
  constexpr int kPatience = 10;
  LoopySummary summary;
  double energy = std::numeric_limits<double>::infinity(), earlier_bound = summary.lower_bound;
  summary.status = Status::MaxIterations;
  while (summary.iterations < options.max_iterations) {
    ++summary.iterations;
    const double forwards = pass(true), backwards = pass(false);
    if (detail::is_set(options.stop)) {
      summary.status = Status::Interrupted;
      summary.message = "stopped on request";
      return summary;
    }
    summary.lower_bound = std::max({summary.lower_bound, forwards, backwards});
    if (!(summary.lower_bound < std::numeric_limits<double>::infinity())) {
      summary.status = Status::InvalidInput;
      summary.message = no_placement();
      return summary;
    }
    read_placement();
    const double of_placement = energy_of(positions_);
    if (of_placement < energy) {
      energy = of_placement;
      best_positions_ = positions_;
    }
    if (energy - summary.lower_bound <= options.tolerance) {
      summary.status = Status::Converged;
      break;
    }
    if (summary.iterations % kPatience != 0) continue;
    if (summary.lower_bound - earlier_bound < options.progress * (energy - summary.lower_bound)) {
      summary.status = Status::NoProgress;
      break;
    }
    earlier_bound = summary.lower_bound;
  }
  summary.energy = energy;
  if (summary.usable()) {
    best.positions = best_positions_;
    best.energy = energy;
  } else {
    summary.message = "no placement was found that the windows of the lengths allow";
  }
  return summary;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
