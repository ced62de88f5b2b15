#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/discrete/distance_transform.hpp>
#include <asterism/solver/discrete/map_search.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/discrete/part_tree.hpp>
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

/// An edge of a tree of parts: what it costs that the child is at x_child while its parent is at x_parent,
/// cost(x_child - x_parent).
struct Joint {
  int parent = 0;         ///< a part, from 0
  int child = 0;          ///< another part
  DisplacementCost cost;  ///< of the child's position less the parent's
};

namespace detail {

inline constexpr const char* kStopped = "stopped on request";

/// Whether a solver that has this flag, which may be none, is to stop.
inline bool is_set(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

/// The problem of a joint of so many parts, or nullptr if there is none.
inline const char* joint_problem(const Joint& joint, int parts) {
  const auto is_part = [parts](int index) { return 0 <= index && index < parts; };
  if (!is_part(joint.parent) || !is_part(joint.child)) return "has an end that is out of range";
  return joint.parent == joint.child ? "joins a part to itself" : joint.cost.problem();
}

}  // namespace detail

/// A place for each part.
struct PartPlacement {
  double energy = std::numeric_limits<double>::infinity();  ///< E of the placement
  Eigen::Matrix2Xi positions;                               ///< 2 x parts, (x, y) in the part's map [px]
};

/// The result of a solve of a pictorial structure.
struct PictorialSummary {
  Status status = Status::NotRun;  ///< Converged, InvalidInput, OutOfMemory or Interrupted
  Message message;                 ///< what is wrong
  double energy = std::numeric_limits<double>::quiet_NaN();  ///< of the placement; NaN if there is none

  /// Whether there is a placement.
  bool usable() const { return status == Status::Converged; }
};

inline std::ostream& operator<<(std::ostream& out, const PictorialSummary& summary) {
  out << summary.status;
  if (summary.usable()) out << ", energy " << summary.energy;
  if (!summary.message.empty()) out << ": " << summary.message;
  return out;
}

/// The best placement of parts that each have a map of costs, linked to a tree by costs of displacement: a
/// pictorial structure (Fischler and Elschlager 1973; Felzenszwalb and Huttenlocher, IJCV 2005). The energy
///   E(x) = sum_i f_i(x_i) + sum_joints cost(x_child - x_parent)
/// is minimised over all positions of all parts by dynamic programming (min-sum) from the leaves to the root;
/// each joint is one generalised distance transform, so that the time is linear in the pixels of all maps.
///
/// The result is exact, for any maps: no placement has a lower energy, up to the rounding of sums of floats
/// (see DistanceTransform). If several placements have the least energy, one of them is found. Maps may have
/// different sizes and strides; a position is in pixels of the part's own map, so that an offset between two
/// maps' origins belongs into the joint's offset. Infinity in a map forbids a position, and an energy above
/// the range of float counts as infinite.
///
/// An object holds its workspace: reuse it to solve without allocation while the sizes of the maps and the
/// tree stay the same, one thread at a time.
class PictorialStructure {
 public:
  /// If given, tested at every part and every further placement: once another thread has set it to true, a
  /// solve ends with Status::Interrupted and leaves `best` as it was, and best_placements finds no more.
  const std::atomic<bool>* stop = nullptr;

  /// Finds the best placement. `joints` is a tree of all parts, in any order: its root is the part that is no
  /// child. `maps` has a map for each part. For bad input, or if every placement is forbidden, the status is
  /// InvalidInput, the message names the joint or the map, and `best` stays as it was.
  PictorialSummary solve(std::span<const Joint> joints, std::span<const MapView<const float>> maps,
                         PartPlacement& best) {
    PictorialSummary summary;
    root_ = -1;
    if (const Defect defect = find_defect(joints, maps)) return invalid(defect);
    detail::attempt<std::bad_alloc>(
        [&] {
          if (const Defect defect = plan(joints, maps)) {
            summary = invalid(defect);
            return;
          }
          if (!collect()) {
            summary.status = Status::Interrupted;
            summary.message = detail::kStopped;
            return;
          }
          summary = place_root(best);
        },
        [&](const std::bad_alloc& error) {
          summary.status = Status::OutOfMemory;
          summary.message = detail::memory_message(error);
        });
    if (!summary.usable()) root_ = -1;
    return summary;
  }

