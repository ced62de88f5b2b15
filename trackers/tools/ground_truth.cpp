#include "ground_truth.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

namespace asterism::tools {
namespace {

bool is_whole(double value) { return std::isfinite(value) && value == std::floor(value); }

// The reason why the numbers of one line are not an annotation; empty if they are.
std::string reason_against(const std::string& line, const std::vector<double>& v) {
  if (line.starts_with('m')) return "masks are not supported: boxes or polygons are needed";
  if (v.size() == 1 && is_whole(v[0]) && v[0] >= 0)
    return {};  // the toolkit's code for a frame without an object
  if (v.size() < 4 || v.size() % 2 != 0)
    return "4, 6, 8, .. numbers expected: x,y,width,height or the corners of a polygon";
  if (std::any_of(v.begin(), v.end(), [](double d) { return std::isinf(d); }))
    return "a number is not finite";
  if (v.size() == 4 && (v[2] < 0 || v[3] < 0))
    return "the box's width or height is negative: NaN,NaN,NaN,NaN says that there is no object";
  if (v.size() > 4 && std::none_of(v.begin(), v.end(), [](double d) { return std::isnan(d); }) &&
      !to_region(v))
    return "a polygon of more than 10,000 corners";
  return {};
}

}  // namespace

std::vector<std::string> read_lines(const std::filesystem::path& path) {
  std::error_code error;
  if (std::filesystem::exists(path, error) && !std::filesystem::is_regular_file(path, error))
    throw std::runtime_error(path.string() + ": not a file");
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error(path.string() + ": " + std::strerror(errno));
  const std::string content{std::istreambuf_iterator<char>(file), {}};
  if (file.bad()) throw std::runtime_error(path.string() + ": cannot be read");
  std::vector<std::string> lines;
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  for (size_t begin = content.starts_with(kMark) ? kMark.size() : 0; begin < content.size();) {
    const size_t end = std::min(content.find_first_of("\r\n", begin), content.size());
    lines.push_back(content.substr(begin, end - begin));
    begin = end + 1;
    // A line that was converted twice ends in CR CR LF.
    if (const size_t feed = content.find_first_not_of('\r', end);
        feed < content.size() && content[feed] == '\n')
      begin = feed + 1;
  }
  return lines;
}

bool are_mot_lines(std::span<const std::vector<double>> lines) {
  std::map<double, double> last;  // last frame of each id
  size_t columns = 0;
  double first = 2;
  for (const std::vector<double>& line : lines) {
    if (line.empty()) continue;
    if (columns == 0) columns = line.size();
    // Eight numbers are polygons of VOT.
    if (line.size() != columns || columns < 6 || columns > 10 || columns == 8) return false;
    if (!is_whole(line[0]) || !is_whole(line[1]) || !(line[4] > 0) || !(line[5] > 0)) return false;
    const auto [found, is_new] = last.emplace(line[1], line[0]);
    if (!is_new && found->second >= line[0]) return false;
    found->second = line[0];
    first = std::min(first, line[0]);
  }
  return first == 0 || first == 1;
}

std::vector<std::optional<Region>> read_ground_truth(const std::filesystem::path& path) {
  const auto fail = [&](size_t line, const std::string& reason) {
    throw std::runtime_error(path.string() + ":" + std::to_string(line) + ": " + reason);
  };
  const std::vector<std::string> lines = read_lines(path);
  std::vector<std::vector<double>> numbers;
  numbers.reserve(lines.size());
  for (const std::string& line : lines) numbers.push_back(parse_numbers(line));
  if (are_mot_lines(numbers)) fail(1, kMotAdvice);

  std::vector<std::optional<Region>> truths;
  size_t first_empty = 0, first_code = 0;
  for (size_t i = 0; i < lines.size(); ++i) {
    // Empty lines are allowed at the end of the file; elsewhere they would silently shift all later frames.
    if (lines[i].find_first_not_of(" \t") == std::string::npos) {
      if (first_empty == 0) first_empty = i + 1;
      continue;
    }
    if (first_empty != 0) fail(first_empty, "empty line");
    if (const std::string reason = reason_against(lines[i], numbers[i]); !reason.empty()) fail(i + 1, reason);
    if (first_code == 0 && numbers[i].size() == 1) first_code = i + 1;
    std::optional<Region> region = to_region(numbers[i]);  // none for NaN and codes
    if (region && region->box().empty()) region.reset();
    truths.push_back(std::move(region));
  }
  if (truths.empty()) fail(1, "no annotation in the file");
  // Trackers start on boxes of at least a pixel.
  const auto in_unit_square = [](const std::optional<Region>& truth) {
    const cv::Rect2d box = truth ? truth->box() : cv::Rect2d(0, 0, 1, 1);
    return box.x >= 0 && box.y >= 0 && box.x <= 1 && box.y <= 1 && box.width <= 1 && box.height <= 1;
  };
  const auto first = std::find_if(truths.begin(), truths.end(), [](const auto& t) { return t.has_value(); });
  if (first != truths.end() && std::all_of(truths.begin(), truths.end(), in_unit_square))
    fail(
        static_cast<size_t>(first - truths.begin()) + 1,
        "all numbers are at most 1, as in YOLO's form, which divides by the image's size: pixels are needed, "
        "x,y,width,height of the left top corner");
  if (first_code > 0 &&
      std::none_of(truths.begin(), truths.end(), [](const auto& t) { return t.has_value(); }))
    fail(first_code, "codes alone, and no box or polygon");
  return truths;
}

double overlap(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double width = std::min(a.x + a.width, b.x + b.width) - std::max(a.x, b.x);
  const double height = std::min(a.y + a.height, b.y + b.height) - std::max(a.y, b.y);
  if (!(width > 0 && height > 0)) return 0;
  const double common = width * height;
  const double iou = common / (a.width * a.height + b.width * b.height - common);
  return std::isfinite(iou) ? iou : 0;
}

}  // namespace asterism::tools
