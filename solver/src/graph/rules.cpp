#include <algorithm>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/graph/rules.hpp>
#include <cmath>
#include <limits>
#include <map>
#include <new>
#include <numeric>
#include <set>
#include <utility>

#include "ruled_points.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

constexpr double kMargin = 0.01;  // of a gap, which passes leave, so that they end
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::size_t at(int index) { return static_cast<std::size_t>(index); }

std::string name(int node) { return "node " + std::to_string(node); }

/// The boxes by ascending lower edges.
template <typename Boxes>
std::vector<int> by_edges(const Boxes& boxes, std::size_t axis) {
  std::vector<int> order(boxes.size());
  std::iota(order.begin(), order.end(), 0);
  std::vector<double> edge;
  for (const auto& box : boxes) edge.push_back(box.centre[axis] - box.half[axis]);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return edge[at(a)] < edge[at(b)]; });
  return order;
}

}  // namespace

RuledPoints::RuledPoints(int dim, int count, const DrawingRules& rules, std::span<const int> order)
    : dim_(dim), count_(count), error_(wrong_with(rules, at(count))) {
  if (!error_.empty()) return;
  const auto node = [&](int point) { return order.empty() ? point : order[at(point)]; };
  std::vector<int> point_of(at(count));
  for (int k = 0; k < count; ++k) point_of[at(node(k))] = k;
  for (const Separation& rule : rules.separations)
    separations_.push_back({point_of[at(rule.before)], point_of[at(rule.after)], rule.axis, rule.gap});
  for (int axis = 0; axis < dim; ++axis) {
    std::map<int, int> first;
    std::vector<int>& variable = variable_[at(axis)];
    std::vector<double>& fixed = fixed_[at(axis)];
    fixed.assign(at(count), kNaN);
    points_[at(axis)].assign(at(count), 0);
    for (int k = 0; k < count; ++k) {
      const std::size_t entry = at(node(k) * dim + axis);
      const int number = rules.aligned.empty() ? -1 : rules.aligned[entry];
      variable.push_back(number < 0 ? k : first.emplace(number, k).first->second);
      ++points_[at(axis)][at(variable.back())];
      if (rules.fixed.empty() || std::isnan(rules.fixed[entry])) continue;
      double& value = fixed[at(variable.back())];
      if (!std::isnan(value) && value != rules.fixed[entry])
        error_ = name(node(k)) + " is aligned with a node of another given coordinate";
      value = rules.fixed[entry];
    }
    coordinate_[at(axis)].assign(at(count), 0.0);
  }
  has_boxes_ = !rules.sizes.empty() || !rules.groups.empty();
  if (!has_boxes_) return;
  for (int k = 0; k < count; ++k) {
    for (std::size_t c = 0; c < 2; ++c)
      half_.push_back(rules.sizes.empty() ? 0 : rules.sizes[at(node(k)) * 2 + c] / 2);
  }
  std::map<int, std::vector<int>> groups;
  std::vector<std::vector<int>> outer;
  for (int k = 0; k < count; ++k) {
    const int group = rules.groups.empty() ? -1 : rules.groups[at(node(k))];
    if (group >= 0) {
      groups[group].push_back(k);
    } else {
      outer.push_back({k});
    }
  }
  for (auto& [group, members] : groups) {
    if (!rules.sizes.empty()) {
      std::vector<std::vector<int>> single;
      for (const int k : members) single.push_back({k});
      add_level(std::move(single));
    }
    outer.push_back(std::move(members));
  }
  add_level(std::move(outer));
  for (int axis = 0; axis < 2; ++axis) {
    for (int k = 0; k < count; ++k) {
      const std::vector<std::vector<int>>& members = levels_.back().members;
      const int box = box_of_.back()[at(k)], other = box_of_.back()[at(variable(k, axis))];
      if (box != other && (members[at(box)].size() > 1 || members[at(other)].size() > 1))
        error_ = name(node(k)) + " is aligned with a node that is not in its group";
    }
  }
}

