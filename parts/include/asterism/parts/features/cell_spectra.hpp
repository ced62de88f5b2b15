#pragma once

#include <Eigen/Core>
#include <asterism/parts/concept/response.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/features/aligned.hpp>
#include <asterism/parts/features/cell_channels.hpp>
#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/features/patch.hpp>
#include <memory>

namespace asterism::part_kernels_v0_1 {
struct FilterPlan;
}

namespace asterism {
inline namespace ASTERISM_ABI {

/// The channels of a cell that a correlation filter uses, at least one of them, in this order.
struct CellFeatures {
  bool hog = true;     ///< the 31 channels of Fhog
  bool gray = true;    ///< the mean gray level, from -0.5 to 0.5
  bool color = false;  ///< a and b of CIE Lab over 128, about -1 to 1; 0 in gray video
  /// Channels of a program's own, or none; filters that are copied share them. They are no part of a saved
  /// state's options: restore a state into a filter with the same ones.
  std::shared_ptr<const CellChannels> own = nullptr;
};

/// The features of a search window's cells under a Hann window, and their spectra: the sample that Kcf and
/// Strcf are trained on and searched with. Transforms are single precision and the library's own
/// (docs/correlation-filters.md).
///
/// Once it has been prepared, nothing is allocated, except for color channels and a program's own. One object
/// is for one thread at a time; copies are independent.
class ASTERISM_API CellSpectra {
 public:
  using Plan = part_kernels_v0_1::FilterPlan;  ///< sizes and tables of the transforms

  /// cell_size in pixels, >= 1. Throws std::invalid_argument where there is no feature; the message begins
  /// with `of`.
  CellSpectra(const CellFeatures& features, int cell_size, const char* of);

  /// The number of cells nearest to `wanted` that the transforms want: a multiple of four without a prime
  /// factor above 7, the smaller of two. It differs by 9 % at most from 20 cells on.
  static int fast_cells(double wanted);

  /// Windows of rows x cols cells from now on, both multiples of four.
  void prepare(int rows, int cols);
  /// Whether it has been.
  bool prepared() const { return plan_ != nullptr; }

  /// The window of a size [px] around a centre [px] -> the spectra of its channels, in `data`; returns the
  /// squared norm of what was transformed. Throws std::invalid_argument for a centre that is not finite, and
  /// std::runtime_error where a program's own channels are not.
  double transform(const Frame& frame, const Point2& centre, const Size2& window);
  /// Whether the window of the last `transform` had one gray level and one color: nothing can be found in it.
  bool flat() const;

  /// The last spectra, of `padded_channels` maps, of which those beyond `channels` are zero;
  /// part_kernels.hpp has their layout.
  const float* data() const { return sample_.data(); }
  /// Numbers of cells and channels. The kernels' lanes want more channels, which are zero.
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int channels() const { return channels_; }
  int padded_channels() const { return padded_channels_; }
  /// The plan of the transforms; null before `prepare`.
  const std::shared_ptr<const Plan>& plan() const { return plan_; }
  /// Workspace of the kernels.
  float* work() { return work_.data(); }

  /// The spectrum of a Gaussian of standard deviation sigma [cells] and height 1 at zero shift, wrapped; it
  /// is real, and laid out as a split spectrum's real part, with zeros between.
  Eigen::ArrayXd gaussian_label(double sigma) const;
  /// factor x plane + constant, with zero shift in the middle, so that it is a picture of the search window.
  void put_response(const float* plane, float factor, float constant, ResponseMap& response) const;
  /// Saves or restores spectra, without their padding and in an order that does not depend on the kernels: a
  /// state may move to a machine of other instructions.
  void visit_spectra(StateArchive& archive, AlignedFloats& spectra) const;

 private:
  // The gray level of `patch_`, and the colors around `centre`.
  void add_gray(float* plane);
  void add_color(const Frame& frame, const Point2& centre, const Size2& window, float* planes);
  void add_own(const Frame& frame, const Point2& centre, const Size2& window, float* planes);

  CellFeatures features_;
  int cell_size_;
  int rows_ = 0, cols_ = 0, channels_ = 0, padded_channels_ = 0;
  PatchSampler sampler_;
  Fhog fhog_;
  std::shared_ptr<const Plan> plan_;
  AlignedFloats hann_;  // one plane of the cosine window
  Scratch patch_, cells_, colored_;
  AlignedFloats planes_, sample_, work_;
  Eigen::ArrayXi cell_work_, cell_sums_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
