// Data sets of every layout, made here in a temporary folder, and the annotated sequences where they are.
#include "dataset.hpp"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

class DatasetTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "asterism-dataset-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
  }
  void TearDown() override { fs::remove_all(root_); }

  void write(const std::string& file, const std::string& text) {
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text;
  }

  // Images first .. last of a folder, whose one colour is their number.
  void images(const std::string& folder, int first, int last, const char* format = "%08d.png") {
    fs::create_directories(root_ / folder);
    for (int i = first; i <= last; ++i) {
      char name[32];
      std::snprintf(name, sizeof name, format, i);
      cv::imwrite((root_ / folder / name).string(), cv::Mat(4, 6, CV_8UC3, cv::Scalar::all(i)));
    }
  }

  // Lines of text, "\n" at the end of each.
  static std::string lines(const std::string& line, int count) {
    std::string text;
    for (int i = 0; i < count; ++i) text += line + "\n";
    return text;
  }

  void vot(const std::string& name = "vot/car", int frames = 3) {
    images(name + "/color", 1, frames);
    write(name + "/groundtruth.txt", lines("0,0,10,0,10,5,0,5", frames));
  }

  std::vector<Sequence> open(const std::string& folder, Layout layout = Layout::Auto,
                             const std::vector<std::string>& only = {}) {
    return open_dataset(root_ / folder, layout, only);
  }

  // That the data set is refused with a message that has all these parts.
  void expect_error(const std::string& folder, const std::vector<std::string>& parts,
                    const std::vector<std::string>& only = {}) {
    try {
      open(folder, Layout::Auto, only);
      ADD_FAILURE() << "no error with " << parts[0];
    } catch (const std::runtime_error& error) {
      for (const std::string& part : parts)
        EXPECT_NE(std::string(error.what()).find(part), std::string::npos)
            << error.what() << " without " << part;
    }
  }

  fs::path root_;
};

TEST_F(DatasetTest, LayoutsHaveNames) {
  for (const char* name : {"auto", "vot", "otb", "got10k", "lasot", "plain"})
    EXPECT_EQ(to_string(parse_layout(name)), name);
  EXPECT_THROW(parse_layout("vto"), std::invalid_argument);
}

TEST_F(DatasetTest, ReadsVotInTheOrderOfItsList) {
  vot("vot/car", 3);
  vot("vot/ball", 2);
  vot("vot/unlisted", 1);
  write("vot/list.txt", "car\r\nball\n\n");
  write("vot/car/groundtruth.txt", "0,0,10,0,10,5,0,5\nnan,nan,nan,nan,nan,nan,nan,nan\n1,2,3,4\n");
  write("vot/car/occlusion.tag", "0\n1\n1\n");
  write("vot/car/blur.label", "1\n0\n0");
  write("vot/car/practical.value", "0.1\n0.2\n0.30");
  const std::vector<Sequence> sequences = open("vot");
  ASSERT_EQ(sequences.size(), 2u);
  const Sequence& car = sequences[0];
  EXPECT_EQ(car.name, "car");
  EXPECT_EQ(sequences[1].name, "ball");
  ASSERT_EQ(car.length(), 3u);
  EXPECT_EQ(car.images[2], root_ / "vot/car/color/00000003.png");
  EXPECT_EQ(car.truth[0], tools::parse_region("0,0,10,0,10,5,0,5"));
  EXPECT_FALSE(car.truth[1]);
  EXPECT_TRUE(car.truth[2]->is_rectangle());
  EXPECT_EQ(car.tags, (std::map<std::string, std::vector<bool>>{{"occlusion", {false, true, true}},
                                                                {"blur", {true, false, false}}}));
  EXPECT_EQ(car.practical, (std::vector<double>{0.1, 0.2, 0.3}));
  // One sequence alone, with a separator at the end.
  EXPECT_EQ(open("vot/ball/").at(0).name, "ball");
}

