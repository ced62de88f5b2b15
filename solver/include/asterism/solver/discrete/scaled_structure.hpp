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
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <atomic>
#include <cstddef>
#include <limits>
#include <new>
#include <span>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A joint whose parts have layers of scale.
struct ScaledJoint : Joint {
  /// The cost of the difference of the child's and the parent's layer [layers]; by default the square of the
  /// difference.
  AxisCost layer;
};

/// A place and a layer for each part.
struct ScaledPlacement : PartPlacement {
  Eigen::VectorXi layers;  ///< of each part, from 0
};

/// The best placement of parts that each have a map of costs for each of several layers of scale, linked to a
/// tree: PictorialStructure with the scale as a third axis. The energy
///   E(x, l) = sum_i f_i(x_i, l_i) + sum_joints cost((x_child - x_parent) / s) + layer(l_child - l_parent),
/// where s is the scale of the parent's layer, is minimised over all positions and layers of all parts:
/// offsets grow with the scale, and weights fall, so that a larger object is as deformable as a small one.
/// Exact, as PictorialStructure is; a joint is as many distance transforms as there are layers, and a minimum
/// over pairs of layers, so that the time is linear in the pixels.
///
/// All maps are on the image's pixels: a response that was computed in a pyramid has to be resampled. The
/// layers of a part have the same size; different parts may have different sizes, and any strides.
///
/// An object holds its workspace: reuse it to solve without allocation while the sizes of the maps, their
/// layers and the tree stay the same, one thread at a time.
class ScaledStructure {
 public:
  /// As PictorialStructure::stop.
  const std::atomic<bool>* stop = nullptr;

  /// Finds the best placement. `scales` are those of the layers, > 0, in any order; `maps` has that of part i
  /// in layer l at [i * layers + l]; `joints` is a tree of all parts. For bad input, or if every placement is
  /// forbidden, the status is InvalidInput, the message names what is wrong, and `best` stays as it was.
  PictorialSummary solve(std::span<const ScaledJoint> joints, std::span<const double> scales,
                         std::span<const MapView<const float>> maps, ScaledPlacement& best) {
    PictorialSummary summary;
    layers_ = 0;
    if (const Defect defect = find_defect(joints, scales, maps)) return invalid(defect);
    detail::attempt<std::bad_alloc>(
        [&] {
          if (const Defect defect = plan(joints, scales, maps)) {
            summary = invalid(defect);
            return;
          }
          layers_ = static_cast<int>(scales.size());
          if (!collect()) {
            summary.status = Status::Interrupted;
            summary.message = detail::kStopped;
            return;
          }
          int layer = 0, x = 0, y = 0;
          best_.energy = std::numeric_limits<double>::infinity();
          if (find_best_root(sums_of(part(tree_.root())), layer, x, y)) backtrack(layer, x, y, best_);
          if (!detail::is_finite(best_.energy)) {
            summary = invalid(no_placement());
            return;
          }
          best = best_;
          summary.status = Status::Converged;
          summary.energy = best.energy;
        },
        [&](const std::bad_alloc& error) {
          summary.status = Status::OutOfMemory;
          summary.message = detail::memory_message(error);
        });
    if (!summary.usable()) layers_ = 0;
    return summary;
  }

  /// The root of the last tree, -1 if the last solve was not successful. What follows needs a successful
  /// solve, and its maps, alive and unchanged.
  int root() const { return layers_ > 0 ? tree_.root() : -1; }

  /// For each position of the root in a layer, the least energy of a placement that has it there; infinity if
  /// there is none. Valid until the next solve; empty for a layer that does not exist.
  MapView<const float> root_min_marginals(int layer) const {
    if (layer < 0 || layer >= layers_) return {};
    return parts_[static_cast<std::size_t>(tree_.root())].layers[static_cast<std::size_t>(layer)].sum;
  }

