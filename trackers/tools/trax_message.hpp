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

/// The name that begins the message's line.
std::string_view to_string(TraxMessage::Type type);

/// True if a line begins as a message does; all others are other output of a tracker.
bool is_trax_message(std::string_view line);

/// Parses a message from its line, without the line's end. An argument is a property if at most 64 letters,
/// digits, dots and underscores precede its first '='. Throws TraxError.
TraxMessage parse_trax_message(std::string_view line);

/// The line that `parse_trax_message` reads, without its end. Throws std::invalid_argument if no line can
/// express the message: an argument that would be a property, an invalid name of a property, a NUL byte.
std::string format_trax_message(const TraxMessage& message);

/// The items of a list in a hello message, "path;memory;".
std::vector<std::string> split_trax_list(std::string_view list);

/// Reads lines from a file descriptor as they arrive.
class LineReader {
 public:
  /// Room for a frame of 7680 x 4320 pixels in base64.
  static constexpr size_t kLongestLine = size_t{128} << 20;

  explicit LineReader(int descriptor, size_t longest = kLongestLine)
      : descriptor_(descriptor), longest_(longest) {}

  /// The next line without its end, waiting for it; empty at the end of the input, where an incomplete line
  /// is dropped.
  std::optional<std::string> next();

  /// The next line if it has arrived already. Throws TraxError if a line is too long.
  std::optional<std::string> take();
  /// Waits for more input and reads what there is; false at its end. Throws std::system_error if it cannot be
  /// read, and TraxError if an unfinished line is too long.
  bool fill();

 private:
  int descriptor_;
  size_t longest_;
  std::string buffer_;
  size_t begin_ = 0, searched_ = 0;  // of the next line; end of the part without a line break
};

/// Base64 with padding (RFC 4648, section 4).
std::string to_base64(std::string_view bytes);
/// Decodes base64; empty if the text is not valid.
std::optional<std::string> from_base64(std::string_view text);

}  // namespace asterism::tools
