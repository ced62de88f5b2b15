#include <algorithm>
#include <asterism/solver/ranges/locate.hpp>
#include <asterism/solver/run/executor.hpp>
#include <atomic>
#include <cmath>
#include <memory>
#include <optional>
#include <thread>
#include <tuple>
#include <vector>

#include "position_lanes.hpp"
#include "position_search.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

const char* LocateOptions::problem() const {
  if (!(within >= 0 && within < std::numeric_limits<double>::infinity()))
    return "within has to be a finite number >= 0";
  if (!(cutoff > 0)) return "cutoff has to be > 0";
  if (max_cells < 1) return "max_cells has to be >= 1";
  return nullptr;
}

namespace locating {

using ranges::Symmetric;
using ranges::Vector;

inline constexpr int kWithoutHeap = 64, kLanes = lanes_v0_1::Cells::kMost;

/// The ranges that were heard, with coordinates about the beacons' centroid, the last along the direction in
/// which the beacons extend least.
template <int Dim>
class Heard {
 public:
  /// What is wrong; empty if nothing is.
  Message read(std::span<const double> beacons, std::span<const double> given,
               std::span<const double> sigma) {
    const int count = static_cast<int>(given.size());
    if (beacons.size() != given.size() * Dim || sigma.size() != given.size())
      return "beacons, ranges and sigma have to be for the same number of beacons";
    if (count > kWithoutHeap) heap_.resize(static_cast<std::size_t>(count) * (Dim + 3));
    double* const memory = count > kWithoutHeap ? heap_.data() : stack_;
    beacons_ = memory;
    range_ = memory + Dim * count;
    weight_ = range_ + count;
    sigma_ = weight_ + count;
    double largest = 0;
    for (int i = 0; i < count; ++i) {
      const double r = given[static_cast<std::size_t>(i)], s = sigma[static_cast<std::size_t>(i)];
      if (std::isnan(r)) continue;
      if (!(r >= 0 && r <= kLargest))
        return wrong("range", i, r < 0 ? "is negative" : "is too large or infinite");
      if (!(s > 0 && s <= kLargest && s >= 1 / kLargest))
        return wrong("sigma", i,
                     s > 0 && std::isfinite(s) ? "is too large or too small" : "is not a finite number > 0");
      for (int k = 0; k < Dim; ++k) {
        const double b = beacons[static_cast<std::size_t>(Dim * i + k)];
        if (!(std::abs(b) <= kLargest))
          return wrong("beacon", i, "has a coordinate that is not finite, or too large");
        beacons_[Dim * count_ + k] = b;
        largest = std::max(largest, std::abs(b));
      }
      range_[count_] = r;
      weight_[count_] = 1 / (s * s);
      sigma_[count_] = s;
      ++count_;
    }
    if (count_ < Dim) {
      return Message("a position ")
          .append(Dim == 2 ? "in the plane" : "in space")
          .append(" needs ranges to at least ")
          .append(Dim)
          .append(" beacons, found ")
          .append(count_);
    }
    return turn(largest);
  }

  ranges::Ranges ranges() const { return {count_, beacons_, range_, weight_, sigma_}; }
  bool is_flat() const { return is_flat_; }

  /// The given coordinates of a place.
  std::array<double, Dim> place(const Vector<Dim>& x) const {
    std::array<double, Dim> result;
    const Vector<Dim> y = mirrored(x);
    for (int k = 0; k < Dim; ++k) result[static_cast<std::size_t>(k)] = y[k] * unit_ + centre_[k];
    return result;
  }
  std::array<double, Dim * Dim> turned(const Symmetric<Dim>& m) const {
    Vector<Dim> columns[Dim];
    for (int k = 0; k < Dim; ++k) {
      for (int l = 0; l < Dim; ++l) columns[k][l] = m(k, l);
      columns[k] = mirrored(columns[k]);  // rows of m, turned: m H
    }
    std::array<double, Dim * Dim> result;
    for (int l = 0; l < Dim; ++l) {
      Vector<Dim> column;
      for (int k = 0; k < Dim; ++k) column[k] = columns[k][l];
      column = mirrored(column);
      for (int k = 0; k < Dim; ++k) result[static_cast<std::size_t>(Dim * k + l)] = column[k] * unit_ * unit_;
    }
    for (int k = 0; k < Dim; ++k)
      for (int l = 0; l < k; ++l)
        result[static_cast<std::size_t>(Dim * l + k)] = result[static_cast<std::size_t>(Dim * k + l)];
    return result;
  }

