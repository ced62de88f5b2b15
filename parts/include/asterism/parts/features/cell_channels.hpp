#pragma once

#include <asterism/solver/base/config.hpp>
#include <opencv2/core.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Channels of a program's own for the correlation filters Kcf and Strcf (CellFeatures::own): numbers that
/// describe each cell of a search window. Filters that are copied share the object, and may be used in
/// several threads, so `compute` must be safe to call from several threads at once, and depend on its
/// arguments alone.
class CellChannels {
 public:
  virtual ~CellChannels() = default;
  /// The number of channels, >= 1; always the same.
  virtual int channels() const = 0;
  /// window: BGR, 8 bits a channel, of as many square cells as `rows` x `cols` says. planes: `channels()`
  /// maps of rows x cols, one after the other, row by row. All values must be finite. They are weighed like
  /// those of HOG if their root mean square is about `kTypical`.
  virtual void compute(const cv::Mat& window, int rows, int cols, float* planes) const = 0;

  /// The root mean square of HOG's channels on textured windows.
  static constexpr float kTypical = 0.2F;

 protected:
  CellChannels() = default;                                ///< For classes of channels.
  CellChannels(const CellChannels&) = default;             ///< A copy.
  CellChannels& operator=(const CellChannels&) = default;  ///< A copy.
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
