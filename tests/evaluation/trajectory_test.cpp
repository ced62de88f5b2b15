#include "trajectory.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/resource.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <stdexcept>

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

class TrajectoryTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "asterism-trajectory-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
  }
  void TearDown() override { fs::remove_all(root_); }

  fs::path write(const std::string& file, const std::string& text) {
    std::ofstream(root_ / file, std::ios::binary) << text;
    return root_ / file;
  }
  std::string read(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  void expect_error(const fs::path& file, const std::string& part) {
    try {
      read_trajectory(file);
      ADD_FAILURE() << "no error with " << part;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos)
          << error.what() << " without " << part;
    }
  }

  fs::path root_;
};

std::vector<TrajectoryFrame> example() {
  return {{{}, TrajectoryFrame::kStarted},
          {Region::rectangle({1.5, -2, 1.0 / 3, 40})},
          {Region::polygon({{0, 0.1}, {10, 0}, {10, 5.25}, {0, 5}})},
          {{}, TrajectoryFrame::kFailed},
          {}};
}

TEST_F(TrajectoryTest, ComesBackFromItsFiles) {
  Trajectory written{example(),
                     {{"time", {0.5, 0.001, 1e-9, 2, std::nan("")}}, {"confidence", {1, 0, -1, 3, 4}}}};
  const fs::path file = results_folder(root_, "dpt", "baseline", "ball_1") / run_file("ball_1", 3);
  EXPECT_EQ(file, root_ / "results/dpt/baseline/ball_1/ball_1_003.txt");
  EXPECT_EQ(anchor_file("ball_1", 50), "ball_1_00000050.txt");
  EXPECT_FALSE(trajectory_exists(file));
  write_trajectory(file, written);
  EXPECT_TRUE(trajectory_exists(file));
  const Trajectory back = read_trajectory(file);
  EXPECT_EQ(back.frames, written.frames);
  ASSERT_EQ(back.values.size(), 2u);
  EXPECT_EQ(back.values.at("confidence"), written.values.at("confidence"));
  EXPECT_TRUE(std::isnan(back.values.at("time")[4]));
  EXPECT_EQ(back.values.at("time")[2], 1e-9);
  // The format that the toolkit reads.
  EXPECT_EQ(read(file).substr(0, 5), "1\n1.5");
  EXPECT_EQ(read(file.parent_path() / "ball_1_003_time.value"), "0.5\n0.001\n1e-09\n2\n\n");
  written.values["time"].pop_back();
  EXPECT_THROW(write_trajectory(file, written), std::invalid_argument);
}

TEST_F(TrajectoryTest, ReadsWhatToolkitsWrote) {
  const fs::path file = write("car_002.txt",
                              "1\n10.0000,20.0000,30.0000,40.0000\r\nNaN,NaN,NaN,NaN\nNaN,NaN,NaN,-2\n0\n"
                              "1,1,5,1,5,5,1,5\nnan,nan,nan,nan,nan,nan,nan,nan\n1.0\ninf");
  write("car_time.txt", "0.1,0.2\n0.1,0.3\n0.1,0.2\n0.1,0.2\n0.1,NaN\n0.1,0.2\n0.1,0.2\n0.1,0.2\n0.1,0.4\n");
  const Trajectory trajectory = read_trajectory(file);
  ASSERT_EQ(trajectory.frames.size(), 9u);
  std::vector<int> codes;
  for (const TrajectoryFrame& frame : trajectory.frames) codes.push_back(frame.region ? -1 : frame.code);
  EXPECT_EQ(codes, (std::vector<int>{1, -1, 0, 2, 0, -1, 0, 1, 0}));
  EXPECT_EQ(trajectory.frames[1].region->box(), cv::Rect2d(10, 20, 30, 40));
  EXPECT_FALSE(trajectory.frames[5].region->is_rectangle());
  EXPECT_EQ(trajectory.values.at("time")[1], 0.3);
  // A tracker's own property is skipped if it is not a number.
  write("car_002_mood.value", "good\n\n\n\n\n\n\n\n\n");
  EXPECT_EQ(read_trajectory(file).values.size(), 1u);
  write("car_002_time.value", "slow\n\n\n\n\n\n\n\n\n");
  expect_error(file, "car_002_time.value: a line is not a number");
  write("car_002_time.value", "1\n2\n");
  expect_error(file, "car_002_time.value:2: 2 values, but 9 frames");
}

TEST_F(TrajectoryTest, CallsUnknownWhatIsNoRegion) {
  const double infinity = std::numeric_limits<double>::infinity();
  const Trajectory wild{{{Region::rectangle({1, 2, -3, 4})},
                         {Region::rectangle({infinity, 2, 3, 4})},
                         {Region::rectangle({1, std::nan(""), 3, 4})},
                         {Region::rectangle({1, 2, 0, 0})}},
                        {}};
  write_trajectory(root_ / "a_001.txt", wild);
  EXPECT_EQ(read(root_ / "a_001.txt"), "0\n0\n0\n1,2,0,0\n");
  EXPECT_EQ(read_trajectory(root_ / "a_001.txt").frames.size(), 4u);
}

