#include <algorithm>
#include <asterism/trackers/around/object_search.hpp>
#include <asterism/trackers/tracker/region.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Of the object's size, relative to the one that is asked for.
constexpr std::array kScales{0.8, 1.0, 1.25};
// Cells beside the object in the window that its template is taken from, so that the template has gradients
// across the object's border as the frame has them.
constexpr int kBeside = 2;
// Least correlation of a match.
constexpr double kLeastScore = 0.1;
// Matches that are moved and scaled.
constexpr std::size_t kRefined = 2;

double share_in_common(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common > 0 ? common / (a.area() + b.area() - common) : 0;
}

cv::Rect2d changed(const cv::Rect2d& box, double right, double down, double scale) {
  const double width = scale * box.width, height = scale * box.height;
  return {box.x + right * box.width + (box.width - width) / 2,
          box.y + down * box.height + (box.height - height) / 2, width, height};
}

// Out of `found` the most probable one in its neighbourhood, by steps of an eighth and of a sixteenth.
void refine(const Frame& frame, BoxJudge& judge, ObjectSearch::Found& found) {
  for (const double step : {1.0 / 8, 1.0 / 16}) {
    const cv::Rect2d start = found.box;
    for (const auto& [right, down, scale] : {std::array{-step, 0.0, 1.0},
                                             {step, 0.0, 1.0},
                                             {0.0, -step, 1.0},
                                             {0.0, step, 1.0},
                                             {0.0, 0.0, 1 - step},
                                             {0.0, 0.0, 1 + step}}) {
      ObjectSearch::Found other{changed(start, right, down, scale), {}, 0};
      other.likeness = judge.compare(frame, other.box);
      other.probability = BoxJudge::probability(other.likeness);
      if (other.probability > found.probability) found = other;
    }
  }
}

}  // namespace

void ObjectSearch::init(const Frame& frame, const cv::Rect2d& box) {
  for (std::size_t i = 0; i < kSides.size(); ++i) {
    const int side = kSides[i], all = side + 2 * kBeside;
    const double ratio = static_cast<double>(all) / side;
    sampler_.sample(frame.gray(), centre_of(box), ratio * Size2(box.width, box.height),
                    {kCell * all, kCell * all}, resized_.mat);
    features_.resize(static_cast<std::size_t>(Fhog::kChannels * all * all));
    hog_.compute(resized_.mat, features_.data());
    Eigen::Index at = 0;
    for (int channel = 0; channel < Fhog::kChannels; ++channel)
      for (int row = 0; row < side; ++row)
        for (int col = 0; col < side; ++col)
          objects_[i][at++] =
              features_[static_cast<std::size_t>((channel * all + row + kBeside) * all + col + kBeside)];
    objects_[i].array() -= objects_[i].mean();
    if (const float norm = objects_[i].norm(); norm > 0) objects_[i] /= norm;
  }
}

ObjectSearch::Found ObjectSearch::find(const Frame& frame, const Size2& size, BoxJudge& judge) {
  std::vector<Match> matches;
  for (const double scale : kScales) {
    const Size2 sides = scale * size;
    const Size2 relative = Size2(frame.size().width, frame.size().height).cwiseQuotient(sides);
    const auto fits = [&](std::size_t i) { return relative.prod() * kSides[i] * kSides[i] <= kMostCells[i]; };
    if (fits(0))
      match<kSides[0]>(frame, sides, objects_[0], matches);
    else if (fits(1))
      match<kSides[1]>(frame, sides, objects_[1], matches);
  }
  keep_apart(matches);
  std::vector<Found> judged;
  for (const Match& match : matches) {
    const BoxJudge::Likeness likeness = judge.compare(frame, match.box);
    judged.push_back({match.box, likeness, BoxJudge::probability(likeness)});
  }
  if (judged.empty()) return {};
  const auto more_probable = [](const Found& a, const Found& b) { return a.probability > b.probability; };
  std::ranges::stable_sort(judged, more_probable);
  for (std::size_t i = 0; i < std::min(judged.size(), kRefined); ++i) refine(frame, judge, judged[i]);
  return *std::ranges::min_element(judged, more_probable);
}

