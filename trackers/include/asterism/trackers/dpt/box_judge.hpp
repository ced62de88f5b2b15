#pragma once

#include <array>
#include <asterism/parts/concept/frame.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/features/patch.hpp>
#include <cstddef>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Says how probable it is that a tracker's box overlaps the object. It compares the box with what the object
/// looked like in the first frame, and never updates this: a tracker that has learned the background is as
/// sure of it as of the object, but the judge is not. It needs nothing of the tracker except its boxes.
///
/// The probability is a logistic regression on three likenesses, which are averaged over the frames. Its
/// weights were fitted to the boxes of dpt_plus; docs/results/confidence.md says on which sequences, and how
/// good the probability is on others.
class ASTERISM_API BoxJudge {
 public:
  /// The object counts as lost if the probability is below this.
  static constexpr double kLostBelow = 0.5;
  /// Weight of the last frame in the averages of the likenesses.
  static constexpr double kRate = 0.1;

  /// How much a box is like the object in the first frame; 1 is the same.
  struct Likeness {
    double shape = 1;   ///< correlation of the histograms of oriented gradients, in [-1, 1]
    double levels = 1;  ///< correlation of the gray levels, in [-1, 1]
    double colors = 1;  ///< Bhattacharyya coefficient of the histograms of colors, in [0, 1]
  };

  /// Remember the object in this box.
  void init(const Frame& frame, const cv::Rect2d& box);
  /// How much a box of a frame is like the object. The averages stay as they are.
  Likeness compare(const Frame& frame, const cv::Rect2d& box);
  /// Takes the likeness of the next frame's box into the averages; `probability(likeness())` is then the
  /// probability that this box overlaps the object.
  void average(const Likeness& seen);
  /// The averages start again at this likeness: the object was found in another place.
  void restart(const Likeness& seen);
  /// The probability, in [0, 1], that the box of the next frame overlaps the object: `compare`, `average`.
  double update(const Frame& frame, const cv::Rect2d& box);
  /// The probability of a likeness, in [0, 1]. The weights were fitted to averages.
  static double probability(const Likeness& likeness);

  /// The averages after the last frame.
  const Likeness& likeness() const { return likeness_; }
  /// Visits what has been learned, for save_state.
  void visit_state(StateArchive& archive);

 private:
  static constexpr int kCell = 4,
                       kCells = 8;  // of the gradients: pixels of the patch, along a side of the box
  static constexpr int kPixels = kCell * kCells;
  static constexpr int kLevels = kPixels / 2;  // gray levels along a side
  static constexpr int kBins = 8;              // of each color channel
  static constexpr std::size_t kSamples = 24;  // of color along a side

  // Vectors of norm 1, or 0 without contrast; a likeness is their inner product.
  struct Look {
    Eigen::VectorXf shape = Eigen::VectorXf::Zero(Fhog::kChannels * kCells * kCells);
    Eigen::VectorXf levels = Eigen::VectorXf::Zero(kLevels * kLevels);
    Eigen::VectorXf colors = Eigen::VectorXf::Zero(kBins * kBins * kBins);
  };
  void look(const Frame& frame, const cv::Rect2d& box, Look& seen);

  Look first_, now_;
  Likeness likeness_;
  bool judged_ = false;  // a frame after the first one
  Fhog hog_{kCell};
  PatchSampler sampler_;
  Scratch patch_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
