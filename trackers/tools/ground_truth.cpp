#include "ground_truth.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace asterism::tools {
namespace {

// Why the numbers of one line are not an annotation; empty where they are one.
std::string reason_against(const std::vector<double>& v) {
  if (v.size() < 4 || v.size() % 2 != 0) return "4, 6, 8, .. numbers expected";
  if (std::any_of(v.begin(), v.end(), [](double d) { return std::isinf(d); }))
    return "a number is not finite";
  if (v.size() == 4 && (v[2] < 0 || v[3] < 0)) return "the box's width or height is negative";
  return {};
}

}  // namespace

std::vector<std::optional<Region>> read_ground_truth(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path.string() + ": " + std::strerror(errno));
  std::vector<std::optional<Region>> truths;
  size_t number = 0, first_empty = 0;
  const auto fail = [&](size_t line, const std::string& reason) {
    throw std::runtime_error(path.string() + ":" + std::to_string(line) + ": " + reason);
  };
  for (std::string line; std::getline(file, line);) {
    ++number;
    // Empty lines may end the file; before an annotation they would silently shift all frames that follow.
    if (line.find_first_not_of(" \t\r") == std::string::npos) {
      if (first_empty == 0) first_empty = number;
      continue;
    }
    if (first_empty != 0) fail(first_empty, "empty line");
    const std::vector<double> values = parse_numbers(line);
    if (const std::string reason = reason_against(values); !reason.empty()) fail(number, reason);
    std::optional<Region> region = to_region(values);  // NaN is none
    if (region && region->box().empty()) region.reset();
    truths.push_back(std::move(region));
  }
  if (file.bad()) fail(number + 1, "cannot be read");
  if (truths.empty()) fail(1, "no annotation in the file");
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
