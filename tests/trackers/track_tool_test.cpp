// Runs asterism-track as a user does: the built program on images and videos made here.

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <asterism/solver/method/ida.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <ground_truth.hpp>
#include <image_source.hpp>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#ifdef ASTERISM_TEST_JSON
#include <asterism/solver/io/json.hpp>
#include <nlohmann/json.hpp>
#endif

#include "moving_square.hpp"

namespace asterism::tools {
namespace {

namespace fs = std::filesystem;

constexpr int kFrames = 20;
constexpr char kHeader[] = "frame,x,y,width,height,confidence,lost,milliseconds,probability";

std::string read(const fs::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<std::string> lines_of(const fs::path& path) {
  std::vector<std::string> lines;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

// Of a line of the CSV; the last is NaN for a tracker without a probability, which leaves the field empty.
std::vector<double> numbers_of(const std::string& line) {
  return parse_numbers(line + (line.ends_with(',') ? "nan" : ""));
}

// The line without milliseconds and probability.
std::string without_time(const std::string& line) {
  return line.substr(0, line.rfind(',', line.rfind(',') - 1));
}

class TrackTool : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "asterism-track-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path make_images(const std::string& name, int frames = kFrames) {
    fs::path folder = folder_ / name;
    fs::create_directories(folder);
    for (int i = 1; i <= frames; ++i) {
      // Not padded: frame 10 comes after frame 9 only in natural order.
      cv::imwrite((folder / ("img_" + std::to_string(i) + ".png")).string(), draw_frame(i - 1));
    }
    return folder;
  }

  fs::path make_sequence(const std::string& truth_after = "") {
    fs::path folder = folder_ / "sequence";
    make_images("sequence/color");
    std::ofstream file(folder / "groundtruth.txt");
    for (int i = 1; i <= kFrames; ++i) {
      const cv::Rect2d b = true_box(i - 1);
      const double right = b.x + b.width, bottom = b.y + b.height;
      file << b.x << ',' << bottom << ',' << b.x << ',' << b.y << ',' << right << ',' << b.y << ',' << right
           << ',' << bottom << '\n';
    }
    file << truth_after;
    return folder;
  }

  fs::path make_video() {
    fs::path path = folder_ / "video.avi";
    cv::VideoWriter writer(path.string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 12, {320, 240});
    for (int i = 1; i <= kFrames; ++i) writer.write(draw_frame(i - 1));
    return path;
  }

  // Runs the program and returns its exit code; its output is in out_ and err_.
  int run(const std::string& arguments, bool with_tracker = true) {
    const std::string command = limits_ + "env -u DISPLAY -u WAYLAND_DISPLAY " ASTERISM_TRACK_TOOL " " +
                                arguments + (with_tracker ? " --tracker kcf" : "") + " > " + path("out") +
                                " 2> " + path("err");
    const int status = std::system(command.c_str());
    out_ = read(folder_ / "out");
    err_ = read(folder_ / "err");
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  // Checks that the run fails with one line of error that has all of `parts`.
  void expect_error(const std::string& arguments, const std::vector<std::string>& parts,
                    bool with_tracker = true) {
    SCOPED_TRACE(arguments);
    EXPECT_GT(run(arguments, with_tracker), 0);
    EXPECT_TRUE(err_.starts_with("asterism-track: ")) << err_;
    EXPECT_EQ(std::count(err_.begin(), err_.end(), '\n'), 1) << err_;
    for (const std::string& part : parts)
      EXPECT_NE(err_.find(part), std::string::npos) << part << " in " << err_;
  }

  // Checks that the CSV has frames first .. first + count - 1, with the boxes on the object.
  void expect_boxes(const fs::path& csv, int first, int count) {
    const std::vector<std::string> lines = lines_of(csv);
    ASSERT_EQ(static_cast<int>(lines.size()), count + 1);
    EXPECT_EQ(lines[0], kHeader);
    for (int i = 0; i < count; ++i) {
      const std::string& line = lines[static_cast<size_t>(i) + 1];
      const std::vector<double> v = numbers_of(line);
      ASSERT_EQ(v.size(), 9u) << line;
      EXPECT_EQ(v[0], first + i);
      EXPECT_GT(overlap({v[1], v[2], v[3], v[4]}, true_box(first + i - 1)), i == 0 ? 0.999 : 0.6)
          << "frame " << v[0];
      EXPECT_TRUE(v[5] >= 0 && v[5] <= 1) << v[5];
      EXPECT_TRUE(v[6] == 0 || v[6] == 1) << v[6];
      EXPECT_GE(v[7], 0);
      EXPECT_TRUE(std::isnan(v[8]) || (v[8] >= 0 && v[8] <= 1)) << v[8];
    }
  }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string csv() const { return " --out " + path("boxes.csv"); }

  static constexpr char kBox[] = " --box 60,50,48,40";
  fs::path folder_;
  std::string limits_;  // shell commands before the program
  std::string out_, err_;
};

TEST_F(TrackTool, FollowsThroughAFolder) {
  ASSERT_EQ(run(make_images("images").string() + kBox + csv()), 0) << err_;
  expect_boxes(path("boxes.csv"), 1, kFrames);
  EXPECT_NE(err_.find("kcf: 20 frames, "), std::string::npos) << err_;
  EXPECT_TRUE(out_.empty());
}

TEST_F(TrackTool, FollowsThroughAVideo) {
  ASSERT_EQ(run(make_video().string() + kBox + csv()), 0) << err_;
  expect_boxes(path("boxes.csv"), 1, kFrames);
}

TEST_F(TrackTool, FollowsThroughPatterns) {
  const std::string images = make_images("images").string();
  for (const std::string pattern : {"/img_%d.png", "/*.png", "/img_?*.png"}) {
    SCOPED_TRACE(pattern);
    ASSERT_EQ(run("'" + images + pattern + "'" + kBox + csv()), 0) << err_;
    expect_boxes(path("boxes.csv"), 1, kFrames);
  }
  ASSERT_EQ(run("'" + images + "/img_%02d.png' --box 87,59,48,40" + csv()), 0) << err_;
  EXPECT_EQ(lines_of(path("boxes.csv")).size(), 12u) << "img_10.png to img_20.png have two digits";
}

TEST_F(TrackTool, StartsASequenceFromItsGroundTruthAndMeasuresTheOverlap) {
  ASSERT_EQ(run(make_sequence().string() + csv()), 0) << err_;
  expect_boxes(path("boxes.csv"), 1, kFrames);
  EXPECT_NE(err_.find("mean overlap "), std::string::npos) << err_;
  EXPECT_NE(err_.find(" in 19 frames"), std::string::npos) << err_;
}

TEST_F(TrackTool, StartsAndStopsWhereItIsTold) {
  const std::string sequence = make_sequence().string(), video = make_video().string();
  ASSERT_EQ(run(sequence + csv() + " --start 6 --frames 9"), 0) << err_;
  expect_boxes(path("boxes.csv"), 6, 9);
  ASSERT_EQ(run(video + csv() + " --start 6 --frames 9 --box 75,55,48,40"), 0) << err_;
  expect_boxes(path("boxes.csv"), 6, 9);
  expect_error(video + " --start 21" + kBox, {"no frame 21", "20"});
}

TEST_F(TrackTool, WritesBoxesToTheStandardOutput) {
  ASSERT_EQ(run(make_images("images").string() + kBox + " --out -"), 0) << err_;
  expect_boxes(path("out"), 1, kFrames);
}

TEST_F(TrackTool, FollowsSeveralObjects) {
  make_images("images");
  ASSERT_EQ(run(kBox + (" --box 200,150,50,40 " + path("images")) + csv() + " --save " + path("overlay.mp4")),
            0)
      << err_;
  EXPECT_TRUE(err_.starts_with("kcf: 2 objects, 20 frames, ")) << err_;
  const std::vector<std::string> lines = lines_of(folder_ / "boxes.csv");
  ASSERT_EQ(lines.size(), 2u * kFrames + 1);
  EXPECT_EQ(lines[0], "frame,id,x,y,width,height,confidence,lost,milliseconds,probability");
  // The first object's boxes are the same as alone.
  ASSERT_EQ(run(path("images") + kBox + " --out " + path("alone.csv")), 0) << err_;
  const std::vector<std::string> alone = lines_of(folder_ / "alone.csv");
  for (size_t i = 1; i < lines.size(); ++i) {
    const std::vector<double> v = numbers_of(lines[i]);
    ASSERT_EQ(v.size(), 10u) << lines[i];
    const size_t frame = (i + 1) / 2;
    EXPECT_EQ(v[0], static_cast<double>(frame));
    EXPECT_EQ(v[1], i % 2 == 1 ? 1 : 2);
    const std::vector<double> w = numbers_of(alone[frame]);
    for (size_t k = 1; i % 2 == 1 && k < 7; ++k) EXPECT_EQ(v[k + 1], w[k]) << lines[i];
    if (i % 2 == 0) {
      EXPECT_GT(overlap({v[2], v[3], v[4], v[5]}, {200, 150, 50, 40}), 0.6);
    }
  }
  cv::VideoCapture video(path("overlay.mp4"));
  EXPECT_EQ(video.get(cv::CAP_PROP_FRAME_COUNT), kFrames);
  expect_error(path("images") + kBox + kBox + " --sheet " + path("sheet.png"), {"--sheet is for one object"});
  expect_error(path("images") + " --box=10,20,-5,30", {"--box \"10,20,-5,30\" is -5 x 30 px, but"});
  expect_error(path("images") + kBox + " --box 1,2,3", {"--box \"1,2,3\" is neither x,y,width,height"});
}

TEST_F(TrackTool, WritesOverlayVideoAndContactSheet) {
  ASSERT_EQ(
      run(make_video().string() + kBox + " --save " + path("overlay.mp4") + " --sheet " + path("sheet.png")),
      0)
      << err_;
  cv::VideoCapture video(path("overlay.mp4"));
  ASSERT_TRUE(video.isOpened());
  EXPECT_EQ(video.get(cv::CAP_PROP_FPS), 12);
  int frames = 0;
  for (cv::Mat image; video.read(image); ++frames)
    EXPECT_EQ(image.size(), cv::Size(640, 480)) << "small: doubled";
  EXPECT_EQ(frames, kFrames);

  const cv::Mat sheet = cv::imread(path("sheet.png"));
  ASSERT_FALSE(sheet.empty());
  EXPECT_GT(sheet.cols, 1600);
  EXPECT_GT(sheet.rows, 600);
  cv::Mat yellow;  // the eight boxes
  cv::inRange(sheet, cv::Scalar(0, 220, 220), cv::Scalar(40, 255, 255), yellow);
  EXPECT_GT(cv::countNonZero(yellow), 8 * 4 * 40);
}

// All but the boxes is as without --smooth, and the outputs are complete.
TEST_F(TrackTool, SmoothsTheBoxesWhenAllFramesHaveBeenTracked) {
  const std::string arguments = make_sequence().string() + " --start 3 --frames 15";
  ASSERT_EQ(run(arguments + csv()), 0) << err_;
  const std::vector<std::string> tracked = lines_of(path("boxes.csv"));
  ASSERT_EQ(run(arguments + " --smooth" + csv() + " --save " + path("overlay.mp4") + " --sheet " +
                path("sheet.png")),
            0)
      << err_;
  expect_boxes(path("boxes.csv"), 3, 15);
  EXPECT_NE(err_.find(" in 14 frames"), std::string::npos) << err_;
  const std::vector<std::string> smoothed = lines_of(path("boxes.csv"));
  ASSERT_EQ(smoothed.size(), tracked.size());
  std::vector<double> before, after;  // the x of the boxes
  for (std::size_t i = 1; i < tracked.size(); ++i) {
    const std::vector<double> v = numbers_of(tracked[i]), w = numbers_of(smoothed[i]);
    for (const std::size_t k : {0u, 5u, 6u}) EXPECT_EQ(v[k], w[k]);
    before.push_back(v[1]);
    after.push_back(w[1]);
  }
  const auto jitter = [](const std::vector<double>& x) {
    double sum = 0;
    for (std::size_t t = 2; t < x.size(); ++t) sum += std::abs(x[t - 2] - 2 * x[t - 1] + x[t]);
    return sum;
  };
  EXPECT_EQ(before.front(), after.front());
  EXPECT_LT(jitter(after), jitter(before));
  EXPECT_EQ(cv::VideoCapture(path("overlay.mp4")).get(cv::CAP_PROP_FRAME_COUNT), 15);
  EXPECT_FALSE(cv::imread(path("sheet.png")).empty());

  // Several objects, and a video.
  ASSERT_EQ(run(make_video().string() + kBox + " --box 200,150,50,40 --smooth" + csv()), 0) << err_;
  EXPECT_EQ(lines_of(path("boxes.csv")).size(), 2u * kFrames + 1);

  // A stream cannot be read again.
  const std::string stream = read(path("video.avi")), camera = path("camera.avi");
  ASSERT_EQ(mkfifo(camera.c_str(), 0600), 0);
  std::thread writer([&] {
    signal(SIGPIPE, SIG_IGN);
    std::ofstream(camera, std::ios::binary).write(stream.data(), std::ssize(stream));
  });
  expect_error(camera + kBox + " --smooth", {"--smooth: " + camera + " cannot be read a second time"});
  writer.join();
}

TEST_F(TrackTool, ComparesTrackersOnAContactSheet) {
  const std::string sequence = make_sequence().string(), sheet = path("sheet.png");
  ASSERT_EQ(run(sequence + " --sheet " + sheet), 0) << err_;
  const cv::Mat alone = cv::imread(sheet);
  ASSERT_EQ(run(sequence + " --compare coarse --compare dpt --sheet " + sheet), 0) << err_;
  const cv::Mat together = cv::imread(sheet);
  EXPECT_GT(together.rows, alone.rows) << "a legend";
  const auto pixels = [](const cv::Mat& image, const cv::Scalar& color) {
    cv::Mat found;
    cv::inRange(image, color - cv::Scalar::all(4), color + cv::Scalar::all(4), found);
    return cv::countNonZero(found);
  };
  // The three colors, those of kcf (on top), coarse and dpt.
  for (const cv::Scalar& color :
       {cv::Scalar(85, 255, 255), cv::Scalar(255, 255, 85), cv::Scalar(255, 85, 255)}) {
    EXPECT_EQ(pixels(alone, color), 0);
    EXPECT_GT(pixels(together, color), 40);
  }
  expect_error(sequence + " --compare coarse", {"--compare", "--sheet"});
  expect_error(sequence + " --compare magic --sheet " + sheet, {"magic"});
}

// The left half of the square is covered from the middle of the run on: from then on its parts, and no
// others, are shown as not updated.
TEST_F(TrackTool, DrawsThePartsWeightsOverTime) {
  fs::create_directories(folder_ / "covered");
  for (int i = 1; i <= kFrames; ++i) {
    cv::Mat image = draw_frame(i - 1);
    const cv::Rect2d box = true_box(i - 1);
    if (i > kFrames / 2)
      image(cv::Rect2d(box.x, box.y, box.width / 2, box.height)) = cv::Scalar(128, 128, 128);
    cv::imwrite((folder_ / "covered" / ("img_" + std::to_string(i) + ".png")).string(), image);
  }
  const std::string picture = path("timeline.png"),
                    arguments = path("covered") + kBox + " --timeline " + picture;
  ASSERT_EQ(run(arguments + " --tracker dpt", false), 0) << err_;
  const cv::Mat timeline = cv::imread(picture);
  ASSERT_FALSE(timeline.empty());
  cv::Mat red;
  cv::inRange(timeline, cv::Scalar(50, 40, 150), cv::Scalar(50, 40, 150), red);
  // Strips of parts 1 to 4 below the film, parts 1 and 3 on the left of the square.
  const int top = 180, strip = 120, left = 110, middle = left + 750;
  for (int part = 0; part < 4; ++part) {
    const auto count = [&](int from, int to) {
      return cv::countNonZero(
          red(cv::Range(top + part * strip, top + (part + 1) * strip - 10), cv::Range(from, to)));
    };
    EXPECT_EQ(count(left, middle - 100), 0) << part;
    if (part % 2 == 0)
      EXPECT_GT(count(middle, left + 1500), 110 * 300) << part;
    else
      EXPECT_EQ(count(middle, left + 1500), 0) << part;
  }
  expect_error(arguments, {"--timeline"});  // kcf has no parts
}

TEST_F(TrackTool, DrawsTheLastConstellationBeforeAndAfterItsSolve) {
  const std::string images = make_images("images").string() + kBox, picture = path("constellation.png");
  ASSERT_EQ(run(images + " --frames 5 --tracker dpt --constellation " + picture, false), 0) << err_;
  const cv::Mat both = cv::imread(picture);
  ASSERT_FALSE(both.empty());
  EXPECT_GT(both.cols, 1.8 * both.rows);
  expect_error(images + " --constellation " + picture, {"--constellation", "kcf"});

  // There is no picture of the first frame.
  fs::remove(picture);
  for (const std::string option : {"--constellation", "--timeline"}) {
    expect_error(images + csv() + " --frames 1 --tracker dpt " + option + " " + picture,
                 {option, "first frame"}, false);
    EXPECT_FALSE(fs::exists(picture));
    expect_boxes(path("boxes.csv"), 1, 1);
  }
}

TEST_F(TrackTool, DrawsTheConstellationOfEveryDpt) {
  const std::string images = make_images("images", 3).string() + kBox, picture = path("constellation.png");
  std::vector<std::string> trackers{"dpt_str"};
#ifdef ASTERISM_TEST_JSON
  trackers.insert(trackers.end(), {"dpt+mosse", "'dpt{\"grid_rows\": 3}'", "'{\"tracker\": \"dpt_loc\"}'"});
#endif
  for (const std::string& tracker : trackers) {
    fs::remove(picture);
    EXPECT_EQ(run(images + " --constellation " + picture + " --tracker " + tracker, false), 0) << err_;
    EXPECT_FALSE(cv::imread(picture).empty()) << tracker;
  }
}

#ifdef ASTERISM_TEST_JSON
TEST_F(TrackTool, TakesATrackerFromAFile) {
  const std::string images = make_images("images").string() + kBox, config = " --config " + path("t.json");
  const auto write = [&](const std::string& text) { std::ofstream(path("t.json")) << text; };
  write(R"({"tracker": "coarse", "root": {"model": "template", "padding": 1}})");
  ASSERT_EQ(run(images + config + csv(), false), 0) << err_;
  expect_boxes(path("boxes.csv"), 1, kFrames);
  expect_error(images + config + " --tracker kcf", {"--config", "--tracker"}, false);
  write(R"({"tracker": "coarse", "roots": 3})");
  expect_error(images + config, {path("t.json"), "unknown option 'roots'", "'root'"}, false);
  write("kcf");
  expect_error(images + config, {path("t.json"), "JSON object"}, false);
  expect_error(images + " --config " + path("none.json"), {path("none.json")}, false);
  expect_error(images + " --config " + path("images"), {path("images") + " is a folder, not a file"}, false);
  expect_error(images + " --config /dev/zero", {"/dev/zero: more than 1 MiB"}, false);
  expect_error(images + " --config /dev/null",
               {"/dev/null: the description of a tracker must be a JSON object"}, false);
  write("{\"tracker\": \"kcf\",\n\n    \"use_color\": false\n}\n");
  ASSERT_EQ(run(images + config, false), 0) << err_;
  EXPECT_TRUE(err_.starts_with("{\"tracker\": \"kcf\", \"use_color\": false }: 20 frames, ")) << err_;
  EXPECT_EQ(std::count(err_.begin(), err_.end(), '\n'), 1) << err_;
  expect_error(images + config + " --out " + path("t.json"), {"--out", "--config"}, false);
  EXPECT_TRUE(read(path("t.json")).starts_with("{"));
}

TEST_F(TrackTool, PrintsTheOptionsOfATracker) {
  ASSERT_EQ(run("--options dpt_plus", false), 0) << err_;
  EXPECT_EQ(out_, tracker_options("dpt_plus") + '\n');
  EXPECT_EQ(err_, "");
  std::ofstream(path("options.json")) << out_;
  const std::string images = make_images("images").string() + kBox;
  ASSERT_EQ(run(images + csv() + " --config " + path("options.json"), false), 0) << err_;
  expect_boxes(path("boxes.csv"), 1, kFrames);
  EXPECT_TRUE(err_.starts_with("{ \"tracker\": \"dpt_plus\",")) << err_;
  EXPECT_NE(err_.find("...: 20 frames, "), std::string::npos) << err_;
  expect_error("--options dtp", {"unknown tracker 'dtp', did you mean 'dpt'?"}, false);
  expect_error("--options", {"--options"}, false);
  expect_error("--optionz dpt", {"unknown argument --optionz, did you mean '--options'?"}, false);
  ASSERT_EQ(run(images + csv() + " --frames 1 --tracker kcf", false), 0) << err_;
  EXPECT_EQ(err_, "kcf: 1 frame\n");
  if (fs::exists("/dev/full")) {
    EXPECT_NE(std::system((ASTERISM_TRACK_TOOL " --options dpt > /dev/full 2> " + path("err")).c_str()), 0);
  }
}

nlohmann::json origin_of(const auto& stored) { return nlohmann::json::parse(stored.origin); }

cv::Rect2d recorded_box(const nlohmann::json& numbers) {
  const auto box = numbers.get<std::array<double, 4>>();
  return {box[0], box[1], box[2], box[3]};
}

TEST_F(TrackTool, RecordsTheSystemsThatDptSolves) {
  const std::string images = make_images("images").string() + kBox + " --tracker dpt";
  ASSERT_EQ(run(images + csv() + " --record-systems " + path("systems.jsonl"), false), 0) << err_;
  const auto systems = read_systems<SpringSystem<double, 2>>(path("systems.jsonl"));
  ASSERT_EQ(systems.size(), static_cast<size_t>(kFrames - 1)) << "none in the first frame";
  for (int frame = 2; frame <= kFrames; ++frame) {
    const auto& [system, start, name, text] = systems[static_cast<size_t>(frame - 2)];
    const auto origin = nlohmann::json::parse(text);
    EXPECT_EQ(name, "images/frame " + std::to_string(frame));
    EXPECT_EQ(origin.at("tracker"), "dpt");
    EXPECT_EQ(origin.at("frame"), frame);
    EXPECT_EQ(origin.at("solver"), "IDA");
    EXPECT_EQ(origin.at("status"), "converged");
    EXPECT_EQ(system.nodes(), 4);
    EXPECT_NE(start, system.anchors);
    // Solving it again from its start gives the same result.
    Dpt::Placement x = start;
    const Summary summary = Ida(system).solve(system, x);
    EXPECT_NEAR(summary.iterations, origin.at("iterations").get<int>(), 1);
    EXPECT_NEAR(summary.initial_energy, origin.at("initial_energy").get<double>(), 1e-12);
    EXPECT_NEAR(summary.final_energy, origin.at("final_energy").get<double>(), 1e-12);
    // The evidence gives the anchors their stiffness.
    ASSERT_EQ(origin.at("peak").size(), 4u);
    ASSERT_EQ(origin.at("covariance").size(), 4u);
    for (size_t i = 0; i < 4; ++i) {
      const auto c = origin["covariance"][i].get<std::array<std::array<double, 2>, 2>>();
      EXPECT_EQ(c[0][1], c[1][0]);
      EXPECT_EQ(origin["peak"][i].get<double>() / (c[0][0] + c[1][1]),
                system.anchor_stiffness(static_cast<Eigen::Index>(i)));
    }
    // The box follows from that of the start by the similarity between the placements.
    const PlaneTransform step = fit_transform(start, x, TransformModel::Similarity);
    const cv::Rect2d start_box = recorded_box(origin.at("start_box")), box = recorded_box(origin.at("box"));
    EXPECT_LT((step(centre_of(start_box)) - centre_of(box)).norm(), 1e-6);
    EXPECT_NEAR(step.scale * start_box.width, box.width, 1e-6);
    const std::vector<double> line = numbers_of(lines_of(path("boxes.csv"))[static_cast<size_t>(frame)]);
    EXPECT_NEAR(box.x, line[1], 1e-3);
    EXPECT_FALSE(origin.contains("true_box")) << "there is no ground truth";
    EXPECT_FALSE(origin.contains("true_placement"));
  }

  // Recording does not affect the tracker.
  ASSERT_EQ(run(images + " --out " + path("alone.csv"), false), 0) << err_;
  const std::vector<std::string> with = lines_of(path("boxes.csv")), without = lines_of(path("alone.csv"));
  ASSERT_EQ(with.size(), without.size());
  for (size_t i = 0; i < with.size(); ++i) EXPECT_EQ(without_time(with[i]), without_time(without[i]));
}

TEST_F(TrackTool, RecordsTheAnnotatedPlacement) {
  const fs::path sequence = make_sequence();
  // 48 x 40 px at first; then no object, twice the size, another shape of the same area, and a square on its
  // corner. The last frame is not annotated.
  std::ofstream(sequence / "groundtruth.txt") << "60,50,48,40\nnan,nan,nan,nan\n10,20,96,80\n"
                                                 "100,50,60,32\n100,66,133.9411255,32.0588745,"
                                                 "167.882251,66,133.9411255,99.9411255\n";
  const std::string file = path("systems.jsonl");
  ASSERT_EQ(run(sequence.string() + " --frames 6 --tracker dpt --record-systems " + file, false), 0) << err_;
  const auto systems = read_systems<SpringSystem<double, 2>>(file);
  ASSERT_EQ(systems.size(), 5u);
  for (const size_t i : {0u, 4u}) {
    EXPECT_FALSE(origin_of(systems[i]).contains("true_box")) << i;
    EXPECT_FALSE(origin_of(systems[i]).contains("true_placement")) << i;
  }
  EXPECT_EQ(recorded_box(origin_of(systems[1]).at("true_box")), cv::Rect2d(10, 20, 96, 80));
  EXPECT_EQ(recorded_box(origin_of(systems[2]).at("true_box")), cv::Rect2d(100, 50, 60, 32));
  const Region square =
      Region::polygon({{100, 66}, {133.9411255, 32.0588745}, {167.882251, 66}, {133.9411255, 99.9411255}});
  EXPECT_EQ(recorded_box(origin_of(systems[3]).at("true_box")), square.equal_area_box());
  EXPECT_NE(square.equal_area_box(), square.box());

  // In the first frame the parts were 12 and 10 px from the middle of the box.
  const auto expect_parts = [&](const nlohmann::json& placement, double x, double y, double scale) {
    ASSERT_EQ(placement.size(), 4u);
    for (size_t i = 0; i < 4; ++i) {
      EXPECT_NEAR(placement[i][0].get<double>(), x - 0.5 + (i % 2 == 0 ? -12 : 12) * scale, 1e-9) << i;
      EXPECT_NEAR(placement[i][1].get<double>(), y - 0.5 + (i < 2 ? -10 : 10) * scale, 1e-9) << i;
    }
  };
  expect_parts(origin_of(systems[1]).at("true_placement"), 58, 60, 2);
  expect_parts(origin_of(systems[2]).at("true_placement"), 130, 66, 1);
  const cv::Rect2d box = square.equal_area_box();
  expect_parts(origin_of(systems[3]).at("true_placement"), 133.9411255, 66,
               std::sqrt(box.area() / (48 * 40)));
}

TEST_F(TrackTool, RecordsNoSystemInAnInterruption) {
  const fs::path images = make_images("images", 6);
  cv::imwrite((images / "img_4.png").string(), cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(0)));
  const std::string file = path("systems.jsonl");
  ASSERT_EQ(run(images.string() + kBox + " --tracker dpt --record-systems " + file, false), 0) << err_;
  std::vector<int> frames;
  for (const auto& stored : read_systems<SpringSystem<double, 2>>(file))
    frames.push_back(origin_of(stored).at("frame").get<int>());
  EXPECT_EQ(frames, (std::vector<int>{2, 3, 5, 6}));
}

TEST_F(TrackTool, WaitsForTheFirstFrameWithAScene) {
  const fs::path images = make_images("images", 6);
  cv::imwrite((images / "img_1.png").string(), cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(0)));
  cv::Mat noise(240, 320, CV_8UC3);
  cv::RNG(1).fill(noise, cv::RNG::NORMAL, 128, 60);
  cv::imwrite((images / "img_2.png").string(), noise);
  const std::string tracked = images.string() + kBox + " --tracker kcf";
  EXPECT_NE(run(tracked, false), 0);
  EXPECT_NE(err_.find("have one gray level or color: there is nothing to follow"), std::string::npos) << err_;
  EXPECT_EQ(run(tracked + " --start 2", false), 0) << err_;
  EXPECT_NE(err_.find("frame 2 shows noise or one gray level; --wait"), std::string::npos) << err_;
  EXPECT_EQ(run(tracked + " --wait", false), 0) << err_;
  EXPECT_NE(err_.find("starts in frame 3, the first that shows a scene"), std::string::npos) << err_;
  EXPECT_NE(err_.find("4 frames"), std::string::npos) << err_;
  EXPECT_NE(run(tracked + " --wait --start 7", false), 0);
}

TEST_F(TrackTool, NamesRecordedSystemsAfterTheInput) {
  const std::string file = path("systems.jsonl"), record = " --tracker dpt --record-systems " + file;
  ASSERT_EQ(run(make_sequence().string() + "/ --start 6 --frames 3" + record, false), 0) << err_;
  ASSERT_EQ((read_systems<SpringSystem<double, 2>>(file).size()), 2u);
  EXPECT_EQ((read_systems<SpringSystem<double, 2>>(file)[0].name), "sequence/frame 7");
  ASSERT_EQ(run(make_video().string() + kBox + " --frames 2" + record, false), 0) << err_;
  ASSERT_EQ((read_systems<SpringSystem<double, 2>>(file).size()), 1u) << "a former file is replaced";
  EXPECT_EQ((read_systems<SpringSystem<double, 2>>(file)[0].name), "video.avi/frame 2");
}

TEST_F(TrackTool, RecordsTheSystemsOfADptWithOptions) {
  const std::string file = path("systems.jsonl"), tracker = R"(dpt{"grid_rows": 3})";
  ASSERT_EQ(
      run(make_images("images", 3).string() + kBox + " --tracker '" + tracker + "' --record-systems " + file,
          false),
      0)
      << err_;
  const auto systems = read_systems<SpringSystem<double, 2>>(file);
  ASSERT_EQ(systems.size(), 2u);
  EXPECT_EQ(origin_of(systems[0]).at("tracker"), tracker);
  EXPECT_EQ(systems[0].system.nodes(), 6);
}

TEST_F(TrackTool, ReportsSystemsThatItCannotRecord) {
  const std::string images = make_images("images", 3).string(), record = " --record-systems ";
  for (const std::string tracker : {"kcf", "coarse"}) {
    expect_error(images + kBox + " --tracker " + tracker + record + path("s.jsonl"),
                 {"--record-systems: ", tracker, "(dpt does)"}, false);
    EXPECT_FALSE(fs::exists(path("s.jsonl")));
  }
  const std::string dpt = " --tracker dpt" + record, video = make_video().string();
  expect_error(images + kBox + dpt + path("no/s.jsonl"), {"--record-systems", path("no")}, false);
  expect_error(images + kBox + dpt + images, {"--record-systems", "folder"}, false);
  expect_error(video + kBox + dpt + video, {"--record-systems", "input"}, false);
  if (fs::exists("/dev/full")) {
    expect_error(images + kBox + dpt + "/dev/full", {"/dev/full", "No space left"}, false);
  }
  // The systems of earlier frames are kept when one fails.
  std::ofstream(images + "/img_3.png", std::ios::trunc) << "broken";
  expect_error(images + kBox + dpt + path("s.jsonl"), {"img_3.png"}, false);
  EXPECT_EQ(read_systems(path("s.jsonl")).size(), 1u);
}
#else
TEST_F(TrackTool, SaysThatItCannotRecordSystems) {
  expect_error(
      make_images("images", 3).string() + kBox + " --tracker dpt --record-systems " + path("s.jsonl"),
      {"--record-systems", "built without", "nlohmann-json3-dev"}, false);
  EXPECT_FALSE(fs::exists(path("s.jsonl")));
}
#endif

TEST_F(TrackTool, ReportsErrorsInOneLine) {
  const std::string images = make_images("images", 3).string();
  expect_error(path("missing.avi") + kBox, {"missing.avi"});
  expect_error(path("missing") + "/%d.png" + kBox, {"missing"});
  expect_error(images + "/x_%d.png" + kBox, {"no images"});
  expect_error(images + "/%d_%d.png" + kBox, {"%d_%d.png"});
  std::ofstream(path("text.avi")) << "no video\n";
  expect_error(path("text.avi") + kBox, {"text.avi"});
  fs::create_directory(path("empty"));
  expect_error(path("empty") + kBox, {"no images"});

  expect_error(images, {"--box"});
  for (const std::string box :
       {"1,2,3", "1,2,3,4,5", "a,b,c,d", "1,2,0,4", "1,2,3,-4", "1,2,nan,4", "1,2,3,4,"}) {
    expect_error(images + " --box=" + box, {"--box"});
  }
  expect_error(images + " --box ''", {"--box"});
  expect_error(images + " --box 4000,50,48,40" + csv(), {"kcf in frame 1: "});
  expect_error(images + kBox + " --tracker magic", {"magic", "dpt", "coarse", "kcf"}, false);

  for (const std::string option : {"--out", "--save", "--sheet", "--timeline"}) {
    expect_error(images + kBox + " " + option + " " + path("no/x.mp4"), {option, path("no")});
    expect_error(images + kBox + " " + option + " " + images, {option, "folder"});
  }
  expect_error(images + kBox + " --sheet " + path("sheet.what"), {"--sheet"});
  expect_error(images + kBox + " --show", {"--show", "display"});
  expect_error(images + kBox + " --bogus", {"--bogus"});
  expect_error(images + "/*.png" + kBox, {"quotes"});
  expect_error(images + kBox + " --start 0", {"--start"});
}

TEST_F(TrackTool, DoesNotOverwriteItsInput) {
  const std::string video = make_video().string();
  const auto size = fs::file_size(video);
  expect_error(video + kBox + " --save " + video, {"--save", "input"});
  EXPECT_EQ(fs::file_size(video), size);
}

TEST_F(TrackTool, DoesNotOverwriteTheFilesOfItsInput) {
  const std::string sequence = make_sequence().string(), images = sequence + "/color",
                    truth = sequence + "/groundtruth.txt", frame = images + "/img_3.png", bytes = read(frame),
                    boxes = read(truth);
  const auto refused = [&](const std::string& input, const std::string& output) {
    expect_error(input + output, {"would change the input"});
    EXPECT_EQ(read(frame), bytes);
    EXPECT_EQ(read(truth), boxes);
  };
  refused(sequence, " --out " + truth);
  refused(sequence, " --out " + images + "/../groundtruth.txt");
  refused(sequence, " --sheet " + frame);
  for (const std::string input : {"", "/img_%d.png", "/*.png", "/img_3.png"})
    refused("'" + images + input + "'" + kBox, " --sheet " + frame);
  fs::create_symlink(frame, path("link.png"));
  refused(images + kBox, " --sheet " + path("link.png"));

  // Also through a link to a file that does not exist yet.
  fs::create_symlink(images + "/img_99.png", path("dangling.png"));
  refused(images + kBox, " --sheet " + path("dangling.png"));
  fs::create_symlink("boxes.csv", path("later.csv"));
  expect_error(images + kBox + " --out " + path("boxes.csv") + " --record-systems " + path("later.csv") +
                   " --tracker dpt",
               {"is the file of"}, false);
  EXPECT_FALSE(fs::exists(images + "/img_99.png") || fs::exists(path("boxes.csv")));

  // New files that the next run would take for frames are refused; others may be in the same folder.
  refused(images + kBox, " --sheet " + images + "/new.png");
  refused("'" + images + "/img_%d.png'" + kBox, " --sheet " + images + "/img_21.png");
  EXPECT_FALSE(fs::exists(images + "/new.png") || fs::exists(images + "/img_21.png"));
  ASSERT_EQ(run("'" + images + "/img_%d.png'" + kBox + " --out " + images + "/boxes.csv --sheet " + images +
                "/new.png"),
            0)
      << err_;
}

TEST_F(TrackTool, WritesNoFileTwice) {
  const std::string images = make_images("images", 3).string() + kBox, file = path("x.png");
  expect_error(images + " --sheet " + file + " --out " + file, {"--sheet", "is the file of --out"});
  expect_error(images + " --sheet " + file + " --save " + path("images/../x.png"),
               {"--sheet", "is the file of --save"});
  EXPECT_FALSE(fs::exists(file));
}

// As under a service manager. Output must not end up in a file that gets a stream's number, and it is an
// error if the boxes cannot be written.
TEST_F(TrackTool, StartsWithClosedStreams) {
  const std::string arguments = make_images("images", 3).string() + kBox + " --tracker kcf --out ";
  for (const std::string closed : {"2>&-", ">&- 2>&-", "<&- >&- 2>&-"}) {
    EXPECT_EQ(run(arguments + path("boxes.csv") + " " + closed + " #", false), 0);
    expect_boxes(path("boxes.csv"), 1, 3);
  }
  EXPECT_EQ(run(arguments + "- >&- 2> " + path("err") + " #", false), 1);
  EXPECT_EQ(err_, "asterism-track: cannot write the standard output: Bad file descriptor\n");
}

TEST_F(TrackTool, ReportsAFullDisk) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  expect_error(make_images("images", 3).string() + kBox + " --out /dev/full", {"/dev/full", "No space left"});
}

