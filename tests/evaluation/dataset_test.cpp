// Opens data sets of every layout, made here in a temporary folder, and the annotated sequences if they are
// present.
#include "dataset.hpp"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>
#include <tuple>

#include "ground_truth.hpp"

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

  // Writes images first .. last of a folder; the uniform color of each is its number.
  void images(const std::string& folder, int first, int last, const char* format = "%08d.png") {
    fs::create_directories(root_ / folder);
    for (int i = first; i <= last; ++i) {
      char name[32];
      std::snprintf(name, sizeof name, format, i);
      cv::imwrite((root_ / folder / name).string(), cv::Mat(4, 6, CV_8UC3, cv::Scalar::all(i)));
    }
  }

  // Repeated lines, each with "\n" at the end.
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
    Dataset dataset = open_dataset(root_ / folder, layout, only);
    notes_ = std::move(dataset.notes);
    return std::move(dataset.sequences);
  }

  // Checks that the data set opened last has a note with all these parts.
  void expect_note(const std::vector<std::string>& parts) const {
    EXPECT_TRUE(std::any_of(notes_.begin(), notes_.end(),
                            [&](const std::string& note) {
                              return std::all_of(parts.begin(), parts.end(), [&](const std::string& part) {
                                return note.find(part) != std::string::npos;
                              });
                            }))
        << parts[0] << " is not in: " << testing::PrintToString(notes_);
  }

  // Checks that a sequence is left out with such a note, and others are read.
  void expect_left_out(const std::string& folder, const std::vector<std::string>& parts) {
    EXPECT_FALSE(open(folder).empty());
    expect_note(parts);
  }

  // Checks that the data set is refused with a message that has all these parts.
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
  std::vector<std::string> notes_;
};

TEST_F(DatasetTest, LayoutsHaveNames) {
  for (const char* name :
       {"auto", "vot", "otb", "got10k", "lasot", "tc128", "trackingnet", "uav123", "nfs", "nfs240", "plain"})
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
  // A single sequence, with a separator at the end.
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
  expect_left_out("otb", {"Tiger1/groundtruth_rect.txt:4: 4 boxes, but 3 images", "0006.png"});
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
  // The test set gives only the first box.
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
  expect_left_out("lasot", {"bear-2/out_of_view.txt:1: "});
  write("lasot/bear/bear-2/out_of_view.txt", "0,0");
  EXPECT_EQ(open("lasot").at(0).tags.at("out_of_view"), std::vector<bool>(3));
  expect_note({"out_of_view.txt: 2 values, but 3 frames: the rest is taken for 0"});
  write("lasot/bear/bear-2/absent.txt", "0\n1\n0\n");
  EXPECT_FALSE(open("lasot").at(0).truth[1]);
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
  EXPECT_THROW(folder(3), UnreadableSequence) << "damaged";
  EXPECT_EQ(folder(4).at<cv::Vec3b>(1, 1)[0], 7);
  write("plain/run.txt", lines("1,2,3,4", 4));
  expect_left_out("plain", {"run.txt:4: 4 boxes, but 5 frames"});
  EXPECT_EQ(open("plain", Layout::Auto, {"walk"}).size(), 1u);
}

TEST_F(DatasetTest, NamesFileAndLineOfWhatIsWrong) {
  expect_error("nothing", {"nothing: no such"});
  fs::create_directories(root_ / "empty");
  expect_error("empty", {"empty: no annotated sequence"});
  vot();
  expect_error("vot", {"no sequence 'cart', did you mean 'car'?"}, {"cart"});
  expect_error("vot", {"no sequence 'CAR', did you mean 'car'?"}, {"CAR"});
  write("vot/list.txt", "car\ntruck\n");
  expect_left_out("vot", {"list.txt:2: ", "truck"});
  fs::remove(root_ / "vot/list.txt");

  write("vot/car/groundtruth.txt", "1,2,3,4\n1,2,3\n1,2,3,4\n");
  expect_error("vot", {"groundtruth.txt:2: "});
  write("vot/car/groundtruth.txt", lines("1,2,3,4", 4));
  expect_error("vot", {"groundtruth.txt:4: 4 boxes, but 3 images", "00000001.png", "00000003.png"});
  write("vot/car/groundtruth.txt", lines("1,2,3,4", 3));
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
  expect_left_out("twice", {"another sequence of that name", "twice/a/car"});
  EXPECT_EQ(open("twice").size(), 1u);
}

