#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::tools {

/// An error in the TraX protocol, such as a message in the wrong place; `what` is the reason.
class TraxError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// One message of the TraX protocol.
struct TraxMessage {
  enum class Type { Hello, Initialize, Frame, State, Quit };

  Type type;
  std::vector<std::string> arguments;
  std::map<std::string, std::string> properties;

  friend bool operator==(const TraxMessage&, const TraxMessage&) = default;
};

/// The message's name in its line.
std::string_view to_string(TraxMessage::Type type);

/// True for a line that begins as a message does; all others are what a tracker happens to print.
bool is_trax_message(std::string_view line);

/// A message from its line, without the line's end. An argument is a property where letters, digits, dots and
/// underscores, at most 64, stand before its first '='. Throws TraxError.
TraxMessage parse_trax_message(std::string_view line);

/// The line that `parse_trax_message` reads, without its end. Throws std::invalid_argument where no line says
/// the message: an argument that would be a property, a property's name that is none, a NUL byte.
std::string format_trax_message(const TraxMessage& message);

/// The items of a list in a hello message, "path;memory;".
std::vector<std::string> split_trax_list(std::string_view list);

/// Lines from a file descriptor, as they come.
class LineReader {
 public:
  /// Room for a frame of 7680 x 4320 pixels in base64.
  static constexpr size_t kLongestLine = size_t{128} << 20;

  explicit LineReader(int descriptor, size_t longest = kLongestLine)
      : descriptor_(descriptor), longest_(longest) {}

  /// The next line without its end, waiting for it; empty at the end of the input, where a line that is not
  /// ended is dropped.
  std::optional<std::string> next();

  /// The next line if it has come already. Throws TraxError for a line that is too long.
  std::optional<std::string> take();
  /// Waits for more input and takes in what there is; false at its end. Throws std::system_error where it
  /// cannot be read and TraxError where too much waits to be taken.
  bool fill();

 private:
  int descriptor_;
  size_t longest_;
  std::string buffer_;
  size_t begin_ = 0, searched_ = 0;  // of the next line; how far there is no end of it
};

/// Base64 with padding (RFC 4648, section 4).
std::string to_base64(std::string_view bytes);
/// The bytes of a base64 text; empty if it is not one.
std::optional<std::string> from_base64(std::string_view text);

}  // namespace asterism::tools
