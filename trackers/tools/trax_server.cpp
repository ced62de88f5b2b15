#include "trax_server.hpp"

#include <unistd.h>

#include <array>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "region.hpp"
#include "trax_image.hpp"
#include "trax_message.hpp"

namespace asterism::tools {
namespace {

using Type = TraxMessage::Type;

void write_all(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t count = write(descriptor, bytes.data(), bytes.size());
    if (count >= 0) {
      bytes.remove_prefix(static_cast<size_t>(count));
    } else if (errno == EPIPE || errno == ECONNRESET) {
      throw TraxError("the client closed the connection without sending quit");
    } else if (errno != EINTR) {
      throw std::system_error(errno, std::generic_category(), "cannot write");
    }
  }
}

// The shortest digits that reproduce the number exactly.
std::string to_text(double value) {
  std::array<char, 32> buffer;
  return {buffer.data(), std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr};
}

TraxMessage hello(const TraxServerOptions& options) {
  TraxMessage message{Type::Hello, {}, {}};
  message.properties = {{"trax.version", std::to_string(options.version)},
                        {"trax.name", options.tracker},
                        {"trax.identifier", "asterism-" ASTERISM_VERSION},
                        {"trax.family", "asterism"},
                        {"trax.region", "rectangle;polygon;"},
                        {"trax.image", "path;memory;buffer;"}};
  if (options.version >= 2) message.properties.emplace("trax.channels", "color;");
  if (options.version >= 4) message.properties.emplace("trax.multiobject", "1");
  return message;
}

// The region in the form of the first one: a polygon is moved, scaled and rotated with the box around it.
Region region_of(const TrackResult& result, const Region& start) {
  if (start.is_rectangle()) return Region::rectangle(result.box);
  const std::array<cv::Point2d, 4> corners = result.corners();
  const cv::Rect2d box = start.equal_area_box();
  std::vector<cv::Point2d> points = start.points();
  for (cv::Point2d& p : points) {
    const cv::Point2d in_box = p - box.tl();
    p = corners[0] + in_box.x / box.width * (corners[1] - corners[0]) +
        in_box.y / box.height * (corners[3] - corners[0]);
  }
  return Region::polygon(std::move(points));
}

TraxMessage state(const TrackResult& result, const Region& region) {
  TraxMessage message{Type::State, {to_string(region)}, {}};
  message.properties = {{"confidence", to_text(result.confidence)}, {"lost", result.lost ? "1" : "0"}};
  std::string parts;
  for (const PartState& part : result.parts) {
    if (!parts.empty()) parts += ';';
    parts += to_text(part.position.x()) + ',' + to_text(part.position.y());
  }
  if (!parts.empty()) message.properties.emplace("parts", parts);
  return message;
}

struct Object {
  AnyTracker tracker;
  Region start;
};

class Session {
 public:
  Session(const TraxServerOptions& options, int in, int out) : options_(options), reader_(in), out_(out) {}

  void run() {
    send(hello(options_));
    try {
      while (true) {
        const TraxMessage message = receive();
        if (message.type == Type::Quit) break;
        if (message.type == Type::Initialize) {
          initialize(message);
        } else if (message.type == Type::Frame) {
          frame(message);
        } else {
          throw TraxError(std::string(to_string(message.type)) + " is a message that only trackers send");
        }
      }
    } catch (const std::exception& e) {
      tell(e.what());
      print_damaged();
      throw;
    }
    print_damaged();
  }

 private:
  TraxMessage receive() {
    while (const std::optional<std::string> line = reader_.next()) {
      if (is_trax_message(*line)) return parse_trax_message(*line);
    }
    throw TraxError("the client closed the connection without sending quit");
  }

  void send(const TraxMessage& message) { write_all(out_, format_trax_message(message) + '\n'); }

  void tell(std::string_view reason) {
    try {
      send({Type::Quit, {}, {{"trax.reason", std::string(reason)}}});
    } catch (const std::exception&) {
      return;  // the client has gone
    }
  }

  // From version 4 on, each object has its own initialize, the first image comes with the frame after them,
  // and an initialize without arguments removes all objects.
  void initialize(const TraxMessage& message) {
    const std::vector<std::string>& arguments = message.arguments;
    if (options_.version >= 4) {
      if (arguments.empty()) {
        objects_.clear();
        starts_.clear();
      } else {
        check_count(message, 1, "a region");
        starts_.push_back(start_region(arguments[0]));
      }
      return;
    }
    check_count(message, 2, "an image and a region");
    objects_.clear();
    starts_ = {start_region(arguments[1])};
    reply(arguments[0]);
  }

  void frame(const TraxMessage& message) {
    check_count(message, 1, "an image");
    if (objects_.empty() && starts_.empty()) throw TraxError("a frame before an object to track");
    reply(message.arguments[0]);
  }

  static void check_count(const TraxMessage& message, size_t count, std::string_view what) {
    if (message.arguments.size() == count) return;
    throw TraxError(std::string(to_string(message.type)) + " needs " + std::string(what) + ", but has " +
                    std::to_string(message.arguments.size()) + " arguments");
  }

  static Region start_region(const std::string& text) {
    const std::optional<Region> region = parse_region(text);
    constexpr size_t kShown = 64;
    if (!region) throw TraxError("expected a rectangle or a polygon, found '" + text.substr(0, kShown) + "'");
    return *region;
  }

  void print_damaged() const {
    if (damaged_ > 0)
      std::fprintf(stderr, "asterism-trax: note: damaged images, treated as blank: %d, the first is %d\n",
                   damaged_, first_damaged_);
  }

  // Sends one state per object, in the order in which they were added.
  void reply(const std::string& argument) {
    const auto [image, damaged] = decode_trax_image(argument, options_.range, size_);
    ++frames_;
    if (damaged) {
      if (!starts_.empty()) throw TraxError("the image to start in is damaged");
      if (damaged_++ == 0) first_damaged_ = frames_;
    } else {
      size_ = image.size();
    }
    try {
      for (Object& object : objects_) {
        const TrackResult result = object.tracker.update(image);
        send(state(result, region_of(result, object.start)));
      }
      for (const Region& start : starts_) {
        objects_.push_back({make_tracker(options_.tracker), start});
        objects_.back().tracker.init(image, start);
        TrackResult result;
        result.confidence = 1;
        send(state(result, start));
      }
    } catch (const TraxError&) {
      throw;
    } catch (const std::exception& e) {
      throw std::runtime_error(options_.tracker + " in image " + std::to_string(frames_) + ": " + e.what());
    }
    starts_.clear();
  }

  const TraxServerOptions& options_;
  LineReader reader_;
  int out_;
  std::vector<Object> objects_;
  std::vector<Region> starts_;  // of objects waiting for their first image
  int frames_ = 0, damaged_ = 0, first_damaged_ = 0;
  cv::Size size_;  // of the last undamaged image
};

}  // namespace

void serve_trax(const TraxServerOptions& options, int in, int out) {
  make_tracker(options.tracker);  // refuses an unknown name before greeting the client
  Session(options, in, out).run();
}

}  // namespace asterism::tools