TEST_F(DatasetTest, ReadsTheSequenceFileOfTodaysToolkit) {
  images("vot/lamp/ir", 1, 2);
  images("vot/lamp/color", 1, 3);
  write("vot/lamp/boxes.txt", lines("1,2,3,4", 2));
  write("vot/lamp/sequence",
        "# made by the toolkit\nname=lamp\nfps=30\ngroundtruth=boxes.txt\nchannels.color=color/%08d.png\n"
        "channels.ir=ir/%08d.png\nchannel.default=ir\n");
  const Sequence lamp = open("vot").at(0);
  EXPECT_EQ(lamp.length(), 2u);
  EXPECT_EQ(lamp.images[0], root_ / "vot/lamp/ir/00000001.png");
  write("vot/lamp/sequence", "name=lamp\nfps\n");
  expect_error("vot", {"lamp/sequence:2: "});
}

TEST_F(DatasetTest, ReadsOtbWithItsSeparatorsObjectsAndParts) {
  images("otb/Walking/img", 1, 3, "%04d.png");
  write("otb/Walking/groundtruth_rect.txt", "1,2,3,4\n1\t2\t3\t4\n1 2 3 4\n");
  images("otb/Jogging/img", 1, 2, "%04d.png");
  write("otb/Jogging/groundtruth_rect.1.txt", lines("1,2,3,4", 2));
  write("otb/Jogging/groundtruth_rect.2.txt", lines("9,2,3,4", 2));
  images("otb/David/img", 298, 302, "%04d.png");
  write("otb/David/groundtruth_rect.txt", lines("1,2,3,4", 3));
  images("otb/Football1/img", 72, 76, "%04d.png");
  write("otb/Football1/groundtruth_rect.txt", lines("1,2,3,4", 3));
  images("otb/Tiger1/img", 1, 8, "%04d.png");
  write("otb/Tiger1/groundtruth_rect.txt", lines("1,2,3,4", 5) + lines("5,6,7,8", 3));
  std::vector<std::string> names;
  const std::vector<Sequence> sequences = open("otb");
  for (const Sequence& s : sequences) names.push_back(s.name);
  EXPECT_EQ(names,
            (std::vector<std::string>{"David", "Football1", "Jogging-1", "Jogging-2", "Tiger1", "Walking"}));
  EXPECT_EQ(sequences[0].images[0].filename(), "0300.png");
  EXPECT_EQ(sequences[1].images.back().filename(), "0074.png");
  EXPECT_EQ(sequences[3].truth[0]->box().x, 9);
  EXPECT_EQ(sequences[4].images[0].filename(), "0006.png");
  EXPECT_EQ(sequences[4].truth[0]->box().x, 5);
  EXPECT_EQ(sequences[5].truth, (std::vector<std::optional<Region>>(3, Region::rectangle({1, 2, 3, 4}))));
  EXPECT_EQ(sequences[5].tags.size(), 3u);
  EXPECT_EQ(sequences[5].tags.at("OCC"), std::vector<bool>(3, true));
  EXPECT_EQ(open("otb", Layout::Auto, {"Jogging-2"}).size(), 1u);
  write("otb/Tiger1/groundtruth_rect.txt", lines("1,2,3,4", 4));
  expect_error("otb", {"Tiger1/groundtruth_rect.txt:4: 4 boxes, but 3 images", "0006.png"});
}

