#include <algorithm>
#include <asterism/parts/models/siamese.hpp>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>

#include "peers_internal.hpp"

namespace asterism::bench {
namespace {

constexpr double kSmallest = 10;  // side of a box [px], as in the published code

// The part model Siamese alone.
struct NanoTrack {
  Report update(const cv::Mat& image) {
    const Point2 found = part.localize(Frame(image), centre).position;
    const Size2 limit(image.cols, image.rows);
    // Limited in pixels' edges.
    centre = (found.array() + 0.5).max(0).min(limit.array()) - 0.5;
    size = part.found_size().cwiseMin(limit).cwiseMax(kSmallest);
    part.resize(size);
    return {Region::rectangle(box_around(centre, size)), part.similarity_at(found)};
  }

  Siamese part;
  Point2 centre;
  Size2 size;
};

}  // namespace

Start nanotrack_peer(const std::string& folder) {
  const auto make = [folder] {
    try {
      return Siamese({.network = {folder}});
    } catch (const std::invalid_argument& error) {
      const std::string text = error.what();
      throw std::invalid_argument("nanotrack" + text.substr(std::min(text.find(':'), text.size())));
    }
  };
  make();  // which may refuse
  return [make](const Image& image, const Region& object) -> Step {
    const cv::Rect2d box = object.equal_area_box();
    const auto tracker =
        std::make_shared<NanoTrack>(NanoTrack{make(), centre_of(box), {box.width, box.height}});
    tracker->part.init(Frame(image.pixels), tracker->centre, tracker->size);
    return [tracker](const Image& next) { return tracker->update(next.pixels); };
  };
}

}  // namespace asterism::bench