TEST_F(TrackTool, ReportsADiskThatFillsUp) {
  const std::string images = make_images("images").string() + kBox;
  limits_ = "trap '' XFSZ; ulimit -f 1; ";  // file size in blocks of 512 bytes
  for (const auto& [option, file] :
       {std::pair(" --out ", "boxes.csv"), {" --save ", "overlay.mp4"}, {" --sheet ", "sheet.png"}})
    expect_error(images + option + path(file), {file});
}

TEST_F(TrackTool, NamesFileAndLineOfMalformedGroundTruth) {
  const std::string file = path("sequence") + "/groundtruth.txt";
  for (const std::string line : {"1,2,3", "1,2,x,4", "1,2,3,4,5,6,7", "1,2,-3,4", "1,2,inf,4"}) {
    expect_error(make_sequence(line + "\n").string(), {file + ":21: "});
  }
  expect_error(make_sequence("\n1,2,3,4\n").string(), {file + ":21: "});
  EXPECT_EQ(run(make_sequence("\n\n").string()), 0) << "empty lines may end the file: " << err_;
  std::ofstream(file, std::ios::trunc).close();
  expect_error(path("sequence"), {file + ":1: "});
}

TEST_F(TrackTool, KeepsWhatThereIsBeforeAFrameThatCannotBeDecoded) {
  const std::string images = make_images("images").string();
  std::ofstream(images + "/img_11.png", std::ios::trunc) << "broken";
  expect_error(images + kBox + csv() + " --save " + path("overlay.mp4") + " --sheet " + path("sheet.png"),
               {"frame 11", "img_11.png"});
  expect_boxes(path("boxes.csv"), 1, 10);
  EXPECT_FALSE(cv::imread(path("sheet.png")).empty());
  cv::VideoCapture video(path("overlay.mp4"));
  int frames = 0;
  for (cv::Mat image; video.read(image);) ++frames;
  EXPECT_EQ(frames, 10);
}