template <int kSide>
void ObjectSearch::match(const Frame& frame, const Size2& size, const Eigen::VectorXf& object,
                         std::vector<Match>& out) {
  const cv::Mat& gray = frame.gray();
  // The frame is resized so that the object has kSide x kSide cells.
  const auto cells = [](int pixels, double side) {
    return static_cast<int>(std::lround(pixels * kSide / side));
  };
  const int cols = cells(gray.cols, size.x()), rows = cells(gray.rows, size.y());
  const int wide = cols - kSide + 1, high = rows - kSide + 1;
  if (wide < 1 || high < 1) return;
  const cv::Size grid(kCell * cols, kCell * rows);
  const bool shrinks = grid.width <= gray.cols && grid.height <= gray.rows;
  cv::resize(gray, resized_.mat, grid, 0, 0, shrinks ? cv::INTER_AREA : cv::INTER_LINEAR);
  const auto plane = static_cast<std::size_t>(cols) * static_cast<std::size_t>(rows);
  features_.resize(Fhog::kChannels * plane);
  hog_.compute(resized_.mat, features_.data());

  cv::Mat sum(rows, cols, CV_32F, cv::Scalar(0)), squares(rows, cols, CV_32F, cv::Scalar(0)),
      score(high, wide, CV_32F, cv::Scalar(0));
  for (int channel = 0; channel < Fhog::kChannels; ++channel) {
    const cv::Mat values(rows, cols, CV_32F, features_.data() + static_cast<std::size_t>(channel) * plane);
    sum += values;
    cv::accumulateSquare(values, squares);
    for (int row = 0; row < high; ++row) {
      auto* const result = score.ptr<float>(row);
      for (int down = 0; down < kSide; ++down) {
        const auto* const value = values.ptr<float>(row + down);
        const float* const weight = object.data() + (channel * kSide + down) * kSide;
        for (int col = 0; col < wide; ++col) {
          float product = 0;
          for (int right = 0; right < kSide; ++right) product += weight[right] * value[col + right];
          result[col] += product;
        }
      }
    }
  }
  cv::Mat sums, sums_of_squares;
  cv::integral(sum, sums, CV_64F);
  cv::integral(squares, sums_of_squares, CV_64F);
  const auto in_window = [](const cv::Mat& integral, int row, int col) {
    return integral.at<double>(row + kSide, col + kSide) - integral.at<double>(row, col + kSide) -
           integral.at<double>(row + kSide, col) + integral.at<double>(row, col);
  };
  constexpr double kCount = Fhog::kChannels * kSide * kSide;
  for (int row = 0; row < high; ++row)
    for (int col = 0; col < wide; ++col) {
      const double total = in_window(sums, row, col),
                   variance = in_window(sums_of_squares, row, col) - total * total / kCount;
      float& value = score.at<float>(row, col);
      value = variance > 1e-6 ? static_cast<float>(value / std::sqrt(variance)) : 0;
    }

  // The pixels of the frame that a cell covers.
  const double cell_x = static_cast<double>(gray.cols) / cols, cell_y = static_cast<double>(gray.rows) / rows;
  cv::Mat largest;
  cv::dilate(score, largest, cv::Mat());
  for (int row = 0; row < high; ++row)
    for (int col = 0; col < wide; ++col)
      if (const double value = score.at<float>(row, col);
          value >= kLeastScore && value >= static_cast<double>(largest.at<float>(row, col)))
        out.push_back({value, {col * cell_x, row * cell_y, kSide * cell_x, kSide * cell_y}});
}

void ObjectSearch::keep_apart(std::vector<Match>& matches) {
  std::ranges::stable_sort(matches, [](const Match& a, const Match& b) { return a.score > b.score; });
  std::vector<Match> kept;
  for (const Match& match : matches) {
    if (kept.size() == kMost) break;
    if (std::ranges::none_of(
            kept, [&](const Match& other) { return share_in_common(match.box, other.box) >= 0.5; }))
      kept.push_back(match);
  }
  matches = std::move(kept);
}

void ObjectSearch::visit_state(StateArchive& archive) {
  for (Eigen::VectorXf& object : objects_) {
    archive(object);
    archive.require((object.array().abs() <= 1.001f).all());  // for rounding
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