  /// The root of the last tree, -1 if the last solve was not successful. What follows needs a successful
  /// solve, and its maps, alive and unchanged.
  int root() const { return root_; }

  /// The root's min-marginals: for each position of the root, the least energy of a placement that has it
  /// there; infinity if there is none. Valid until the next solve.
  MapView<const float> root_min_marginals() const {
    return root_ < 0 ? MapView<const float>() : parts_[static_cast<std::size_t>(root_)].sum;
  }

  /// The same for any part, to a map of the part's size. Two distance transforms for each joint between the
  /// part and the root. Returns what is wrong with the input, or an empty text.
  Message min_marginals(int part, const MapView<float>& result);

  /// Up to `count` good placements whose roots differ: the first is the best of all, and each further one
  /// is the best of all placements whose root is farther than `distance` [px] from the roots of those before
  /// it. Each is exact in that sense. They are not the placements of the `count` lowest energies: two that
  /// have their roots at the same place, or near to each other, are not both found. Fewer are found if no
  /// root is left. Returns their number; `placements` is resized only if it is shorter. Without a successful
  /// solve, 0.
  int best_placements(int count, double distance, std::vector<PartPlacement>& placements);

 private:
  struct Part {
    MapView<const float> map;
    MapView<const float> sum;    // the map and the messages of all children; the map itself for a leaf
    std::vector<float> numbers;  // of the sum
    int parent = -1;
    DisplacementCost cost;        // of the joint to the parent
    DistanceTransform transform;  // of the sum, for the parent
    bool is_leaf = true;
  };

  static PictorialSummary invalid(const Defect& defect) {
    PictorialSummary summary;
    summary.status = Status::InvalidInput;
    summary.message = defect;
    return summary;
  }

  static Defect find_defect(std::span<const Joint> joints, std::span<const MapView<const float>> maps);
  Defect plan(std::span<const Joint> joints, std::span<const MapView<const float>> maps);
  bool collect();
  PictorialSummary place_root(PartPlacement& best);
  Defect no_placement() const;
  bool backtrack(int x, int y, PartPlacement& placement) const;
  static MapView<float> compact(std::vector<float>& numbers, const MapView<const float>& shape) {
    const auto size = static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(shape.height);
    if (numbers.size() < size) {
      detail::require_memory(sizeof(float) * static_cast<double>(size));
      numbers.resize(size);
    }
    return {numbers.data(), shape.width, shape.height};
  }
  template <typename Assign>
  static void for_each_pixel(const MapView<const float>& from, const MapView<float>& to, Assign&& assign) {
    for (int y = 0; y < from.height; ++y) {
      for (int x = 0; x < from.width; ++x) assign(from(x, y), to(x, y));
    }
  }

  std::vector<Part> parts_;
  detail::PartTree tree_;
  int root_ = -1;
  std::vector<float> candidates_;                  // of best_placements
  std::vector<float> upward_, others_, marginal_;  // of min_marginals
  DistanceTransform downward_;
  std::vector<int> path_;
};

inline Defect PictorialStructure::find_defect(std::span<const Joint> joints,
                                              std::span<const MapView<const float>> maps) {
  if (maps.empty()) return {"maps", -1, "are none"};
  if (maps.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()))
    return {"maps", -1, "are more than can be counted"};
  const auto parts = static_cast<int>(maps.size());
  detail::EnergyRange range;
  for (int i = 0; i < parts; ++i) {
    float least = 0;
    if (const char* problem = detail::map_problem(maps[static_cast<std::size_t>(i)], least))
      return {"map", i, problem};
    range.add_least(least);
  }
  if (range.is_below_floats()) return {"maps", -1, detail::kBelowFloats};
  if (joints.size() + 1 != maps.size()) return {"joints", -1, "are not one fewer than maps: no tree of all"};
  for (int k = 0; k < parts - 1; ++k) {
    if (const char* problem = detail::joint_problem(joints[static_cast<std::size_t>(k)], parts))
      return {"joint", k, problem};
  }
  return {};
}