std::string RuledPoints::wrong_with(const DrawingRules& rules, std::size_t count) const {
  const std::size_t dim = at(dim_);
  if (dim_ < 2 || dim_ > 3) return "the dimension is not 2 or 3";
  if ((!rules.sizes.empty() || !rules.groups.empty()) && dim_ != 2)
    return "boxes and groups are only for the plane";
  if ((!rules.sizes.empty() && rules.sizes.size() != 2 * count) ||
      (!rules.fixed.empty() && rules.fixed.size() != dim * count) ||
      (!rules.aligned.empty() && rules.aligned.size() != dim * count) ||
      (!rules.groups.empty() && rules.groups.size() != count))
    return "expected values for each node";
  for (const double size : rules.sizes) {
    if (!(size >= 0 && std::isfinite(size))) return "a size is not >= 0 and finite";
  }
  for (const double value : rules.fixed) {
    if (std::isinf(value)) return "a given coordinate is infinite";
  }
  for (const Separation& rule : rules.separations) {
    const bool are_nodes =
        rule.before >= 0 && rule.after >= 0 && at(rule.before) < count && at(rule.after) < count;
    if (!are_nodes || rule.axis < 0 || rule.axis >= dim_)
      return "an order names a node or an axis that does not exist";
    if (rule.before == rule.after) return name(rule.before) + " is to be after itself";
    if (!(rule.gap >= 0 && std::isfinite(rule.gap))) return "the gap of an order is not >= 0 and finite";
  }
  return {};
}

void RuledPoints::add_level(std::vector<std::vector<int>> members) {
  Level level;
  std::vector<int> box_of(at(count_), -1);
  for (std::size_t box = 0; box < members.size(); ++box) {
    std::array<std::vector<int>, 3> variables;
    for (const int point : members[box]) {
      box_of[at(point)] = static_cast<int>(box);
      for (int axis = 0; axis < dim_; ++axis) variables[at(axis)].push_back(variable(point, axis));
    }
    for (std::vector<int>& some : variables) {
      std::sort(some.begin(), some.end());
      some.erase(std::unique(some.begin(), some.end()), some.end());
    }
    level.variables.push_back(std::move(variables));
  }
  level.members = std::move(members);
  levels_.push_back(std::move(level));
  box_of_.push_back(std::move(box_of));
}

int RuledPoints::variable(int point, int axis) const { return variable_[at(axis)][at(point)]; }

bool RuledPoints::is_fixed(int point, int axis) const {
  return !std::isnan(fixed_[at(axis)][at(variable(point, axis))]);
}

void RuledPoints::load(const std::vector<double>& x) {
  double largest = 0;
  for (int axis = 0; axis < dim_; ++axis) {
    std::vector<double>& values = coordinate_[at(axis)];
    std::fill(values.begin(), values.end(), 0.0);
    for (int k = 0; k < count_; ++k) {
      const std::size_t v = at(variable(k, axis));
      values[v] += x[at(k * dim_ + axis)] / points_[at(axis)][v];
    }
    for (std::size_t v = 0; v < values.size(); ++v) {
      if (!std::isnan(fixed_[at(axis)][v])) values[v] = fixed_[at(axis)][v];
      largest = std::max(largest, std::abs(values[v]));
    }
  }
  for (const double half : half_) largest = std::max(largest, half);
  for (const Separation& rule : separations_) largest = std::max(largest, rule.gap);
  pad_ = 1e-11 * largest;
  for (std::size_t c = 0; c < 3; ++c) {
    const bool is_free =
        std::all_of(fixed_[c].begin(), fixed_[c].end(), [](double v) { return std::isnan(v); });
    pads_[c] = is_tight_ && !is_free ? 0 : pad_;
  }
}

void RuledPoints::store(std::vector<double>& x) const {
  for (int k = 0; k < count_; ++k) {
    for (int axis = 0; axis < dim_; ++axis)
      x[at(k * dim_ + axis)] = coordinate_[at(axis)][at(variable(k, axis))];
  }
}

std::vector<RuledPoints::Box> RuledPoints::boxes_of(const Level& level) const {
  std::vector<Box> boxes(level.members.size());
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    for (std::size_t c = 0; c < 2; ++c) {
      const std::vector<int>& members = level.members[b];
      const auto middle = [&](int point) { return coordinate_[c][at(variable_[c][at(point)])]; };
      if (members.size() == 1) {
        boxes[b].centre[c] = middle(members[0]);
        boxes[b].half[c] = half_[at(members[0]) * 2 + c];
        continue;
      }
      double least = std::numeric_limits<double>::infinity(), largest = -least;
      for (const int point : members) {
        least = std::min(least, middle(point) - half_[at(point) * 2 + c]);
        largest = std::max(largest, middle(point) + half_[at(point) * 2 + c]);
      }
      boxes[b].centre[c] = least / 2 + largest / 2;
      boxes[b].half[c] = largest / 2 - least / 2;
    }
  }
  return boxes;
}

