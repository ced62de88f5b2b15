#include <algorithm>
#include <array>
#include <asterism/solver/ranges/locate.hpp>
#include <asterism/solver/ranges/path.hpp>
#include <cmath>
#include <iterator>
#include <numbers>
#include <numeric>
#include <utility>

#include "path_bound.hpp"
#include "path_chain.hpp"
#include "path_descent.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

const char* PathOptions::problem() const {
  const auto sigma = [](double s) { return s > 0 && !std::isnan(s); };
  if (!(cutoff > 0)) return "cutoff has to be > 0";
  if (!(turn_sigma >= 0 && std::isfinite(turn_sigma))) return "turn_sigma has to be a finite number >= 0";
  if (!(step_sigma > 0 && std::isfinite(step_sigma))) return "step_sigma has to be a finite number > 0";
  if (!(scale_sigma >= 0 && std::isfinite(scale_sigma))) return "scale_sigma has to be a finite number >= 0";
  if (!(shortest >= 0 && std::isfinite(shortest))) return "shortest has to be a finite number >= 0";
  if (!sigma(start_sigma[0]) || !sigma(start_sigma[1])) return "start_sigma has to be > 0";
  const auto nans = std::count_if(start.begin(), start.end(), [](double s) { return std::isnan(s); });
  if (nans != 0 && nans != 3) return "start has to be x, y and heading, or nothing";
  if (nans == 0 && !std::all_of(start.begin(), start.end(), [](double s) { return std::isfinite(s); }))
    return "start has to be finite";
  if (nans == 3 && (std::isfinite(start_sigma[0]) || std::isfinite(start_sigma[1])))
    return "start_sigma needs a start";
  if (max_iterations < 1) return "max_iterations has to be >= 1";
  return nullptr;
}

namespace {

using ranges::Complex;
using ranges::PathChain;
using ranges::PathRange;
using ranges::PathTerms;
using Point = PathChain<2>::Point;
using Block = PathChain<2>::Block;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Complex complex_of(const Point& p) { return {p[0], p[1]}; }

class PathSolver {
 public:
  PathSolver(const PathMeasurements& given, const PathOptions& options)
      : given_(given), options_(options), chain_(terms_), descent_(options.stop) {}