inline Defect PictorialStructure::plan(std::span<const Joint> joints,
                                       std::span<const MapView<const float>> maps) {
  if (parts_.size() != maps.size()) parts_.resize(maps.size());
  for (std::size_t i = 0; i < maps.size(); ++i) {
    parts_[i].map = parts_[i].sum = maps[i];
    parts_[i].parent = -1;
    parts_[i].is_leaf = true;
  }
  if (const Defect defect = tree_.plan(joints, static_cast<int>(maps.size()))) return defect;
  for (const Joint& joint : joints) {
    Part& child = parts_[static_cast<std::size_t>(joint.child)];
    child.parent = joint.parent;
    child.cost = joint.cost;
    parts_[static_cast<std::size_t>(joint.parent)].is_leaf = false;
  }
  root_ = tree_.root();
  for (Part& part : parts_) {
    if (!part.is_leaf || part.parent < 0) part.sum = compact(part.numbers, part.map);
    if (part.parent < 0) continue;
    const MapView<const float>& parent = parts_[static_cast<std::size_t>(part.parent)].map;
    part.transform.reserve(part.map.width, part.map.height, part.cost, parent.width, parent.height);
  }
  return {};
}

// Min-sum from the leaves to the root; false if it was stopped.
inline bool PictorialStructure::collect() {
  for (Part& part : parts_) {
    if (detail::is_set(stop)) return false;
    if (part.is_leaf && part.parent >= 0) continue;
    const MapView<float> sum = compact(part.numbers, part.map);
    for (int y = 0; y < sum.height; ++y) {
      if (part.map.column_stride == 1) {
        std::copy_n(part.map.row(y), sum.width, sum.row(y));
      } else {
        for (int x = 0; x < sum.width; ++x) sum(x, y) = part.map(x, y);
      }
    }
  }
  for (std::size_t k = tree_.order.size(); k-- > 1;) {
    if (detail::is_set(stop)) return false;
    Part& part = parts_[static_cast<std::size_t>(tree_.order[k])];
    Part& parent = parts_[static_cast<std::size_t>(part.parent)];
    part.transform.write<true>(part.sum, compact(parent.numbers, parent.map));
  }
  return true;
}

inline PictorialSummary PictorialStructure::place_root(PartPlacement& best) {
  int x = 0, y = 0;
  if (!detail::find_least(parts_[static_cast<std::size_t>(root_)].sum, x, y) || !backtrack(x, y, best))
    return invalid(no_placement());
  PictorialSummary summary;
  summary.status = Status::Converged;
  summary.energy = best.energy;
  return summary;
}

inline Defect PictorialStructure::no_placement() const {
  detail::EnergyRange range;
  for (const Part& part : parts_) {
    range.add(part.map);
    if (part.parent >= 0) range.add(part.cost, parts_[static_cast<std::size_t>(part.parent)].map, part.map);
  }
  return range.no_placement();
}

// The best placement with the root at (x, y), if there is one.
inline bool PictorialStructure::backtrack(int x, int y, PartPlacement& placement) const {
  const auto count = static_cast<Eigen::Index>(parts_.size());
  if (placement.positions.cols() != count) placement.positions.resize(2, count);
  placement.energy = 0;
  for (const int i : tree_.order) {
    const Part& part = parts_[static_cast<std::size_t>(i)];
    Eigen::Vector2i position(x, y);
    if (part.parent >= 0) {
      const Eigen::Vector2i at = placement.positions.col(part.parent);
      position = part.transform.best_place(part.sum, part.cost, at.x(), at.y());
      if (position.x() < 0) return false;
      const Eigen::Vector2i displacement = position - at;
      placement.energy += part.cost(displacement.x(), displacement.y());
    }
    placement.positions.col(i) = position;
    placement.energy += static_cast<double>(part.map(position.x(), position.y()));
  }
  return detail::is_finite(placement.energy);
}