/// 0 if the box is held along the axis.
double RuledPoints::inverse_mass(const Level& level, std::size_t box, int axis) const {
  for (const int v : level.variables[box][at(axis)]) {
    if (!std::isnan(fixed_[at(axis)][at(v)])) return 0;
  }
  const std::vector<int>& members = level.members[box];
  if (members.size() > 1) return 1 / static_cast<double>(members.size());
  return 1.0 / points_[at(axis)][at(variable(members[0], axis))];
}

void RuledPoints::move(const Level& level, std::size_t box, int axis, double by) {
  if (by == 0) return;
  for (const int v : level.variables[box][at(axis)]) coordinate_[at(axis)][at(v)] += by;
}

void RuledPoints::snap(std::vector<double>& x) {
  load(x);
  store(x);
}

bool RuledPoints::push(std::vector<double>& x) {
  load(x);
  bool was_near = false;
  for (const Separation& rule : separations_) {
    std::vector<double>& values = coordinate_[at(rule.axis)];
    const std::size_t a = at(variable(rule.before, rule.axis)), b = at(variable(rule.after, rule.axis));
    const double distance = values[b] - values[a];
    if (distance < rule.gap) was_near = true;
    const double missing = rule.gap * (1 + kMargin) - distance;
    const double of_a = is_fixed(rule.before, rule.axis) ? 0 : 1.0 / points_[at(rule.axis)][a];
    const double of_b = is_fixed(rule.after, rule.axis) ? 0 : 1.0 / points_[at(rule.axis)][b];
    if (missing <= 0 || of_a + of_b == 0) continue;
    values[a] -= missing * of_a / (of_a + of_b);
    values[b] += missing * of_b / (of_a + of_b);
  }
  for (const Level& level : levels_) was_near = push_boxes(level) || was_near;
  is_reversed_ = !is_reversed_;
  store(x);
  return was_near;
}

bool RuledPoints::push_boxes(const Level& level) {
  std::vector<Box> boxes = boxes_of(level);
  std::vector<std::array<double, 2>> inverse(boxes.size());
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    for (std::size_t c = 0; c < 2; ++c) inverse[b][c] = inverse_mass(level, b, static_cast<int>(c));
  }
  const std::vector<int> order = by_edges(boxes, 0);
  std::vector<double> edges;
  for (const int b : order) edges.push_back(boxes[at(b)].centre[0] - boxes[at(b)].half[0]);
  bool was_near = false;
  for (std::size_t t = 0; t < order.size(); ++t) {
    const std::size_t k = is_reversed_ ? order.size() - 1 - t : t;
    const std::size_t a = at(order[k]);
    for (std::size_t m = k + 1; m < order.size(); ++m) {
      if (edges[m] >= boxes[a].centre[0] + boxes[a].half[0]) break;
      const std::size_t b = at(order[m]);
      std::array<double, 2> missing;
      bool overlap = true, are_near = true;
      for (std::size_t c = 0; c < 2; ++c) {
        const double gap = boxes[a].half[c] + boxes[b].half[c];
        const double distance = std::abs(boxes[b].centre[c] - boxes[a].centre[c]);
        missing[c] = (1 + kMargin) * gap - distance;
        if (distance >= gap) overlap = false;
        if (missing[c] <= 0) are_near = false;
      }
      if (!are_near) continue;
      was_near = was_near || overlap;
      int axis = -1;  // in which less is missing, of those in which one of the two can move away
      for (int c = 0; c < 2; ++c) {
        if (inverse[a][at(c)] + inverse[b][at(c)] == 0) continue;
        if (level.variables[a][at(c)] == level.variables[b][at(c)]) continue;
        if (axis < 0 || missing[at(c)] < missing[at(axis)]) axis = c;
      }
      if (axis < 0) continue;
      const std::size_t c = at(axis);
      const double way = boxes[b].centre[c] < boxes[a].centre[c] ? -1 : 1;
      const double share = way * missing[c] / (inverse[a][c] + inverse[b][c]);
      for (const auto& [box, by] :
           {std::pair(a, -share * inverse[a][c]), std::pair(b, share * inverse[b][c])}) {
        boxes[box].centre[c] += by;
        move(level, box, axis, by);
      }
    }
  }
  return was_near;
}

