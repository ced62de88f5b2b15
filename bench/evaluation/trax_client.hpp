#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "region.hpp"
#include "trax_image.hpp"
#include "trax_message.hpp"

namespace asterism::tools {

/// How an external tracker is run.
struct TraxClientOptions {
  double timeout = 30;  ///< for its introduction and each reply [s]
  /// Talk through TRAX_SOCKET, a port of this machine, and not through the tracker's standard streams.
  bool socket = false;
  /// Restart the tracker for every `initialize`. Trackers with the VOT toolkit's wrapper are always
  /// restarted: they end after one sequence.
  bool restart = false;
  /// File to which the tracker's output is appended; the standard error if empty.
  std::string log;
  /// What messages call it; the command if empty.
  std::string name = {};
};

/// An external tracker that speaks TraX, versions 1 to 4, as a child process.
///
/// Each call throws TraxError with the reason if the tracker cannot be started, dies, does not reply in time,
/// violates the protocol or sends an unexpected message; its process is ended then, and the next `initialize`
/// starts it again.
class TraxClient {
 public:
  /// The tracker's answer for one object in one image.
  struct Reply {
    /// Empty if the tracker reports no object: NaN, or a single number, in place of coordinates.
    std::optional<Region> region;
    std::optional<double> confidence;               ///< as the tracker scales it
    std::map<std::string, std::string> properties;  ///< all of the answer besides the region
  };

  /// Starts `command`, a line for /bin/sh, and waits for its introduction. Throws std::invalid_argument for a
  /// timeout that is not positive.
  explicit TraxClient(std::string command, TraxClientOptions options = {});
  /// Tells the tracker to quit, and kills it if it has not ended three seconds later.
  ~TraxClient();
  TraxClient(TraxClient&&) noexcept;
  TraxClient& operator=(TraxClient&&) noexcept;

  /// The properties of the tracker's introduction, "trax.name" for instance.
  const std::map<std::string, std::string>& hello() const { return hello_; }

  /// Starts to track one object, or several if the tracker supports that, and drops all former ones. Objects
  /// are sent in a form that the tracker accepts: a polygon may become its bounding box, a rectangle its
  /// corners. The replies are in the order of the objects. Throws std::invalid_argument for no object, and
  /// for more of them than the tracker accepts.
  std::vector<Reply> initialize(const TraxImage& image, const std::vector<Region>& objects);
  /// The objects in the next image. Throws std::logic_error before `initialize`.
  std::vector<Reply> frame(const TraxImage& image);

 private:
  class Process;

  void start();
  void read_hello();
  std::string region_argument(const Region& region) const;
  std::vector<Reply> replies();
  /// Ends the tracker if `call` throws.
  template <class Call>
  auto guarded(Call call) -> decltype(call());

  std::string command_;
  TraxClientOptions options_;
  std::unique_ptr<Process> process_;
  std::map<std::string, std::string> hello_;
  int version_ = 1;
  std::vector<std::string> image_formats_, region_formats_;
  size_t objects_ = 0;
};

}  // namespace asterism::tools
