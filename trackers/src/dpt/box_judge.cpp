#include <algorithm>
#include <asterism/trackers/dpt/box_judge.hpp>
#include <cmath>
#include <cstdint>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// The output of: asterism-signs DATA --trackers dpt_plus --kinds pass --frames 200 --out signs.csv
//                fit_judge.py signs.csv folds.tsv
constexpr double kConstant = -8.107;
constexpr BoxJudge::Likeness kWeight{.shape = 11.117, .levels = 1.09, .colors = 10.933};

// The pixels nearest to the middles of kCount equal intervals of [begin, begin + length); outside the image
// its border is continued.
template <std::size_t kCount>
std::array<int, kCount> pixels_along(double begin, double length, int limit) {
  std::array<int, kCount> result;
  for (std::size_t i = 0; i < kCount; ++i) {
    const double at = begin - 0.5 + (static_cast<double>(i) + 0.5) * length / kCount;
    result[i] = static_cast<int>(std::lround(std::clamp(at, 0.0, limit - 1.0)));
  }
  return result;
}

// Without the mean, and of norm 1 where there is contrast.
void standardise(Eigen::VectorXf& values) {
  values.array() -= values.mean();
  if (const float norm = values.norm(); norm > 0) values /= norm;
}

}  // namespace

void BoxJudge::init(const Frame& frame, const cv::Rect2d& box) {
  look(frame, box, first_);
  likeness_ = {};
  judged_ = false;
}

BoxJudge::Likeness BoxJudge::compare(const Frame& frame, const cv::Rect2d& box) {
  look(frame, box, now_);
  return {now_.shape.dot(first_.shape), now_.levels.dot(first_.levels), now_.colors.dot(first_.colors)};
}

void BoxJudge::average(const Likeness& seen) {
  const double rate = judged_ ? kRate : 1;
  judged_ = true;
  const auto move = [rate](double& mean, double value) { mean += rate * (value - mean); };
  move(likeness_.shape, seen.shape);
  move(likeness_.levels, seen.levels);
  move(likeness_.colors, seen.colors);
}

void BoxJudge::restart(const Likeness& seen) {
  judged_ = true;
  likeness_ = seen;
}

double BoxJudge::update(const Frame& frame, const cv::Rect2d& box) {
  average(compare(frame, box));
  return probability(likeness_);
}

double BoxJudge::probability(const Likeness& likeness) {
  const double log_odds = kConstant + kWeight.shape * likeness.shape + kWeight.levels * likeness.levels +
                          kWeight.colors * likeness.colors;
  return 1 / (1 + std::exp(-log_odds));
}

void BoxJudge::look(const Frame& frame, const cv::Rect2d& box, Look& seen) {
  sampler_.sample(frame.gray(), centre_of(box), {box.width, box.height}, {kPixels, kPixels}, patch_.mat);
  hog_.compute(patch_.mat, seen.shape.data());
  standardise(seen.shape);

  seen.levels.setZero();
  for (int row = 0; row < kPixels; ++row)
    for (int col = 0; col < kPixels; ++col)
      seen.levels[row / 2 * kLevels + col / 2] += patch_.mat.at<std::uint8_t>(row, col);
  standardise(seen.levels);

  const cv::Mat& image = frame.bgr().empty() ? frame.gray() : frame.bgr();
  const auto cols = pixels_along<2 * kSamples>(box.x, box.width, image.cols),
             rows = pixels_along<2 * kSamples>(box.y, box.height, image.rows);
  seen.colors.setZero();
  for (std::size_t row = 0; row < rows.size(); row += 2)
    for (std::size_t col = 0; col < cols.size(); col += 2) {
      // The mean of four pixels, as single ones are noisy; of gray images in all channels.
      cv::Vec3i sum = cv::Vec3i::all(0);
      for (const int y : {rows[row], rows[row + 1]})
        for (const int x : {cols[col], cols[col + 1]})
          sum += image.channels() == 3 ? cv::Vec3i(image.at<cv::Vec3b>(y, x))
                                       : cv::Vec3i::all(image.at<std::uint8_t>(y, x));
      const auto bin = [&sum](int channel) { return sum[channel] * kBins / (4 * 256); };
      seen.colors[(bin(0) * kBins + bin(1)) * kBins + bin(2)] += 1;
    }
  seen.colors = seen.colors.cwiseSqrt() / static_cast<float>(kSamples);  // the squares' sum is 1
}

void BoxJudge::visit_state(StateArchive& archive) {
  constexpr double kMost = 1.001;  // for rounding
  for (Eigen::VectorXf* const vector : {&first_.shape, &first_.levels, &first_.colors}) {
    archive(*vector);
    archive.require((vector->array().abs() <= static_cast<float>(kMost)).all());
  }
  for (double* const mean : {&likeness_.shape, &likeness_.levels, &likeness_.colors}) {
    archive(*mean);
    archive.require(std::abs(*mean) <= kMost);
  }
  archive(judged_);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