  /// Up to `count` good placements: the first is the best of all, and each further one is the best of all
  /// whose root, in any layer, is farther than `distance` [px] from the roots of those before it. Returns
  /// their number; `placements` is resized only if it is shorter. Without a successful solve, 0.
  int best_placements(int count, double distance, std::vector<ScaledPlacement>& placements) {
    if (layers_ == 0 || count <= 0 || !(distance >= 0)) return 0;
    candidates_.resize(static_cast<std::size_t>(layers_));
    left_.clear();
    for (int l = 0; l < layers_; ++l) {
      const MapView<const float> marginals = root_min_marginals(l);
      auto& numbers = candidates_[static_cast<std::size_t>(l)];
      const auto size = pixels(marginals);
      numbers.assign(marginals.data, marginals.data + size);
      left_.emplace_back(numbers.data(), marginals.width, marginals.height);
    }
    int found = 0, layer = 0, x = 0, y = 0;
    while (found < count && !detail::is_set(stop) && find_best_root(left_, layer, x, y)) {
      if (placements.size() <= static_cast<std::size_t>(found)) placements.emplace_back();
      ScaledPlacement& placement = placements[static_cast<std::size_t>(found)];
      backtrack(layer, x, y, placement);
      if (!detail::is_finite(placement.energy)) break;
      ++found;
      for (const MapView<float>& map : left_) detail::forbid_near(map, x, y, distance);
    }
    return found;
  }

 private:
  // A part in one layer.
  struct Layer {
    MapView<const float> map;
    MapView<const float> sum;     // the map and the messages of all children; the map itself for a leaf
    MapView<const float> around;  // the best of all layers of the part, for a parent in this one
    std::vector<float> of_sum, of_around;
    DisplacementCost cost;        // of the joint to a parent in this layer
    DistanceTransform transform;  // of `around`, for the parent
  };
  struct Part {
    std::vector<Layer> layers;
    int parent = -1;
    AxisCost change;  // of layers, from the parent to this part
    bool is_leaf = true;
  };

  static PictorialSummary invalid(const Defect& defect) {
    PictorialSummary summary;
    summary.status = Status::InvalidInput;
    summary.message = defect;
    return summary;
  }
  Part& part(int i) { return parts_[static_cast<std::size_t>(i)]; }
  const Part& part(int i) const { return parts_[static_cast<std::size_t>(i)]; }
  static std::size_t pixels(const MapView<const float>& map) {
    return static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height);
  }
  static MapView<float> compact(std::vector<float>& numbers, const MapView<const float>& shape) {
    const std::size_t size = pixels(shape);
    if (numbers.size() < size) {
      detail::require_memory(sizeof(float) * static_cast<double>(size));
      numbers.resize(size);
    }
    return {numbers.data(), shape.width, shape.height};
  }
  std::span<const MapView<const float>> sums_of(const Part& of) {
    sums_.clear();
    for (const Layer& layer : of.layers) sums_.push_back(layer.sum);
    return sums_;
  }
  template <typename Map>
  static bool find_best_root(const Map& maps, int& layer, int& x, int& y) {
    float least = std::numeric_limits<float>::infinity();
    bool found = false;
    int of_map = 0;
    for (const auto& map : maps) {
      int u = 0, v = 0;
      if (detail::find_least(map, u, v) && map(u, v) < least) {
        least = map(u, v);
        layer = of_map;
        x = u;
        y = v;
        found = true;
      }
      ++of_map;
    }
    return found;
  }

  static Defect find_defect(std::span<const ScaledJoint> joints, std::span<const double> scales,
                            std::span<const MapView<const float>> maps);
  Defect plan(std::span<const ScaledJoint> joints, std::span<const double> scales,
              std::span<const MapView<const float>> maps);
  bool collect();
  Defect no_placement() const;
  void backtrack(int layer, int x, int y, ScaledPlacement& placement) const;

  std::vector<Part> parts_;
  detail::PartTree tree_;
  int layers_ = 0;  // 0 without a solution
  ScaledPlacement best_;
  std::vector<MapView<const float>> sums_;
  std::vector<MapView<float>> left_;  // of best_placements
  std::vector<std::vector<float>> candidates_;
};