// Frames that would be black in 8 bits.
TEST_F(DatasetTest, DeepImagesWithoutTheirRangeCannotBeRead) {
  vot("vot/car", 2);
  for (const auto& [depth, scale, taken] : {std::tuple(CV_16U, 1.0, false), {CV_16U, 257.0, true}}) {
    cv::Mat image(4, 6, CV_8UC3, cv::Scalar::all(200));
    image.convertTo(image, depth, scale);
    for (const char* name : {"00000001.png", "00000002.png"})
      cv::imwrite((root_ / "vot/car/color" / name).string(), image);
    Sequence car = open("vot").at(0);
    FrameReader frames(car);
    if (taken)
      EXPECT_EQ(frames(0).at<cv::Vec3b>(1, 1)[0], 200);
    else
      EXPECT_THROW(frames(0), UnreadableSequence);
    car.range = PixelRange{0, 255 * scale};
    EXPECT_EQ(FrameReader(car)(1).at<cv::Vec3b>(1, 1)[0], 200);
  }
}

TEST_F(DatasetTest, AnnotationsInTheUnitSquareAreRefused) {
  vot();
  // A frame without the object is no objection.
  write("vot/car/groundtruth.txt", "0.5,0.5,0.2,0.3\nnan,nan,nan,nan\n0.6,0.5,0.2,0.3\n");
  expect_error("vot", {"groundtruth.txt:1: ", "YOLO"});
  write("vot/car/groundtruth.txt", "0,0,0,0\n.1,.1,.9,.1,.9,.9,.1,.9\n.1,.1,.9,.1,.9,.9,.1,.9\n");
  expect_error("vot", {"groundtruth.txt:2: ", "YOLO"});
  write("vot/car/groundtruth.txt", "0.5,0.5,0.2,0.3\n0.6,0.5,0.2,0.3\n0.7,0.5,2,3\n");
  EXPECT_EQ(open("vot").size(), 1u);
  write("vot/car/groundtruth.txt", "3,2,1,1\n3,2,1,1\n3,2,1,1\n");
  EXPECT_EQ(open("vot").size(), 1u);
}

TEST_F(DatasetTest, ADamagedSequenceIsLeftOutAndTheOthersAreRead) {
  vot("vot/car");
  vot("vot/ball");
  write("vot/car/groundtruth.txt", "1,2,3\n");
  EXPECT_EQ(open("vot").size(), 1u);
  expect_note({"car/groundtruth.txt:1: ", "left out"});
  expect_error("vot", {"car/groundtruth.txt:1: "}, {"ball", "car"});  // requested by name
  write("vot/ball/groundtruth.txt", "1,2,3\n");
  expect_error("vot", {"ball/groundtruth.txt:1: "});
}

TEST_F(DatasetTest, WhatIsNotTakenIsListed) {
  vot("data/car");
  images("data/walk", 1, 2);
  write("data/GOPR0001.MP4", "");
  write("data/readme.md", "");
  EXPECT_EQ(open("data").size(), 1u);
  expect_note({"GOPR0001.MP4: a video without GOPR0001.txt beside it"});
  expect_note({"data: left out, as no sequence in a known layout", "readme.md", "walk"});
  fs::create_directories(root_ / "data/other/list.txt");
  open("data");
  expect_note({"other/list.txt: not a file"});
  for (int i = 0; i < 20; ++i) write("data/file" + std::to_string(i), "");
  open("data");
  expect_note({"file0", " and 17 others"});
  expect_error("data/walk", {"walk: no annotated sequence", "00000001.png"});
}

