#pragma once

#include <array>
#include <asterism/solver/graph/rules.hpp>
#include <atomic>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

inline constexpr std::string_view kNoRoom =
    "no places were found that keep to all rules: an order in a circle, or no room between given coordinates";

/// Points that are moved so that they keep to rules.
class RuledPoints {
 public:
  /// Point k is node order[k] of the rules, or node k if `order` is empty.
  RuledPoints(int dim, int count, const DrawingRules& rules, std::span<const int> order = {});

  /// What is wrong with the rules; empty if nothing is.
  const std::string& error() const { return error_; }
  bool is_fixed(int point, int axis) const;
  /// Moves what is given or aligned to its place.
  void snap(std::vector<double>& x);
  /// One pass, which moves apart what is too near. Whether something was.
  bool push(std::vector<double>& x);
  /// Passes until all rules hold, `most` at most; then the sweeps, if they do not and `stop` is not set.
  /// False if there is no room.
  bool finish(std::vector<double>& x, int most, const std::atomic<bool>* stop, int& passes);
  /// Whether all rules hold.
  bool keeps(const std::vector<double>& x);

 private:
  /// Whether all rules hold after load, with the pad between boxes.
  bool holds(const std::vector<double>& x) const;

  /// Boxes none of which may overlap: single points, or groups.
  struct Level {
    std::vector<std::vector<int>> members;                   // the points of each box
    std::vector<std::array<std::vector<int>, 3>> variables;  // of each box along each axis, each once
  };
  struct Box {
    std::array<double, 2> centre, half;
  };
  /// Coordinates along an axis that move together, those of a box at least.
  struct Units {
    std::vector<int> of_box;
    std::vector<double> value;
    std::vector<char> is_fixed;
    std::vector<double> mass;
  };
  struct Constraint {
    int before, after;  // units
    double gap;
  };
  using Axes = std::array<Units, 3>;

  std::string wrong_with(const DrawingRules& rules, std::size_t count) const;
  void add_level(std::vector<std::vector<int>> members);
  int variable(int point, int axis) const;
  double inverse_mass(const Level& level, std::size_t box, int axis) const;
  void load(const std::vector<double>& x);
  void store(std::vector<double>& x) const;
  std::vector<Box> boxes_of(const Level& level) const;
  void move(const Level& level, std::size_t box, int axis, double by);
  bool push_boxes(const Level& level);
  bool are_apart(const Level& level) const;

  bool enforce(std::vector<double>& x);
  bool enforce(const Level& level, const std::vector<int>& box_of);
  Axes units_of(const Level& level, const std::vector<Box>& boxes) const;
  bool arrange(Axes& axes, const std::vector<Box>& boxes, const std::array<std::vector<Constraint>, 3>& asked,
               int last) const;
  void add_overlaps(std::vector<Constraint>& to, const Axes& axes, const std::vector<Box>& boxes,
                    int along) const;
  bool add_neighbours(std::vector<Constraint>& to, const Axes& axes, const std::vector<Box>& boxes,
                      int along) const;
  bool settle(int axis, Units& units, std::vector<Constraint> constraints) const;

  int dim_, count_;
  std::string error_;
  bool has_boxes_ = false;
  std::vector<double> half_;  // 2 for each point
  std::vector<Separation> separations_;
  std::array<std::vector<int>, 3> variable_;       // of each point: the first one that is aligned with it
  std::array<std::vector<double>, 3> fixed_;       // of each variable; NaN
  std::array<std::vector<int>, 3> points_;         // of each variable: how many
  std::array<std::vector<double>, 3> coordinate_;  // of each variable
  std::vector<Level> levels_;             // those of the points of each group, and last the outer one
  std::vector<std::vector<int>> box_of_;  // of each level: the box of a point, -1
  double pad_ = 0;                        // between boxes, so that rounding cannot make them overlap
  std::array<double, 3> pads_{};  // the same along each axis; 0 where is_tight_ and coordinates are given
  bool is_tight_ = false;
  bool is_reversed_ = false;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