bool RuledPoints::are_apart(const Level& level) const {
  const std::vector<Box> boxes = boxes_of(level);
  const std::vector<int> order = by_edges(boxes, 0);
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Box& a = boxes[at(order[k])];
    for (std::size_t m = k + 1; m < order.size(); ++m) {
      const Box& b = boxes[at(order[m])];
      if (b.centre[0] - b.half[0] >= a.centre[0] + a.half[0] + pad_) break;
      bool overlap = true;
      for (std::size_t c = 0; c < 2; ++c) {
        const int axis = static_cast<int>(c);
        const bool are_held =
            inverse_mass(level, at(order[k]), axis) == 0 && inverse_mass(level, at(order[m]), axis) == 0;
        if (std::abs(a.centre[c] - b.centre[c]) >= a.half[c] + b.half[c] + (are_held ? 0 : pads_[c] / 2))
          overlap = false;
      }
      if (overlap) return false;
    }
  }
  return true;
}

bool RuledPoints::holds(const std::vector<double>& x) const {
  for (int k = 0; k < count_; ++k) {
    for (int axis = 0; axis < dim_; ++axis) {
      if (x[at(k * dim_ + axis)] != coordinate_[at(axis)][at(variable(k, axis))]) return false;
    }
  }
  for (const Separation& rule : separations_) {
    const double distance = x[at(rule.after * dim_ + rule.axis)] - x[at(rule.before * dim_ + rule.axis)];
    const bool are_held = is_fixed(rule.before, rule.axis) && is_fixed(rule.after, rule.axis);
    if (!(distance >= rule.gap + (are_held ? 0 : pads_[at(rule.axis)] / 2))) return false;
  }
  return std::all_of(levels_.begin(), levels_.end(), [&](const Level& level) { return are_apart(level); });
}

bool RuledPoints::keeps(const std::vector<double>& x) {
  load(x);
  pad_ = 0;
  pads_.fill(0);
  return holds(x);
}

bool RuledPoints::finish(std::vector<double>& x, int most, const std::atomic<bool>* stop, int& passes) {
  passes = 0;
  load(x);
  store(x);
  if (holds(x)) return true;
  while (passes < most && !(stop != nullptr && *stop)) {
    ++passes;
    if (push(x)) continue;
    load(x);
    if (holds(x)) return true;
  }
  if ((stop != nullptr && *stop) || enforce(x)) return true;
  // Between given coordinates there may be just room enough, without the pad.
  is_tight_ = true;
  const bool is_done = enforce(x);
  is_tight_ = false;
  return is_done;
}

bool RuledPoints::enforce(std::vector<double>& x) {
  load(x);
  if (!has_boxes_) {
    Level level;  // of all points
    std::vector<int> box_of;
    levels_.clear();
    std::vector<std::vector<int>> single;
    for (int k = 0; k < count_; ++k) single.push_back({k});
    add_level(std::move(single));
    const bool is_done = enforce(levels_[0], box_of_[0]);
    levels_.clear();
    box_of_.clear();
    if (!is_done) return false;
  }
  for (std::size_t l = 0; l < levels_.size(); ++l) {
    if (!enforce(levels_[l], box_of_[l])) return false;
  }
  store(x);
  load(x);
  return holds(x);
}