TEST_F(TrackTool, TakesDamagedFramesAsBlank) {
  const std::string images = make_images("images").string();
  for (const int frame : {8, 12}) {
    const std::string file = images + "/img_" + std::to_string(frame) + ".png", whole = read(file);
    std::ofstream(file, std::ios::binary | std::ios::trunc)
        << whole.substr(0, frame == 8 ? whole.size() / 2 : 0);
  }
  ASSERT_EQ(run(images + kBox + csv() + " --sheet " + path("sheet.png")), 0) << err_;
  EXPECT_EQ(lines_of(path("boxes.csv")).size(), kFrames + 1u);
  const std::string note =
      "asterism-track: note: damaged frames, treated as blank: 2, the first is frame 8, " + images +
      "/img_8.png\n";
  EXPECT_TRUE(err_.starts_with(note)) << err_;
  EXPECT_EQ(std::count(err_.begin(), err_.end(), '\n'), 2)
      << "and the summary, nothing of the codecs: " << err_;
  expect_error(images + " --start 8" + kBox, {"frame 8, ", "img_8.png is damaged", "--start"});
  expect_error(images + " --start 12" + kBox, {"frame 12, ", "a damaged image of unknown size"});
}

TEST_F(TrackTool, RefusesImagesOfGigabytes) {
  const std::string images = make_images("images", 3).string(), file = images + "/img_2.png";
  std::string bytes = read(file);
  bytes.replace(16, 8, std::string("\x00\x00\xff\xff\x00\x00\xff\xff", 8));
  std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
  expect_error(images + kBox,
               {"frame 2, ", "img_2.png: an image of 65535 x 65535 pixels, and at most 134217728"});
}