inline Defect ScaledStructure::find_defect(std::span<const ScaledJoint> joints,
                                           std::span<const double> scales,
                                           std::span<const MapView<const float>> maps) {
  constexpr auto kMost = static_cast<std::size_t>(std::numeric_limits<int>::max());
  if (scales.empty()) return {"scales", -1, "are none"};
  for (std::size_t l = 0; l < scales.size(); ++l) {
    if (!(scales[l] >= 1e-3 && scales[l] <= 1e3))
      return {"scale", static_cast<int>(l), "is not between 1/1000 and 1000"};
  }
  if (maps.empty()) return {"maps", -1, "are none"};
  if (maps.size() > kMost) return {"maps", -1, "are more than can be counted"};
  if (maps.size() % scales.size() != 0) return {"maps", -1, "are not as many for each part as scales"};
  detail::EnergyRange range;
  float least = 0;  // of the part
  for (std::size_t i = 0; i < maps.size(); ++i) {
    float of_map = 0;
    if (const char* problem = detail::map_problem(maps[i], of_map))
      return {"map", static_cast<int>(i), problem};
    const bool is_last = (i + 1) % scales.size() == 0;
    least = std::min(least, of_map);
    if (is_last) range.add_least(std::exchange(least, 0.0F));
    const MapView<const float>& first = maps[i / scales.size() * scales.size()];
    if (maps[i].width != first.width || maps[i].height != first.height)
      return {"map", static_cast<int>(i), "is not of the size of the part's first layer"};
  }
  if (range.is_below_floats()) return {"maps", -1, detail::kBelowFloats};
  const std::size_t parts = maps.size() / scales.size();
  if (joints.size() + 1 != parts) return {"joints", -1, "are not one fewer than parts: no tree of all"};
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const auto number = static_cast<int>(k);
    if (const char* problem = detail::joint_problem(joints[k], static_cast<int>(parts)))
      return {"joint", number, problem};
    if (joints[k].layer.problem() != nullptr)
      return {"joint", number, "has a cost of layers that is not valid"};
    for (const double scale : scales) {
      if (joints[k].cost.scaled(scale).problem() != nullptr)
        return {"joint", number, "has a cost that is out of range at one of the scales"};
    }
  }
  return {};
}

inline Defect ScaledStructure::plan(std::span<const ScaledJoint> joints, std::span<const double> scales,
                                    std::span<const MapView<const float>> maps) {
  const std::size_t layers = scales.size(), count = maps.size() / layers;
  if (parts_.size() != count) parts_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    Part& one = parts_[i];
    if (one.layers.size() != layers) one.layers.resize(layers);
    for (std::size_t l = 0; l < layers; ++l) one.layers[l].map = one.layers[l].sum = maps[i * layers + l];
    one.parent = -1;
    one.is_leaf = true;
  }
  if (const Defect defect = tree_.plan(joints, static_cast<int>(count))) return defect;
  for (const ScaledJoint& joint : joints) {
    Part& child = part(joint.child);
    child.parent = joint.parent;
    child.change = joint.layer;
    for (std::size_t l = 0; l < layers; ++l) child.layers[l].cost = joint.cost.scaled(scales[l]);
    part(joint.parent).is_leaf = false;
  }
  for (Part& one : parts_) {
    for (Layer& layer : one.layers) {
      if (!one.is_leaf || one.parent < 0) layer.sum = compact(layer.of_sum, layer.map);
      if (one.parent < 0) continue;
      layer.around = compact(layer.of_around, layer.map);
      const MapView<const float>& to = part(one.parent).layers[0].map;
      layer.transform.reserve(layer.map.width, layer.map.height, layer.cost, to.width, to.height);
    }
  }
  return {};
}