inline Message PictorialStructure::min_marginals(int part, const MapView<float>& result) {
  if (root_ < 0) return "there is no solution";
  if (part < 0 || part >= static_cast<int>(parts_.size())) return Defect{"part", part, "is out of range"};
  const Part& wanted = parts_[static_cast<std::size_t>(part)];
  if (result.empty() || result.width != wanted.map.width || result.height != wanted.map.height)
    return Defect{"result", -1, "is not of the size of the part's map"};
  Message message;
  const auto work = [&] {
    path_.clear();
    for (int i = part; i != root_; i = parts_[static_cast<std::size_t>(i)].parent) path_.push_back(i);
    MapView<const float> marginal = root_min_marginals();
    for (std::size_t k = path_.size(); k-- > 0;) {
      Part& child = parts_[static_cast<std::size_t>(path_[k])];
      // What the parent's marginals are without the child, and for the child.
      const MapView<float> upward = compact(upward_, marginal), others = compact(others_, marginal);
      child.transform.write<false>(child.sum, upward);
      for_each_pixel(marginal, others, [](float all, float& without) { without = all; });
      for_each_pixel(upward, others, [](float message_of_child, float& without) {
        if (without < std::numeric_limits<float>::infinity()) without -= message_of_child;
      });
      const DisplacementCost back = child.cost.reversed();
      const MapView<float> own = compact(marginal_, child.map);
      for_each_pixel(child.sum, own, [](float from, float& to) { to = from; });
      downward_.reserve(others.width, others.height, back, own.width, own.height);
      downward_.write<true>(others, own);
      marginal = own;
    }
    for_each_pixel(marginal, result, [](float from, float& to) { to = from; });
  };
  detail::attempt<std::bad_alloc>(
      work, [&](const std::bad_alloc& error) { message = detail::memory_message(error); });
  return message;
}

inline int PictorialStructure::best_placements(int count, double distance,
                                               std::vector<PartPlacement>& placements) {
  if (root_ < 0 || count <= 0 || !(distance >= 0)) return 0;
  const MapView<const float> marginals = root_min_marginals();
  const MapView<float> left = compact(candidates_, marginals);
  for_each_pixel(marginals, left, [](float from, float& to) { to = from; });
  int found = 0, x = 0, y = 0;
  while (found < count && !detail::is_set(stop) && detail::find_least(left, x, y)) {
    if (placements.size() <= static_cast<std::size_t>(found)) placements.emplace_back();
    if (!backtrack(x, y, placements[static_cast<std::size_t>(found)])) break;
    ++found;
    detail::forbid_near(left, x, y, distance);
  }
  return found;
}

/// The result of pictorial_structure.
struct PictorialResult : PictorialSummary {
  PartPlacement best;  ///< the best placement
  int root = -1;       ///< the part that is no child
  /// The root's min-marginals, height x width of its map: see PictorialStructure.
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> min_marginals;
};

/// The best placement of parts on a tree, with a workspace of its own; see PictorialStructure, which solves
/// repeatedly without allocation and has further placements and the min-marginals of all parts.
inline PictorialResult pictorial_structure(std::span<const Joint> joints,
                                           std::span<const MapView<const float>> maps) {
  PictorialResult result;
  PictorialStructure structure;
  static_cast<PictorialSummary&>(result) = structure.solve(joints, maps, result.best);
  if (!result.usable()) return result;
  result.root = structure.root();
  const MapView<const float> marginals = structure.root_min_marginals();
  detail::attempt<std::bad_alloc>(
      [&] {
        result.min_marginals =
            decltype(result.min_marginals)::Map(marginals.data, marginals.height, marginals.width);
      },
      [&](const std::bad_alloc& error) {
        static_cast<PictorialSummary&>(result) = PictorialSummary();
        result.status = Status::OutOfMemory;
        result.message = detail::memory_message(error);
      });
  return result;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