TEST_F(TrackTool, TakesARangeForDeepImages) {
  const auto make = [&](double scale) {
    fs::create_directories(path("deep"));
    for (int i = 1; i <= 5; ++i) {
      cv::Mat image;
      draw_frame(i - 1).convertTo(image, CV_16U, scale);
      cv::imwrite(path("deep/" + std::to_string(i) + ".png"), image);
    }
    return path("deep") + kBox + csv();
  };
  ASSERT_EQ(run(make(257)), 0) << err_;
  EXPECT_EQ(err_.find("note"), std::string::npos) << err_;
  expect_boxes(path("boxes.csv"), 1, 5);
  const auto boxes = [&] {
    std::string text;
    for (const std::string& line : lines_of(path("boxes.csv"))) text += without_time(line) + "\n";
    return text;
  };
  const std::string expected = boxes();
  expect_error(make(1), {"frame 1: ", "--bits 8"});
  for (const std::string range : {" --bits 8", " --range 0,255"}) {
    ASSERT_EQ(run(make(1) + range), 0) << err_;
    EXPECT_EQ(boxes(), expected);
  }
  ASSERT_EQ(run(make(4095.0 / 255)), 0) << err_;
  EXPECT_NE(err_.find("note: the first frame uses 12 of 16 bits: --bits 12"), std::string::npos) << err_;
  ASSERT_EQ(run(make(4095.0 / 255) + " --bits 12"), 0) << err_;
  EXPECT_EQ(err_.find("note"), std::string::npos) << err_;
  EXPECT_EQ(boxes(), expected);
  for (const std::string bad : {"--bits 0", "--bits 17", "--bits x", "--range 1", "--range 2,1",
                                "--range 0,nan", "--range 1,2,3", "--bits 8 --range 0,255"})
    expect_error(make(1) + " " + bad, {bad.substr(0, bad.find(' '))});
}