 private:
  static constexpr double kLargest = 1e75;  ///< products of two variances stay finite

  static Message wrong(const char* what, int index, const char* problem) {
    return Defect{what, index, problem};
  }

  /// Householder's reflection, which is its own inverse.
  Vector<Dim> mirrored(const Vector<Dim>& x) const {
    const double q = factor_ * dot(normal_, x);
    Vector<Dim> y;
    for (int k = 0; k < Dim; ++k) y[k] = x[k] - q * normal_[k];
    return y;
  }

  Message turn(double largest) {
    double total = 0;
    centre_ = ranges::constant<Dim>(0);
    for (int i = 0; i < count_; ++i) total += weight_[i];
    for (int i = 0; i < count_; ++i)
      for (int k = 0; k < Dim; ++k) centre_[k] += weight_[i] / total * beacons_[Dim * i + k];
    double extent = 0, furthest = 0;
    for (int i = 0; i < count_; ++i) {
      double square = 0;
      for (int k = 0; k < Dim; ++k) {
        const double b = beacons_[Dim * i + k] -= centre_[k];
        square += b * b;
      }
      extent = std::max(extent, std::sqrt(square));
      furthest = std::max(furthest, range_[i]);
    }
    if (extent <= 1e-13 * largest)
      return Dim == 2 ? "the beacons are all in one place: every position on a circle around it fits equally"
                      : "the beacons are all in one place: every position on a sphere around it fits equally";
    // In units of the largest distance, products stay within the range of numbers.
    unit_ = std::ldexp(1.0, std::ilogb(std::max(extent, furthest)));
    extent /= unit_;
    const double rounding = 1e-14 * largest / unit_;
    Symmetric<Dim> scatter = Symmetric<Dim>::zero();  // without weights: the geometry
    for (int i = 0; i < count_; ++i) {
      if (!(weight_[i] * unit_ * unit_ >= 1e-50 && weight_[i] * unit_ * unit_ <= 1e50))
        return "sigma is out of proportion to the distances: their quotient has to be between 1e-25 and 1e25";
      weight_[i] *= unit_ * unit_;
      range_[i] /= unit_;
      sigma_[i] /= unit_;
      Vector<Dim> b;
      for (int k = 0; k < Dim; ++k) b[k] = beacons_[Dim * i + k] /= unit_;
      scatter.add(1, b);
    }
    const double size = scatter.trace();
    if constexpr (Dim == 3) {
      const Symmetric<Dim> minors = scatter.adjugate();
      if (minors.trace() <= 1e-12 * size * size)
        return "the beacons lie on one line: every position on a circle around it fits equally";
    }
    Vector<Dim> least = normal_of_farthest();
    double height = 0;
    for (int i = 0; i < count_; ++i) height = std::max(height, std::abs(dot(least, beacon(i))));
    is_flat_ = height <= 1e-10 * extent + 10 * rounding;
    if (!is_flat_) {
      // Powers of the inverse bring out the direction of least extent.
      const Symmetric<Dim> adjugate = scatter.shifted(1e-10 * size).adjugate();
      for (int k = 0; k < Dim; ++k) least[k] = 1 + 0.37 * k;
      for (int round = 0; round < 3; ++round) least = normalised(adjugate.times(least));
    }
    normal_ = least;
    normal_[Dim - 1] += least[Dim - 1] >= 0 ? 1 : -1;
    factor_ = 2 / dot(normal_, normal_);
    for (int i = 0; i < count_; ++i) {
      const Vector<Dim> b = mirrored(beacon(i));
      for (int k = 0; k < Dim; ++k) beacons_[Dim * i + k] = b[k];
      if (is_flat_) beacons_[Dim * i + Dim - 1] = 0;
    }
    return {};
  }

  Vector<Dim> beacon(int i) const {
    Vector<Dim> b;
    for (int k = 0; k < Dim; ++k) b[k] = beacons_[Dim * i + k];
    return b;
  }

  static Vector<Dim> normalised(Vector<Dim> v) {
    const double length = norm(v);
    for (double& a : v.at) a /= length;
    return v;
  }

