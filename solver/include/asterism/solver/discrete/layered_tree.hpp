#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/finite.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/displacement_cost.hpp>
#include <asterism/solver/discrete/distance_transform.hpp>
#include <asterism/solver/discrete/joint.hpp>
#include <asterism/solver/discrete/map_search.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/discrete/part_tree.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/run/status.hpp>
#include <atomic>
#include <cstddef>
#include <limits>
#include <new>
#include <span>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// What ScaledStructure, and PictorialStructure with its one layer, have in common: the best placement on a
/// tree of parts that have a map in each of several layers. Joints are AnyJoint, with or without a cost of
/// the change of layers, `layer`; placements are PartPlacement, with or without `layers`.
class LayeredTree {
 public:
  template <typename AnyJoint, typename Placement>
  PictorialSummary solve(std::span<const AnyJoint> joints, std::span<const double> scales,
                         std::span<const MapView<const float>> maps, const std::atomic<bool>* stop,
                         Placement& best) {
    const auto refused = [](const Defect& defect) {
      return without_placement<PictorialSummary>(Status::InvalidInput, defect);
    };
    layers_ = 0;
    if (const Defect defect = find_defect(joints, scales, maps)) return refused(defect);
    const PictorialSummary summary = within_memory<PictorialSummary>([&] {
      if (const Defect defect = plan(joints, scales, maps)) return refused(defect);
      layers_ = static_cast<int>(scales.size());
      if (!collect(stop)) return stopped<PictorialSummary>();
      sums_.clear();
      for (const Layer& layer : part(tree_.root()).layers) sums_.push_back(layer.sum);
      int layer = 0, x = 0, y = 0;
      if (!find_best_root(sums_, layer, x, y) || !backtrack(layer, x, y)) return refused(no_placement());
      take_found(best);
      PictorialSummary found;
      found.status = Status::Converged;
      found.energy = best.energy;
      return found;
    });
    if (!summary.usable()) layers_ = 0;
    return summary;
  }

  /// -1 if the last solve was not successful.
  int root() const { return layers_ > 0 ? tree_.root() : -1; }

  MapView<const float> root_min_marginals(int layer) const {
    if (layer < 0 || layer >= layers_) return {};
    return part(tree_.root()).layers[static_cast<std::size_t>(layer)].sum;
  }

  /// Of the first layer.
  Message min_marginals(int part, const MapView<float>& result);

