#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <cstddef>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// A tree of parts by its joints, each of which has a parent and a child.
struct PartTree {
  std::vector<int> joint_of;  ///< for each part, the joint to its parent; -1 for the root
  std::vector<int> order;     ///< all parts, parents before children
  std::vector<int> first_of;  ///< for each part, the first joint of which it is the parent; -1 for none
  std::vector<int> next_of;   ///< for each joint, the next one of the same parent; -1 for none

  int root() const { return order[0]; }

  /// For joints whose ends are different parts, in range, one joint fewer than parts: what is wrong with the
  /// tree. Allocates what it needs.
  template <typename Joint>
  Defect plan(std::span<const Joint> joints, int parts) {
    joint_of.assign(static_cast<std::size_t>(parts), -1);
    first_of.assign(static_cast<std::size_t>(parts), -1);
    next_of.resize(joints.size());
    for (std::size_t k = 0; k < joints.size(); ++k) {
      int& of_child = joint_of[static_cast<std::size_t>(joints[k].child)];
      if (of_child >= 0) return {"joint", static_cast<int>(k), "gives its child a second parent"};
      of_child = static_cast<int>(k);
    }
    for (std::size_t k = joints.size(); k-- > 0;) {
      int& first = first_of[static_cast<std::size_t>(joints[k].parent)];
      next_of[k] = first;
      first = static_cast<int>(k);
    }
    // As many joints as children: exactly one part is no child. The parts that it does not reach are a cycle.
    order.clear();
    order.reserve(joint_of.size());
    order.push_back(static_cast<int>(std::find(joint_of.begin(), joint_of.end(), -1) - joint_of.begin()));
    for (std::size_t next = 0; next < order.size(); ++next) {
      for (int k = first_of[static_cast<std::size_t>(order[next])]; k >= 0;) {
        order.push_back(joints[static_cast<std::size_t>(k)].child);
        k = next_of[static_cast<std::size_t>(k)];
      }
    }
    if (order.size() == joint_of.size()) return {};
    for (const int reached : order) joint_of[static_cast<std::size_t>(reached)] = -1;
    const auto left = std::find_if(joints.begin(), joints.end(), [this](const Joint& joint) {
      return joint_of[static_cast<std::size_t>(joint.child)] >= 0;
    });
    return {"joint", static_cast<int>(left - joints.begin()), "is part of a cycle or hangs on one"};
  }
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