  /// That of the line through the centroid and the farthest beacon, or, in space, of the plane through these
  /// and the beacon that is farthest from the line.
  Vector<Dim> normal_of_farthest() const {
    const auto farthest = [this](auto&& across) {
      Vector<Dim> best = across(beacon(0));
      for (int i = 1; i < count_; ++i) {
        const Vector<Dim> v = across(beacon(i));
        if (dot(v, v) > dot(best, best)) best = v;
      }
      return best;
    };
    const Vector<Dim> to = farthest([](const Vector<Dim>& b) { return b; });
    if constexpr (Dim == 2) {
      return normalised({{-to[1], to[0]}});
    } else {
      return normalised(farthest([&to](const Vector<Dim>& b) {
        return Vector<Dim>{
            {to[1] * b[2] - to[2] * b[1], to[2] * b[0] - to[0] * b[2], to[0] * b[1] - to[1] * b[0]}};
      }));
    }
  }

  double stack_[kWithoutHeap * (Dim + 3)];
  std::vector<double> heap_;
  double *beacons_ = nullptr, *range_ = nullptr, *weight_ = nullptr, *sigma_ = nullptr;
  int count_ = 0;
  Vector<Dim> centre_, normal_;
  double factor_ = 0, unit_ = 1;
  bool is_flat_ = false;
};

/// Memory of the lanes, for so many beacons.
template <int Dim>
class Lanes {
 public:
  explicit Lanes(int beacons) {
    const auto rows = static_cast<std::size_t>(beacons) * kLanes;
    if (beacons > kWithoutHeap) heap_.resize(rows * (Dim + 2));
    double* const memory = beacons > kWithoutHeap ? heap_.data() : stack_;
    std::fill_n(memory, rows * (Dim + 2), 0.0);  // lanes that are not used yet
    cells_.dim = Dim;
    cells_.beacons = beacons;
    cells_.places = memory;
    cells_.ranges = memory + Dim * rows;
    cells_.weights = cells_.ranges + rows;
    std::fill_n(cells_.extent, kLanes, 1.0);
  }
  Lanes(const Lanes&) = delete;
  Lanes& operator=(const Lanes&) = delete;
  lanes_v0_1::Cells& cells() { return cells_; }

 private:
  double stack_[kWithoutHeap * (Dim + 2) * kLanes];
  std::vector<double> heap_;
  lanes_v0_1::Cells cells_ = {};
};

inline constexpr const char* mirror_message(int dim) {
  return dim == 2
             ? "the beacons lie on one line: each minimum beside it has a mirror image of the same energy"
             : "the beacons lie in one plane: each minimum beside it has a mirror image of the same energy";
}

template <int Dim>
PositionFix<Dim> proven_fix(const lanes_v0_1::LaneFix& of_lane, double within) {
  PositionFix<Dim> fix;
  fix.status = Status::Converged;
  fix.proven = true;
  fix.within = within;
  fix.count = of_lane.count;
  for (int i = 0; i < fix.count; ++i) {
    PositionMinimum<Dim>& minimum = fix.minima[static_cast<std::size_t>(i)];
    std::copy_n(of_lane.x[i], Dim, minimum.x.begin());
    std::copy_n(of_lane.covariance[i], Dim * Dim, minimum.covariance.begin());
    minimum.energy = of_lane.energy;
    minimum.weight = 1.0 / fix.count;
  }
  if (fix.count == 2) fix.message = mirror_message(Dim);
  return fix;
}

/// What a search has found.
template <int Dim>
PositionFix<Dim> found_fix(ranges::PositionSearch<Dim>& search, const Heard<Dim>& heard,
                           const LocateOptions& options) {
  PositionFix<Dim> fix;
  fix.status = Status::InvalidInput;
  const ranges::Minima<Dim>& minima = search.finish();
  fix.count = minima.count();
  fix.cells = static_cast<int>(search.cells());
  if (fix.count == 0) {
    fix.message.append("no position agrees with ")
        .append(Dim)
        .append(" ranges or more: a larger cutoff, or other ranges, are needed");
    return fix;
  }
  fix.status = Status::Converged;
  fix.proven = search.is_complete();
  fix.within = minima.within();
  double total = 0;
  for (int i = 0; i < fix.count; ++i) {
    const ranges::Minimum<Dim>& minimum = minima[i];
    PositionMinimum<Dim>& result = fix.minima[static_cast<std::size_t>(i)];
    // Where the energy is flat to rounding, as where a mirror image joins its minimum, the variance is huge.
    const bool is_flat = !minimum.hessian.is_definite();
    const Symmetric<Dim> covariance =
        minimum.hessian.shifted(is_flat ? 1e-12 * search.total_weight() : 0).inverse();
    result = {heard.place(minimum.x), heard.turned(covariance), minimum.energy, 0};
    result.weight =
        std::exp(fix.minima[0].energy - minimum.energy) * std::sqrt(std::max(0.0, covariance.determinant()));
    total += result.weight;
  }
  for (int i = 0; i < fix.count; ++i) {
    double& weight = fix.minima[static_cast<std::size_t>(i)].weight;
    weight = total > 0 ? weight / total : i == 0 ? 1 : 0;
  }
  if (!fix.proven)
    fix.message = "not proven: the search ended at max_cells";
  else if (fix.within < options.within)
    fix.message.append("more than ").append(fix.kMost).append(" places fit: the lowest are listed");
  else if (heard.is_flat() && fix.count > 1)
    fix.message = mirror_message(Dim);
  else if (fix.count > 1)
    fix.message.append(fix.count).append(" places fit");
  return fix;
}

/// Searches of tags whose positions the closed forms do not prove: one in each lane.
template <int Dim>
class SideBySide {
 public:
  SideBySide(int beacons, const LocateOptions& options) : options_(options), lanes_(beacons) {}

