#pragma once

#include <string>

namespace asterism::tools {

/// What asterism-trax runs.
struct TraxServerOptions {
  std::string tracker = "dpt";
  /// Of the protocol, 1 to 4. The default is the highest that clients of all ages speak: 4 has another way to
  /// begin a track, for several objects.
  int version = 3;
};

/// Runs a tracker for the client at the two descriptors until it quits. Throws std::exception with the reason
/// where that is not how the session ends; the client has been told then, if it is still there.
void serve_trax(const TraxServerOptions& options, int in, int out);

}  // namespace asterism::tools
