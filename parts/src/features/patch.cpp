#include <algorithm>
#include <asterism/parts/features/patch.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "../kernels/part_kernels.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Width of the box filter for one axis: the odd number nearest to the shrink factor; odd, so that it shifts
// nothing. A width of twice the image's `pixels` covers them all already.
int box_filter_width(double shrink, int pixels) {
  shrink = std::min(shrink, 2.0 * pixels);
  return 2 * static_cast<int>(std::lround((shrink - 1) / 2)) + 1;
}

// The pixels in [0, n) that bilinear sampling of [low, high] reads, with a margin. Positions outside the
// image read the border pixel, which is filtered too and therefore needs the margin as well.
cv::Range source_range(double low, double high, int margin, int n) {
  const double last = n - 1;
  const int from = static_cast<int>(std::floor(std::clamp(low, 0.0, last)));
  const int to = static_cast<int>(std::ceil(std::clamp(high, 0.0, last)));
  return {std::max(from - margin, 0), std::min(to + margin, n - 1) + 1};
}

// The grid on which a window is sampled.
struct Lattice {
  Size2 step;          // image pixels per patch pixel
  Point2 first, last;  // image positions of the centres of the first and the last patch pixel
  cv::Size filter;     // size of the box filter

  Lattice(const cv::Mat& image, const Point2& centre, const Size2& size, const cv::Size& grid)
      : step(size.cwiseQuotient(Size2(grid.width, grid.height))) {
    if (!centre.allFinite() || !size.allFinite())
      throw std::invalid_argument("sample_patch: the window must be finite");
    const Size2 half = step.cwiseProduct(Size2(grid.width - 1, grid.height - 1)) / 2;
    first = centre - half;
    last = centre + half;
    filter = {box_filter_width(step.x(), image.cols), box_filter_width(step.y(), image.rows)};
  }
};

}  // namespace

