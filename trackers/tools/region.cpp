#include "region.hpp"

#include <charconv>

namespace asterism::tools {
namespace {

constexpr std::string_view kBlanks = " \t\r";

std::string_view trim(std::string_view text) {
  const size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

}  // namespace

std::optional<Region> parse_region(std::string_view text) { return to_region(parse_numbers(text)); }

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
      if (text.empty()) return {};  // a separator at the end: a number is missing
    } else if (text.size() == rest.size()) {
      return {};  // no separator: "12px"
    }
  }
  return values;
}

}  // namespace asterism::tools