  /// Starts the searches of these tags, and goes on until a lane has none. ranges_of(tag): a tag's beacons,
  /// ranges and sigma.
  template <typename RangesOf, typename Take>
  void run(std::span<const int> tags, RangesOf&& ranges_of, Take&& take) {
    std::size_t next = 0;
    for (bool is_idle = false; !is_idle;) {
      for (int lane = 0; lane < kLanes; ++lane) {
        Lane& of = each_[lane];
        while (!(of.search && of.search->next())) {
          end(of, take);
          is_idle = next == tags.size();
          if (is_idle) break;
          of.tag = tags[next++];
          if (PositionFix<Dim> wrong; !start(of, lane, ranges_of(of.tag), wrong)) take(of.tag, wrong);
        }
      }
      lanes_v0_1::judge(lanes_.cells());
      for (Lane& of : each_)
        if (of.search) of.search->use();
    }
  }

  /// Ends what is left, each search in all lanes.
  template <typename Take>
  void finish(Take&& take) {
    for (Lane& of : each_) {
      if (of.search) of.search->branch_and_bound();
      end(of, take);
    }
  }

 private:
  struct Lane {
    std::optional<Heard<Dim>> heard;
    std::optional<ranges::PositionSearch<Dim>> search;
    int tag = 0;
  };

  template <typename Take>
  void end(Lane& of, Take&& take) {
    if (of.search) take(of.tag, found_fix<Dim>(*of.search, *of.heard, options_));
    of.search.reset();
  }

  template <typename Given>
  bool start(Lane& of, int lane, const Given& given, PositionFix<Dim>& wrong) {
    of.heard.emplace();
    wrong.status = Status::InvalidInput;
    wrong.message = std::apply([&](auto... spans) { return of.heard->read(spans...); }, given);
    if (!wrong.message.empty()) return false;
    of.search.emplace(of.heard->ranges(), of.heard->is_flat(), options_.within, options_.cutoff,
                      options_.max_cells, lanes_.cells());
    if (!of.search->is_proven_at_once()) of.search->begin(lane);
    return true;
  }

  LocateOptions options_;
  Lanes<Dim> lanes_;
  Lane each_[kLanes];
};

}  // namespace locating

template <int Dim>
PositionFix<Dim> locate(std::span<const double> beacons, std::span<const double> given,
                        std::span<const double> sigma, const LocateOptions& options) {
  PositionFix<Dim> fix;
  locating::Heard<Dim> heard;
  fix.status = Status::InvalidInput;
  if (const char* problem = options.problem()) {
    fix.message = problem;
    return fix;
  }
  fix.message = heard.read(beacons, given, sigma);
  if (!fix.message.empty()) return fix;
  locating::Lanes<Dim> lanes(heard.ranges().count);
  ranges::PositionSearch<Dim> search(heard.ranges(), heard.is_flat(), options.within, options.cutoff,
                                     options.max_cells, lanes.cells());
  search.run();
  return locating::found_fix<Dim>(search, heard, options);
}

