#pragma once

#include <array>
#include <asterism/parts/concept/frame.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/features/patch.hpp>
#include <asterism/trackers/dpt/box_judge.hpp>
#include <cstddef>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Searches a whole frame for an object by what it looked like in the first one, from coarse to fine. It
/// never learns anything else.
///
/// 1. The frame's histograms of oriented gradients are correlated with the object's (normalised to [-1, 1])
///    at every cell, for three sizes of the object. The object has 8 x 8 cells of 31 channels, or 4 x 4 in a
///    frame that is large against it.
/// 2. A BoxJudge compares the kMost best matches, which overlap each other by less than one half, with the
///    first frame.
/// 3. The two most probable of them are moved and scaled as long as that makes them more probable.
class ASTERISM_API ObjectSearch {
 public:
  /// Matches that are judged.
  static constexpr std::size_t kMost = 20;

  /// The match that was found.
  struct Found {
    cv::Rect2d box;               ///< in pixels' edges; within the frame except for fractions of its sides
    BoxJudge::Likeness likeness;  ///< of this box in this frame
    double probability = 0;       ///< of this likeness; 0: there is no box to look at
  };

  /// Remember the object in this box.
  void init(const Frame& frame, const cv::Rect2d& box);
  /// The most probable box about as large as `size` [px, > 0]. There is none (probability 0) in a frame that
  /// is smaller than the object, or of more than 8192 times its area: so small an object is not searched.
  /// `judge` must have been started as this search was; its averages stay as they are.
  Found find(const Frame& frame, const Size2& size, BoxJudge& judge);
  /// Visits what has been learned, for save_state.
  void visit_state(StateArchive& archive);

 private:
  static constexpr int kCell = 4;                    // pixels of the resized frame
  static constexpr std::array<int, 2> kSides{8, 4};  // of the object [cells], of both templates
  static constexpr std::array<int, 2> kMostCells{1 << 15, 1 << 17};  // of a frame, for each

  struct Match {
    double score = 0;
    cv::Rect2d box;
  };
  // Adds the local maxima of the correlation with a template of kSide x kSide cells.
  template <int kSide>
  void match(const Frame& frame, const Size2& size, const Eigen::VectorXf& object, std::vector<Match>& out);
  // The best matches that overlap each other by less than one half.
  static void keep_apart(std::vector<Match>& matches);

  std::array<Eigen::VectorXf, kSides.size()> objects_{
      // without the mean, of norm 1 or, if flat, 0
      Eigen::VectorXf::Zero(Fhog::kChannels * kSides[0] * kSides[0]),
      Eigen::VectorXf::Zero(Fhog::kChannels* kSides[1] * kSides[1])};
  Fhog hog_{kCell};
  PatchSampler sampler_;
  Scratch resized_;
  std::vector<float> features_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