TEST_F(DatasetTest, NamesOfSequencesAreThoseOfFolders) {
  vot("vot/s0");
  vot("vot/s1");
  write("vot/list.txt", "s0/\n./s1//\n/\n");
  const std::vector<Sequence> sequences = open("vot");
  ASSERT_EQ(sequences.size(), 2u);
  EXPECT_EQ(sequences[0].name, "s0");
  EXPECT_EQ(sequences[1].name, "s1");
  vot("bytes/car");
  vot("bytes/\xFF");
  write("bytes/car/\xFE.tag", lines("0", 3));
  EXPECT_EQ(open("bytes").size(), 1u);
  EXPECT_TRUE(notes_.size() == 2) << testing::PrintToString(notes_);
  expect_note({"bytes/\\xFF", "not UTF-8"});
  expect_note({"car/\\xFE.tag", "not UTF-8"});
}

TEST_F(DatasetTest, ReadsTempleColor) {
  images("tc/Ball_ce1/img", 1, 6, "%04d.png");
  write("tc/Ball_ce1/Ball_ce1_gt.txt", lines("1,2,3,4", 3));
  write("tc/Ball_ce1/Ball_ce1_frames.txt", "2,4\r\n");
  const Sequence ball = open("tc").at(0);
  EXPECT_EQ(ball.length(), 3u);
  EXPECT_EQ(ball.images[0].filename(), "0002.png");
  write("tc/Ball_ce1/Ball_ce1_frames.txt", "2\n");
  expect_error("tc", {"Ball_ce1_frames.txt:1: "});
}

TEST_F(DatasetTest, ReadsTrackingNet) {
  images("net/TRAIN_0/frames/aB_c-0", 0, 11, "%d.png");
  write("net/TRAIN_0/anno/aB_c-0.txt", lines("1.0,2.0,3.0,4.0", 12));
  images("net/TEST/frames/x_1", 0, 2, "%d.png");
  write("net/TEST/anno/x_1.txt", "1,2,3,4\n");
  images("net/TEST/frames/x_2", 0, 2, "%d.png");
  const std::vector<Sequence> sequences = open("net");
  ASSERT_EQ(sequences.size(), 2u);
  EXPECT_EQ(sequences[0].name, "x_1");
  EXPECT_TRUE(sequences[0].truth[0] && !sequences[0].truth[2]);
  EXPECT_EQ(sequences[1].images[10].filename(), "10.png");
  expect_note({"frames: left out, as no sequence in a known layout", "x_2"});
  EXPECT_EQ(open("net/TRAIN_0/frames/aB_c-0").size(), 1u);
}

TEST_F(DatasetTest, ReadsUav123WithThePublishedPartsOfVideos) {
  images("UAV123/data_seq/UAV123/bike1", 1, 3, "%06d.png");
  write("UAV123/anno/UAV123/bike1.txt", "1,2,3,4\nNaN,NaN,NaN,NaN\n1,2,3,4\n");
  write("UAV123/anno/UAV20L/bike1.txt", lines("1,2,3,4", 3));
  images("UAV123/data_seq/UAV123/bird1", 250, 253, "%06d.png");  // the first images are not needed
  write("UAV123/anno/UAV123/bird1_1.txt", lines("1,2,3,4", 4));
  write("UAV123/configSeqs.m", "");
  const std::vector<Sequence> sequences = open("UAV123");
  ASSERT_EQ(sequences.size(), 2u);
  EXPECT_EQ(sequences[0].name, "bike1");
  EXPECT_FALSE(sequences[0].truth[1]);
  EXPECT_EQ(sequences[1].name, "bird1_1");
  images("UAV123/data_seq/UAV123/truck4", 576, 579, "%06d.png");
  write("UAV123/anno/UAV123/truck4_1.txt", lines("1,2,3,4", 2));
  write("UAV123/anno/UAV123/truck4_2.txt", lines("9,2,3,4", 3));
  const std::vector<Sequence> trucks = open("UAV123/data_seq/UAV123/truck4");
  ASSERT_EQ(trucks.size(), 2u);
  EXPECT_EQ(trucks[0].images.back().filename(), "000577.png");
  EXPECT_EQ(trucks[1].images.front().filename(), "000577.png");
  EXPECT_EQ(open("UAV123", Layout::Uav123, {"truck4_2"}).at(0).truth[0]->box().x, 9);
  // At a third of the frame rate.
  images("UAV123_10fps/data_seq/UAV123_10fps/truck4", 193, 194, "%06d.png");
  write("UAV123_10fps/anno/UAV123_10fps/truck4_2.txt", lines("1,2,3,4", 2));
  EXPECT_EQ(open("UAV123_10fps").at(0).images.front().filename(), "000193.png");
  write("UAV123/anno/UAV123/truck4_2.txt", lines("9,2,3,4", 5));
  expect_left_out("UAV123", {"truck4_2.txt:5: 5 boxes, but 3 images"});
}

