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
#include "made_videos.hpp"
#include "overlap.hpp"
#include "run_tool.hpp"

namespace {

using namespace asterism;
using bench::Region;
using bench::Shown;
using bench::Video;

// For how many frames the object is away, at most a quarter of the sequence where its scene goes on.
constexpr std::size_t kAway = 30;
// The sequence that is shown meanwhile: so many further in the data set.
constexpr std::size_t kOther = 7;

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
  app.add_option("--kinds", kinds, "pass, covered, cut, elsewhere: docs/evaluation.md")
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
      const Video video = bench::shown(data.sequences[s], most);
      const Video other = bench::shown(data.sequences[(s + kOther) % data.sequences.size()], kAway);
      for (const std::string& name : names)
        for (const std::string& kind : kinds)
          follow(name, kind, data.sequences[s].name, bench::made_video(kind, video, other, kAway), out);
    }
    if (!out) throw std::runtime_error("cannot write " + file);
  });
}
