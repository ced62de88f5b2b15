#pragma once

#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <charconv>
#include <cstddef>
#include <cstring>
#include <ostream>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

/// A short text without heap memory; a text that is too long is cut off.
class Message {
 public:
  Message() = default;
  /// The text, as far as it fits.
  Message(std::string_view text) { append(text); }
  Message(const char* text) : Message(std::string_view(text)) {}

  /// "<subject> <index> <problem>", empty for no defect.
  Message(const Defect& defect) {
    if (!defect) return;
    append(defect.subject).append(" ");
    if (defect.index != Defect::kNoIndex) append(defect.index).append(" ");
    append(defect.problem);
  }

  /// In place, as a solve of a microsecond notices a copy.
  Message& assign(std::string_view text) {
    size_ = 0;
    return append(text);
  }
  /// No text.
  void clear() { size_ = 0; }

  /// Adds a text or a number, as far as it fits.
  Message& append(std::string_view text) {
    const std::size_t count = std::min(text.size(), sizeof text_ - size_);
    std::memcpy(text_ + size_, text.data(), count);
    size_ += count;
    return *this;
  }

  /// Adds a text or a number, as far as it fits.
  Message& append(int value) {
    char digits[16];
    return append({digits, static_cast<std::size_t>(std::to_chars(digits, digits + sizeof digits, value).ptr -
                                                    digits)});
  }

  /// The text; valid while the message lives.
  operator std::string_view() const { return {text_, size_}; }
  /// Whether there is no text.
  bool empty() const { return size_ == 0; }

  /// Whether it is this text.
  friend bool operator==(const Message& a, std::string_view b) { return std::string_view(a) == b; }
  friend std::ostream& operator<<(std::ostream& out, const Message& message) {
    return out << std::string_view(message);
  }

 private:
  std::size_t size_ = 0;
  char text_[168];
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