TEST_F(DatasetTest, ReadsNeedForSpeedAtEitherRate) {
  const auto annotation = [](int frames) {
    std::string text;
    for (int t = 0; t < frames; ++t)
      text += "0 " + std::to_string(10 + t) + " 20 " + std::to_string(40 + t) + " 60 " + std::to_string(t) +
              " 0 " + (t == 8 ? "1" : "0") + " 0 \"the ball\"\n";
    return text;
  };
  images("nfs/ball/30/ball", 1, 3, "%05d.png");
  write("nfs/ball/30/ball.txt", annotation(17));  // for each frame at 240 frames per second
  images("nfs/ball/240/ball", 1, 18, "%05d.png");
  write("nfs/ball/240/ball.txt", annotation(17));
  const std::vector<Sequence> slow = open("nfs");
  ASSERT_EQ(slow.size(), 1u);
  expect_note({"240 frames a second are left out: --layout nfs240"});
  EXPECT_EQ(slow[0].name, "ball");
  ASSERT_EQ(slow[0].length(), 3u);
  EXPECT_EQ(slow[0].truth[1]->box(), cv::Rect2d(18, 20, 30, 40));
  EXPECT_EQ(slow[0].tags.at("occlusion"), (std::vector<bool>{false, true, false}));
  const std::vector<Sequence> fast = open("nfs", Layout::Nfs240);
  ASSERT_EQ(fast.size(), 1u);
  EXPECT_EQ(fast[0].length(), 17u);
  expect_note({"240/ball.txt: 17 boxes, but 18 frames: the last one is left out"});
  EXPECT_EQ(open("nfs/ball/240/ball").at(0).length(), 17u);
  write("nfs/ball/30/ball.txt", annotation(2) + "1,2,3,4\n");
  expect_error("nfs/ball/30", {"ball.txt:3: track, left, top, right, bottom"});
  write("nfs/ball/30/ball.txt", annotation(5));
  expect_error("nfs/ball/30", {"ball.txt:5: 5 boxes, but 3 images"});
}

TEST_F(DatasetTest, ReadsVideosOfEveryEnding) {
  cv::VideoWriter writer((root_ / "video.avi").string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 10,
                         {64, 48});
  for (int i = 0; i < 3; ++i) writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(40 * i)));
  writer.release();
  std::vector<std::string> names;
  for (const char* ending :
       {"AVI", "3gp", "M4V", "mkv", "MOV", "MP4", "mpeg", "mpg", "MTS", "ts", "webm", "WMV"}) {
    names.push_back(std::string("clip_") + ending);
    fs::create_directories(root_ / "videos");
    fs::copy_file(root_ / "video.avi", root_ / "videos" / (names.back() + "." + ending));
    write("videos/" + names.back() + ".txt", "1,2,3,4\n");
  }
  EXPECT_EQ(open("videos", Layout::Auto, names).size(), names.size());
}

// Annotation files as in published data sets, or as other systems and programs write them.
struct Annotation {
  const char* name;
  std::string text;
  std::string boxes;   // x in each frame, "-" for none; empty: refused ...
  std::string reason;  // ... with this
};

