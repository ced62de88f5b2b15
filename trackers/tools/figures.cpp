#include "figures.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "pen.hpp"

namespace asterism::tools {
namespace {

constexpr std::size_t kMostParts = 16;
const cv::Scalar kPaper(24, 24, 24), kAxis(150, 150, 150), kBlocked(50, 40, 150), kOrange(40, 140, 255),
    kYellow(0, 255, 255);

// Layout of the timeline [px].
constexpr int kLeft = 110, kRight = 20, kFooter = 34, kStrip = 110, kStripGap = 10;
constexpr int kShots = 10;
const cv::Size kShot(150, 150);

std::string format(const char* pattern, double value) {
  char text[32];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

void blend(cv::Mat area, const cv::Scalar& color, double opacity) {
  cv::Mat painted(area.size(), area.type(), color);
  cv::addWeighted(painted, opacity, area, 1 - opacity, 0, area);
}

}  // namespace

void Timeline::add(const cv::Mat& frame, const TrackResult& result, int number) {
  if (frames_++ == 0 && result.parts.empty()) return;  // the result of init
  if (result.parts.empty() || result.parts.size() > kMostParts ||
      (!moments_.empty() && moments_.front().weights.size() != result.parts.size()))
    throw std::runtime_error("--timeline: needs a tracker with 1 to 16 parts whose number does not change");
  Moment& moment = moments_.emplace_back();
  moment.number = number;
  moment.threshold = result.update_threshold;
  for (const PartState& part : result.parts) {
    moment.weights.push_back(part.weight);
    moment.updated.push_back(part.updated);
  }
  if (shots_.next()) shots_.keep({Still(frame, number), result});
}

double Timeline::position(int number) const {
  const double first = moments_.front().number, last = moments_.back().number;
  return last > first ? (number - first) / (last - first) : 0.5;
}

// Each place in the film shows the frame nearest in time to the middle of that place.
void Timeline::draw_film(const cv::Mat& film) const {
  const std::vector<Shot>& shots = shots_.members();
  const std::size_t parts = moments_.front().weights.size();
  for (int k = 0; k < kShots; ++k) {
    const double time = (k + 0.5) / kShots;
    const Shot& shot = *std::min_element(shots.begin(), shots.end(), [&](const Shot& a, const Shot& b) {
      return std::abs(position(a.still.number) - time) < std::abs(position(b.still.number) - time);
    });
    const cv::Rect2d& box = shot.result.box;
    const double side = 1.7 * std::max(box.width, box.height);
    View view;
    cv::Mat tile = shot.still.cut(box, {side, side}, kShot - cv::Size(6, 6), view);
    for (std::size_t i = 0; i < parts; ++i) {
      const PartState& part = shot.result.parts[i];
      const cv::Rect2d covered = box_around(part.position, part.size);
      const Pen pen{tile, view};
      if (!part.updated) {
        const cv::Point2d corner = pen.map(covered.x - 0.5, covered.y - 0.5);
        const cv::Rect area =
            cv::Rect(cvRound(corner.x), cvRound(corner.y), cvRound(covered.width * view.scale),
                     cvRound(covered.height * view.scale)) &
            cv::Rect({0, 0}, tile.size());
        if (!area.empty()) blend(tile(area), kBlocked, 0.5);
      }
      pen.box(covered, color_of(i, parts), 2);
    }
    draw_text(tile, {std::to_string(shot.still.number)}, {5, 5}, 0.45);
    const cv::Rect place(kLeft + k * kShot.width + (kShot.width - tile.cols) / 2,
                         (kShot.height - tile.rows) / 2, tile.cols, tile.rows);
    tile.copyTo(film(place));
  }
}

void Timeline::draw_strip(cv::Mat strip, std::size_t part, double top) const {
  const auto x = [&](int number) {
    return static_cast<int>(std::lround(position(number) * (strip.cols - 1)));
  };
  const auto y = [&](double weight) {
    return static_cast<int>(std::lround((1 - std::clamp(weight / top, 0.0, 1.0)) * (strip.rows - 1)));
  };
  strip.setTo(cv::Scalar(40, 40, 40));
  for (std::size_t k = 0; k < moments_.size(); ++k) {
    if (moments_[k].updated[part]) continue;
    const int from = x(moments_[k].number),
              to = k + 1 < moments_.size() ? x(moments_[k + 1].number) : from + 1;
    strip.colRange(from, std::clamp(to, from + 1, strip.cols)).setTo(kBlocked);
  }
  std::vector<cv::Point> weights, threshold;
  for (const Moment& moment : moments_) {
    weights.emplace_back(x(moment.number), y(moment.weights[part]));
    threshold.emplace_back(x(moment.number), y(moment.threshold));
  }
  cv::polylines(strip, threshold, false, kAxis, 1, cv::LINE_AA);
  cv::polylines(strip, weights, false, color_of(part, moments_.front().weights.size()), 2, cv::LINE_AA);
}

cv::Mat Timeline::draw() const {
  if (moments_.empty()) return {};
  const auto parts = moments_.front().weights.size();
  double top = 0.1;
  for (const Moment& moment : moments_)
    for (const double weight : moment.weights) top = std::max(top, weight);
  const int width = kShots * kShot.width, strips = static_cast<int>(parts) * (kStrip + kStripGap);
  cv::Mat canvas(kShot.height + 30 + strips + kFooter, kLeft + width + kRight, CV_8UC3, kPaper);
  draw_film(canvas);
  draw_text(canvas, {"weight of each part; gray: threshold of the update; red: not updated"},
            {kLeft, kShot.height + 4});
  for (std::size_t i = 0; i < parts; ++i) {
    const int row = kShot.height + 30 + static_cast<int>(i) * (kStrip + kStripGap);
    draw_strip(canvas(cv::Rect(kLeft, row, width, kStrip)), i, top);
    cv::rectangle(canvas, cv::Rect(8, row + kStrip / 2 - 8, 14, 16), color_of(i, parts), cv::FILLED);
    draw_text(canvas, {"part " + std::to_string(i + 1)}, {28, row + kStrip / 2 - 6});
    draw_text(canvas, {format("%.1f", top)}, {kLeft - 28, row}, 0.35);
    draw_text(canvas, {"0"}, {kLeft - 12, row + kStrip - 10}, 0.35);
  }
  for (int k = 0; k <= kShots; ++k) {
    const Moment& first = moments_.front();
    const int frame = first.number + (moments_.back().number - first.number) * k / kShots;
    const int x = kLeft + static_cast<int>(position(frame) * (width - 1));
    cv::line(canvas, {x, canvas.rows - kFooter - kStripGap}, {x, canvas.rows - kFooter - kStripGap + 6},
             kAxis);
    draw_text(canvas, {std::to_string(frame)}, {x - 14, canvas.rows - kFooter + 2});
  }
  return canvas;
}

cv::Mat draw_solve(const cv::Mat& frame, const SolveWatch::Solve& solve, const TrackResult& result,
                   int number) {
  constexpr double kAround = 1.3, kNominal = 0.001;
  constexpr int kPanel = 640, kTitle = 52;
  const Still still(frame, number);
  const double side = kAround * std::max(result.box.width, result.box.height);
  Dpt::Placement after = solve.start;
  for (std::size_t i = 0; i < result.parts.size(); ++i)
    after.col(static_cast<Eigen::Index>(i)) = result.parts[i].position;

  cv::Mat canvas(kTitle + kPanel, 2 * kPanel + 4, CV_8UC3, kPaper);
  for (const bool solved : {false, true}) {
    const Dpt::Placement& x = solved ? after : solve.start;
    View view;
    cv::Mat panel = still.cut(result.box, {side, side}, {kPanel, kPanel}, view);
    panel.convertTo(panel, -1, 0.6);  // so that lines stand out
    const Pen pen{panel, view};
    for (Eigen::Index i = 0; i < x.cols(); ++i) {
      pen.box(box_around(x.col(i), result.parts[static_cast<std::size_t>(i)].size), kAxis, 1);
      pen.line(x.col(i), solve.springs.anchors().col(i), kWhite, 1);
    }
    if (solved) pen.box(result.box, kYellow, 2);
    for (int l = 0; const auto [i, j] : solve.springs.links()) {
      const double length = (x.col(i) - x.col(j)).norm(), nominal = solve.springs.rest_lengths()(0, l++);
      const bool near = std::abs(length - nominal) <= kNominal * nominal;
      pen.line(x.col(i), x.col(j), near ? kWhite : length > nominal ? kOrange : kBlue, 2);
    }
    for (Eigen::Index i = 0; i < x.cols(); ++i) {
      pen.dot(x.col(i), kDark, 7);
      pen.dot(x.col(i), color_of(static_cast<std::size_t>(i), result.parts.size()), 5);
      pen.cross(solve.springs.anchors().col(i), kDark, 5, 7);
      pen.cross(solve.springs.anchors().col(i), color_of(static_cast<std::size_t>(i), result.parts.size()), 2,
                7);
    }
    const int left = solved ? kPanel + 4 : 0;
    panel.copyTo(canvas(cv::Rect(left + (kPanel - panel.cols) / 2, kTitle + (kPanel - panel.rows) / 2,
                                 panel.cols, panel.rows)));
    const Summary& summary = solve.summary;
    const std::string title = solved ? "after " + std::to_string(summary.iterations) + " iterations of " +
                                           std::string(summary.solver) + ": energy " +
                                           format("%.4g", summary.final_energy)
                                     : "frame " + std::to_string(number) + ", before: energy " +
                                           format("%.4g", summary.initial_energy);
    draw_text(canvas,
              {title, solved ? "springs: orange stretched, blue pressed, white within 0.1 %"
                             : "dots: parts; crosses: where they look best"},
              {left + 8, 6}, 0.5);
  }
  return canvas;
}

}  // namespace asterism::tools
