#pragma once

// The interface between the part models and their compiled kernels. It uses neither Eigen nor the standard
// library: the kernels are compiled for wider instructions than their callers, and of an inline function that
// both emit, the linker may keep either copy.
#include <asterism/solver/base/export.hpp>
#include <cstddef>
#include <cstdint>

/// The namespace changes with the library's version.
namespace asterism::part_kernels_v0_1 {

constexpr int kMaxLanes = 16;   ///< of the widest kernel
constexpr int kMaxPasses = 16;  ///< of a transform; enough for 2^16 points

/// A complex transform of n points as a sequence of small ones (Stockham's self-sorting FFT).
struct Passes {
  int points;
  int count;
  int radix[kMaxPasses];
  /// For each pass: exp(-2 pi i q k / (radix m)) as (re, im), q = 0 .. m - 1, k = 1 .. radix - 1, where radix
  /// m points are left to transform.
  const float* twiddles[kMaxPasses];
  /// For a pass whose radix is odd and above 3: cos, then sin, of 2 pi j / radix, j = 0 .. radix - 1.
  const float* roots[kMaxPasses];
};

/// The transform of a filter's maps of rows x cols, both multiples of four.
///
/// Spectra of channels are stored in blocks of as many channels as the kernels have lanes; within a block the
/// order is row, bin (of cols / 2 + 1), real parts, imaginary parts. The spectrum of a plane is split:
/// `padded_rows` rows of `padded_bins` real parts, then as many imaginary ones. A plane itself is stored in
/// blocks of as many rows as there are lanes; within a block the order is column, row.
struct Transform {
  int rows, cols, bins;
  int padded_rows, padded_bins;  ///< rounded up to multiples of the number of lanes
  Passes down, across;           ///< of rows and of cols / 2 points
  const float* real_twiddles;    ///< exp(-2 pi i k / cols) as (re, im), k = 0 .. cols / 2
};

/// Floats of workspace that each function with a Transform needs.
constexpr std::ptrdiff_t work_floats(int rows, int cols) {
  const std::ptrdiff_t longest = rows > cols ? rows : cols;
  return kMaxLanes * (4 * longest + 5 * cols + 2 * kMaxLanes);
}

/// One row of a patch, its neighbours above and below, and where its votes go.
struct VoteRow {
  const float *above, *here, *below;  ///< `width` gray levels; `here` has one more on either side
  int width, cell_size;
  std::int32_t slot_stride;  ///< of the slots of `votes`, in entries of four floats
  float* magnitude;          ///< workspace of `width` + kMaxLanes
  std::int32_t* slot;        ///< workspace of the same size
  const float* weights;      ///< four for each of the cell_size phases
  float* votes;
};

/// One row of cells, and the 31 planes that receive its features.
struct CellRow {
  const float* histogram;        ///< 18 rows of `stride`
  const float *upper, *lower;    ///< normalisers of the cells + 1 blocks above and below
  int cells;                     ///< at most stride - kMaxLanes
  std::ptrdiff_t stride, plane;  ///< [floats]
  float* features;
};

/// A row of a patch, and the two rows of the image between which it is interpolated.
struct SampledRow {
  const std::uint8_t *above, *below;
  int blend;                     ///< weight of `below` [1/32]
  int first, last;               ///< first and last pixel of the image's row that is read
  int limit;                     ///< pixels in the image's row; the last one is its own right neighbour
  int width;                     ///< of the patch
  const std::int32_t* column;    ///< index of the left pixel
  const std::int32_t* fraction;  ///< weight of its right neighbour [1/32]
  int run_first, run_end;        ///< [run_first, run_end) has consecutive columns and one fraction
  std::int32_t* work;            ///< workspace of `limit` + 1
  std::uint8_t* out;
};

/// One round of the alternating direction method of multipliers (ADMM) for Strcf, whose header gives the
/// equations. Pointers are to spectra of `channels` maps, except `label`: the real part of a split spectrum.
struct RegressionRound {
  int channels;
  const float* label;     ///< y
  const float* sample;    ///< x
  const float* previous;  ///< f of the previous frame
  float* filter;          ///< f of the previous round -> f
  float* multiplier;      ///< h of the previous round -> h
  float* constrained;     ///< g of the previous round -> penalty f + h, from which `weigh` makes g
  float last_penalty;     ///< gamma of the previous round; 0 in the first, where g and h are 0
  float penalty;          ///< gamma, > 0
  float temporal;         ///< mu
  bool last;              ///< only f is needed; h and g stay unchanged
};

/// The kernels for one instruction set.
struct KernelSet {
  int lanes;

  /// planes (channels x rows x cols), multiplied by `window` -> spectra; returns the squared norm of the
  /// product. `channels` is a multiple of lanes, here and below.
  double (*forward)(const Transform& t, int channels, const float* planes, const float* window,
                    float* spectra, float* work);
  /// sum over channels of z conj(x) -> split spectrum
  void (*correlate)(const Transform& t, int channels, const float* z, const float* x, float* cross);
  /// sum over channels of |sample|^2 -> split spectrum (its imaginary part is 0), and
  /// templates += rate (sample - templates); returns the squared norm of templates' maps.
  double (*train)(const Transform& t, int channels, float rate, const float* sample, float* templates,
                  float* power);
  /// Computes the filter of a round; returns the response of the sample to it at zero shift.
  double (*regress)(const Transform& t, const RegressionRound& round);
  /// spectra -> spectra of the maps multiplied by `weight` (rows x cols). Rows of zeros cost little.
  void (*weigh)(const Transform& t, int channels, const float* weight, float* spectra, float* work);
  /// Split spectrum -> plane; overwrites the spectrum.
  void (*inverse_plane)(const Transform& t, float* split, float* plane, float* work);
  /// plane -> split spectrum
  void (*forward_plane)(const Transform& t, const float* plane, float* split, float* work);
  /// c -> exp(-max(0, norms - 2 c) factor) - 1, elementwise; `count` is a multiple of kMaxLanes or of lanes.
  void (*gaussian)(float norms, float factor, std::ptrdiff_t count, float* plane);

  /// For Fhog: gradients of a row and their votes; features of a row of cells.
  void (*vote_row)(const VoteRow& row);
  /// done = open + upper lanes of the votes, open = their lower lanes, for the 18 orientations of `cells`
  /// cells; energy: sum of squares over the nine unsigned ones. The votes become zero.
  void (*collect)(float* votes, int intervals, int cells, std::ptrdiff_t stride, float* open, float* done,
                  float* energy);
  void (*emit_row)(const CellRow& row);

  void (*sample_row)(const SampledRow& row);
  /// Sums over cell x cell pixels, for one row of cells. Size of work: cell x cells.
  void (*cell_sums)(const std::uint8_t* pixels, std::ptrdiff_t stride, int cell, int cells,
                    std::int32_t* work, std::int32_t* sums);
};

enum Isa : int { kPortable = 0, kAvx2 = 1, kAvx512 = 2 };

/// The kernels for an instruction set; nullptr if this build or this machine does not have it.
ASTERISM_API const KernelSet* kernels(Isa isa);
/// The widest kernels that this machine has, or those set by `prefer`.
ASTERISM_API const KernelSet& kernels();
/// For tests and benchmarks: the kernels that objects constructed from now on use; nullptr for the widest.
ASTERISM_API void prefer(const KernelSet* set);

}  // namespace asterism::part_kernels_v0_1
