#include "trax_message.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <system_error>

namespace asterism::tools {
namespace {

constexpr std::string_view kPrefix = "@@TRAX:";
constexpr size_t kLongestKey = 64;

using Type = TraxMessage::Type;

struct Name {
  std::string_view text;
  Type type;
};
// The first implementations sent "status" for "state".
constexpr std::array kNames = {Name{"hello", Type::Hello}, Name{"initialize", Type::Initialize},
                               Name{"frame", Type::Frame}, Name{"state", Type::State},
                               Name{"quit", Type::Quit},   Name{"status", Type::State}};

bool is_alphanumeric(char c) {
  return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

bool is_key(std::string_view text) {
  return !text.empty() && text.size() <= kLongestKey && std::all_of(text.begin(), text.end(), [](char c) {
    return is_alphanumeric(c) || c == '.' || c == '_';
  });
}

bool is_property(std::string_view argument) {
  const size_t equals = argument.find('=');
  return equals != std::string_view::npos && is_key(argument.substr(0, equals));
}

// Removes an argument, quoted or not, from the front of `rest` and resolves its escapes.
std::string take_argument(std::string_view& rest) {
  const bool quoted = rest.front() == '"';
  if (quoted) rest.remove_prefix(1);
  std::string argument;
  while (true) {
    const size_t plain = std::min(rest.find_first_of(quoted ? "\"\\" : "\"\\ \r"), rest.size());
    argument.append(rest.substr(0, plain));
    rest.remove_prefix(plain);
    if (rest.empty()) {
      if (quoted) throw TraxError("the quotes of an argument are not closed");
      return argument;
    }
    const char c = rest.front();
    if (c == '\\') {
      if (rest.size() < 2) throw TraxError("the line ends in a backslash");
      const char escaped = rest[1];
      if (escaped != '"' && escaped != '\\' && escaped != 'n') throw TraxError("unknown escape sequence");
      argument += escaped == 'n' ? '\n' : escaped;
      rest.remove_prefix(2);
    } else if (c == '"') {
      rest.remove_prefix(1);
      if (!quoted) throw TraxError("a quote within an argument that has none at its start");
      if (!rest.empty() && rest.front() != ' ' && rest.front() != '\r') {
        throw TraxError("no blank after an argument's closing quote");
      }
      return argument;
    } else {
      return argument;
    }
  }
}

void append_quoted(std::string& line, std::string_view text) {
  line += " \"";
  for (size_t at = 0; at < text.size();) {
    const size_t plain = std::min(text.find_first_of("\"\\\n", at), text.size());
    line.append(text.substr(at, plain - at));
    if (plain < text.size()) {
      line += '\\';
      line += text[plain] == '\n' ? 'n' : text[plain];
    }
    at = plain + 1;
  }
  line += '"';
}

constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

constexpr auto kValues = [] {
  std::array<std::int8_t, 256> values{};
  values.fill(-1);
  for (size_t i = 0; i < kDigits.size(); ++i) {
    values[static_cast<unsigned char>(kDigits[i])] = static_cast<std::int8_t>(i);
  }
  return values;
}();

}  // namespace

std::string_view to_string(Type type) {
  return std::find_if(kNames.begin(), kNames.end(), [&](const Name& n) { return n.type == type; })->text;
}

bool is_trax_message(std::string_view line) { return line.starts_with(kPrefix); }

TraxMessage parse_trax_message(std::string_view line) {
  if (!is_trax_message(line)) throw TraxError("not a message of the TraX protocol");
  if (line.find('\0') != std::string_view::npos) throw TraxError("a NUL byte in a message");
  if (line.find('\n') != std::string_view::npos) throw TraxError("a message of more than one line");
  line.remove_prefix(kPrefix.size());
  const std::string_view name = line.substr(0, line.find_first_of(" \r"));
  const auto known =
      std::find_if(kNames.begin(), kNames.end(), [&](const Name& n) { return n.text == name; });
  if (known == kNames.end()) {
    constexpr size_t kShown = 32;
    throw TraxError("unknown message '" + std::string(name.substr(0, kShown)) + "'");
  }
  TraxMessage message{known->type, {}, {}};
  std::string_view rest = line.substr(name.size());
  while (true) {
    rest.remove_prefix(std::min(rest.find_first_not_of(" \r"), rest.size()));
    if (rest.empty()) return message;
    std::string argument = take_argument(rest);
    if (!is_property(argument)) {
      message.arguments.push_back(std::move(argument));
      continue;
    }
    const size_t equals = argument.find('=');
    const auto [property, is_new] =
        message.properties.emplace(argument.substr(0, equals), argument.substr(equals + 1));
    if (!is_new) throw TraxError("property " + property->first + " is given twice");
  }
}

std::string format_trax_message(const TraxMessage& message) {
  std::string line(kPrefix);
  line += to_string(message.type);
  for (const std::string& argument : message.arguments) {
    if (is_property(argument)) throw std::invalid_argument("this argument would be a property: " + argument);
    append_quoted(line, argument);
  }
  for (const auto& [key, value] : message.properties) {
    if (!is_key(key)) throw std::invalid_argument("not the name of a property: " + key);
    append_quoted(line, std::string(key).append("=").append(value));
  }
  if (line.find('\0') != std::string::npos) throw std::invalid_argument("a NUL byte in a message");
  return line;
}

std::vector<std::string> split_trax_list(std::string_view list) {
  // The documentation has commas, implementations in use have semicolons.
  constexpr std::string_view kSeparators = ";, ";
  std::vector<std::string> items;
  while (true) {
    list.remove_prefix(std::min(list.find_first_not_of(kSeparators), list.size()));
    if (list.empty()) return items;
    items.emplace_back(list.substr(0, list.find_first_of(kSeparators)));
    list.remove_prefix(items.back().size());
  }
}

std::optional<std::string> LineReader::next() {
  while (true) {
    if (auto line = take()) return line;
    if (!fill()) return {};
  }
}

std::optional<std::string> LineReader::take() {
  const size_t end = buffer_.find('\n', searched_);
  if (end == std::string::npos) {
    searched_ = buffer_.size();
    return {};
  }
  std::string line = buffer_.substr(begin_, end - begin_);
  begin_ = searched_ = end + 1;
  if (begin_ == buffer_.size()) {
    buffer_.clear();
    begin_ = searched_ = 0;
  }
  if (line.size() > longest_) throw TraxError("a line longer than " + std::to_string(longest_) + " bytes");
  return line;
}

bool LineReader::fill() {
  constexpr size_t kChunk = size_t{1} << 16;
  if (buffer_.size() - begin_ > longest_) {
    throw TraxError("a line longer than " + std::to_string(longest_) + " bytes");
  }
  buffer_.erase(0, begin_);
  searched_ -= begin_;
  begin_ = 0;
  std::array<char, kChunk> chunk;
  while (true) {
    const ssize_t count = read(descriptor_, chunk.data(), chunk.size());
    if (count >= 0) {
      buffer_.append(chunk.data(), static_cast<size_t>(count));
      return count > 0;
    }
    if (errno == ECONNRESET) return false;  // the other side closed with unread data
    if (errno != EINTR) throw std::system_error(errno, std::generic_category(), "cannot read");
  }
}

std::string to_base64(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (size_t at = 0; at < bytes.size(); at += 3) {
    const size_t count = std::min<size_t>(3, bytes.size() - at);
    std::uint32_t bits = 0;
    for (size_t i = 0; i < 3; ++i) {
      bits = bits << 8 | (i < count ? static_cast<unsigned char>(bytes[at + i]) : 0u);
    }
    for (size_t i = 0; i < 4; ++i) {
      text += i <= count ? kDigits[bits >> (18 - 6 * i) & 63] : '=';
    }
  }
  return text;
}

std::optional<std::string> from_base64(std::string_view text) {
  if (text.size() % 4 != 0) return {};
  size_t padding = 0;
  while (padding < 2 && padding < text.size() && text[text.size() - 1 - padding] == '=') ++padding;
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  std::uint32_t bits = 0;
  for (size_t at = 0; at < text.size(); ++at) {
    const bool padded = at >= text.size() - padding;
    const int value = padded ? 0 : kValues[static_cast<unsigned char>(text[at])];
    if (value < 0) return {};
    bits = bits << 6 | static_cast<std::uint32_t>(value);
    if (at % 4 == 3) {
      bytes += static_cast<char>(bits >> 16 & 255);
      bytes += static_cast<char>(bits >> 8 & 255);
      bytes += static_cast<char>(bits & 255);
    }
  }
  bytes.resize(bytes.size() - padding);
  return bytes;
}

}  // namespace asterism::tools