TEST_F(TrackTool, TurnsFramesAndTakesARate) {
  fs::create_directories(path("turned"));
  for (int i = 1; i <= 5; ++i) {
    cv::Mat image;
    cv::rotate(draw_frame(i - 1), image, cv::ROTATE_90_COUNTERCLOCKWISE);
    cv::imwrite(path("turned/" + std::to_string(i) + ".png"), image);
  }
  ASSERT_EQ(run(path("turned") + kBox + csv() + " --rotate 90 --fps 7.5 --save " + path("overlay.mp4")), 0)
      << err_;
  expect_boxes(path("boxes.csv"), 1, 5);
  EXPECT_EQ(cv::VideoCapture(path("overlay.mp4")).get(cv::CAP_PROP_FPS), 7.5);
  for (const std::string bad : {"--rotate 45", "--rotate -90", "--fps 0", "--fps nan", "--fps x"})
    expect_error(path("turned") + kBox + " " + bad, {bad.substr(0, bad.find(' '))});
}

TEST_F(TrackTool, ReadsThePagesOfAStack) {
  std::vector<cv::Mat> pages;
  for (int i = 0; i < kFrames; ++i) pages.push_back(draw_frame(i));
  ASSERT_TRUE(cv::imwritemulti(path("stack.tif"), pages));
  ASSERT_EQ(run(path("stack.tif") + kBox + csv()), 0) << err_;
  expect_boxes(path("boxes.csv"), 1, kFrames);
  expect_error(path("stack.tif") + kBox + " --sheet " + path("stack.tif"), {"would change the input"});
}

