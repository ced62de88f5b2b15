#pragma once

// The border between the part models and their compiled kernels. No Eigen and no standard library on it: the
// kernels are compiled for wider instructions than their callers, and whatever both would emit, the linker
// could take from either.
#include <asterism/solver/detail/export.hpp>
#include <cstddef>
#include <cstdint>

/// Moves with the library's version.
namespace asterism::part_kernels_v0_1 {

constexpr int kMaxLanes = 16;   ///< of the widest kernel
constexpr int kMaxPasses = 16;  ///< of a transform: 2^16 points and less

/// A complex transform of n points as passes of small ones (Stockham's self-sorting FFT).
struct Passes {
  int points;
  int count;
  int radix[kMaxPasses];
  /// Of each pass: exp(-2 pi i q k / (radix m)) as (re, im), q = 0 .. m - 1, k = 1 .. radix - 1, where
  /// radix m points are left to transform.
  const float* twiddles[kMaxPasses];
  /// Of a pass whose radix is odd and above 3: cos and then sin of 2 pi j / radix, j = 0 .. radix - 1.
  const float* roots[kMaxPasses];
};

/// The transform of a filter's maps, rows x cols, both multiples of four.
///
/// Spectra of channels are stored in blocks of as many channels as the kernels have lanes: block, row, bin
/// (of cols / 2 + 1), real parts, imaginary parts. That of one plane is split: `padded_rows` rows of
/// `padded_bins` real parts, then as many imaginary ones. A plane itself is stored in blocks of as many rows
/// as there are lanes: block, column, row.
struct Transform {
  int rows, cols, bins;
  int padded_rows, padded_bins;  ///< to multiples of the number of lanes
  Passes down, across;           ///< of rows and of cols / 2 points
  const float* real_twiddles;    ///< exp(-2 pi i k / cols) as (re, im), k = 0 .. cols / 2
};

/// Floats of workspace of every function that takes a Transform.
constexpr std::ptrdiff_t work_floats(int rows, int cols) {
  const std::ptrdiff_t longest = rows > cols ? rows : cols;
  return kMaxLanes * (4 * longest + 5 * cols + 2 * kMaxLanes);
}

/// One row of pixels of a patch, the gray levels of its neighbours, and what its votes are called for.
struct VoteRow {
  const float *above, *here, *below;  ///< of `width` pixels; `here` has one more on either side
  int width, cell_size;
  std::int32_t slot_stride;  ///< of the slots of `votes`, in entries of four floats
  float* magnitude;          ///< workspace, `width` and kMaxLanes more
  std::int32_t* slot;        ///< the same
  const float* weights;      ///< four for each of cell_size phases
  float* votes;
};

/// Cells of one row, and the 31 planes that their features go to.
struct CellRow {
  const float* histogram;        ///< 18 rows of `stride`
  const float *upper, *lower;    ///< normalisers of the blocks above and below; one more than cells
  int cells;                     ///< `stride` has room for kMaxLanes more
  std::ptrdiff_t stride, plane;  ///< [floats]
  float* features;
};

/// A row of a patch and the two rows of the image that it is interpolated from, in 32nds.
struct SampledRow {
  const std::uint8_t *above, *below;
  int blend;                     ///< 32nds of `below`
  int first, last;               ///< pixels of the image's row that are read
  int limit;                     ///< pixels of the image's row: the last one is its own right neighbour
  int width;                     ///< of the patch
  const std::int32_t* column;    ///< left pixel
  const std::int32_t* fraction;  ///< 32nds of its right neighbour
  int run_first, run_end;        ///< where columns are consecutive and have one fraction
  std::int32_t* work;            ///< `limit` and one more
  std::uint8_t* out;
};

/// A round of the alternating direction method of multipliers for Strcf, whose header has its equations.
/// Except for `label`, the real part of a split spectrum, pointers are to spectra of `channels` maps.
struct RegressionRound {
  int channels;
  const float* label;     ///< y
  const float* sample;    ///< x
  const float* previous;  ///< f of the frame before
  float* filter;          ///< f of the round before -> f
  float* multiplier;      ///< h of the round before -> h
  float* constrained;     ///< g of the round before -> penalty f + h, of which `weigh` makes g
  float last_penalty;     ///< gamma of the round before; 0: there was none, g and h are 0
  float penalty;          ///< gamma, > 0
  float temporal;         ///< mu
  bool last;              ///< f is all that is wanted: h and g are left as they are
};

/// One instruction set.
struct KernelSet {
  int lanes;

  /// planes (channels x rows x cols, times `window`) -> spectra; returns the squared norm of what was
  /// transformed. `channels` is a multiple of lanes, here and below.
  double (*forward)(const Transform& t, int channels, const float* planes, const float* window,
                    float* spectra, float* work);
  /// sum over channels of z conj(x) -> split spectrum
  void (*correlate)(const Transform& t, int channels, const float* z, const float* x, float* cross);
  /// sum over channels of |sample|^2 -> split spectrum (its imaginary part is 0), and
  /// templates += rate (sample - templates); returns the squared norm of templates' maps.
  double (*train)(const Transform& t, int channels, float rate, const float* sample, float* templates,
                  float* power);
  /// The filter of a round; returns the response of the sample to it at zero shift.
  double (*regress)(const Transform& t, const RegressionRound& round);
  /// spectra -> those of the maps times `weight` (rows x cols). Rows of zeros cost little.
  void (*weigh)(const Transform& t, int channels, const float* weight, float* spectra, float* work);
  /// Split spectrum -> plane; the spectrum's content is destroyed.
  void (*inverse_plane)(const Transform& t, float* split, float* plane, float* work);
  /// plane -> split spectrum
  void (*forward_plane)(const Transform& t, const float* plane, float* split, float* work);
  /// c -> exp(-max(0, norms - 2 c) factor) - 1, elementwise; `count` a multiple of kMaxLanes or of lanes.
  void (*gaussian)(float norms, float factor, std::ptrdiff_t count, float* plane);

  /// Fhog: magnitudes and orientations of a row's gradients and its votes; one row of cells' features.
  void (*vote_row)(const VoteRow& row);
  /// done = open + upper lanes of the votes, open = their lower lanes, for the 18 orientations of `cells`
  /// cells; energy: sum of squares over the nine unsigned ones. The votes become zero.
  void (*collect)(float* votes, int intervals, int cells, std::ptrdiff_t stride, float* open, float* done,
                  float* energy);
  void (*emit_row)(const CellRow& row);

  void (*sample_row)(const SampledRow& row);
  /// Sums over cell x cell pixels, for a row of cells. work: cell x cells.
  void (*cell_sums)(const std::uint8_t* pixels, std::ptrdiff_t stride, int cell, int cells,
                    std::int32_t* work, std::int32_t* sums);
};

enum Isa : int { kPortable = 0, kAvx2 = 1, kAvx512 = 2 };

/// The kernels for an instruction set, nullptr where this build or this machine does not have it.
ASTERISM_API const KernelSet* kernels(Isa isa);
/// The widest that this machine has, or the one that `prefer` named.
ASTERISM_API const KernelSet& kernels();
/// For tests and benchmarks: what objects made from now on use; nullptr for the widest.
ASTERISM_API void prefer(const KernelSet* set);

}  // namespace asterism::part_kernels_v0_1