std::vector<Annotation> annotations() {
  return {
      {"unix", "1,2,3,4\n5,2,3,4\n", "1 5", ""},
      {"windows", "1,2,3,4\r\n5,2,3,4\r\n", "1 5", ""},
      {"old_macintosh", "1,2,3,4\r5,2,3,4\r", "1 5", ""},
      {"converted_twice", "1,2,3,4\r\r\n5,2,3,4\r\r\n", "1 5", ""},
      {"byte_order_mark",
       "\xEF\xBB\xBF"
       "1,2,3,4\n5,2,3,4",
       "1 5", ""},
      {"trailing_blanks", "1,2,3,4 \t\n 5 2\t3;4\n \n\n", "1 5", ""},
      {"nan", "1,2,3,4\nNaN,NaN,NaN,NaN\nnan,nan,nan,nan\n-nan nan nan nan\n", "1 - - -", ""},
      {"zero_size", "1,2,3,4\n0,0,0,0\n7,7,0,5\n", "1 - -", ""},
      {"codes_of_the_toolkit", "1,2,3,4\n0\n5,2,3,4\n", "1 - 5", ""},
      {"polygon", "1,2,3,2,3,4,1,4\n5,2,7,2,7,4,5,4\n", "1 5", ""},
      {"moving_polygon", "1,1,9,1,9,9,1,9\n2,1,10,1,10,9,2,9\n3,1,11,1,11,9,3,9\n", "1 2 3", ""},
      {"triangle", "4,1,9,1,4,9\n5,1,10,1,5,9\n", "4 5", ""},
      {"negative_size", "1,2,3,4\n1,2,-3,4\n", "", ":2: the box's width or height is negative"},
      {"infinite", "1,2,3,inf\n", "", ":1: a number is not finite"},
      {"three_numbers", "1,2,3,4\n1,2,3\n", "", ":2: 4, 6, 8, .. numbers expected"},
      {"words", "x,y,w,h\n1,2,3,4\n", "", ":1: 4, 6, 8, .. numbers expected"},
      {"empty_line_within", "1,2,3,4\n\n1,2,3,4\n", "", ":2: empty line"},
      {"empty", "", "", ":1: no annotation"},
      {"codes_alone", "0\n1\n", "", ":1: codes alone"},
      {"mask", "m1,2,3,4,5,6\n", "", ":1: masks are not supported"},
      {"mot_of_six", "1,1,10,20,30,40\n2,1,11,20,30,40\n3,1,12,20,30,40\n", "", ":1: lines of MOTChallenge"},
      {"mot_of_ten", "1,-1,10,20,30,40,0.9,-1,-1,-1\n2,-1,12,20,30,40,0.8,-1,-1,-1\n", "",
       ":1: lines of MOT"},
      {"mot_of_two_objects", "1,1,10,20,30,40,1,1,1\n2,1,11,20,30,40,1,1,1\n1,2,50,20,30,40,1,1,1\n", "",
       ":1: lines of MOTChallenge"},
      {"mot_line", "1,1,912,484,97,109\n", "", ":1: lines of MOTChallenge"}};
}

class AnnotationFile : public DatasetTest, public testing::WithParamInterface<Annotation> {};

TEST_P(AnnotationFile, IsReadOrRefusedWithWhatToDo) {
  const Annotation& annotation = GetParam();
  write("boxes.txt", annotation.text);
  try {
    std::string boxes;
    for (const auto& region : tools::read_ground_truth(root_ / "boxes.txt"))
      boxes += (boxes.empty() ? "" : " ") +
               (region ? std::to_string(static_cast<int>(region->box().x)) : std::string("-"));
    EXPECT_EQ(boxes, annotation.boxes);
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(annotation.boxes, "") << error.what();
    EXPECT_NE(std::string(error.what()).find("boxes.txt" + annotation.reason), std::string::npos)
        << error.what();
  }
}

INSTANTIATE_TEST_SUITE_P(Annotations, AnnotationFile, testing::ValuesIn(annotations()),
                         [](const auto& instance) { return std::string(instance.param.name); });

