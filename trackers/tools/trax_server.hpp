#pragma once

#include <optional>
#include <string>

#include "image_file.hpp"

namespace asterism::tools {

/// Options of asterism-trax.
struct TraxServerOptions {
  std::string tracker = "dpt_plus";
  /// Of the protocol, 1 to 4. The default is the highest that both old and new clients speak: 4 begins a
  /// track differently, for several objects.
  int version = 3;
  std::optional<PixelRange> range = {};  ///< of the images' pixels; default: that of Frame
};

/// Runs a tracker for the client at the two descriptors until it quits. Throws std::exception with the reason
/// if the session ends otherwise, after telling the client if it is still there. Damaged images are blank
/// frames, whose number is printed on standard error at the end; no object can start in one.
void serve_trax(const TraxServerOptions& options, int in, int out);

}  // namespace asterism::tools
