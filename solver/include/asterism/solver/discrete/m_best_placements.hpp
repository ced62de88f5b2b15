#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/discrete/map_search.hpp>
#include <asterism/solver/discrete/map_view.hpp>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <atomic>
#include <cstddef>
#include <limits>
#include <new>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The M best placements of a pictorial structure, exactly: the first is the best of all, and each further
/// one is the best of all placements that differ from each one before it. Two placements differ if a part of
/// one is farther than `distance` [px] from the same part of the other. With a distance of 0 these are the
/// placements of the M least energies.
///
/// PictorialStructure::best_placements, which is much faster, compares the roots only.
///
/// Lawler's partition (Management Science 1972): the placements that differ from one that is found are
/// divided by the first part that is farther away: it is kept out of a disc, and the parts before it are kept
/// in theirs. Each piece restricts each part by itself, so that its best placement is a pictorial structure
/// on maps with forbidden positions. The pieces of the least energy are taken first. About as many solves
/// as M times the number of parts, more if the distance is large.
///
/// An object holds its workspace: reuse it to solve without allocation while the sizes and the number of
/// pieces do not grow, one thread at a time.
class MBestPlacements {
 public:
  /// As PictorialStructure::stop. The placements found until then stay.
  const std::atomic<bool>* stop = nullptr;

  /// Finds up to `count` placements, at least 1, fewer if no others are allowed; `distance` from 0 up.
  /// `joints` and `maps` as PictorialStructure has them. The summary is that of the best placement, and names
  /// what is wrong with bad input. found() is the number of placements; the vector is only resized if it is
  /// shorter.
  PictorialSummary solve(std::span<const Joint> joints, std::span<const MapView<const float>> maps, int count,
                         double distance, std::vector<PartPlacement>& placements) {
    found_ = 0;
    if (count < 1 || !(distance >= 0))
      return detail::without_placement<PictorialSummary>(
          Status::InvalidInput, count < 1 ? Defect{"count", count, "is below 1"}
                                          : Defect{"distance", Defect::kNoIndex, "is negative or NaN"});
    const auto summary = detail::within_memory<PictorialSummary>(
        [&] { return search(joints, maps, count, distance, placements); });
    if (summary.status == Status::OutOfMemory) found_ = 0;
    return summary;
  }

  /// Placements that the last solve found.
  int found() const { return found_; }

 private:
  // Placements with parts before `part` near those of the placement `from`, and `part` farther away; all this
  // within the piece `whole`, which is all for -1.
  struct Piece {
    int whole = -1;
    int from = -1;
    int part = 0;
    bool is_open = true;
    PartPlacement best;
  };

  PictorialSummary search(std::span<const Joint> joints, std::span<const MapView<const float>> maps,
                          int count, double distance, std::vector<PartPlacement>& placements) {
    pieces_in_use_ = 0;
    views_.assign(maps.begin(), maps.end());
    Piece& all = next_piece();
    structure_.stop = stop;
    PictorialSummary summary = structure_.solve(joints, views_, all.best);
    if (!summary.usable()) return summary;
    all.whole = all.from = -1;
    all.is_open = true;
    ++pieces_in_use_;
    if (masked_.size() < maps.size()) masked_.resize(maps.size());

    while (true) {
      const int piece = best_open_piece();
      if (piece < 0) return summary;
      if (detail::is_set(stop)) return detail::stopped<PictorialSummary>();
      const PartPlacement& best = pieces_[static_cast<std::size_t>(piece)].best;
      // The piece may reach into the discs of a placement that was found in another one.
      int from = 0;
      while (from < found_ && !are_near(best, placements[static_cast<std::size_t>(from)], distance)) ++from;
      if (from == found_) {
        if (placements.size() <= static_cast<std::size_t>(found_)) placements.emplace_back();
        placements[static_cast<std::size_t>(found_++)] = best;
        if (found_ == count) return summary;
      }
      divide(joints, maps, piece, from, distance, placements);
    }
  }

  void divide(std::span<const Joint> joints, std::span<const MapView<const float>> maps, int whole, int from,
              double distance, const std::vector<PartPlacement>& placements) {
    pieces_[static_cast<std::size_t>(whole)].is_open = false;
    for (int part = 0; part < static_cast<int>(maps.size()); ++part) {
      Piece& piece = next_piece();
      piece.whole = whole;
      piece.from = from;
      piece.part = part;
      for (int i = 0; i < static_cast<int>(maps.size()); ++i) restrict(piece, i, maps, distance, placements);
      if (structure_.solve(joints, views_, piece.best).usable()) {
        piece.is_open = true;
        ++pieces_in_use_;
      }
    }
  }

  // Sets the view of a part's map to the positions that a piece allows.
  void restrict(const Piece& piece, int part, std::span<const MapView<const float>> maps, double distance,
                const std::vector<PartPlacement>& placements) {
    const auto i = static_cast<std::size_t>(part);
    const MapView<const float>& map = maps[i];
    views_[i] = map;
    MapView<float> masked;
    for (const Piece* of = &piece; of->from >= 0; of = &pieces_[static_cast<std::size_t>(of->whole)]) {
      if (of->part < part) continue;
      if (masked.empty()) {
        const auto size = static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height);
        detail::require_memory(sizeof(float) * static_cast<double>(size));
        if (masked_[i].size() < size) masked_[i].resize(size);
        masked = {masked_[i].data(), map.width, map.height};
        detail::copy_map(map, masked);
        views_[i] = masked;
      }
      const Eigen::Vector2i at = placements[static_cast<std::size_t>(of->from)].positions.col(part);
      if (of->part == part) {
        detail::forbid_near(masked, at.x(), at.y(), distance);
        continue;
      }
      for (int y = 0; y < map.height; ++y) {
        for (int x = 0; x < map.width; ++x) {
          if (!detail::is_near(x - at.x(), y - at.y(), distance)) {
            masked(x, y) = std::numeric_limits<float>::infinity();
          }
        }
      }
    }
  }

  int best_open_piece() const {
    int best = -1;
    double least = std::numeric_limits<double>::infinity();
    for (int k = 0; k < pieces_in_use_; ++k) {
      const Piece& piece = pieces_[static_cast<std::size_t>(k)];
      if (!piece.is_open || !(piece.best.energy < least)) continue;
      least = piece.best.energy;
      best = k;
    }
    return best;
  }

  // Kept from solve to solve, with their placements.
  Piece& next_piece() {
    const auto next = static_cast<std::size_t>(pieces_in_use_);
    if (pieces_.size() <= next) pieces_.emplace_back();
    return pieces_[next];
  }

  static bool are_near(const PartPlacement& a, const PartPlacement& b, double distance) {
    for (Eigen::Index i = 0; i < a.positions.cols(); ++i) {
      const Eigen::Vector2i d = a.positions.col(i) - b.positions.col(i);
      if (!detail::is_near(d.x(), d.y(), distance)) return false;
    }
    return true;
  }

  PictorialStructure structure_;
  std::vector<Piece> pieces_;
  int pieces_in_use_ = 0, found_ = 0;
  std::vector<std::vector<float>> masked_;
  std::vector<MapView<const float>> views_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