template <int Dim>
bool locate_each(const RangeBatch& batch, const LocateOptions& options, int threads,
                 const std::function<void(int tag, const PositionFix<Dim>& fix)>& take,
                 const std::function<bool()>& is_stopped) {
  const auto tags = static_cast<std::size_t>(std::max(batch.tags, 0));
  const auto beacons = static_cast<std::size_t>(std::max(batch.beacons_per_tag, 0));
  const bool own_beacons = tags != 1 && batch.beacons.size() == tags * beacons * Dim;
  const bool own_sigma = tags != 1 && batch.sigma.size() == tags * beacons;
  if (batch.tags < 0 || batch.beacons_per_tag < 0 || batch.ranges.size() != tags * beacons ||
      (!own_beacons && batch.beacons.size() != beacons * Dim) ||
      (!own_sigma && batch.sigma.size() != beacons))
    return false;
  constexpr std::size_t kChunk = 64;
  // The closed forms prove most tags, many at once.
  const bool has_lanes = options.problem() == nullptr &&
                         options.cutoff == std::numeric_limits<double>::infinity() &&
                         beacons <= lanes_v0_1::kMostBeacons;
  const int workers = detail::thread_count(threads);
  // For each worker, made by the first chunk that needs it.
  std::vector<std::unique_ptr<locating::SideBySide<Dim>>> searches(static_cast<std::size_t>(workers));
  std::atomic<bool> stopped{false};
  const int chunks = static_cast<int>((tags + kChunk - 1) / kChunk);
  const std::thread::id caller = std::this_thread::get_id();
  detail::for_each_task(workers, chunks, [&](int worker, int chunk) {
    const bool asks = is_stopped && std::this_thread::get_id() == caller;
    const std::size_t first = static_cast<std::size_t>(chunk) * kChunk;
    const auto beacons_of = [&](std::size_t tag) {
      return batch.beacons.subspan(own_beacons ? tag * beacons * Dim : 0, beacons * Dim);
    };
    const auto ranges_of = [&](std::size_t tag) { return batch.ranges.subspan(tag * beacons, beacons); };
    const auto sigma_of = [&](std::size_t tag) {
      return batch.sigma.subspan(own_sigma ? tag * beacons : 0, beacons);
    };
    const std::size_t count = std::min(tags - first, kChunk);
    lanes_v0_1::LaneFix fixes[kChunk];
    if (has_lanes)
      lanes_v0_1::fix({Dim, batch.beacons_per_tag, static_cast<int>(count), beacons_of(first).data(),
                       own_beacons ? batch.beacons_per_tag * Dim : 0, ranges_of(first).data(),
                       sigma_of(first).data(), own_sigma ? batch.beacons_per_tag : 0, options.within, fixes});
    int left[kChunk];
    std::size_t left_count = 0;
    for (std::size_t n = 0; n < count && !stopped; ++n) {
      if (asks && is_stopped()) {
        stopped = true;
        return;
      }
      const std::size_t tag = first + n;
      if (!has_lanes)
        take(static_cast<int>(tag), locate<Dim>(beacons_of(tag), ranges_of(tag), sigma_of(tag), options));
      else if (fixes[n].count > 0)
        take(static_cast<int>(tag), locating::proven_fix<Dim>(fixes[n], options.within));
      else
        left[left_count++] = static_cast<int>(tag);
    }
    if (left_count == 0 || stopped) return;
    std::unique_ptr<locating::SideBySide<Dim>>& search = searches[static_cast<std::size_t>(worker)];
    if (search == nullptr)
      search = std::make_unique<locating::SideBySide<Dim>>(batch.beacons_per_tag, options);
    search->run(
        std::span(left, left_count),
        [&](int tag) {
          const auto n = static_cast<std::size_t>(tag);
          return std::tuple(beacons_of(n), ranges_of(n), sigma_of(n));
        },
        take);
  });
  detail::for_each_task(workers, workers, [&](int, int worker) {
    if (const auto& search = searches[static_cast<std::size_t>(worker)]; search != nullptr && !stopped)
      search->finish(take);
  });
  return !stopped;
}

template ASTERISM_API PositionFix<2> locate<2>(std::span<const double>, std::span<const double>,
                                               std::span<const double>, const LocateOptions&);
template ASTERISM_API PositionFix<3> locate<3>(std::span<const double>, std::span<const double>,
                                               std::span<const double>, const LocateOptions&);
template ASTERISM_API bool locate_each<2>(const RangeBatch&, const LocateOptions&, int,
                                          const std::function<void(int, const PositionFix<2>&)>&,
                                          const std::function<bool()>&);
template ASTERISM_API bool locate_each<3>(const RangeBatch&, const LocateOptions&, int,
                                          const std::function<void(int, const PositionFix<3>&)>&,
                                          const std::function<bool()>&);

}  // namespace ASTERISM_ABI
}  // namespace asterism