bool RuledPoints::enforce(const Level& level, const std::vector<int>& box_of) {
  const std::vector<Box> boxes = has_boxes_ ? boxes_of(level) : std::vector<Box>();
  const Axes before = units_of(level, boxes);
  std::array<std::vector<Constraint>, 3> asked;
  for (const Separation& rule : separations_) {
    const std::size_t c = at(rule.axis);
    const int a = box_of[at(rule.before)], b = box_of[at(rule.after)];
    if (a < 0 || b < 0 || a == b) continue;  // of another level
    const Units& units = before[c];
    const int from = units.of_box[at(a)], to = units.of_box[at(b)];
    const auto offset = [&](int point, int unit) {
      return coordinate_[c][at(variable(point, rule.axis))] - units.value[at(unit)];
    };
    if (from == to) {
      if (rule.gap > 0) return false;
      continue;
    }
    asked[c].push_back({from, to, rule.gap + offset(rule.before, from) - offset(rule.after, to)});
  }
  double least = std::numeric_limits<double>::infinity();
  Axes best;
  for (int last = has_boxes_ ? 1 : 0; last >= 0; --last) {
    Axes axes = before;
    if (!arrange(axes, boxes, asked, last)) continue;
    double moved = 0;
    for (int axis = 0; axis < dim_; ++axis) {
      const Units &from = before[at(axis)], &to = axes[at(axis)];
      for (std::size_t u = 0; u < from.value.size(); ++u)
        moved += from.mass[u] * std::pow(to.value[u] - from.value[u], 2);
    }
    if (!(moved < least)) continue;
    least = moved;
    best = std::move(axes);
  }
  if (!std::isfinite(least)) return false;
  for (int axis = 0; axis < dim_; ++axis) {
    const Units& units = best[at(axis)];
    for (std::size_t b = 0; b < level.members.size(); ++b) {
      const std::size_t u = at(units.of_box[b]);
      if (units.is_fixed[u] != 0) continue;
      if (level.members[b].size() > 1) {
        move(level, b, axis, units.value[u] - before[at(axis)].value[u]);
      } else {
        coordinate_[at(axis)][at(variable(level.members[b][0], axis))] = units.value[u];
      }
    }
  }
  return true;
}

RuledPoints::Axes RuledPoints::units_of(const Level& level, const std::vector<Box>& boxes) const {
  Axes axes;
  for (int axis = 0; axis < dim_; ++axis) {
    Units& units = axes[at(axis)];
    std::vector<int> of_variable(at(count_), -1);
    for (std::size_t b = 0; b < level.members.size(); ++b) {
      const bool is_single = level.members[b].size() == 1;
      const int v = variable(level.members[b][0], axis);
      const double inverse = inverse_mass(level, b, axis);
      if (is_single && of_variable[at(v)] >= 0) {
        units.of_box.push_back(of_variable[at(v)]);
        continue;
      }
      const int unit = static_cast<int>(units.value.size());
      if (is_single) of_variable[at(v)] = unit;
      units.of_box.push_back(unit);
      units.value.push_back(is_single ? coordinate_[at(axis)][at(v)] : boxes[b].centre[at(axis)]);
      units.is_fixed.push_back(inverse == 0 ? 1 : 0);
      units.mass.push_back(inverse == 0 ? 0 : 1 / inverse);
    }
  }
  return axes;
}

bool RuledPoints::arrange(Axes& axes, const std::vector<Box>& boxes,
                          const std::array<std::vector<Constraint>, 3>& asked, int last) const {
  for (int axis = 0; axis < dim_; ++axis) {
    if (!settle(axis, axes[at(axis)], asked[at(axis)])) return false;
  }
  if (!has_boxes_) return true;
  const int first = 1 - last;
  std::vector<Constraint> constraints = asked[at(first)];
  add_overlaps(constraints, axes, boxes, first);
  settle(first, axes[at(first)],
         std::move(constraints));  // what finds no room here gets it along the last one
  constraints = asked[at(last)];
  return add_neighbours(constraints, axes, boxes, last) &&
         settle(last, axes[at(last)], std::move(constraints));
}

/// The order along an axis of boxes that overlap there less than along the other one, or that cannot be moved
/// apart along the other one.
void RuledPoints::add_overlaps(std::vector<Constraint>& to, const Axes& axes, const std::vector<Box>& boxes,
                               int along) const {
  const std::size_t c = at(along), o = 1 - c;
  const Units &units = axes[c], &others = axes[o];
  std::vector<Box> moved = boxes;
  for (std::size_t b = 0; b < boxes.size(); ++b)
    moved[b].centre = {axes[0].value[at(axes[0].of_box[b])], axes[1].value[at(axes[1].of_box[b])]};
  const std::vector<int> order = by_edges(moved, o);
  for (std::size_t k = 0; k < order.size(); ++k) {
    const std::size_t a = at(order[k]);
    for (std::size_t m = k + 1; m < order.size(); ++m) {
      const std::size_t b = at(order[m]);
      const double across =
          moved[a].half[o] + moved[b].half[o] - std::abs(moved[b].centre[o] - moved[a].centre[o]);
      if (across <= 0) break;
      const std::size_t of_a = at(others.of_box[a]), of_b = at(others.of_box[b]);
      const bool is_stuck = of_a == of_b || (others.is_fixed[of_a] != 0 && others.is_fixed[of_b] != 0);
      const double gap = moved[a].half[c] + moved[b].half[c];
      const double distance = moved[b].centre[c] - moved[a].centre[c];
      const int from = units.of_box[a], unto = units.of_box[b];
      if (from == unto) continue;
      if (!is_stuck && (std::abs(distance) >= gap || gap - std::abs(distance) > across)) continue;
      const bool is_before = distance > 0 || (distance == 0 && a < b);
      to.push_back({is_before ? from : unto, is_before ? unto : from, gap});
    }
  }
}