// Missing values are filled as VOT's toolkit does.
TEST_F(DatasetTest, ShortFilesOfVotArePaddedAsByItsToolkit) {
  vot("vot/bag", 5);
  write("vot/bag/occlusion.tag", "1\n1\n");
  write("vot/bag/blur.tag", "");
  write("vot/bag/size.tag", lines("1", 9));
  write("vot/bag/practical.value", "0.1\n0.2\n");
  write("vot/bag/groundtruth.txt", lines("1,2,3,4", 4));
  const Sequence bag = open("vot").at(0);
  EXPECT_EQ(bag.tags.at("occlusion"), (std::vector<bool>{true, true, false, false, false}));
  EXPECT_EQ(bag.tags.at("blur"), std::vector<bool>(5));
  EXPECT_EQ(bag.tags.at("size"), std::vector<bool>(5, true));
  EXPECT_TRUE(bag.practical.empty());
  EXPECT_TRUE(bag.truth[3] && !bag.truth[4]);
  for (const char* note :
       {"occlusion.tag: 2 values, but 5 frames: the rest is taken for 0", "blur.tag: 0 values",
        "size.tag: 9 values, but 5 frames: those beyond", "practical.value: 2 values, but 5 frames: left out",
        "groundtruth.txt: 4 regions, but 5 frames: the rest is unknown"})
    expect_note({note});
  EXPECT_EQ(notes_.size(), 5u);
}

// File patterns as in a shell, and the time that the worst of them takes.
struct FilePattern {
  std::string name, pattern;
  bool matches;
};

class FilePatterns : public DatasetTest, public testing::WithParamInterface<FilePattern> {};

TEST_P(FilePatterns, AreAShells) {
  const auto& [name, pattern, matches] = GetParam();
  write("files/" + name, "");
  write("files/zz", "");
  const auto begin = std::chrono::steady_clock::now();
  bool found = false;
  try {
    found = tools::ImageSource::open((root_ / "files" / pattern).string()).images().at(0).filename() == name;
  } catch (const std::runtime_error&) {
  }
  EXPECT_EQ(found, matches) << pattern;
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(), 1) << pattern;
}

std::string repeated(const std::string& text, int count) {
  std::string result;
  for (int i = 0; i < count; ++i) result += text;
  return result;
}

INSTANTIATE_TEST_SUITE_P(
    Patterns, FilePatterns,
    testing::Values(FilePattern{"a.png", "*.png", true}, FilePattern{"a.png", "?.png", true},
                    FilePattern{"a.png", "??.png", false}, FilePattern{"abcabc.png", "*abc.png", true},
                    FilePattern{"abcab.png", "a*bc*", true}, FilePattern{"abcab.png", "a*bd*", false},
                    FilePattern{"ab.png", "**a**b*.p?g*", true}, FilePattern{"a.png", "a.png?", false},
                    FilePattern{"mississippi", "m*iss*ip*pi", true},
                    FilePattern{std::string(200, 'a'), repeated("*a", 80) + "*", true},
                    FilePattern{std::string(200, 'a'), repeated("*a", 80) + "b", false}));

TEST(AnnotatedSequences, AreRead) {
  const fs::path folder = ASTERISM_SEQUENCES;
  if (!fs::exists(folder / "bicycle"))
    GTEST_SKIP() << "no sequence bicycle in " << ASTERISM_SEQUENCES
                 << " (configure with -DASTERISM_SEQUENCES=FOLDER to name another)";
  const std::vector<Sequence> sequences = open_dataset(folder).sequences;
  for (const Sequence& sequence : sequences) {
    EXPECT_EQ(sequence.images.size(), sequence.length());
    EXPECT_TRUE(sequence.truth.at(0));
    for (const auto& [name, values] : sequence.tags) EXPECT_EQ(values.size(), sequence.length()) << name;
  }
  const Sequence bicycle = open_dataset(folder, Layout::Vot, {"bicycle"}).sequences.at(0);
  EXPECT_EQ(bicycle.length(), 271u);
  EXPECT_EQ(bicycle.tags.size(), 5u);
  EXPECT_EQ(bicycle.practical.size(), 271u);
  EXPECT_FALSE(bicycle.truth[0]->is_rectangle());
  FrameReader frames(bicycle);
  EXPECT_FALSE(frames(270).empty());
}

}  // namespace
}  // namespace asterism::bench