TEST_F(TrackTool, RefusesTwoImagesOfAFrame) {
  const std::string images = make_images("images", 3).string();
  cv::imwrite(images + "/img_2.jpg", draw_frame(1));
  expect_error(images + kBox, {"two images for one frame", "img_2.jpg", "img_2.png"});
  EXPECT_EQ(run("'" + images + "/*.png'" + kBox), 0) << err_;
}

TEST_F(TrackTool, KeepsWhatThereIsWhenInterrupted) {
  // Far more frames than can be tracked before the signal.
  const fs::path image = make_images("images", 1) / "img_1.png";
  fs::create_directory(path("long"));
  for (int i = 1; i <= 3000; ++i) fs::create_symlink(image, path("long/" + std::to_string(i) + ".png"));
  for (const auto& [signal, code] : {std::pair(SIGINT, 130), std::pair(SIGTERM, 143)}) {
    const std::string csv = path(std::to_string(signal) + ".csv"),
                      sheet = path(std::to_string(signal) + ".png"),
                      save = path(std::to_string(signal) + ".mp4");
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      if (std::freopen("/dev/null", "w", stderr) == nullptr) _exit(99);
      execl(ASTERISM_TRACK_TOOL, ASTERISM_TRACK_TOOL, path("long").c_str(), "--box", "60,50,48,40",
            "--tracker", "kcf", "--out", csv.c_str(), "--sheet", sheet.c_str(), "--save", save.c_str(),
            nullptr);
      _exit(99);
    }
    for (int i = 0; i < 3000 && lines_of(csv).size() < 6; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    kill(child, signal);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status)) << status;
    EXPECT_EQ(WEXITSTATUS(status), code);

    const std::vector<std::string> lines = lines_of(csv);
    ASSERT_GE(lines.size(), 6u);
    EXPECT_LT(lines.size(), 3000u);
    EXPECT_EQ(read(csv).back(), '\n');
    for (size_t i = 1; i < lines.size(); ++i) EXPECT_EQ(numbers_of(lines[i]).size(), 9u) << lines[i];
    EXPECT_FALSE(cv::imread(sheet).empty());
    cv::VideoCapture video(save);
    size_t frames = 0;
    for (cv::Mat frame; video.read(frame);) ++frames;
    EXPECT_EQ(frames, lines.size() - 1);
  }
}