void sample_patch(const cv::Mat& image, const Point2& centre, const Size2& size, const cv::Size& grid,
                  cv::Mat& patch) {
  const auto [step, first, last, filter] = Lattice(image, centre, size, grid);
  const cv::Range cols = source_range(first.x(), last.x(), filter.width / 2 + 1, image.cols);
  const cv::Range rows = source_range(first.y(), last.y(), filter.height / 2 + 1, image.rows);
  cv::Mat source = image(rows, cols);
  if (filter.area() > 1) {
    cv::Mat smooth;
    cv::blur(source, smooth, filter, {-1, -1}, cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
    source = smooth;
  }
  const cv::Matx23d to_source(step.x(), 0, first.x() - cols.start, 0, step.y(), first.y() - rows.start);
  cv::warpAffine(source, patch, to_source, grid, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
}

// Reproduces the fixed-point coordinates of OpenCV: in 1024ths of a pixel, then rounded to 32nds. OpenCV
// rounds step and origin separately along x (`apart`), but their sum along y.
void PatchSampler::Axis::place(double first, double step, int count, int limit, bool apart) {
  pixel.resize(static_cast<std::size_t>(count));
  fraction.resize(static_cast<std::size_t>(count));
  // Clamped: positions so far outside the image only have to keep their sign.
  const auto fixed = [](double v) { return std::llrint(std::clamp(v * 1024, -1e15, 1e15)); };
  for (int i = 0; i < count; ++i) {
    const long long sum = apart ? fixed(first) + fixed(step * i) : fixed(step * i + first);
    const long long position = (sum + 16) >> 5, whole = position >> 5;
    const bool inside = whole >= 0 && whole < limit;
    pixel[static_cast<std::size_t>(i)] = static_cast<std::int32_t>(std::clamp(whole, 0LL, limit - 1LL));
    fraction[static_cast<std::size_t>(i)] = inside ? static_cast<std::int32_t>(position & 31) : 0;
  }
}

// Means over the filter's box around pixels first .. last of row y; borders are replicated.
void PatchSampler::box_filter_row(const cv::Mat& image, int y, const cv::Size& filter, int first, int last,
                                  std::vector<std::uint8_t>& out) {
  const int half = filter.width / 2, limit = image.cols;
  const int low = std::max(first - half, 0), high = std::min(last + half, limit - 1);
  sums_.assign(static_cast<std::size_t>(limit), 0);
  std::int32_t* const sum = sums_.data();
  for (int dy = -(filter.height / 2); dy <= filter.height / 2; ++dy) {
    const std::uint8_t* const row = image.ptr<std::uint8_t>(std::clamp(y + dy, 0, image.rows - 1));
    for (int x = low; x <= high; ++x) sum[x] += row[x];
  }
  out.resize(static_cast<std::size_t>(limit));
  const float scale = 1 / static_cast<float>(filter.area());
  const auto mean = [scale](auto box) {
    // NOLINTNEXTLINE(bugprone-incorrect-roundings): never negative
    return static_cast<std::uint8_t>(static_cast<float>(box) * scale + 0.5F);
  };
  const auto running = [&](int from, int to) {
    const auto at = [&](int x) { return sum[std::clamp(x, 0, limit - 1)]; };
    std::int64_t box = 0;
    for (int x = from - half; x < from + half; ++x) box += at(x);
    for (int x = from; x <= to; ++x) {
      box += at(x + half);
      out[static_cast<std::size_t>(x)] = mean(box);
      box -= at(x - half);
    }
  };
  // Narrow boxes are summed offset by offset along the whole row, which vectorises; wide boxes and those at
  // the border use a running sum.
  constexpr int kNarrow = 9;
  const int inner = std::max(first, half), inner_end = std::min(last + 1, limit - half);
  if (filter.width > kNarrow || filter.height > kNarrow || inner_end <= inner) return running(first, last);
  running(first, inner - 1);
  boxes_.assign(static_cast<std::size_t>(limit), 0);
  std::int32_t* __restrict const box = boxes_.data();
  for (int dx = -half; dx <= half; ++dx)
    for (int x = inner; x < inner_end; ++x) box[x] += sum[x + dx];
  std::uint8_t* __restrict const to = out.data();
  for (int x = inner; x < inner_end; ++x) to[x] = mean(box[x]);
  running(inner_end, last);
}

void PatchSampler::sample(const cv::Mat& image, const Point2& centre, const Size2& size, const cv::Size& grid,
                          cv::Mat& patch) {
  if (image.empty() || image.type() != CV_8UC1)
    throw std::invalid_argument("PatchSampler: the image must be CV_8UC1 and not empty");
  const auto [step, begin, end, filter] = Lattice(image, centre, size, grid);
  x_.place(begin.x(), step.x(), grid.width, image.cols, true);
  y_.place(begin.y(), step.y(), grid.height, image.rows, false);
  patch.create(grid, CV_8UC1);
  work_.resize(static_cast<std::size_t>(image.cols) + 1);

  part_kernels_v0_1::SampledRow row{};
  row.first = x_.pixel.front();
  row.last = std::min(x_.pixel.back() + 1, image.cols - 1);
  row.limit = image.cols;
  row.width = grid.width;
  row.column = x_.pixel.data();
  row.fraction = x_.fraction.data();
  row.work = work_.data();
  // The run of consecutive pixels with equal fractions: without resampling, all but those at the border.
  int run = 1;
  while (row.run_first + run < grid.width && row.column[row.run_first + run] == row.column[row.run_first]) {
    ++row.run_first;
  }
  const auto follows = [&](int x) {
    return row.column[x] == row.column[x - 1] + 1 && row.fraction[x] == row.fraction[x - 1];
  };
  while (row.run_first + run < grid.width && follows(row.run_first + run)) ++run;
  row.run_end = row.run_first + run;

  const auto& kernels = part_kernels_v0_1::kernels();
  for (int y = 0; y < grid.height; ++y) {
    const auto i = static_cast<std::size_t>(y);
    const int upper = y_.pixel[i], lower = std::min(upper + 1, image.rows - 1);
    if (filter.area() > 1) {
      box_filter_row(image, upper, filter, row.first, row.last, above_);
      box_filter_row(image, lower, filter, row.first, row.last, below_);
      row.above = above_.data();
      row.below = below_.data();
    } else {
      row.above = image.ptr<std::uint8_t>(upper);
      row.below = image.ptr<std::uint8_t>(lower);
    }
    row.blend = y_.fraction[i];
    row.out = patch.ptr<std::uint8_t>(y);
    kernels.sample_row(row);
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
