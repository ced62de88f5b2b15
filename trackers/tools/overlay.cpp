#include "overlay.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "pen.hpp"

namespace asterism::tools {
namespace {

const cv::Scalar kRed(0, 0, 255);
constexpr double kFaded = 0.35;    // opacity of parts that were not updated
constexpr int kMinReadable = 480;  // height below which the overlay is drawn at twice the size [px]

void draw_part(const Pen& pen, const TrackResult& result, const PartState& part) {
  pen.outline(result.corners(part), kBlue, 1);
  pen.dot(part.position, kBlue, 2);
}

void draw_constellation(const Pen& pen, const TrackResult& result, bool updated) {
  const auto count = static_cast<int>(result.parts.size());
  for (const Link& link : result.links) {
    if (link.i < 0 || link.j < 0 || link.i >= count || link.j >= count) continue;
    const PartState& a = result.parts[static_cast<size_t>(link.i)];
    const PartState& b = result.parts[static_cast<size_t>(link.j)];
    if ((a.updated && b.updated) == updated) pen.line(a.position, b.position, kBlue, 1);
  }
  for (const PartState& part : result.parts) {
    if (part.updated == updated) draw_part(pen, result, part);
  }
}

std::string text(const char* format, double value) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

}  // namespace

cv::Mat to_bgr(const cv::Mat& frame) {
  cv::Mat bgr;
  if (frame.channels() == 1) {
    cv::cvtColor(frame, bgr, cv::COLOR_GRAY2BGR);
  } else {
    bgr = frame.clone();
  }
  return bgr;
}

double overlay_scale(cv::Size frame) { return frame.height < kMinReadable ? 2 : 1; }

void draw_track(cv::Mat& canvas, const TrackResult& result, const View& view, const cv::Scalar& color) {
  if (!result.parts.empty()) {
    cv::Mat faded = canvas.clone();
    draw_constellation({faded, view}, result, false);
    cv::addWeighted(faded, kFaded, canvas, 1 - kFaded, 0, canvas);
    draw_constellation({canvas, view}, result, true);
  }
  const cv::Scalar& shown = result.lost ? kRed : color;
  Pen{canvas, view}.box(result.box, shown, 2);
  if (result.angle != 0) Pen{canvas, view}.outline(result.corners(), shown, 1);
}

void draw_text(cv::Mat& canvas, const std::vector<std::string>& lines, cv::Point corner, double size) {
  int height = 0, baseline = 0;
  height = cv::getTextSize("Ag", cv::FONT_HERSHEY_SIMPLEX, size, 1, &baseline).height;
  for (const std::string& line : lines) {
    corner.y += height;
    cv::putText(canvas, line, corner, cv::FONT_HERSHEY_SIMPLEX, size, kDark, 3, cv::LINE_AA);
    cv::putText(canvas, line, corner, cv::FONT_HERSHEY_SIMPLEX, size, kWhite, 1, cv::LINE_AA);
    corner.y += baseline + 2;
  }
}

cv::Mat draw_overlay(const cv::Mat& frame, std::span<const TrackResult> objects, int number, double fps) {
  cv::Mat canvas = to_bgr(frame);
  const double scale = overlay_scale(frame.size());
  if (scale != 1) cv::resize(canvas, canvas, {}, scale, scale, cv::INTER_CUBIC);
  std::vector<std::string> lines = {"frame " + std::to_string(number)};
  if (fps > 0) lines.push_back(text("%.1f fps", fps));
  if (objects.size() != 1) {
    for (size_t i = 0; i < objects.size(); ++i) {
      const TrackResult& object = objects[i];
      draw_track(canvas, object, {scale, {}}, color_of(i, objects.size()));
      const cv::Rect2d& box = object.box;
      if (!(std::abs(box.x) < 1e6 && std::abs(box.y) < 1e6)) continue;  // nowhere to write
      draw_text(canvas, {std::to_string(i + 1) + (object.lost ? "  LOST" : "")},
                {cvRound(box.x * scale) + 4, cvRound(box.y * scale) + 4});
    }
    draw_text(canvas, lines, {8, 8});
    return canvas;
  }
  const TrackResult& result = objects.front();
  draw_track(canvas, result, {scale, {}});
  if (result.lost) lines.front() += "  LOST";
  if (!result.times.empty()) lines.push_back(text("%.2f ms in all", result.milliseconds()));
  for (const StageTime& t : result.times) {
    lines.push_back(text("%.2f ms ", t.milliseconds) + std::string(t.stage));
  }
  draw_text(canvas, lines, {8, 8});
  return canvas;
}

cv::Rect cut_around(cv::Size frame, const cv::Rect2d& box, const cv::Size2d& region) {
  const cv::Rect all({0, 0}, frame);
  if (!std::isfinite(box.x + box.y + box.width + box.height)) return all;
  const auto place = [](double centre, double length, int limit) {
    return length >= limit ? 0 : static_cast<int>(std::clamp(centre - length / 2, 0.0, limit - length));
  };
  const cv::Rect around(place(box.x + box.width / 2, region.width, frame.width),
                        place(box.y + box.height / 2, region.height, frame.height),
                        cvCeil(std::min<double>(region.width, frame.width)),
                        cvCeil(std::min<double>(region.height, frame.height)));
  return around & all;
}

cv::Scalar color_of(std::size_t index, std::size_t count) {
  const auto hue =
      static_cast<std::uint8_t>((180 * index + 90) / std::max<std::size_t>(1, count));  // none is red
  cv::Mat pixel(1, 1, CV_8UC3, cv::Scalar(hue, 170, 255));
  cv::cvtColor(pixel, pixel, cv::COLOR_HSV2BGR);
  const auto bgr = pixel.at<cv::Vec3b>(0, 0);
  return {double(bgr[0]), double(bgr[1]), double(bgr[2])};
}

Still::Still(const cv::Mat& image, int frame_number) : frame(to_bgr(image)), number(frame_number) {
  constexpr int kMaxSide = 1280;
  if (const int side = std::max(frame.cols, frame.rows); side > kMaxSide) {
    scale = static_cast<double>(kMaxSide) / side;
    cv::resize(frame, frame, {}, scale, scale, cv::INTER_AREA);
  }
}

cv::Mat Still::cut(const cv::Rect2d& box, const cv::Size2d& region, cv::Size tile, View& view) const {
  const auto scaled = [&](double value) { return value * scale; };
  const cv::Rect part =
      cut_around(frame.size(), {scaled(box.x), scaled(box.y), scaled(box.width), scaled(box.height)},
                 {scaled(region.width), scaled(region.height)});
  const double zoom =
      std::min(static_cast<double>(tile.width) / part.width, static_cast<double>(tile.height) / part.height);
  cv::Mat result;
  cv::resize(frame(part), result, {}, zoom, zoom, zoom < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
  view = {zoom * scale, cv::Point2d(part.x / scale, part.y / scale)};
  return result;
}

namespace {

constexpr int kTileGap = 4, kLegend = 36;
constexpr std::size_t kColumns = 4, kTiles = 8;
const cv::Size kTile(480, 360);

}  // namespace

void ContactSheet::add(const cv::Mat& frame, const std::vector<TrackResult>& results,
                       const std::optional<cv::Rect2d>& truth, int number) {
  if (entries_.next()) entries_.keep({Still(frame, number), results, truth});
}

// All tiles have the same magnification, at which the largest box fills this fraction of a tile's width or
// height.
cv::Size2d ContactSheet::region() const {
  constexpr double kBoxInTile = 0.4;
  double width = 64;
  for (const Entry& entry : entries_.members()) {
    const cv::Rect2d& b = entry.results.front().box;
    if (!std::isfinite(b.width + b.height)) continue;
    width = std::max(width, std::max(b.width, b.height * kTile.width / kTile.height) / kBoxInTile);
  }
  return {width, width * kTile.height / kTile.width};
}

void ContactSheet::draw_tile(cv::Mat& tile, const Entry& entry, const View& view) const {
  const TrackResult& first = entry.results.front();
  if (names_.size() == 1) {
    draw_track(tile, first, view);
    draw_text(tile, {std::to_string(entry.still.number) + (first.lost ? "  LOST" : "")}, {8, 8}, 0.7);
    return;
  }
  const Pen pen{tile, view};
  if (entry.truth) pen.box(*entry.truth, kWhite, 1);
  // In reverse, so that the first is on top.
  for (std::size_t i = entry.results.size(); i-- > 0;) {
    pen.box(entry.results[i].box, kDark, 4);
    pen.box(entry.results[i].box, color_of(i, names_.size()), 2);
  }
  draw_text(tile, {std::to_string(entry.still.number)}, {8, 8}, 0.7);
}

cv::Mat ContactSheet::draw() const {
  const std::vector<Entry>& entries = entries_.members();
  if (entries.empty()) return {};
  const cv::Size2d shown = region();
  const int top = names_.size() > 1 ? kLegend : 0;
  cv::Mat sheet(top + 2 * kTile.height + 3 * kTileGap, 4 * kTile.width + 5 * kTileGap, CV_8UC3,
                cv::Scalar::all(32));
  const std::size_t tiles = std::min(kTiles, entries.size());
  for (std::size_t k = 0; k < tiles; ++k) {
    const std::size_t chosen = tiles == 1 ? 0 : (k * (entries.size() - 1) + (tiles - 1) / 2) / (tiles - 1);
    const Entry& entry = entries[chosen];
    View view;
    cv::Mat tile = entry.still.cut(entry.results.front().box, shown, kTile, view);
    draw_tile(tile, entry, view);
    const auto column = static_cast<int>(k % kColumns), row = static_cast<int>(k / kColumns);
    const cv::Point corner(kTileGap + column * (kTile.width + kTileGap),
                           top + kTileGap + row * (kTile.height + kTileGap));
    const cv::Point centred((kTile.width - tile.cols) / 2, (kTile.height - tile.rows) / 2);
    cv::Rect target(corner + centred, tile.size());
    target &= cv::Rect({0, 0}, sheet.size());
    tile(cv::Rect({0, 0}, target.size())).copyTo(sheet(target));
  }
  if (top > 0) draw_legend(sheet);
  return sheet;
}

void ContactSheet::draw_legend(cv::Mat& sheet) const {
  constexpr double kSize = 0.7;
  int x = kTileGap + 8;
  const auto entry = [&](const std::string& name, const cv::Scalar& color) {
    cv::rectangle(sheet, cv::Rect(x, 12, 22, 16), color, 2, cv::LINE_AA);
    draw_text(sheet, {name}, {x + 32, 12}, kSize);
    int baseline = 0;
    x += 64 + cv::getTextSize(name, cv::FONT_HERSHEY_SIMPLEX, kSize, 1, &baseline).width;
  };
  for (std::size_t i = 0; i < names_.size(); ++i) entry(names_[i], color_of(i, names_.size()));
  const auto& entries = entries_.members();
  if (std::any_of(entries.begin(), entries.end(), [](const Entry& e) { return e.truth.has_value(); }))
    entry("ground truth", kWhite);
}

}  // namespace asterism::tools