TEST_F(TrackTool, NotesAVideoThatEndsEarly) {
  const std::string video = make_video().string();
  // The index at the end is lost; the header still announces all frames.
  fs::resize_file(video, fs::file_size(video) / 2);
  ASSERT_EQ(run(video + kBox + csv()), 0) << err_;
  const std::vector<std::string> lines = lines_of(path("boxes.csv"));
  EXPECT_GT(lines.size(), 5u);
  EXPECT_LT(lines.size(), static_cast<size_t>(kFrames));
}

TEST_F(TrackTool, NotesWhatIsMissing) {
  const fs::path images = make_images("images");
  fs::remove(images / "img_5.png");
  ASSERT_EQ(run(images.string() + kBox + csv()), 0) << err_;
  EXPECT_NE(err_.find("note: images are missing: 1 by their numbers, the first after " +
                      (images / "img_4.png").string()),
            std::string::npos)
      << err_;
  EXPECT_EQ(lines_of(path("boxes.csv")).size(), static_cast<size_t>(kFrames));

  const fs::path video = folder_ / "video.ts";
  cv::VideoWriter writer(video.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('m', 'p', 'g', '2'), 25,
                         {320, 240});
  if (!writer.isOpened()) GTEST_SKIP() << "OpenCV writes no transport stream here";
  for (int i = 0; i < 75; ++i) writer.write(draw_frame(i % kFrames));
  writer.release();
  std::string bytes = read(video);
  for (std::size_t i = bytes.size() * 2 / 5; i < bytes.size() * 3 / 5; ++i)
    bytes[i] = static_cast<char>(37 * i * i);
  std::ofstream(video, std::ios::binary | std::ios::trunc) << bytes;
  ASSERT_EQ(run(video.string() + kBox + csv()), 0) << err_;
  EXPECT_NE(err_.find("note: frames are missing, about "), std::string::npos) << err_;
}