// Min-sum from the leaves to the root; false if it was stopped.
inline bool ScaledStructure::collect() {
  for (Part& one : parts_) {
    if (detail::is_set(stop)) return false;
    if (one.is_leaf && one.parent >= 0) continue;
    for (Layer& layer : one.layers) {
      const MapView<float> sum = compact(layer.of_sum, layer.map);
      for (int y = 0; y < sum.height; ++y) {
        for (int x = 0; x < sum.width; ++x) sum(x, y) = layer.map(x, y);
      }
    }
  }
  for (std::size_t k = tree_.order.size(); k-- > 1;) {
    Part& child = part(tree_.order[k]);
    Part& parent = part(child.parent);
    for (int l = 0; l < layers_; ++l) {
      if (detail::is_set(stop)) return false;
      Layer& layer = child.layers[static_cast<std::size_t>(l)];
      const MapView<float> around = compact(layer.of_around, layer.map);
      std::fill_n(around.data, pixels(around), std::numeric_limits<float>::infinity());
      for (int other = 0; other < layers_; ++other) {
        const MapView<const float>& sum = child.layers[static_cast<std::size_t>(other)].sum;
        const auto cost =
            static_cast<float>(std::min(child.change(other - l), double{std::numeric_limits<float>::max()}));
        for (int y = 0; y < sum.height; ++y) {
          float* const to = around.row(y);
          const float* const from = sum.row(y);
          for (int x = 0; x < sum.width; ++x) to[x] = std::min(to[x], from[x * sum.column_stride] + cost);
        }
      }
      layer.transform.write<true>(
          around, compact(parent.layers[static_cast<std::size_t>(l)].of_sum, parent.layers[0].map));
    }
  }
  return true;
}

inline Defect ScaledStructure::no_placement() const {
  detail::EnergyRange range;
  for (const Part& one : parts_) {
    for (const Layer& layer : one.layers) {
      range.add(layer.map);
      if (one.parent >= 0) range.add(layer.cost, part(one.parent).layers[0].map, layer.map);
    }
  }
  return range.no_placement();
}

// The best placement with the root in a layer at (x, y); of infinite energy if there is none.
inline void ScaledStructure::backtrack(int layer, int x, int y, ScaledPlacement& placement) const {
  const auto count = static_cast<Eigen::Index>(parts_.size());
  if (placement.positions.cols() != count) placement.positions.resize(2, count);
  if (placement.layers.size() != count) placement.layers.resize(count);
  placement.energy = 0;
  for (const int i : tree_.order) {
    const Part& one = part(i);
    Eigen::Vector2i position(x, y);
    int of_part = layer;
    if (one.parent >= 0) {
      const Eigen::Vector2i at = placement.positions.col(one.parent);
      const int of_parent = placement.layers(one.parent);
      const Layer& from = one.layers[static_cast<std::size_t>(of_parent)];
      position = from.transform.best_place(from.around, from.cost, at.x(), at.y());
      double least = std::numeric_limits<double>::infinity();
      if (position.x() >= 0) {
        for (int l = 0; l < layers_; ++l) {
          const double of_layer =
              one.change(l - of_parent) +
              static_cast<double>(one.layers[static_cast<std::size_t>(l)].sum(position.x(), position.y()));
          if (of_layer < least) {
            least = of_layer;
            of_part = l;
          }
        }
      }
      if (!detail::is_finite(least)) {
        placement.energy = std::numeric_limits<double>::infinity();
        return;
      }
      const Eigen::Vector2i d = position - at;
      placement.energy += from.cost(d.x(), d.y()) + one.change(of_part - of_parent);
    }
    placement.positions.col(i) = position;
    placement.layers(i) = of_part;
    const MapView<const float>& map = one.layers[static_cast<std::size_t>(of_part)].map;
    placement.energy += static_cast<double>(map(position.x(), position.y()));
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
