#include <dlib/image_processing.h>
#include <dlib/opencv/cv_image.h>

#include <memory>

#include "peers_internal.hpp"

namespace asterism::bench {

void add_dlib_peers(std::map<std::string, Start>& peers) {
  // dlib's rectangles go from the first to the last pixel, both included.
  peers["dlib"] = [](const Image& image, const Region& object) -> Step {
    const cv::Rect2d b = object.equal_area_box();
    auto tracker = std::make_shared<dlib::correlation_tracker>();
    tracker->start_track(dlib::cv_image<dlib::bgr_pixel>(image.pixels),
                         dlib::drectangle(b.x, b.y, b.x + b.width - 1, b.y + b.height - 1));
    return [tracker](const Image& next) {
      const double confidence = tracker->update(dlib::cv_image<dlib::bgr_pixel>(next.pixels));
      const dlib::drectangle box = tracker->get_position();
      return Report{Region::rectangle({box.left(), box.top(), box.width(), box.height()}), confidence};
    };
  };
}

}  // namespace asterism::bench