  PathEstimate run() {
    result_.status = Status::InvalidInput;
    if (!(read() && join())) return std::move(result_);
    attach();
    if (!determined()) return std::move(result_);
    search();
    settle_scale();
    if (!descent_.stopped()) finish();
    if (descent_.stopped()) {
      result_ = PathEstimate{};
      result_.status = Status::Interrupted;
      result_.message = "asked to stop";
    }
    return std::move(result_);
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  bool wrong(const char* what, std::size_t index, const char* problem) {
    result_.message.assign(what).append(" ").append(static_cast<int>(index)).append(" ").append(problem);
    return false;
  }
  bool wrong(const char* problem) {
    result_.message.assign(problem);
    return false;
  }

  bool read() {
    if (const char* problem = options_.problem()) return wrong(problem);
    const std::size_t count = given_.range.size();
    if (given_.steps.size() % 3 != 0) return wrong("steps have to be triples of numbers");
    if (given_.beacons.size() % 2 != 0) return wrong("beacons have to be pairs of numbers");
    if (given_.pose.size() != count || given_.beacon.size() != count || given_.sigma.size() != count)
      return wrong("pose, beacon, range and sigma have to be of the same length");
    steps_ = given_.steps.size() / 3;
    beacons_ = given_.beacons.size() / 2;
    if (steps_ == 0) return wrong("a path needs at least one step");
    for (std::size_t i = 0; i < given_.steps.size(); ++i)
      if (!(std::abs(given_.steps[i]) <= kLargest))
        return wrong("step", i / 3, "has a number that is not finite, or too large");
    for (std::size_t j = 0; j < beacons_; ++j) {
      const double x = given_.beacons[2 * j], y = given_.beacons[2 * j + 1];
      if (std::isnan(x) && std::isnan(y)) continue;
      if (!(std::abs(x) <= kLargest && std::abs(y) <= kLargest))
        return wrong("beacon", j, "has a coordinate that is not finite, or too large");
    }
    for (std::size_t i = 0; i < count; ++i) {
      const double r = given_.range[i], s = given_.sigma[i], pose = given_.pose[i];
      if (given_.beacon[i] < 0 || at(given_.beacon[i]) >= beacons_)
        return wrong("range", i, "is to a beacon that does not exist");
      if (!(pose >= 0 && pose <= static_cast<double>(steps_)))
        return wrong("range", i, "is from a pose that does not exist");
      if (std::isnan(r)) continue;
      if (!(r >= 0)) return wrong("range", i, "is negative");
      if (!(r <= kLargest)) return wrong("range", i, "is too large or infinite");
      if (!(s > 1 / kLargest && s <= kLargest))
        return wrong("sigma", i,
                     s > 0 && std::isfinite(s) ? "is too large or too small" : "is not a finite number > 0");
    }
    return true;
  }

  /// Dead reckoning, and which poses are nodes.
  bool join() {
    reckoned_.resize(steps_ + 1);
    turned_.resize(steps_ + 1);
    std::vector<double> lengths;
    for (std::size_t k = 0; k < steps_; ++k) {
      const double* s = &given_.steps[3 * k];
      reckoned_[k + 1] = reckoned_[k] + std::polar(1.0, turned_[k]) * Complex(s[0], s[1]);
      turned_[k + 1] = std::remainder(turned_[k] + s[2], 2 * std::numbers::pi);
      const double length = std::hypot(s[0], s[1]);
      if (length > 0) lengths.push_back(length);
    }
    double shortest = options_.shortest;
    if (shortest == 0 && !lengths.empty()) {
      const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
      std::nth_element(lengths.begin(), middle, lengths.end());
      shortest = *middle / 2;
    }
    nodes_ = {0};
    for (std::size_t k = 1; k <= steps_ && shortest > 0; ++k)
      if (std::abs(reckoned_[k] - reckoned_[nodes_.back()]) >= shortest) nodes_.push_back(k);
    if (nodes_.size() < 2)
      return wrong("the robot does not move: a path needs two positions, a single one is found by locate");
    for (std::size_t o = 0; o + 1 < nodes_.size(); ++o) {
      moves_.push_back(reckoned_[nodes_[o + 1]] - reckoned_[nodes_[o]]);
      terms_.length.push_back(std::abs(moves_[o]));
      if (o > 0) terms_.turn.push_back(moves_[o] / moves_[o - 1]);
    }
    return true;
  }

  /// Pose p (possibly between two) as a node and a complex number.
  std::pair<std::size_t, Complex> on_chain(double pose) const {
    const auto whole = std::min(static_cast<std::size_t>(pose), steps_);
    Complex place = reckoned_[whole];
    const double part = pose - static_cast<double>(whole);
    if (part > 0) place += part * (reckoned_[whole + 1] - reckoned_[whole]);
    const auto after = std::upper_bound(nodes_.begin(), nodes_.end(), whole);
    const auto o = std::min(static_cast<std::size_t>(after - nodes_.begin()) - 1, nodes_.size() - 2);
    if (part == 0 && nodes_[o] == whole) return {o, 0.0};
    if (part == 0 && nodes_[o + 1] == whole) return {o, 1.0};
    return {o, (place - reckoned_[nodes_[o]]) / moves_[o]};
  }

  void attach() {
    for (std::size_t i = 0; i < given_.range.size(); ++i) {
      if (std::isnan(given_.range[i])) continue;
      const auto [node, a] = on_chain(given_.pose[i]);
      const double s = given_.sigma[i];
      terms_.ranges.push_back({static_cast<int>(node), -1, a, known_place(at(given_.beacon[i])),
                               given_.range[i], 1 / (s * s), static_cast<int>(i)});
    }
    std::stable_sort(terms_.ranges.begin(), terms_.ranges.end(),
                     [](const PathRange& a, const PathRange& b) { return a.node < b.node; });
    // Those to beacons that have no place yet count nothing.
    for (PathRange& range : terms_.ranges)
      if (!is_known(beacon_of(range))) range.information = 0;
    unknown_.assign(beacons_, -1);
  }
  std::size_t beacon_of(const PathRange& range) const { return at(given_.beacon[at(range.index)]); }
  bool is_known(std::size_t j) const { return !std::isnan(given_.beacons[2 * j]); }
  Complex known_place(std::size_t j) const {
    return is_known(j) ? Complex(given_.beacons[2 * j], given_.beacons[2 * j + 1]) : Complex(0);
  }

  /// What the known beacons determine, and whether unknown ones have ranges enough.
  bool determined() {
    std::vector<int> count(beacons_, 0);
    for (const PathRange& range : terms_.ranges) ++count[beacon_of(range)];
    std::vector<Complex> places;
    for (std::size_t j = 0; j < beacons_; ++j) {
      if (count[j] == 0 && is_known(j)) continue;
      if (!is_known(j)) {
        if (count[j] < 2)
          return wrong("beacon", j, "has no place and fewer than two ranges, which do not determine it");
      } else if (std::find(places.begin(), places.end(), known_place(j)) == places.end()) {
        places.push_back(known_place(j));
      }
    }
    anchors_ = static_cast<int>(std::min<std::size_t>(places.size(), 2));
    result_.status = Status::NotRun;
    return true;
  }

  bool has_start() const { return !std::isnan(options_.start[0]); }

  /// The terms of the first pose: the user's, or of a frame where nothing else determines it.
  void set_start() {
    const Complex place = has_start() ? Complex(options_.start[0], options_.start[1]) : Complex(0);
    const double heading = has_start() ? options_.start[2] : 0;
    // The first step is in the frame of the first pose.
    const Complex first = std::polar(1.0, heading) * moves_[0];
    const double length = std::abs(first);
    terms_.start = place;
    terms_.first_step = first;
    if (std::isfinite(options_.start_sigma[0])) terms_.start_weight = std::pow(options_.start_sigma[0], -2);
    if (std::isfinite(options_.start_sigma[1]))
      terms_.heading_weight = std::pow(options_.start_sigma[1] * length, -2);
    const double stiff = 1e8 / (length * length);
    const bool held = anchors_ == 0 && terms_.start_weight == 0;
    if (anchors_ < 2 && terms_.heading_weight == 0) {
      const Eigen::Vector2d normal(-first.imag() / length, first.real() / length);
      Eigen::Vector4d n;
      n << -normal, normal;
      terms_.prior.hessian += stiff * n * n.transpose();
    }
    if (held) terms_.prior.hessian.topLeftCorner<2, 2>() += stiff * Eigen::Matrix2d::Identity();
    terms_.prior.place << place.real(), place.imag(), place.real() + first.real(),
        place.imag() + first.imag();
    if (anchors_ == 0) {
      result_.message = "the beacons do not determine where the path is: it starts at `start`";
    } else if (anchors_ == 1) {
      result_.message =
          "one known place does not determine the path's direction: it starts with that of `start`";
    }
  }

  /// The first two nodes of a path.
  using Start = std::array<Point, 2>;

  /// Where the user says the path begins, or where the ranges of the first stage fit: places that differ, the
  /// best first. Of a short stretch, or one that is nearly straight, they may fit its mirror image as well.
  std::vector<Start> starts(std::size_t stage) const {
    const Complex place = terms_.start, first = terms_.first_step;
    const std::vector<Start> given{{PathChain<2>::of(place), PathChain<2>::of(place + first)}};
    if (has_start() || anchors_ == 0) return given;
    // With a given heading, ranges to beacons from a rigid path are ranges to beacons that are shifted.
    std::vector<const PathRange*> used;
    for (const PathRange& range : terms_.ranges)
      if (at(range.node) + 1 < stage && is_known(beacon_of(range))) used.push_back(&range);
    thin(used, 60);
    const int headings = anchors_ == 1 ? 1 : kHeadings;
    std::vector<double> beacons(2 * used.size()), lengths, sigma;
    for (const PathRange* range : used) {
      lengths.push_back(range->length);
      sigma.push_back(std::max(given_.sigma[at(range->index)], 0.02 * range->length));
    }
    LocateOptions options;
    options.max_cells = 2000;
    options.within = 30;
    struct Candidate {
      double energy;
      int heading;
      Complex place;
    };
    std::vector<Candidate> candidates;
    for (int h = 0; h < headings; ++h) {
      const Complex turn = turned(h);
      for (std::size_t i = 0; i < used.size(); ++i) {
        const Complex shifted = used[i]->place - turn * place_on(*used[i]);
        beacons[2 * i] = shifted.real();
        beacons[2 * i + 1] = shifted.imag();
      }
      const PositionFix<2> fix = locate<2>(beacons, lengths, sigma, options);
      for (int m = 0; m < fix.count; ++m) {
        const Complex to(fix.minima[at(m)].x[0], fix.minima[at(m)].x[1]);
        double energy = 0;
        for (std::size_t i = 0; i < used.size(); ++i) {
          const double e = std::abs(to - Complex(beacons[2 * i], beacons[2 * i + 1])) - lengths[i];
          energy += ranges::range_energy(e, 1 / (sigma[i] * sigma[i]), options_.cutoff * options_.cutoff);
        }
        candidates.push_back({energy, h, to});
      }
    }
    // The least along the headings; a place moves by so much from one to the next.
    const double way = candidates.empty() ? 0 : 0.2 * *std::max_element(lengths.begin(), lengths.end());
    std::vector<Candidate> kept;
    std::copy_if(candidates.begin(), candidates.end(), std::back_inserter(kept), [&](const Candidate& one) {
      return std::none_of(candidates.begin(), candidates.end(), [&](const Candidate& other) {
        const int apart = std::abs(one.heading - other.heading);
        return other.energy < one.energy && std::min(apart, headings - apart) == 1 &&
               std::abs(one.place - other.place) < way;
      });
    });
    std::sort(kept.begin(), kept.end(),
              [](const Candidate& a, const Candidate& b) { return a.energy < b.energy; });
    if (kept.size() > kMostStarts) kept.resize(kMostStarts);
    if (kept.empty()) return given;
    std::vector<Start> result;
    for (const Candidate& one : kept)
      result.push_back(
          {PathChain<2>::of(one.place), PathChain<2>::of(one.place + turned(one.heading) * first)});
    return result;
  }
  static Complex turned(int heading) { return std::polar(1.0, 2 * std::numbers::pi * heading / kHeadings); }
  /// By dead reckoning from the origin.
  Complex place_on(const PathRange& range) const {
    const auto o = at(range.node);
    return reckoned_[nodes_[o]] + range.at * moves_[o];
  }
  template <typename T>
  static void thin(std::vector<T>& list, std::size_t most) {
    if (list.size() <= most) return;
    for (std::size_t i = 0; i < most; ++i) list[i] = list[i * list.size() / most];
    list.resize(most);
  }

  /// The ranges to a beacon from the path as it is.
  std::vector<std::size_t> ranges_to(std::size_t j) const {
    std::vector<std::size_t> used;
    for (std::size_t i = 0, count = chain_.range_count(); i < count; ++i)
      if (beacon_of(terms_.ranges[i]) == j) used.push_back(i);
    return used;
  }
  /// Where they say that it is, with minima up to so much above the least energy.
  PositionFix<2> place_of(std::size_t j, double within) const {
    std::vector<std::size_t> used = ranges_to(j);
    thin(used, 60);
    std::vector<double> places, lengths, sigma;
    for (const std::size_t i : used) {
      const PathRange& range = terms_.ranges[i];
      Point p = chain_.difference(range);
      p += range.beacon < 0 ? PathChain<2>::of(range.place) : chain_.beacons[at(range.beacon)];
      places.insert(places.end(), {p[0], p[1]});
      lengths.push_back(range.length);
      sigma.push_back(std::max(given_.sigma[at(range.index)], 0.02 * range.length));
    }
    LocateOptions options;
    options.max_cells = 2000;
    options.within = within;
    return locate<2>(places, lengths, sigma, options);
  }

  /// Gives places to beacons that have none, from the path as it is.
  void place_beacons(bool is_last) {
    for (std::size_t j = 0; j < beacons_; ++j) {
      if (is_known(j) || unknown_[j] >= 0) continue;
      const std::vector<std::size_t> used = ranges_to(j);
      if (used.size() < (is_last ? 2 : 8)) continue;
      const PositionFix<2> fix = place_of(j, 5);
      if (!is_last && (fix.count == 0 || (fix.count > 1 && fix.minima[1].weight > 0.02))) continue;
      Point place = chain_.x[at(terms_.ranges[used[0]].node)];
      if (fix.count > 0)
        place << fix.minima[0].x[0], fix.minima[0].x[1];
      else
        place[0] += terms_.ranges[used[0]].length;
      unknown_[j] = static_cast<int>(chain_.beacons.size());
      chain_.beacons.push_back(place);
      for (PathRange& range : terms_.ranges) {
        if (beacon_of(range) != j) continue;
        range.beacon = unknown_[j];
        range.information = std::pow(given_.sigma[at(range.index)], -2);
      }
    }
  }

  void extend(std::size_t nodes) {
    while (chain_.x.size() < nodes) {
      const std::size_t k = chain_.x.size();
      chain_.x.push_back(chain_.x[k - 1] +
                         PathChain<2>::times(terms_.turn[k - 2], chain_.x[k - 1] - chain_.x[k - 2]));
    }
  }

  /// A path as far as it was found.
  struct Path {
    std::vector<Point> x, beacons;
    std::vector<int> unknown;
    std::vector<PathRange> ranges;
    double turn_sigma = 0, scale = 1, evidence = -kInfinity;
    bool converged = false;
  };
  Path path() const {
    return {chain_.x,          chain_.beacons, unknown_,   terms_.ranges,
            terms_.turn_sigma, chain_.scale,   -kInfinity, converged_};
  }
  void set_path(const Path& path) {
    chain_.x = path.x;
    chain_.beacons = path.beacons;
    unknown_ = path.unknown;
    terms_.ranges = path.ranges;
    terms_.turn_sigma = path.turn_sigma;
    chain_.scale = path.scale;
    converged_ = path.converged;
  }

  /// The path of the greatest evidence, of those from several starts.
  void search() {
    const std::size_t nodes = nodes_.size();
    bound_ = options_.cutoff * options_.cutoff;
    terms_.turn_sigma = options_.turn_sigma > 0 ? options_.turn_sigma : kUsualSigma;
    terms_.step_sigma = options_.step_sigma;
    if (options_.scale_sigma > 0) terms_.scale_weight = std::min(std::pow(options_.scale_sigma, -2), 1e30);
    set_start();
    // As long as it takes to hear something.
    std::size_t stage = std::min<std::size_t>(nodes, 128);
    if (terms_.ranges.size() > 24) stage = std::max(stage, at(terms_.ranges[24].node) + 2);
    stage = std::min(stage, nodes);
    const std::vector<Start> starts = this->starts(stage);
    Path fresh = path(), best;
    std::vector<double> least;  // energy of each stage
    for (const Start& start : starts) {
      fresh.x.assign(start.begin(), start.end());
      set_path(fresh);
      const bool is_whole = grow(stage, least);
      if (descent_.stopped()) return;
      if (starts.size() == 1) return;
      if (!is_whole) continue;
      Path found = path();
      if (factorize()) found.evidence = evidence();
      if (best.x.empty() || found.evidence > best.evidence) best = std::move(found);
    }
    set_path(best);
  }

  /// The path from its beginning, twice as long in each stage. Returns false if it ends after one that has
  /// far more energy than the least.
  bool grow(std::size_t stage, std::vector<double>& least) {
    const std::size_t nodes = nodes_.size();
    for (std::size_t number = 0;; ++number) {
      const bool is_last = stage == nodes;
      extend(stage);
      place_beacons(is_last);
      descent_.graduate(chain_, terms_, bound_);
      converged_ = descent_.run(chain_, bound_, options_.max_iterations);
      const double energy = chain_.energy(bound_);
      if (number == least.size()) {
        least.push_back(energy);
      } else if (std::abs(energy - least[number]) < 1e-9 * (1 + energy) ||
                 (!is_last && energy > least[number] + 30)) {
        return false;
      }
      least[number] = std::min(least[number], energy);
      if (is_last || stage <= kEarly) move_beacons(stage <= kEarly);
      estimate_turn_sigma(is_last ? 40 : 3);
      if (is_last || descent_.stopped()) return true;
      stage = std::min(nodes, 2 * stage);
    }
  }

  /// Unknown beacons go to other places if the whole path has less energy then: each to those that its ranges
  /// allow and, as long as the path is short, each and all to the other side of it, since its first stretch
  /// may be straight.
  void move_beacons(bool to_other_side) {
    if (chain_.beacons.empty()) return;
    std::vector<Point> places = chain_.beacons;
    for (Point& place : places) place = beyond_path(place);
    if (to_other_side) move_beacons_to(places);
    for (std::size_t j = 0; j < beacons_; ++j) {
      if (unknown_[j] < 0) continue;
      const auto place = at(unknown_[j]);
      const PositionFix<2> fix = place_of(j, 30);
      for (int m = 0; m < std::min(fix.count, 3); ++m) {
        const auto& minimum = fix.minima[at(m)];
        places = chain_.beacons;
        const Point to(minimum.x[0], minimum.x[1]);
        if ((to - places[place]).squaredNorm() < 16 * (minimum.covariance[0] + minimum.covariance[3]))
          continue;
        places[place] = to;
        move_beacons_to(places);
      }
      if (!to_other_side) continue;
      places = chain_.beacons;
      places[place] = beyond_path(places[place]);
      move_beacons_to(places);
    }
  }
  void move_beacons_to(const std::vector<Point>& places) {
    if (descent_.stopped()) return;
    const Path before = path();
    const double energy = chain_.energy(bound_);
    chain_.beacons = places;
    descent_.graduate(chain_, terms_, bound_);
    converged_ = descent_.run(chain_, bound_, options_.max_iterations);
    if (!(chain_.energy(bound_) < energy - 1e-6 * (1 + energy))) set_path(before);
  }
  /// The mirror image of a point, about the line along which the path is longest.
  Point beyond_path(const Point& point) const {
    Point middle = Point::Zero();
    for (const Point& p : chain_.x) middle += p / static_cast<double>(chain_.nodes());
    Complex twice = 0;  // the angle of the line
    for (const Point& p : chain_.x) twice += std::pow(complex_of(p - middle), 2);
    const double size = std::abs(twice);
    const Complex turn = size > 0 ? twice / size : 1.0, to = turn * std::conj(complex_of(point - middle));
    return middle + PathChain<2>::of(to);
  }

  double evidence() const {
    const auto n = static_cast<double>(nodes_.size());
    const double of_scale = chain_.has_scale() ? 0.5 * std::log(terms_.scale_weight) : 0;
    return of_scale - chain_.energy(bound_) - 0.5 * chain_.log_determinant() -
           2 * (n - 2) * std::log(terms_.turn_sigma);
  }

  /// MacKay's update (Neural Computation 4(3), 1992): the variance of residuals is the sum of their squares
  /// divided by how many of them the data determine. It stands still at the greatest posterior density of the
  /// logarithm, for a prior density of s exp(-2 s / kUsualSigma). The evidence alone of few ranges is often
  /// flat towards 0: the odometry would be exact, and the path's regions far too small (Chung et al.,
  /// Psychometrika 78(4), 2013).
  void estimate_turn_sigma(int rounds) {
    if (options_.turn_sigma > 0 || chain_.nodes() < 4) return;
    for (int i = 0; i < rounds && !descent_.stopped(); ++i) {
      if (!factorize()) return;
      chain_.invert(inverse_);
      const double ratio = turn_ratio();
      terms_.turn_sigma = std::clamp(terms_.turn_sigma * ratio, kLeastSigma, 1.0);
      converged_ = descent_.run(chain_, bound_, options_.max_iterations);
      if (std::abs(std::log(ratio)) < 2e-3) return;
    }
  }

  /// By what turn_sigma is to be multiplied.
  double turn_ratio() const {
    double squares = 0, determined = 0;
    const std::size_t nodes = chain_.nodes();
    for (std::size_t k = 0; k + 2 < nodes; ++k) {
      const Block a = PathChain<2>::block(terms_.turn[k]), b = PathChain<2>::block(-1.0 - terms_.turn[k]);
      const double w = terms_.chain_weight(k);
      const Block spread = a * inverse_.own[k] * a.transpose() + b * inverse_.own[k + 1] * b.transpose() +
                           inverse_.own[k + 2] +
                           2 * (b * inverse_.next[k] * a.transpose() + inverse_.next[k + 1] * b.transpose() +
                                inverse_.second[k] * a.transpose());
      squares += w * chain_.chain_residual(k).squaredNorm();
      determined += 2 - w * spread.trace();
    }
    const double prior = 2 * terms_.turn_sigma / kUsualSigma;
    return std::sqrt(std::clamp((squares + 2) / (std::max(determined, 0.0) + prior), 0.05, 20.0));
  }

  double scale_deviation() const {
    return std::sqrt(inverse_.corner(chain_.scale_row(), chain_.scale_row()));
  }

  /// A scale that may as well be 1 is 1: to estimate what is known makes the path worse.
  void settle_scale() {
    if (!chain_.has_scale() || descent_.stopped() || !factorize()) return;
    chain_.invert(inverse_);
    if (std::abs(chain_.scale - 1) >= kClearly * scale_deviation()) return;
    terms_.scale_weight = 0;
    chain_.scale = 1;
    converged_ = descent_.run(chain_, bound_, options_.max_iterations);
    estimate_turn_sigma(40);
  }

  bool factorize() {
    for (const auto curvature : {ranges::PathCurvature::True, ranges::PathCurvature::Convex}) {
      chain_.assemble(curvature, bound_);
      if (chain_.factorize()) return true;
    }
    return false;
  }

  void finish() {
    const bool is_definite = factorize();
    result_.energy = chain_.energy(bound_);
    result_.nodes = static_cast<int>(nodes_.size());
    result_.turn_sigma = terms_.turn_sigma;
    result_.scale = chain_.scale;
    result_.status = converged_ ? Status::Converged : Status::MaxIterations;
    if (!is_definite || !std::isfinite(result_.energy)) {
      result_ = PathEstimate{};
      result_.status = Status::NumericalFailure;
      result_.message =
          "the measurements do not determine the path, or have numbers that are too large or too small";
      return;
    }
    result_.evidence = evidence();
    if (options_.covariance) {
      chain_.invert(inverse_);
      if (chain_.has_scale()) result_.scale_deviation = scale_deviation();
    }
    write_path();
    write_beacons();
    write_residuals();
    if (options_.lower_bound) write_lower_bound();
    result_.iterations += descent_.iterations();
    for (const auto* list : {&result_.x, &result_.heading, &result_.covariance, &result_.beacon_covariance}) {
      if (std::all_of(list->begin(), list->end(), [](double v) { return std::isfinite(v); })) continue;
      result_ = PathEstimate{};
      result_.status = Status::NumericalFailure;
      result_.message = "numbers that are too large or too small";
      return;
    }
  }

  /// Of paths with the same scale, as if the odometry had counted right.
  void write_lower_bound() {
    if (!(chain_.scale > 0)) return;
    PathTerms terms = terms_;
    terms.scale_weight = 0;
    for (double& length : terms.length) length *= chain_.scale;
    terms.first_step *= chain_.scale;
    terms.turn_sigma /= chain_.scale;
    terms.step_sigma /= chain_.scale;
    PathChain<2> minimum(terms);
    minimum.x = chain_.x;
    minimum.beacons = chain_.beacons;
    const double energy = minimum.energy(bound_), of_scale = result_.energy - energy;
    ranges::PathBound bound(terms, minimum, bound_, options_.stop);
    result_.lower_bound = of_scale + bound.run(anchors_ == 0 && terms.start_weight == 0, energy);
    result_.iterations += bound.iterations();
  }

  void write_path() {
    const std::size_t poses = steps_ + 1;
    result_.x.resize(2 * poses);
    result_.heading.resize(poses);
    if (options_.covariance) result_.covariance.resize(4 * poses);
    for (std::size_t k = 0; k < poses; ++k) {
      const auto [o, a] = on_chain(static_cast<double>(k));
      const Point step = chain_.x[o + 1] - chain_.x[o];
      const Point p = chain_.x[o] + PathChain<2>::times(a, step);
      result_.x[2 * k] = p[0];
      result_.x[2 * k + 1] = p[1];
      const Complex turn = complex_of(step) / moves_[o] * std::polar(1.0, turned_[k]);
      result_.heading[k] = std::arg(turn);
      if (!options_.covariance) continue;
      const Block b = PathChain<2>::block(1.0 - a), c = PathChain<2>::block(a);
      const Block cross = c * inverse_.next[o] * b.transpose();
      const Block s = b * inverse_.own[o] * b.transpose() + c * inverse_.own[o + 1] * c.transpose() + cross +
                      cross.transpose();
      for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j) result_.covariance[4 * k + at(2 * i + j)] = 0.5 * (s(i, j) + s(j, i));
    }
  }