/// The order along an axis of all boxes that overlap along the other one: of those that are neighbours at
/// some place of a scan line. False if two of them cannot be moved apart.
bool RuledPoints::add_neighbours(std::vector<Constraint>& to, const Axes& axes, const std::vector<Box>& boxes,
                                 int along) const {
  struct Event {
    double place;
    int box;
    bool is_end;
  };
  const std::size_t c = at(along), o = 1 - c;
  const auto centre = [&](std::size_t axis, int box) {
    return axes[axis].value[at(axes[axis].of_box[at(box)])];
  };
  std::vector<Event> events;
  // What are_apart, which asks for half of the pad, may call an overlap is one here, and what settle has
  // moved apart by the pad is none.
  const double margin = 0.375 * pads_[o];
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const int box = static_cast<int>(b);
    events.push_back({centre(o, box) - boxes[b].half[o] - margin, box, false});
    events.push_back({centre(o, box) + boxes[b].half[o] + margin, box, true});
  }
  std::sort(events.begin(), events.end(), [](const Event& a, const Event& b) {
    return a.place < b.place || (a.place == b.place && a.is_end && !b.is_end);
  });
  std::set<std::pair<double, int>> open;
  bool is_possible = true;
  const auto add = [&](int a, int b) {
    const int from = axes[c].of_box[at(a)], unto = axes[c].of_box[at(b)];
    if (from == unto) is_possible = false;
    to.push_back({from, unto, boxes[at(a)].half[c] + boxes[at(b)].half[c]});
  };
  for (const Event& event : events) {
    const std::pair<double, int> entry(centre(c, event.box), event.box);
    const auto place = event.is_end ? open.find(entry) : open.insert(entry).first;
    if (place == open.end()) return false;  // a box without an extent, of points whose unit is too large
    const auto next = std::next(place);
    if (!event.is_end) {
      if (place != open.begin()) add(std::prev(place)->second, event.box);
      if (next != open.end()) add(event.box, next->second);
    } else {
      if (place != open.begin() && next != open.end()) add(std::prev(place)->second, next->second);
      open.erase(place);
    }
  }
  return is_possible;
}

