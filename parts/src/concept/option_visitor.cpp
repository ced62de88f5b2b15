#include <array>
#include <asterism/parts/concept/option_visitor.hpp>
#include <charconv>
#include <stdexcept>
#include <string>

namespace asterism {
inline namespace ASTERISM_ABI {

void detail::RangeCheck::refuse(std::string_view name, double value, const OptionRange& range) const {
  const auto text = [](double number) {
    std::array<char, 32> buffer{};
    return std::string(buffer.data(),
                       std::to_chars(buffer.data(), buffer.data() + buffer.size(), number).ptr);
  };
  std::string message(of_);
  message += ": ";
  for (const std::string_view options : path_) message.append(options).append(1, '.');
  message.append(name) +=
      " must be in [" + text(range.least) + ", " + text(range.most) + "], is " + text(value);
  throw std::invalid_argument(message);
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