TEST_F(DatasetTest, ReadsGot10k) {
  const std::string folder = "got/val/GOT-10k_Val_000001";
  images(folder, 1, 4);
  write(folder + "/groundtruth.txt", lines("1.0000,2.0000,3.0000,4.0000", 4));
  write(folder + "/absence.label", "0\n1\n0\n0\n");
  write(folder + "/cut_by_image.label", "0\n0\n1\n0\n");
  write(folder + "/cover.label", "8\n0\n5\n0\n");
  write(folder + "/meta_info.ini", "[METAINFO]\nanno_fps: 10Hz\n");
  const Sequence sequence = open("got").at(0);
  EXPECT_EQ(sequence.name, "GOT-10k_Val_000001");
  EXPECT_TRUE(sequence.truth[0] && !sequence.truth[1] && sequence.truth[2] && !sequence.truth[3]);
  EXPECT_EQ(sequence.tags.at("occlusion"), (std::vector<bool>{false, true, true, true}));
  EXPECT_EQ(sequence.tags.at("cut_by_image"), (std::vector<bool>{false, false, true, false}));
  write(folder + "/cover.label", "8\n0\n9\n0\n");
  expect_error("got", {"cover.label:3: "});
  // The test set gives the first box alone.
  images("got/test/GOT-10k_Test_000001", 1, 3);
  write("got/test/GOT-10k_Test_000001/groundtruth.txt", "1,2,3,4\n");
  write("got/test/GOT-10k_Test_000001/meta_info.ini", "");
  const Sequence test = open("got/test").at(0);
  EXPECT_EQ(test.length(), 3u);
  EXPECT_TRUE(test.truth[0] && !test.truth[1] && !test.truth[2]);
}

TEST_F(DatasetTest, ReadsLasot) {
  images("lasot/bear/bear-10/img", 1, 2);
  images("lasot/bear/bear-2/img", 1, 3);
  for (const auto& [name, frames] : {std::pair("bear-10", 2), std::pair("bear-2", 3)}) {
    write("lasot/bear/" + std::string(name) + "/groundtruth.txt", lines("1,2,3,4", frames));
    write("lasot/bear/" + std::string(name) + "/out_of_view.txt", frames == 2 ? "0,0" : "0,0,1");
    write("lasot/bear/" + std::string(name) + "/full_occlusion.txt", frames == 2 ? "0,1\n" : "0,1,0\n");
  }
  const std::vector<Sequence> sequences = open("lasot");
  ASSERT_EQ(sequences.size(), 2u);
  EXPECT_EQ(sequences[0].name, "bear-2");
  EXPECT_EQ(sequences[1].name, "bear-10");
  EXPECT_TRUE(sequences[0].truth[0] && !sequences[0].truth[1] && !sequences[0].truth[2]);
  EXPECT_EQ(sequences[0].tags.at("full_occlusion"), (std::vector<bool>{false, true, false}));
  write("lasot/bear/bear-2/out_of_view.txt", "0,0,2");
  expect_error("lasot", {"bear-2/out_of_view.txt:1: "});
  write("lasot/bear/bear-2/out_of_view.txt", "0,0");
  expect_error("lasot", {"out_of_view.txt:1: 2 values, but 3 frames"});
}

TEST_F(DatasetTest, ReadsPlainFoldersAndVideos) {
  images("plain/walk", 3, 12, "shot%d.png");
  write("plain/walk.txt", lines("1,2,3,4", 10));
  fs::create_directories(root_ / "plain/no_sequence");
  cv::VideoWriter writer((root_ / "plain/run.avi").string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 10,
                         {64, 48});
  for (int i = 0; i < 5; ++i) writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(40 * i)));
  writer.release();
  write("plain/run.txt", "1,2,3,4\n");
  const std::vector<Sequence> sequences = open("plain");
  ASSERT_EQ(sequences.size(), 2u);
  const Sequence &run = sequences[0], &walk = sequences[1];
  EXPECT_EQ(run.name, "run");
  EXPECT_EQ(run.length(), 5u);
  EXPECT_TRUE(run.images.empty() && run.truth[0] && !run.truth[4]);
  EXPECT_EQ(walk.name, "walk");
  EXPECT_EQ(walk.images[7].filename(), "shot10.png");

  FrameReader video(run), folder(walk);
  for (const std::size_t t : {0u, 1u, 4u, 2u, 2u, 3u}) {
    EXPECT_NEAR(video(t).at<cv::Vec3b>(20, 20)[0], 40 * static_cast<int>(t), 3) << t;
    EXPECT_EQ(folder(t).at<cv::Vec3b>(1, 1)[0], 3 + t);
  }
  EXPECT_THROW(video(5), std::out_of_range);
  write("plain/walk/shot5.png", "no image");
  EXPECT_THROW(folder(2), std::runtime_error);
  write("plain/walk/shot6.png", "");
  EXPECT_EQ(cv::norm(folder(3), cv::Mat(folder(4).size(), CV_8UC3, cv::Scalar::all(128)), cv::NORM_INF), 0)
      << "blank, since it is damaged";
  EXPECT_EQ(folder.damaged(), (std::set<fs::path>{walk.images[3]}));
  write("plain/run.txt", lines("1,2,3,4", 4));
  expect_error("plain", {"run.txt:4: 4 boxes, but 5 frames"});
  EXPECT_EQ(open("plain", Layout::Auto, {"walk"}).size(), 1u);
}

