// asterism-signs: what BoxJudge sees in each frame and whether the box was right, for fit_judge.py.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <asterism/trackers/dpt/box_judge.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <fstream>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "dataset.hpp"
#include "overlap.hpp"
#include "run_tool.hpp"

namespace {

using namespace asterism;
using bench::Region;
using bench::Sequence;

/// What a tracker is shown. Without `truth` the frame does not count, unless the object is known to be
/// absent.
struct Shown {
  cv::Mat image;
  std::optional<cv::Rect2d> truth;
  bool absent = false;
};
using Video = std::vector<Shown>;

// The object leaves before this frame, or after a third of a shorter sequence, ...
constexpr std::size_t kLeaves = 40;
// ... for so many frames, at most a quarter of the sequence, ...
constexpr std::size_t kAway = 30;
// ... and is followed for so many frames when it is back.
constexpr std::size_t kAfter = 60;
// The sequence that is shown meanwhile: so many further in the data set.
constexpr std::size_t kOther = 7;

Video video_of(const Sequence& sequence, std::size_t most) {
  Video video;
  bench::FrameReader reader(sequence);
  for (std::size_t t = 0; t < std::min(most, sequence.length()); ++t) {
    const std::optional<Region>& truth = sequence.truth[t];
    video.push_back({reader(t).clone(), truth ? std::optional(truth->equal_area_box()) : std::nullopt});
  }
  return video;
}

// The image beside the object in place of the object, a fifth of its sides larger on each side.
cv::Mat without_object(const cv::Mat& image, const cv::Rect2d& box) {
  constexpr double kMargin = 0.2;
  const cv::Rect all({}, image.size());
  const cv::Rect hole =
      cv::Rect(
          cv::Point(cv::Point2d(box.x - kMargin * box.width, box.y - kMargin * box.height)),
          cv::Point(cv::Point2d(box.x + (1 + kMargin) * box.width, box.y + (1 + kMargin) * box.height))) &
      all;
  cv::Mat result = image.clone();
  if (hole.empty()) return result;
  for (const cv::Point step : {cv::Point(-hole.width, 0), cv::Point(hole.width, 0),
                               cv::Point(0, -hole.height), cv::Point(0, hole.height)})
    if (((hole + step) & all) == hole + step) {
      image(hole + step).copyTo(result(hole));
      return result;
    }
  result(hole) = cv::mean(image);
  return result;
}

// "pass": the sequence as it is. "covered": the object leaves a scene that goes on, and comes back. "cut":
// the scene is replaced by another video, and then goes on a little later, a third of the frames away.
Video made(const std::string& kind, const Video& video, const Video& other) {
  if (kind == "pass") return video;
  const std::size_t leaves = std::min(kLeaves, video.size() / 3), away = std::min(kAway, video.size() / 4),
                    back = leaves + away, end = std::min(video.size(), back + kAfter);
  Video result(video.begin(), video.begin() + static_cast<std::ptrdiff_t>(leaves));
  if (kind == "covered") {
    for (std::size_t t = leaves; t < end; ++t) {
      const Shown& shown = video[t];
      if (t < back && shown.truth)
        result.push_back({without_object(shown.image, *shown.truth), {}, true});
      else
        result.push_back(shown);
    }
  } else if (kind == "cut") {
    for (std::size_t t = 0; t < std::min(kAway, other.size()); ++t) {
      cv::Mat image;
      cv::resize(other[t].image, image, video[0].image.size(), 0, 0, cv::INTER_AREA);
      result.push_back({image, {}, true});
    }
    result.insert(result.end(), video.begin() + static_cast<std::ptrdiff_t>(leaves + away / 3),
                  video.begin() + static_cast<std::ptrdiff_t>(end));
  } else {
    throw std::invalid_argument("--kinds: unknown kind '" + kind + "' (known: pass, covered, cut)");
  }
  return result;
}

void follow(const std::string& name, const std::string& kind, const std::string& sequence, const Video& video,
            std::ostream& out) {
  AnyTracker tracker = make_tracker(name);
  BoxJudge judge;
  tracker.init(video.at(0).image, video[0].truth.value());
  judge.init(Frame(video[0].image), *video[0].truth);
  for (std::size_t t = 1; t < video.size(); ++t) {
    const Shown& shown = video[t];
    const TrackResult result = tracker.update(shown.image);
    if (result.interrupted) continue;  // which is not for the judge to say
    const double probability = judge.update(Frame(shown.image), result.box);
    if (!shown.truth && !shown.absent) continue;
    double overlap = 0;
    if (shown.truth)
      overlap = bench::overlap(Region::rectangle(result.box), Region::rectangle(*shown.truth),
                               bench::OverlapRule::Exact);
    out << name << ',' << kind << ',' << sequence << ',' << t << ',' << overlap << ',' << result.is_weak()
        << ',' << judge.likeness().shape << ',' << judge.likeness().levels << ',' << judge.likeness().colors
        << ',' << probability << '\n';
  }
  out.flush();
}

}  // namespace

int main(int argc, char** argv) {
  std::string dataset, file;
  std::vector<std::string> names{"dpt_plus", "dpt"}, kinds{"pass", "covered", "cut"}, only;
  std::size_t most = 1000000;
  CLI::App app(
      "Writes, for each frame, the signs from which BoxJudge computes the probability that a tracker's box "
      "is "
      "right, and the overlap of this box with the object: in annotated sequences as they are, and in videos "
      "made of them in which the object leaves and comes back. fit_judge.py fits the weights to these lines.",
      "asterism-signs");
  app.add_option("DATASET", dataset, "a sequence, or a folder of sequences")->required();
  app.add_option("--trackers", names, "names or descriptions")->capture_default_str();
  app.add_option("--kinds", kinds,
                 "pass: as it is; covered: the image beside the object covers it for a while; cut: another "
                 "sequence is inserted")
      ->capture_default_str();
  app.add_option("--frames", most, "of a sequence, at most")->capture_default_str();
  app.add_option("--out", file, "the CSV file to write")->required();
  app.add_option("--sequences", only, "only these, separated by commas")->delimiter(',');
  return asterism::tools::run_tool(app, argc, argv, [&] {
    cv::setNumThreads(1);
    const bench::Dataset data = bench::open_dataset(dataset, bench::Layout::Auto, only);
    print_notes(data);
    std::ofstream out(file);
    out << "tracker,kind,sequence,frame,overlap,weak,shape,levels,colors,probability\n";
    for (std::size_t s = 0; s < data.sequences.size(); ++s) {
      const Video video = video_of(data.sequences[s], most);
      const Video other = video_of(data.sequences[(s + kOther) % data.sequences.size()], kAway);
      for (const std::string& name : names)
        for (const std::string& kind : kinds)
          follow(name, kind, data.sequences[s].name, made(kind, video, other), out);
    }
    if (!out) throw std::runtime_error("cannot write " + file);
  });
}