  void write_beacons() {
    result_.beacons.assign(given_.beacons.begin(), given_.beacons.end());
    if (options_.covariance) result_.beacon_covariance.assign(4 * beacons_, 0.0);
    for (std::size_t j = 0; j < beacons_; ++j) {
      if (unknown_[j] < 0) continue;
      const Point& p = chain_.beacons[at(unknown_[j])];
      result_.beacons[2 * j] = p[0];
      result_.beacons[2 * j + 1] = p[1];
      if (!options_.covariance) continue;
      const Eigen::Index c = 2 * unknown_[j];
      for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b)
          result_.beacon_covariance[4 * j + at(2 * a + b)] = inverse_.corner(c + a, c + b);
    }
  }

  void write_residuals() {
    result_.residuals.assign(given_.range.size(), kNan);
    for (const PathRange& range : terms_.ranges) {
      const auto i = at(range.index);
      result_.residuals[i] = (chain_.difference(range).norm() - range.length) / given_.sigma[i];
    }
  }

  static constexpr double kLargest = 1e60;
  static constexpr int kHeadings = 32;           ///< that the search tries
  static constexpr std::size_t kEarly = 1000;    ///< positions of a path that is short
  static constexpr std::size_t kMostStarts = 4;  ///< that are continued
  static constexpr double kLeastSigma = 1e-4;    ///< that is estimated: better than any odometry
  static constexpr double kClearly = 1.5;        ///< deviations from 1 of a scale that is not 1
  static constexpr double kUsualSigma = 0.03;    ///< where nothing says what it is

  const PathMeasurements& given_;
  const PathOptions& options_;
  PathEstimate result_;
  std::size_t steps_ = 0, beacons_ = 0;
  std::vector<Complex> reckoned_, moves_;  ///< of poses; of nodes
  std::vector<double> turned_;
  std::vector<std::size_t> nodes_;  ///< their poses
  std::vector<int> unknown_;        ///< of each beacon, its place among the unknown ones
  PathTerms terms_;
  PathChain<2> chain_;
  PathChain<2>::Inverse inverse_;
  ranges::PathDescent<2> descent_;
  int anchors_ = 0;  ///< known places that are heard, up to two
  double bound_ = kInfinity;
  bool converged_ = false;
};

}  // namespace

PathEstimate locate_path(const PathMeasurements& measurements, const PathOptions& options) {
  return PathSolver(measurements, options).run();
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