TEST_F(DatasetTest, NamesFileAndLineOfWhatIsWrong) {
  expect_error("nothing", {"nothing: no such"});
  fs::create_directories(root_ / "empty");
  expect_error("empty", {"empty: no annotated sequence"});
  vot();
  expect_error("vot", {"no sequence \"cart\""}, {"cart"});
  write("vot/list.txt", "car\ntruck\n");
  expect_error("vot", {"list.txt:2: ", "truck"});
  fs::remove(root_ / "vot/list.txt");

  write("vot/car/groundtruth.txt", "1,2,3,4\n1,2,3\n1,2,3,4\n");
  expect_error("vot", {"groundtruth.txt:2: "});
  write("vot/car/groundtruth.txt", lines("1,2,3,4", 4));
  expect_error("vot", {"groundtruth.txt:4: 4 boxes, but 3 images", "00000001.png", "00000003.png"});
  write("vot/car/groundtruth.txt", lines("1,2,3,4", 3));
  write("vot/car/blur.tag", "0\n1\n");
  expect_error("vot", {"blur.tag:2: 2 values, but 3 frames"});
  write("vot/car/blur.tag", "0\n1\nyes\n");
  expect_error("vot", {"blur.tag:3: ", "yes"});
  write("vot/car/blur.tag", "0\n1\n2\n");
  expect_error("vot", {"blur.tag:3: 0 or 1"});
  fs::remove(root_ / "vot/car/blur.tag");
  write("vot/car/practical.value", "0.1\nnan\n0.3\n");
  expect_error("vot", {"practical.value:2: "});
  fs::remove(root_ / "vot/car/practical.value");

  fs::rename(root_ / "vot/car/color/00000002.png", root_ / "vot/car/color/00000005.png");
  expect_error("vot", {"00000003.png: frame 2 is missing"});
  fs::remove_all(root_ / "vot/car/color");
  fs::create_directories(root_ / "vot/car/color");
  expect_error("vot", {"no images in"});

  vot("twice/a/car");
  vot("twice/b/car");
  expect_error("twice", {"another sequence of that name", "twice/a/car"});
}

TEST(AnnotatedSequences, AreRead) {
  const fs::path folder = ASTERISM_SEQUENCES;
  if (!fs::exists(folder / "bicycle"))
    GTEST_SKIP() << "no sequence bicycle in " << ASTERISM_SEQUENCES
                 << " (configure with -DASTERISM_SEQUENCES=FOLDER to name another)";
  const std::vector<Sequence> sequences = open_dataset(folder);
  for (const Sequence& sequence : sequences) {
    EXPECT_EQ(sequence.images.size(), sequence.length());
    EXPECT_TRUE(sequence.truth.at(0));
    for (const auto& [name, values] : sequence.tags) EXPECT_EQ(values.size(), sequence.length()) << name;
  }
  const Sequence bicycle = open_dataset(folder, Layout::Vot, {"bicycle"}).at(0);
  EXPECT_EQ(bicycle.length(), 271u);
  EXPECT_EQ(bicycle.tags.size(), 5u);
  EXPECT_EQ(bicycle.practical.size(), 271u);
  EXPECT_FALSE(bicycle.truth[0]->is_rectangle());
  FrameReader frames(bicycle);
  EXPECT_FALSE(frames(270).empty());
}

}  // namespace
}  // namespace asterism::bench
