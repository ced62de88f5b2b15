#include <asterism/parts/concept/part_plugin.hpp>
#include <asterism/parts/models/cv_tracker_part.hpp>
#include <opencv2/tracking.hpp>

using namespace asterism;

class CsrtPart : public CvTrackerPart {
 public:
  explicit CsrtPart(const CvTrackerPartOptions& options)
      : CvTrackerPart([] { return cv::TrackerCSRT::create(); }, options) {}
};

ASTERISM_PART_PLUGIN(models) { models.add<CsrtPart, CvTrackerPartOptions>("csrt"); }