// Half the size in mid-stream: the object keeps its size in the first frame's pixels.
TEST_F(TrackTool, FollowsThroughFramesOfHalfTheSize) {
  const fs::path images = make_images("images");
  for (int i = 11; i <= kFrames; ++i) {
    cv::Mat half;
    cv::resize(draw_frame(i - 1), half, {}, 0.5, 0.5, cv::INTER_AREA);
    cv::imwrite((images / ("img_" + std::to_string(i) + ".png")).string(), half);
  }
  ASSERT_EQ(run(images.string() + kBox + csv()), 0) << err_;
  expect_boxes(path("boxes.csv"), 1, kFrames);
  EXPECT_NE(err_.find("frame 11 has 160 x 120 pixels"), std::string::npos) << err_;
}

TEST_F(TrackTool, SurvivesVideosThatAreCutOrDamaged) {
  const std::string video = make_video().string(), whole = read(video);
  const auto survives = [&](const std::string& bytes) {
    std::ofstream(video, std::ios::binary | std::ios::trunc) << bytes;
    const int code = run(video + kBox + csv());
    EXPECT_TRUE(code == 0 || code == 1) << code;
    if (code == 1) {
      EXPECT_EQ(std::count(err_.begin(), err_.end(), '\n'), 1) << err_;
    }
    return code;
  };
  for (const std::size_t length : {std::size_t{0}, std::size_t{1}, std::size_t{100}})
    EXPECT_EQ(survives(whole.substr(0, length)), 1) << length;
  for (std::size_t eighth = 1; eighth < 8; ++eighth) {
    SCOPED_TRACE(eighth);
    survives(whole.substr(0, whole.size() * eighth / 8));
    std::string damaged = whole;
    for (std::size_t i = 0; i < 64; ++i) damaged[whole.size() * (eighth - 1) / 8 + 97 * i] ^= char(0x5a);
    survives(damaged);
  }
}

// As when a camera is unplugged within a frame: results so far are kept.
TEST_F(TrackTool, KeepsWhatThereIsWhenACameraDisappears) {
  const std::string stream = read(make_video()), camera = path("camera.avi");
  ASSERT_EQ(mkfifo(camera.c_str(), 0600), 0);
  std::thread writer([&] {
    signal(SIGPIPE, SIG_IGN);
    std::ofstream(camera, std::ios::binary).write(stream.data(), std::ssize(stream) * 6 / 10);
  });
  const int code = run(camera + kBox + csv());
  writer.join();
  EXPECT_EQ(code, 0) << err_;
  const std::size_t frames = lines_of(path("boxes.csv")).size() - 1;
  EXPECT_GT(frames, std::size_t{kFrames / 3});
  EXPECT_LT(frames, std::size_t{kFrames});
  expect_error("97" + std::string(kBox), {"cannot open camera 97"});
}

TEST(GroundTruthFile, GivesBoundingBoxesOfPolygonsAndRectangles) {
  const fs::path path =
      fs::path(testing::TempDir()) / ("asterism_truth_" + std::to_string(getpid()) + ".txt");
  std::ofstream(path) << "10,20,5,3,30,12,25,31\r\n 1.5\t2 3 4 \nnan,nan,nan,nan\n0,0,0,0\n\n";
  const std::vector<std::optional<Region>> truth = read_ground_truth(path);
  fs::remove(path);
  ASSERT_EQ(truth.size(), 4u);
  ASSERT_TRUE(truth[0] && truth[1]);
  EXPECT_EQ(truth[0]->box(), cv::Rect2d(5, 3, 25, 28));
  EXPECT_EQ(truth[0]->points()[3], cv::Point2d(25, 31));
  EXPECT_EQ(truth[1]->box(), cv::Rect2d(1.5, 2, 3, 4));
  EXPECT_EQ(truth[1]->points()[2], cv::Point2d(4.5, 6));
  EXPECT_FALSE(truth[2] || truth[3]);
  EXPECT_THROW(read_ground_truth("/no/such/file"), std::runtime_error);
}

TEST(Region, IsARectangleOrAPolygonByTheCountOfItsNumbers) {
  const auto box = parse_region("1.5, 2;3\t4");
  ASSERT_TRUE(box);
  EXPECT_TRUE(box->is_rectangle());
  EXPECT_EQ(box->box(), cv::Rect2d(1.5, 2, 3, 4));
  const auto triangle = parse_region("0,0,10,-5,4,8");
  ASSERT_TRUE(triangle);
  EXPECT_FALSE(triangle->is_rectangle());
  EXPECT_EQ(triangle->points().size(), 3u);
  EXPECT_EQ(triangle->box(), cv::Rect2d(0, -5, 10, 13));
  for (const char* none : {"", "1", "1,2,3,4,5", "1,2", "1,2,-3,4", "nan,nan,nan,nan", "0,0,inf,1,1,1",
                           "1,2,3,x", "1,2,3,4,5,6,7"}) {
    EXPECT_FALSE(parse_region(none)) << none;
  }
  EXPECT_THROW(Region::polygon({{0, 0}, {1, 1}}), std::invalid_argument);
}

TEST(Region, ComesBackExactlyFromItsText) {
  const Region box = Region::rectangle({0.1, -1e-9, 1.0 / 3, 1e300});
  EXPECT_EQ(parse_region(to_string(box)), box);
  const Region polygon = Region::polygon({{0.1, 2}, {1.0 / 3, 1e-300}, {-7, 5}});
  EXPECT_EQ(parse_region(to_string(polygon)), polygon);
  EXPECT_EQ(to_string(Region::rectangle({1, 2.5, 3, 4})), "1,2.5,3,4");
}

TEST(Overlap, IsIntersectionOverUnion) {
  EXPECT_DOUBLE_EQ(overlap({0, 0, 10, 10}, {0, 0, 10, 10}), 1);
  EXPECT_DOUBLE_EQ(overlap({0, 0, 10, 10}, {5, 0, 10, 10}), 1.0 / 3);
  EXPECT_EQ(overlap({0, 0, 10, 10}, {10, 0, 10, 10}), 0);
  EXPECT_EQ(overlap({0, 0, 0, 0}, {0, 0, 0, 0}), 0);
  EXPECT_EQ(overlap({std::nan(""), 0, 1, 1}, {0, 0, 1, 1}), 0);
}

TEST(NaturalOrder, ComparesRunsOfDigitsAsNumbers) {
  EXPECT_TRUE(natural_less("frame9", "frame10"));
  EXPECT_TRUE(natural_less("frame009", "frame10"));
  EXPECT_TRUE(natural_less("a1b2", "a1b10"));
  EXPECT_TRUE(natural_less("a", "b"));
  EXPECT_FALSE(natural_less("frame10", "frame9"));
  EXPECT_FALSE(natural_less("x1", "x1"));
  EXPECT_NE(natural_less("x01", "x1"), natural_less("x1", "x01"));
  EXPECT_TRUE(natural_less("99999999999999999999998", "99999999999999999999999"));
}

}  // namespace
}  // namespace asterism::tools
