#include "overlay.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <set>

namespace asterism::tools {
namespace {

const cv::Scalar kRed(0, 0, 255), kBlue(255, 112, 16), kWhite(255, 255, 255), kDark(0, 0, 0);
constexpr double kFaded = 0.35;    // opacity of what was not updated
constexpr int kSubpixelBits = 4;   // of the coordinates that OpenCV draws
constexpr int kMinReadable = 480;  // rows below which the overlay is drawn at twice the size

cv::Point subpixel(const cv::Point2d& p) {
  // Far outside is drawn as far outside: coordinates beyond OpenCV's integers would wrap around.
  const auto fixed = [](double v) {
    return static_cast<int>(std::lround(std::clamp(v, -1e6, 1e6) * (1 << kSubpixelBits)));
  };
  return {fixed(p.x), fixed(p.y)};
}

// Drawing in frame coordinates, in which integers are pixel centres, as cv::resize maps them.
struct Pen {
  cv::Mat& canvas;
  const View& view;
  cv::Point2d map(double x, double y) const {
    return {(x + 0.5 - view.origin.x) * view.scale - 0.5, (y + 0.5 - view.origin.y) * view.scale - 0.5};
  }
  void outline(const std::array<cv::Point2d, 4>& corners, const cv::Scalar& colour, int width) const {
    std::vector<cv::Point> drawn;
    for (const cv::Point2d& corner : corners) {
      if (!std::isfinite(corner.x + corner.y)) return;
      // A box begins at the outer edge of its first pixel and ends at that of the last one.
      drawn.push_back(subpixel(map(corner.x - 0.5, corner.y - 0.5)));
    }
    cv::polylines(canvas, drawn, true, colour, width, cv::LINE_AA, kSubpixelBits);
  }
  void part(const TrackResult& result, const PartState& part) const {
    outline(result.corners(part), kBlue, 1);
    if (!part.position.allFinite()) return;
    cv::circle(canvas, subpixel(map(part.position.x(), part.position.y())), 2 << kSubpixelBits, kBlue,
               cv::FILLED, cv::LINE_AA, kSubpixelBits);
  }
  void spring(const PartState& a, const PartState& b) const {
    if (!a.position.allFinite() || !b.position.allFinite()) return;
    cv::line(canvas, subpixel(map(a.position.x(), a.position.y())),
             subpixel(map(b.position.x(), b.position.y())), kBlue, 1, cv::LINE_AA, kSubpixelBits);
  }
};

void draw_constellation(const Pen& pen, const TrackResult& result, bool updated) {
  const auto count = static_cast<int>(result.parts.size());
  for (const Link& link : result.links) {
    if (link.i < 0 || link.j < 0 || link.i >= count || link.j >= count) continue;
    const PartState& a = result.parts[static_cast<size_t>(link.i)];
    const PartState& b = result.parts[static_cast<size_t>(link.j)];
    if ((a.updated && b.updated) == updated) pen.spring(a, b);
  }
  for (const PartState& part : result.parts) {
    if (part.updated == updated) pen.part(result, part);
  }
}

cv::Mat to_bgr(const cv::Mat& frame) {
  cv::Mat bgr;
  if (frame.channels() == 1) {
    cv::cvtColor(frame, bgr, cv::COLOR_GRAY2BGR);
  } else {
    bgr = frame.clone();
  }
  return bgr;
}

std::string text(const char* format, double value) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

}  // namespace

double overlay_scale(cv::Size frame) { return frame.height < kMinReadable ? 2 : 1; }

cv::Scalar colour_of(size_t object) {
  constexpr std::array<std::array<double, 3>, 6> kColours{
      {{0, 255, 255}, {80, 220, 80}, {255, 200, 0}, {240, 80, 240}, {0, 150, 255}, {255, 255, 255}}};
  const auto& [blue, green, red] = kColours[object % kColours.size()];
  return {blue, green, red};
}

void draw_track(cv::Mat& canvas, const TrackResult& result, const View& view, const cv::Scalar& colour) {
  if (!result.parts.empty()) {
    cv::Mat faded = canvas.clone();
    draw_constellation({faded, view}, result, false);
    cv::addWeighted(faded, kFaded, canvas, 1 - kFaded, 0, canvas);
    draw_constellation({canvas, view}, result, true);
  }
  const cv::Scalar& shown = result.lost ? kRed : colour;
  Pen{canvas, view}.outline(turned(result.box, 0), shown, 2);
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
      draw_track(canvas, object, {scale, {}}, colour_of(i));
      const cv::Rect2d& box = object.box;
      if (!(std::abs(box.x) < 1e6 && std::abs(box.y) < 1e6)) continue;  // no place to write at
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

namespace {

constexpr size_t kColumns = 4, kTiles = 8;
constexpr size_t kCandidates = 48;  // kept of a run; even spacing is exact to 1 / 24 of its length
constexpr int kMaxKeptSide = 1280;  // candidates of larger frames are kept smaller [px]
constexpr int kTileWidth = 480, kTileHeight = 360, kTileGap = 4;

}  // namespace

void ContactSheet::add(const cv::Mat& frame, const TrackResult& result, int number) {
  if (count_++ % stride_ != 0) return;
  if (entries_.size() == kCandidates) {
    // Every other one goes; this one is then the next in the series, since kCandidates is even.
    for (size_t i = 1; 2 * i < kCandidates; ++i) std::swap(entries_[i], entries_[2 * i]);
    entries_.resize(kCandidates / 2);
    stride_ *= 2;
  }
  Entry entry{.frame = to_bgr(frame), .scale = 1, .result = result, .number = number};
  if (const int side = std::max(frame.cols, frame.rows); side > kMaxKeptSide) {
    entry.scale = static_cast<double>(kMaxKeptSide) / side;
    cv::resize(entry.frame, entry.frame, {}, entry.scale, entry.scale, cv::INTER_AREA);
  }
  entries_.push_back(std::move(entry));
}

// All tiles show the same magnification, in which the largest box has this part of a tile's height or width.
cv::Size2d ContactSheet::region() const {
  constexpr double kBoxInTile = 0.4;
  double width = 64;
  for (const Entry& entry : entries_) {
    const cv::Rect2d& b = entry.result.box;
    if (!std::isfinite(b.width + b.height)) continue;
    width =
        std::max(width, entry.scale * std::max(b.width, b.height * kTileWidth / kTileHeight) / kBoxInTile);
  }
  return {width, width * kTileHeight / kTileWidth};
}

cv::Rect ContactSheet::cut(const Entry& entry, const cv::Size2d& region) {
  const cv::Rect frame({0, 0}, entry.frame.size());
  const cv::Rect2d& b = entry.result.box;
  if (!std::isfinite(b.x + b.y + b.width + b.height)) return frame;
  const auto place = [](double centre, double length, int limit) {
    return length >= limit ? 0 : static_cast<int>(std::clamp(centre - length / 2, 0.0, limit - length));
  };
  const cv::Rect around(place((b.x + b.width / 2) * entry.scale, region.width, frame.width),
                        place((b.y + b.height / 2) * entry.scale, region.height, frame.height),
                        cvCeil(std::min<double>(region.width, frame.width)),
                        cvCeil(std::min<double>(region.height, frame.height)));
  return around & frame;
}

cv::Mat ContactSheet::draw() const {
  if (entries_.empty()) return {};
  const cv::Size2d shown = region();
  cv::Mat sheet(2 * kTileHeight + 3 * kTileGap, 4 * kTileWidth + 5 * kTileGap, CV_8UC3, cv::Scalar::all(32));
  const size_t tiles = std::min(kTiles, entries_.size());
  for (size_t k = 0; k < tiles; ++k) {
    const size_t chosen = tiles == 1 ? 0 : (k * (entries_.size() - 1) + (tiles - 1) / 2) / (tiles - 1);
    const Entry& entry = entries_[chosen];
    const cv::Rect cut = ContactSheet::cut(entry, shown);
    const double zoom =
        std::min(static_cast<double>(kTileWidth) / cut.width, static_cast<double>(kTileHeight) / cut.height);
    cv::Mat tile;
    cv::resize(entry.frame(cut), tile, {}, zoom, zoom, zoom < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
    draw_track(tile, entry.result,
               {zoom * entry.scale, cv::Point2d(cut.x / entry.scale, cut.y / entry.scale)});
    draw_text(tile, {std::to_string(entry.number) + (entry.result.lost ? "  LOST" : "")}, {8, 8}, 0.7);
    const auto column = static_cast<int>(k % kColumns), row = static_cast<int>(k / kColumns);
    const cv::Point corner(kTileGap + column * (kTileWidth + kTileGap),
                           kTileGap + row * (kTileHeight + kTileGap));
    const cv::Size centred((kTileWidth - tile.cols) / 2, (kTileHeight - tile.rows) / 2);
    cv::Rect target(corner + cv::Point(centred), tile.size());
    target &= cv::Rect({0, 0}, sheet.size());
    tile(cv::Rect({0, 0}, target.size())).copyTo(sheet(target));
  }
  return sheet;
}

}  // namespace asterism::tools