  template <typename Placement>
  int best_placements(int count, double distance, const std::atomic<bool>* stop,
                      std::vector<Placement>& placements) {
    if (layers_ == 0 || count <= 0 || !(distance >= 0)) return 0;
    candidates_.resize(static_cast<std::size_t>(layers_));
    left_.clear();
    for (int l = 0; l < layers_; ++l) {
      const MapView<const float> marginals = root_min_marginals(l);
      left_.push_back(compact(candidates_[static_cast<std::size_t>(l)], marginals));
      copy_map(marginals, left_.back());
    }
    int found = 0, layer = 0, x = 0, y = 0;
    while (found < count && !is_set(stop) && find_best_root(left_, layer, x, y)) {
      if (placements.size() <= static_cast<std::size_t>(found)) placements.emplace_back();
      if (!backtrack(layer, x, y)) break;
      take_found(placements[static_cast<std::size_t>(found++)]);
      for (const MapView<float>& map : left_) forbid_near(map, x, y, distance);
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

    // Whether `around` may differ from `sum`.
    bool has_changes() const { return layers.size() > 1 || change(0) != 0; }
  };

  Part& part(int i) { return parts_[static_cast<std::size_t>(i)]; }
  const Part& part(int i) const { return parts_[static_cast<std::size_t>(i)]; }
  static MapView<float> compact(std::vector<float>& numbers, const MapView<const float>& shape) {
    const auto size = static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(shape.height);
    if (numbers.size() < size) {
      require_memory(sizeof(float) * static_cast<double>(size));
      numbers.resize(size);
    }
    return {numbers.data(), shape.width, shape.height};
  }

  template <typename AnyJoint>
  static Defect find_defect(std::span<const AnyJoint> joints, std::span<const double> scales,
                            std::span<const MapView<const float>> maps);
  template <typename AnyJoint>
  Defect plan(std::span<const AnyJoint> joints, std::span<const double> scales,
              std::span<const MapView<const float>> maps);
  bool collect(const std::atomic<bool>* stop);
  template <typename Map>
  static bool find_best_root(const std::vector<Map>& maps, int& layer, int& x, int& y);
  bool backtrack(int layer, int x, int y);
  Defect no_placement() const;
  template <typename Placement>
  void take_found(Placement& placement) const {
    static_cast<PartPlacement&>(placement) = found_;
    if constexpr (requires { placement.layers; }) placement.layers = layer_of_;
  }

  std::vector<Part> parts_;
  PartTree tree_;
  int layers_ = 0;       // 0 without a solution
  PartPlacement found_;  // by backtrack
  Eigen::VectorXi layer_of_;
  std::vector<MapView<const float>> sums_;  // of the root
  std::vector<MapView<float>> left_;        // of best_placements
  std::vector<std::vector<float>> candidates_;
  std::vector<float> upward_, others_, marginal_;  // of min_marginals
  DistanceTransform downward_;
  std::vector<int> path_;
};

template <typename AnyJoint>
Defect LayeredTree::find_defect(std::span<const AnyJoint> joints, std::span<const double> scales,
                                std::span<const MapView<const float>> maps) {
  constexpr bool kHasLayers = requires(const AnyJoint& joint) { joint.layer; };
  constexpr auto kMost = static_cast<std::size_t>(std::numeric_limits<int>::max());
  if (scales.empty()) return {"scales", Defect::kNoIndex, "are none"};
  for (std::size_t l = 0; l < scales.size(); ++l) {
    if (!(scales[l] >= 1e-3 && scales[l] <= 1e3))
      return {"scale", static_cast<int>(l), "is not between 1/1000 and 1000"};
  }
  if (maps.empty()) return {"maps", Defect::kNoIndex, "are none"};
  if (maps.size() > kMost) return {"maps", Defect::kNoIndex, "are more than can be counted"};
  if (maps.size() % scales.size() != 0)
    return {"maps", Defect::kNoIndex, "are not as many for each part as scales"};
  EnergyRange range;
  float least = 0;  // of the part
  for (std::size_t i = 0; i < maps.size(); ++i) {
    float of_map = 0;
    if (const char* problem = map_problem(maps[i], of_map)) return {"map", static_cast<int>(i), problem};
    const bool is_last = (i + 1) % scales.size() == 0;
    least = std::min(least, of_map);
    if (is_last) range.add_least(std::exchange(least, 0.0F));
    const MapView<const float>& first = maps[i / scales.size() * scales.size()];
    if (maps[i].width != first.width || maps[i].height != first.height)
      return {"map", static_cast<int>(i), "is not of the size of the part's first layer"};
  }
  if (range.is_below_floats()) return {"maps", Defect::kNoIndex, kBelowFloats};
  const std::size_t parts = maps.size() / scales.size();
  if (joints.size() + 1 != parts)
    return {"joints", Defect::kNoIndex,
            kHasLayers ? "are not one fewer than parts: no tree of all"
                       : "are not one fewer than maps: no tree of all"};
  for (std::size_t k = 0; k < joints.size(); ++k) {
    const auto number = static_cast<int>(k);
    if (const char* problem = joint_problem(joints[k], static_cast<int>(parts)))
      return {"joint", number, problem};
    if constexpr (kHasLayers) {
      if (joints[k].layer.problem() != nullptr)
        return {"joint", number, "has a cost of layers that is not valid"};
      for (const double scale : scales) {
        if (joints[k].cost.scaled(scale).problem() != nullptr)
          return {"joint", number, "has a cost that is out of range at one of the scales"};
      }
    }
  }
  return {};
}

template <typename AnyJoint>
Defect LayeredTree::plan(std::span<const AnyJoint> joints, std::span<const double> scales,
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
  for (const AnyJoint& joint : joints) {
    Part& child = part(joint.child);
    child.parent = joint.parent;
    if constexpr (requires { joint.layer; }) child.change = joint.layer;
    for (std::size_t l = 0; l < layers; ++l) child.layers[l].cost = joint.cost.scaled(scales[l]);
    part(joint.parent).is_leaf = false;
  }
  for (Part& one : parts_) {
    for (Layer& layer : one.layers) {
      if (!one.is_leaf || one.parent < 0) layer.sum = compact(layer.of_sum, layer.map);
      if (one.parent < 0) continue;
      layer.around = one.has_changes() ? compact(layer.of_around, layer.map) : layer.sum;
      const MapView<const float>& to = part(one.parent).layers[0].map;
      layer.transform.reserve(layer.map.width, layer.map.height, layer.cost, to.width, to.height);
    }
  }
  return {};
}

// Min-sum from the leaves to the root; false if it was stopped.
inline bool LayeredTree::collect(const std::atomic<bool>* stop) {
  for (Part& one : parts_) {
    if (is_set(stop)) return false;
    if (one.is_leaf && one.parent >= 0) continue;
    for (Layer& layer : one.layers) copy_map(layer.map, compact(layer.of_sum, layer.map));
  }
  for (std::size_t k = tree_.order.size(); k-- > 1;) {
    Part& child = part(tree_.order[k]);
    Part& parent = part(child.parent);
    for (int l = 0; l < layers_; ++l) {
      if (is_set(stop)) return false;
      Layer& layer = child.layers[static_cast<std::size_t>(l)];
      if (child.has_changes()) {
        const MapView<float> around = compact(layer.of_around, layer.map);
        std::fill_n(around.data, std::ptrdiff_t{around.width} * around.height,
                    std::numeric_limits<float>::infinity());
        for (int other = 0; other < layers_; ++other) {
          const MapView<const float>& sum = child.layers[static_cast<std::size_t>(other)].sum;
          const auto cost = static_cast<float>(
              std::min(child.change(other - l), double{std::numeric_limits<float>::max()}));
          for (int y = 0; y < sum.height; ++y) {
            float* const to = around.row(y);
            const float* const from = sum.row(y);
            for (int x = 0; x < sum.width; ++x) to[x] = std::min(to[x], from[x * sum.column_stride] + cost);
          }
        }
      }
      layer.transform.write<true>(
          layer.around, compact(parent.layers[static_cast<std::size_t>(l)].of_sum, parent.layers[0].map));
    }
  }
  return true;
}

template <typename Map>
bool LayeredTree::find_best_root(const std::vector<Map>& maps, int& layer, int& x, int& y) {
  float least = std::numeric_limits<float>::infinity();
  for (std::size_t l = 0; l < maps.size(); ++l) {
    int u = 0, v = 0;
    if (!find_least(maps[l], u, v) || !(maps[l](u, v) < least)) continue;
    least = maps[l](u, v);
    layer = static_cast<int>(l);
    x = u;
    y = v;
  }
  return least < std::numeric_limits<float>::infinity();
}

// The best placement with the root in a layer at (x, y); whether there is one.
inline bool LayeredTree::backtrack(int layer, int x, int y) {
  const auto count = static_cast<Eigen::Index>(parts_.size());
  if (found_.positions.cols() != count) found_.positions.resize(2, count);
  if (layer_of_.size() != count) layer_of_.resize(count);
  found_.energy = 0;
  for (const int i : tree_.order) {
    const Part& one = part(i);
    Eigen::Vector2i position(x, y);
    int of_part = layer;
    if (one.parent >= 0) {
      const Eigen::Vector2i at = found_.positions.col(one.parent);
      const int of_parent = layer_of_(one.parent);
      const Layer& from = one.layers[static_cast<std::size_t>(of_parent)];
      position = from.transform.best_place(from.around, from.cost, at.x(), at.y());
      if (position.x() < 0) return false;
      double least = std::numeric_limits<double>::infinity();
      for (int l = 0; l < layers_; ++l) {
        const double of_layer =
            one.change(l - of_parent) +
            static_cast<double>(one.layers[static_cast<std::size_t>(l)].sum(position.x(), position.y()));
        if (!(of_layer < least)) continue;
        least = of_layer;
        of_part = l;
      }
      if (!is_finite(least)) return false;
      const Eigen::Vector2i d = position - at;
      found_.energy += from.cost(d.x(), d.y()) + one.change(of_part - of_parent);
    }
    found_.positions.col(i) = position;
    layer_of_(i) = of_part;
    const MapView<const float>& map = one.layers[static_cast<std::size_t>(of_part)].map;
    found_.energy += static_cast<double>(map(position.x(), position.y()));
  }
  return is_finite(found_.energy);
}

inline Defect LayeredTree::no_placement() const {
  EnergyRange range;
  for (const Part& one : parts_) {
    for (const Layer& layer : one.layers) {
      range.add(layer.map);
      if (one.parent >= 0) range.add(layer.cost, part(one.parent).layers[0].map, layer.map);
    }
  }
  return range.no_placement();
}

inline Message LayeredTree::min_marginals(int of, const MapView<float>& result) {
  if (layers_ == 0) return "there is no solution";
  if (of < 0 || of >= static_cast<int>(parts_.size())) return Defect{"part", of, "is out of range"};
  const MapView<const float>& map = part(of).layers[0].map;
  if (result.empty() || result.width != map.width || result.height != map.height)
    return Defect{"result", Defect::kNoIndex, "is not of the size of the part's map"};
  Message message;
  const auto work = [&] {
    path_.clear();
    for (int i = of; i != tree_.root(); i = part(i).parent) path_.push_back(i);
    MapView<const float> marginal = root_min_marginals(0);
    for (std::size_t k = path_.size(); k-- > 0;) {
      Layer& child = part(path_[k]).layers[0];
      // What the parent's marginals are without the child, and for the child.
      const MapView<float> upward = compact(upward_, marginal), others = compact(others_, marginal);
      child.transform.write<false>(child.sum, upward);
      copy_map(marginal, others);
      for_each_pixel(MapView<const float>(upward), others, [](float message_of_child, float& without) {
        if (without < std::numeric_limits<float>::infinity()) without -= message_of_child;
      });
      const MapView<float> own = compact(marginal_, child.map);
      copy_map(child.sum, own);
      downward_.reserve(others.width, others.height, child.cost.reversed(), own.width, own.height);
      downward_.write<true>(others, own);
      marginal = own;
    }
    copy_map(marginal, result);
  };
  attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) { message = memory_message(error); });
  return message;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