TEST_F(TrajectoryTest, ReadsTextOfEverySystem) {
  const std::vector<TrajectoryFrame> expected = {{{}, 1}, {Region::rectangle({1, 2, 3, 10})}, {{}, 0}};
  for (const char* text :
       {"1\n1,2,3,10\n0\n", "1\r\n1,2,3,10\r\n0\r\n", "1\r1,2,3,10\r0", "1\r\r\n1,2,3,10\r\r\n0\r\r\n",
        "\xEF\xBB\xBF"
        "1\n1,2,3,10\n0\n",
        "1 \n 1 2\t3 10 \n0\n", "1\n1,2,3,10\n0\n\n \n"})
    EXPECT_EQ(read_trajectory(write("a_001.txt", text)).frames, expected) << text;
  // Results of another program are not taken for polygons.
  expect_error(write("a_001.txt", "1,1,10,20,30,40\n2,1,11,20,30,40\n"),
               "a_001.txt:1: lines of MOTChallenge");
  std::string corners;
  for (int i = 0; i < 10'001; ++i) corners += (i > 0 ? ",1,2" : "1,2");
  expect_error(write("a_001.txt", "1\n" + corners + "\n"), "a_001.txt:2: neither a rectangle nor a polygon");
}

std::string binary_example() {
  using namespace std::string_literals;
  return "\x01\x00\x03\x00\x00\x00"s                                              // version 1, three frames
         "\x00\x01\x00\x00\x00"s                                                  // code 1
         "\x01\x00\x00\x80\x3f\x00\x00\x00\x40\x00\x00\x40\x40\x00\x00\x20\x41"s  // 1, 2, 3, 10
         "\x02\x03\x00"s                                                          // three corners
         "\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x80\xbf"s;
}

TEST_F(TrajectoryTest, ReadsTheToolkitsBinaryFormat) {
  const fs::path file = write("car_001.bin", binary_example());
  write("car_001.txt", "0\n0\n0\n");  // ignored: the toolkit prefers the binary file
  write("car_001_time.value", "1\n2\n3\n");
  const Trajectory trajectory = read_trajectory(root_ / "car_001.txt");
  EXPECT_EQ(trajectory.frames,
            (std::vector<TrajectoryFrame>{
                {{}, 1}, {Region::rectangle({1, 2, 3, 10})}, {Region::polygon({{0, 0}, {1, 0}, {1, -1}})}}));
  EXPECT_EQ(trajectory.values.at("time"), (std::vector<double>{1, 2, 3}));
}

TEST_F(TrajectoryTest, NamesFileAndLineOfWhatIsMalformed) {
  expect_error(root_ / "none_001.txt", "none_001.txt: No such file");
  expect_error(write("a_001.txt", ""), "a_001.txt:1: no frames");
  for (const char* line : {"x", "1,2,3", "1,2", "1,2,-3,4", "1,2,nan,4", "1,2,3,4,5", "-1", "1.5", "1e9", "",
                           "m0,0,2,2,1,3", "1,2,3,4,"})
    expect_error(write("a_001.txt", std::string("1\n") + line + "\n0\n"), "a_001.txt:2: ");
}

TEST_F(TrajectoryTest, SurvivesHostileFiles) {
  const std::string good = binary_example();
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_THROW(read_trajectory(write("b_001.bin", good.substr(0, length))), std::runtime_error) << length;
  EXPECT_THROW(read_trajectory(write("b_001.bin", good + "x")), std::runtime_error);
  std::mt19937 random(3);
  int read = 0;
  for (int k = 0; k < 1000; ++k) {
    std::string bad = k % 2 == 0 ? good : "1\n10,20,30,40\n1,1,5,1,5,5,1,5\nNaN,NaN,NaN,NaN\n";
    for (int i = 0; i < 3; ++i) bad[random() % bad.size()] = static_cast<char>(random());
    try {
      read_trajectory(write(k % 2 == 0 ? "b_001.bin" : "c_001.txt", bad));
      ++read;
    } catch (const std::runtime_error&) {
    }
  }
  EXPECT_LT(read, 1000);
}

TEST_F(TrajectoryTest, LeavesNoHalfFileOnAFullDisk) {
  const fs::path file = root_ / "car_001.txt";
  Trajectory trajectory{example(), {}};
  write_trajectory(file, trajectory);
  const std::string before = read(file);
  trajectory.frames.resize(100000, {Region::rectangle({1, 2, 3, 4})});
  // A limit on file sizes makes a write fail part-way, as a full disk does.
  rlimit old_limit;
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &old_limit), 0);
  rlimit limit = old_limit;
  limit.rlim_cur = 100000;
  const auto old_handler = signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  EXPECT_THROW(write_trajectory(file, trajectory), std::runtime_error);
  EXPECT_THROW(write_trajectory(root_ / "new_001.txt", trajectory), std::runtime_error);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &old_limit), 0);
  signal(SIGXFSZ, old_handler);
  EXPECT_EQ(read(file), before);
  EXPECT_EQ(std::distance(fs::directory_iterator(root_), {}), 1) << "no other file is left";
  write_trajectory(file, trajectory);
  EXPECT_EQ(read_trajectory(file).frames.size(), 100000u);
  fs::create_directories(root_ / "folder_001.txt");
  EXPECT_THROW(write_trajectory(root_ / "folder_001.txt", trajectory), std::runtime_error);
}

}  // namespace
}  // namespace asterism::bench
