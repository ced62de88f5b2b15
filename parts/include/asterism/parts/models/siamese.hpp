#pragma once

#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <memory>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Options of Siamese; the defaults are those published with NanoTrack.
struct SiameseOptions {
  /// The folder with the networks, backbone.onnx and head.onnx. The library has none: it must be named.
  OptionText network;
  /// How strongly a change of size and aspect ratio lowers a cell's score, in [0, 10].
  double penalty = 0.138;
  /// Share of a Hann window around the last position in a cell's score, in [0, 1].
  double window = 0.455;
  /// The largest rate at which `found_size` takes the size of the best cell, in [0, 1].
  double size_rate = 0.348;
  /// Weight, in [0, 1], of the response of a filter that learns in each frame, in place of as much of a
  /// cell's probability. 0, as published: no filter.
  double filter_share = 0;
  /// The filter; without effect if it has no share.
  SpatialReliabilityOptions filter = [] {
    SpatialReliabilityOptions result;
    result.color_channels = true;
    return result;
  }();
};

/// A Siamese network with boxes: NanoTrack (github.com/HonglinChu/SiamTrackers), with networks that a user
/// has. A PartModel that also measures its target's size (SizingModel); copies share the networks, and learn
/// independently.
///
/// The backbone sees the target when it is learned, the template, and a window of about four times its size
/// in each further frame. The head compares both: for each cell of the window it says how probable the target
/// is there, and how far the sides of its box are from the cell's point. The template is never updated, so
/// that the model does not drift: `adapt` is for the filter, if there is one. The backbone and the head run
/// once a frame.
///
/// Evidence: the centre of the best cell's box, its probability, and the spread of all cells' centres, each
/// weighted by the square of its probability.
class ASTERISM_API Siamese {
 public:
  /// Throws std::invalid_argument, with a line that says which file, if the folder is not named, a network is
  /// missing, cannot be read, or is not a backbone or a head of NanoTrack; for options out of range; and if
  /// the library was built without OpenCV's dnn module.
  explicit Siamese(const SiameseOptions& options);

  /// Learn a target of `size` [px] at `centre` [px].
  void init(const Frame& frame, const Point2& centre, const Size2& size);
  /// Search the window around a position. Outside the frame is the mean color of the frame of `init`.
  Evidence localize(const Frame& frame, const Point2& around);
  /// Update the filter, if there is one; networks and template do not learn.
  void adapt(const Frame& frame, const Point2& at);

  double similarity_at(const Point2& position) const { return peak_.at(position); }
  /// The target's size [px] by the last `localize`: between that before and the best cell's.
  const Size2& found_size() const { return found_size_; }
  /// Let the target have another size in the image from now on [px].
  void resize(const Size2& size);

  /// Template, mean color and size, for save_state.
  void visit_state(StateArchive& archive);

  const SiameseOptions& options() const { return options_; }

 private:
  struct Networks;
  // Of the window of pixels x pixels network pixels around a position.
  cv::Mat features(const Frame& frame, const Point2& centre, int pixels);

  SiameseOptions options_;
  std::shared_ptr<Networks> networks_;
  cv::Mat template_;  // its features, never changed in place: copies share them
  cv::Scalar mean_;   // color of the first frame
  Size2 size_ = Size2::Zero(), found_size_ = Size2::Zero();
  SpatialReliability filter_;
  ResponsePeak peak_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