/// Moves the units as little as possible, nearly, so that the constraints hold; false if they cannot.
bool RuledPoints::settle(int axis, Units& units, std::vector<Constraint> constraints) const {
  const auto is_fixed = [&](int unit) { return units.is_fixed[at(unit)] != 0; };
  std::vector<double>& x = units.value;
  bool is_possible = true;
  std::erase_if(constraints, [&](const Constraint& each) {
    if (!is_fixed(each.before) || !is_fixed(each.after)) return false;
    if (!(x[at(each.after)] - x[at(each.before)] >= each.gap)) is_possible = false;
    return true;
  });
  if (!is_possible) return false;
  for (Constraint& each : constraints) each.gap += pads_[at(axis)];
  if (std::all_of(constraints.begin(), constraints.end(),
                  [&](const Constraint& each) { return x[at(each.after)] - x[at(each.before)] >= each.gap; }))
    return true;

  // A topological order of the constraints.
  const std::size_t n = x.size();
  std::vector<std::vector<int>> following(n);
  std::vector<int> missing(n, 0), ready, place(n, 0);
  for (std::size_t k = 0; k < constraints.size(); ++k) {
    following[at(constraints[k].before)].push_back(static_cast<int>(k));
    ++missing[at(constraints[k].after)];
  }
  for (std::size_t u = 0; u < n; ++u) {
    if (missing[u] == 0) ready.push_back(static_cast<int>(u));
  }
  for (std::size_t k = 0; k < ready.size(); ++k) {
    place[at(ready[k])] = static_cast<int>(k);
    for (const int each : following[at(ready[k])]) {
      const int after = constraints[at(each)].after;
      if (--missing[at(after)] == 0) ready.push_back(after);
    }
  }
  if (ready.size() < n) return false;  // a circle
  std::sort(constraints.begin(), constraints.end(), [&](const Constraint& a, const Constraint& b) {
    return place[at(a.before)] < place[at(b.before)];
  });

  // Where the units may be at all, between those that are fixed.
  std::vector<double> least(n, -std::numeric_limits<double>::infinity()), most(n, -least[0]);
  for (std::size_t u = 0; u < n; ++u) {
    if (units.is_fixed[u] != 0) least[u] = most[u] = x[u];
  }
  for (const Constraint& each : constraints) {
    double& bound = least[at(each.after)];
    bound = std::max(bound, least[at(each.before)] + each.gap);
  }
  for (std::size_t k = constraints.size(); k-- > 0;) {
    double& bound = most[at(constraints[k].before)];
    bound = std::min(bound, most[at(constraints[k].after)] - constraints[k].gap);
  }
  for (std::size_t u = 0; u < n; ++u) {
    if (least[u] > most[u] || (units.is_fixed[u] != 0 && (least[u] != x[u] || most[u] != x[u]))) return false;
  }

  // Hildreth's method (1957) goes to the nearest point.
  std::vector<double> pressure(constraints.size(), 0.0);
  constexpr int kPasses = 200;
  for (int pass = 0; pass < kPasses; ++pass) {
    double worst = 0;
    for (std::size_t k = 0; k < constraints.size(); ++k) {
      const Constraint& each = constraints[k];
      const std::size_t a = at(each.before), b = at(each.after);
      const double of_a = units.is_fixed[a] != 0 ? 0 : 1 / units.mass[a];
      const double of_b = units.is_fixed[b] != 0 ? 0 : 1 / units.mass[b];
      const double more = std::max(-pressure[k], (each.gap - (x[b] - x[a])) / (of_a + of_b));
      pressure[k] += more;
      x[a] -= more * of_a;
      x[b] += more * of_b;
      worst = std::max(worst, std::abs(more) * (of_a + of_b) / std::max(each.gap, pad_));
    }
    if (worst < 1e-4) break;
  }
  // What is left: halfway between the points that two sweeps find, as what is between two that are feasible
  // is feasible.
  std::vector<double> up(n), down(n);
  for (std::size_t u = 0; u < n; ++u) up[u] = down[u] = std::clamp(x[u], least[u], most[u]);
  for (const Constraint& each : constraints)
    up[at(each.after)] = std::max(up[at(each.after)], up[at(each.before)] + each.gap);
  for (std::size_t k = constraints.size(); k-- > 0;) {
    const Constraint& each = constraints[k];
    down[at(each.before)] = std::min(down[at(each.before)], down[at(each.after)] - each.gap);
  }
  for (std::size_t u = 0; u < n; ++u) {
    if (units.is_fixed[u] == 0) x[u] = up[u] / 2 + down[u] / 2;
  }
  return true;
}

Summary apply_rules(int dim, std::span<double> x, const DrawingRules& rules, const RuleOptions& options) {
  const detail::Stopwatch stopwatch;
  Summary summary;
  const auto work = [&] {
    RuledPoints points(dim, dim > 0 ? static_cast<int>(x.size() / at(dim)) : 0, rules);
    std::vector<double> moved(x.begin(), x.end());
    std::string error = points.error();
    if (dim > 0 && x.size() % at(dim) != 0) error = "expected dim coordinates for each point";
    if (!std::all_of(moved.begin(), moved.end(), [](double value) { return std::isfinite(value); }))
      error = "expected finite coordinates";
    if (error.empty() && points.keeps(moved)) {
      summary.iterations = 0;
    } else if (error.empty() && !points.finish(moved, options.passes, options.stop, summary.iterations)) {
      error = kNoRoom;
    }
    if (!error.empty()) {
      summary = detail::refused("rules", std::string_view(error));
      return;
    }
    const bool is_interrupted = options.stop != nullptr && *options.stop;
    if (!is_interrupted) std::copy(moved.begin(), moved.end(), x.begin());
    summary.status = is_interrupted ? Status::Interrupted : Status::Converged;
    summary.message = "";
  };
  detail::attempt<std::bad_alloc>(work, [&](const std::bad_alloc& error) {
    summary.status = Status::OutOfMemory;
    summary.message = detail::memory_message(error);
  });
  summary.solver = "rules";
  summary.seconds = stopwatch.seconds();
  return summary;
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
