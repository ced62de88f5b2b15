// The program of a tracker, as docs/trax.md and the guide to a tracker of one's own promise it.

#include <gtest/gtest.h>
#include <unistd.h>

#include <asterism/trackers/tracker/program.hpp>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <stdexcept>
#include <string>

namespace asterism {
namespace {

namespace fs = std::filesystem;

// Its box moves by the gray level of the frame's first pixel.
class Moving {
 public:
  void init(const cv::Mat&, const cv::Rect2d& box) { box_ = box; }
  TrackResult update(const cv::Mat& image) {
    if (image.at<cv::Vec3b>(0, 0)[0] == 99) throw std::runtime_error("a \"reason\"");
    TrackResult result;
    result.box = box_ += cv::Point2d(image.at<cv::Vec3b>(0, 0)[0], 0);
    result.confidence = 0.5;
    result.lost = image.at<cv::Vec3b>(0, 0)[0] == 7;
    return result;
  }

 private:
  cv::Rect2d box_;
};
static_assert(Tracker<Moving>);

class Program : public ::testing::Test {
 protected:
  Program() {
    fs::create_directories(folder_);
    for (const int level : {0, 3, 7, 99})
      cv::imwrite(image(level), cv::Mat(4, 6, CV_8UC3, cv::Scalar::all(level)));
  }
  ~Program() override { fs::remove_all(folder_); }

  std::string image(int level) const { return (folder_ / ("a b" + std::to_string(level) + ".png")).string(); }

  // The answers to messages, a line each.
  static std::string answers(const std::string& messages, bool throws = false) {
    Moving tracker;
    std::istringstream in(messages);
    std::ostringstream out;
    if (throws)
      EXPECT_ANY_THROW(serve_trax(tracker, in, out));
    else
      serve_trax(tracker, in, out);
    const std::string text = out.str();
    const std::string hello = R"(@@TRAX:hello "trax.version=1" "trax.image=path" "trax.region=rectangle")"
                              "\n";
    EXPECT_EQ(text.substr(0, hello.size()), hello);
    return text.substr(hello.size());
  }
  std::string start(const std::string& box = "1.5,2,3,4") const {
    return "@@TRAX:initialize \"file://" + image(0) + "\" \"" + box + "\"\n";
  }
  std::string frame(int level) const { return "@@TRAX:frame \"" + image(level) + "\"\n"; }

  fs::path folder_ = fs::temp_directory_path() / ("asterism-program-" + std::to_string(getpid()));
};

TEST_F(Program, AnswersEveryMessage) {
  const std::string first = "@@TRAX:state \"1.5,2,3,4\" \"confidence=0\"\n";
  EXPECT_EQ(
      answers(start() + "no message\n" + frame(3) + frame(3) + start() + "@@TRAX:quit\n" + frame(3)),
      first +
          "@@TRAX:state \"4.5,2,3,4\" \"confidence=0.5\"\n@@TRAX:state \"7.5,2,3,4\" \"confidence=0.5\"\n" +
          first);
  EXPECT_EQ(answers(""), "");
}

TEST_F(Program, TellsTheClientWhyItEnds) {
  EXPECT_NE(answers(start() + frame(99), true).find("@@TRAX:quit \"trax.reason=a \\\"reason\\\"\"\n"),
            std::string::npos);
  EXPECT_EQ(answers(start("1,2,3"), true),
            "@@TRAX:quit \"trax.reason='1,2,3' is not a box X,Y,WIDTH,HEIGHT\"\n");
  EXPECT_EQ(answers(start("1,2,3,4,5"), true),
            "@@TRAX:quit \"trax.reason='1,2,3,4,5' is not a box X,Y,WIDTH,HEIGHT\"\n");
  EXPECT_EQ(answers("@@TRAX:initialize \"/no/image.png\" \"1,2,3,4\"\n", true),
            "@@TRAX:quit \"trax.reason=/no/image.png: no image that OpenCV reads\"\n");
}

TEST_F(Program, FollowsAVideo) {
  for (const int i : {1, 2, 3})
    cv::imwrite((folder_ / (std::to_string(i) + ".png")).string(),
                cv::Mat(4, 6, CV_8UC3, cv::Scalar::all(i == 3 ? 7 : i)));
  Moving tracker;
  std::ostringstream out;
  follow_video(tracker, (folder_ / "%d.png").string(), {1, 2, 3, 4}, out);
  EXPECT_EQ(out.str(), "3,2,3,4 0.5\n10,2,3,4 0.5 lost\n");
  EXPECT_THROW(follow_video(tracker, "/no/%d.png", {1, 2, 3, 4}, out), std::runtime_error);
}

}  // namespace
}  // namespace asterism
