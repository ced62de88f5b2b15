#pragma once

#include <optional>
#include <string>

#include "image_file.hpp"

namespace asterism::tools {

/// Options of asterism-trax.
struct TraxServerOptions {
  std::string tracker = "dpt";
  /// Of the protocol, 1 to 4. The default is the highest that clients of all ages speak: 4 has another way to
  /// begin a track, for several objects.
  int version = 3;
  std::optional<PixelRange> range = {};  ///< of the images' pixels; without one what Frame assumes
};

/// Runs a tracker for the client at the two descriptors until it quits. Throws std::exception with the reason
/// where that is not how the session ends; the client has been told then, if it is still there. Images that
/// are damaged are blank frames, whose number is printed on standard error at the end; no object starts in
/// one.
void serve_trax(const TraxServerOptions& options, int in, int out);

}  // namespace asterism::tools
