#include "ground_truth.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <string>

namespace asterism::tools {
namespace {

constexpr std::string_view kBlanks = " \t\r";

std::string_view trim(std::string_view text) {
  const size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

GroundTruth from_numbers(const std::vector<double>& v) {
  GroundTruth truth;
  truth.visible = std::none_of(v.begin(), v.end(), [](double d) { return std::isnan(d); });
  if (v.size() == 4) {
    truth.box = {v[0], v[1], v[2], v[3]};
    const double right = v[0] + v[2], bottom = v[1] + v[3];
    truth.polygon = {{v[0], v[1]}, {right, v[1]}, {right, bottom}, {v[0], bottom}};
  } else {
    for (size_t i = 0; i < v.size(); i += 2) truth.polygon.emplace_back(v[i], v[i + 1]);
    const auto [left, right] = std::minmax({v[0], v[2], v[4], v[6]});
    const auto [top, bottom] = std::minmax({v[1], v[3], v[5], v[7]});
    truth.box = {left, top, right - left, bottom - top};
  }
  truth.visible = truth.visible && truth.box.width > 0 && truth.box.height > 0;
  return truth;
}

// Why the numbers of one line are not an annotation; empty where they are one.
std::string reason_against(const std::vector<double>& v) {
  if (v.size() != 4 && v.size() != 8) return "4 or 8 numbers expected";
  if (std::any_of(v.begin(), v.end(), [](double d) { return std::isinf(d); }))
    return "a number is not finite";
  if (v.size() == 4 && (v[2] < 0 || v[3] < 0)) return "the box's width or height is negative";
  return {};
}

}  // namespace

std::vector<double> parse_numbers(std::string_view text) {
  std::vector<double> values;
  text = trim(text);
  while (!text.empty()) {
    if (text.front() == '+') text.remove_prefix(1);
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{}) return {};
    values.push_back(value);
    const std::string_view rest = text.substr(static_cast<size_t>(end - text.data()));
    text = trim(rest);
    if (text.empty()) break;
    if (text.front() == ',' || text.front() == ';') {
      text = trim(text.substr(1));
      if (text.empty()) return {};  // ends in a separator: a number is missing
    } else if (text.size() == rest.size()) {
      return {};  // no separator: "12px"
    }
  }
  return values;
}

std::vector<GroundTruth> read_ground_truth(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path.string() + ": " + std::strerror(errno));
  std::vector<GroundTruth> truths;
  size_t number = 0, first_empty = 0;
  const auto fail = [&](size_t line, const std::string& reason) {
    throw std::runtime_error(path.string() + ":" + std::to_string(line) + ": " + reason);
  };
  for (std::string line; std::getline(file, line);) {
    ++number;
    // Empty lines may end the file; before an annotation they would silently shift all frames that follow.
    if (trim(line).empty()) {
      if (first_empty == 0) first_empty = number;
      continue;
    }
    if (first_empty != 0) fail(first_empty, "empty line");
    const std::vector<double> values = parse_numbers(line);
    if (const std::string reason = reason_against(values); !reason.empty()) fail(number, reason);
    truths.push_back(from_numbers(values));
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
