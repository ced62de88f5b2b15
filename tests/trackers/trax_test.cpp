// The messages of the TraX protocol, and asterism-trax as a client runs it.

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <asterism/trackers/tracker/tracker.hpp>
#include <chrono>
#include <cmath>
#include <complex>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <thread>
#include <trax_client.hpp>
#include <trax_image.hpp>
#include <trax_message.hpp>
#include <utility>
#include <variant>
#include <vector>

#include "moving_square.hpp"

namespace asterism::tools {
namespace {

namespace fs = std::filesystem;
using Type = TraxMessage::Type;
using testing::Test;

// The reason of the TraxError that `call` throws; empty if it throws none.
template <class Call>
std::string reason_of(Call call) {
  try {
    call();
  } catch (const TraxError& e) {
    return e.what();
  }
  return {};
}

void expect_reason(const std::string& reason, const std::vector<std::string>& parts) {
  for (const std::string& part : parts) {
    EXPECT_NE(reason.find(part), std::string::npos) << part << " in: " << reason;
  }
}

// ---- Messages ----

TEST(TraxMessages, ReadAsTheProtocolWritesThem) {
  EXPECT_EQ(parse_trax_message("@@TRAX:quit"), (TraxMessage{Type::Quit, {}, {}}));
  EXPECT_EQ(parse_trax_message("@@TRAX:quit \r"), (TraxMessage{Type::Quit, {}, {}}));
  EXPECT_EQ(parse_trax_message("@@TRAX:status 1,2,3,4"), (TraxMessage{Type::State, {"1,2,3,4"}, {}}))
      << "the old name of state, and no quotes";
  // libtrax writes a blank at the end of each line.
  EXPECT_EQ(
      parse_trax_message(R"(@@TRAX:hello "trax.version=4" trax.name=ncc "trax.image=path;memory;" )"),
      (TraxMessage{
          Type::Hello, {}, {{"trax.version", "4"}, {"trax.name", "ncc"}, {"trax.image", "path;memory;"}}}));
  EXPECT_EQ(
      parse_trax_message(R"(@@TRAX:initialize "file:///a b/\"1\"\\\n.jpg"   "1,2,3,4" "a_1.b=x=\"y\"")"),
      (TraxMessage{Type::Initialize, {"file:///a b/\"1\"\\\n.jpg", "1,2,3,4"}, {{"a_1.b", "x=\"y\""}}}));
  EXPECT_EQ(parse_trax_message(R"(@@TRAX:frame "")"), (TraxMessage{Type::Frame, {""}, {}}));
}

TEST(TraxMessages, TakeForPropertiesOnlyWhatHasTheNameOfOne) {
  const std::string longest(64, 'k');
  const TraxMessage message =
      parse_trax_message("@@TRAX:frame \"file:///a=b.jpg\" \"image:1;1;gray8;AA==\" =x \"" + longest +
                         "=1\" \"k" + longest + "=2\" \"a-b=3\"");
  EXPECT_EQ(message.arguments, (std::vector<std::string>{"file:///a=b.jpg", "image:1;1;gray8;AA==", "=x",
                                                         "k" + longest + "=2", "a-b=3"}));
  EXPECT_EQ(message.properties, (std::map<std::string, std::string>{{longest, "1"}}));
}

TEST(TraxMessages, ComeBackFromTheirLines) {
  std::string bytes;
  for (int i = 1; i < 256; ++i) bytes += static_cast<char>(i);
  const TraxMessage message = {Type::State,
                               {"1,2,3,4", "", " ", "\"\\\n", "\\n", bytes},
                               {{"confidence", "0.5"}, {"a", ""}, {"b.c_D9", bytes}}};
  const std::string line = format_trax_message(message);
  EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 0);
  EXPECT_EQ(parse_trax_message(line), message);
  for (const Type type : {Type::Hello, Type::Initialize, Type::Frame, Type::State, Type::Quit}) {
    EXPECT_EQ(parse_trax_message(format_trax_message({type, {"x"}, {}})).type, type);
  }
}

TEST(TraxMessages, AreRefusedWithTheReason) {
  const auto expect = [](const std::string& line, const std::string& part) {
    SCOPED_TRACE(line);
    expect_reason(reason_of([&] { parse_trax_message(line); }), {part});
  };
  expect("", "not a message");
  expect("@@TRAX", "not a message");
  expect(" @@TRAX:quit", "not a message");
  expect("@@TRAX:", "unknown message ''");
  expect("@@TRAX: quit", "unknown message ''");
  expect("@@TRAX:Quit", "unknown message 'Quit'");
  expect("@@TRAX:quit\"", "unknown message");
  expect("@@TRAX:" + std::string(100000, 'x'), "unknown message 'xxx");
  expect("@@TRAX:frame \"file:///1.jpg", "not closed");
  expect("@@TRAX:frame \"", "not closed");
  expect("@@TRAX:frame \"a\\", "backslash");
  expect("@@TRAX:frame a\\", "backslash");
  expect("@@TRAX:frame \"a\\t\"", "escape");
  expect("@@TRAX:frame \"a\"\"b\"", "no blank");
  expect("@@TRAX:frame a\"b\"", "quote");
  expect("@@TRAX:state \"1,2,3,4\" a=1 \"a=2\"", "a is given twice");
  expect("@@TRAX:frame \"a\nb\"", "more than one line");
  expect(std::string("@@TRAX:frame \"a\0b\"", 18), "NUL");
}

TEST(TraxMessages, AreNotFormattedWhereNoLineSaysThem) {
  EXPECT_THROW(format_trax_message({Type::Frame, {"a=b"}, {}}), std::invalid_argument);
  EXPECT_THROW(format_trax_message({Type::Frame, {std::string("a\0", 2)}, {}}), std::invalid_argument);
  EXPECT_THROW(format_trax_message({Type::Frame, {}, {{"", "b"}}}), std::invalid_argument);
  EXPECT_THROW(format_trax_message({Type::Frame, {}, {{"a b", "c"}}}), std::invalid_argument);
  EXPECT_THROW(format_trax_message({Type::Frame, {}, {{std::string(65, 'a'), ""}}}), std::invalid_argument);
}

TEST(TraxMessages, ListsMayHaveCommas) {
  using List = std::vector<std::string>;
  EXPECT_EQ(split_trax_list("path;memory;"), (List{"path", "memory"}));
  EXPECT_EQ(split_trax_list("color, depth"), (List{"color", "depth"}));
  EXPECT_EQ(split_trax_list(" ;;"), List{});
}

TEST(Base64, ComesBack) {
  EXPECT_EQ(to_base64(""), "");
  EXPECT_EQ(to_base64("f"), "Zg==");  // RFC 4648, section 10
  EXPECT_EQ(to_base64("fo"), "Zm8=");
  EXPECT_EQ(to_base64("foobar"), "Zm9vYmFy");
  std::string bytes;
  for (int i = 0; i < 300; ++i) {
    EXPECT_EQ(from_base64(to_base64(bytes)), bytes);
    bytes += static_cast<char>(i * 7);
  }
  for (const char* text : {"Z", "Zg", "Zg=", "Z===", "====", "Zg==Zg==", "Zm9v ", "Zm-v", "Zm=v", "=Zg="}) {
    EXPECT_FALSE(from_base64(text)) << text;
  }
}

// ---- Lines ----

class Lines : public Test {
 protected:
  void SetUp() override { ASSERT_EQ(pipe(ends_.data()), 0); }
  void TearDown() override {
    close(ends_[0]);
    end();
  }
  void write(const std::string& text) {
    ASSERT_EQ(::write(ends_[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  void end() {
    if (ends_[1] >= 0) close(ends_[1]);
    ends_[1] = -1;
  }
  int descriptor() const { return ends_[0]; }

 private:
  std::array<int, 2> ends_;
};

TEST_F(Lines, ComeInPieces) {
  LineReader reader(descriptor());
  write("first\n\nsec");
  EXPECT_EQ(reader.next(), "first");
  EXPECT_EQ(reader.take(), "");
  EXPECT_EQ(reader.take(), std::nullopt);
  write("ond");
  EXPECT_TRUE(reader.fill());
  EXPECT_EQ(reader.take(), std::nullopt);
  write("\nthird");
  EXPECT_EQ(reader.next(), "second");
  end();
  EXPECT_EQ(reader.next(), std::nullopt) << "not ended: it may be cut off";
  EXPECT_EQ(reader.next(), std::nullopt);
}

TEST_F(Lines, HaveALongestLength) {
  const std::string longest(100, 'x');
  for (const std::string more : {"x\n", "x"}) {
    LineReader reader(descriptor(), longest.size());
    write(longest + '\n' + longest + more);
    EXPECT_EQ(reader.next(), longest);
    expect_reason(reason_of([&] { reader.next(); }), {"longer than 100 bytes"});
  }
}

TEST_F(Lines, WithstandSignals) {
  struct sigaction action = {}, former;
  action.sa_handler = [](int) {};
  sigaction(SIGUSR1, &action, &former);  // without SA_RESTART: read ends with EINTR
  const pthread_t reading = pthread_self();
  std::thread other([&] {
    for (int i = 0; i < 20; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      pthread_kill(reading, SIGUSR1);
    }
    write("line\n");
  });
  LineReader reader(descriptor());
  EXPECT_EQ(reader.next(), "line");
  other.join();
  sigaction(SIGUSR1, &former, nullptr);
}

TEST_F(Lines, FromWhatCannotBeRead) {
  LineReader reader(-1);
  EXPECT_THROW(reader.next(), std::system_error);
}

// ---- Images ----

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

TEST(TraxImages, ComeBack) {
  const cv::Mat color = noise({13, 7}, 3, 0, 255, 1);
  cv::Mat gray, deep;
  cv::cvtColor(color, gray, cv::COLOR_BGR2GRAY);
  gray.convertTo(deep, CV_16U, 257);
  for (const cv::Mat& image : {color, gray, deep, color(cv::Rect(2, 1, 5, 4)), gray(cv::Rect(2, 1, 5, 4))}) {
    EXPECT_TRUE(same(decode_trax_image(encode_trax_image(image, {"memory"})).pixels, image));
  }
  for (const std::string format : {"data", "buffer"}) {
    EXPECT_TRUE(same(decode_trax_image(encode_trax_image(color, {"path", format})).pixels, color));
  }
  EXPECT_EQ(encode_trax_image(cv::Mat(1, 2, CV_8UC3, cv::Scalar(3, 2, 1)), {"memory"}),
            "image:2;1;rgb;AQIDAQID");
  EXPECT_EQ(encode_trax_image(fs::path("/a b/1.jpg"), {"memory", "path"}), "file:///a b/1.jpg");
}

TEST(TraxImages, AsDataAreReadAsDocumentedAndAsInUse) {
  const cv::Mat image = noise({8, 8}, 3, 0, 255, 1);
  const std::string text = encode_trax_image(image, {"data"}), header = "data:image/png;";
  ASSERT_TRUE(text.starts_with(header));
  for (const std::string word : {"base64;", "base64,"}) {
    EXPECT_TRUE(same(decode_trax_image(header + word + text.substr(header.size())).pixels, image));
  }
}

TEST(TraxImages, AreRefusedWithTheReason) {
  const auto expect = [](const std::string& argument, const std::string& part) {
    SCOPED_TRACE(argument);
    expect_reason(reason_of([&] { decode_trax_image(argument); }), {part});
  };
  expect("", "no such image");
  expect("/missing.png", "no such image: /missing.png");
  expect("file:///missing.png", "no such image: /missing.png");
  expect("file:/missing.png", "no such image: /missing.png");
  expect("http://example.com/1.png", "URL");
  expect("image:", "header");
  expect("image:1;1;rgb", "header");
  expect("image:0;1;rgb;AAAA", "width or height");
  expect("image:-1;1;rgb;AAAA", "width or height");
  expect("image:1x;1;rgb;AAAA", "width or height");
  expect("image:99999999999;1;rgb;AAAA", "width or height");
  expect("image:1;1;bgr;AAAA", "pixel format");
  expect("image:1;1;rgb;AA", "base64");
  expect("image:1;1;rgb;AAAAAAAA", "6 bytes");
  expect("image:2147483647;2147483647;rgb;AAAA", "3 bytes");
  expect("image:65536;65536;gray8;", "0 bytes");
  expect("data:image/png", "header");
  expect("data:image/png;", "cannot decode");
  expect("data:image/png;AAAA", "cannot decode");
  expect("data:image/png;base64,AA", "base64");
  expect_reason(reason_of([] { encode_trax_image(cv::Mat(2, 2, CV_32F), {"memory"}); }), {"8 bit"});
  expect_reason(reason_of([] { encode_trax_image(cv::Mat(), {"memory"}); }), {"empty"});
  expect_reason(reason_of([] {
                  encode_trax_image(cv::Mat(2, 2, CV_8U), {"path", "url"});
                }),
                {"takes images"});
}

// ---- asterism-trax and its client ----

constexpr int kFrames = 8;

class Trax : public Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "asterism-trax-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
    for (int i = 0; i < kFrames; ++i) {
      images_.push_back(draw_frame(i));
      // A file name with all characters that need quoting or escapes.
      files_.push_back(folder_ / ("a=b \"" + std::to_string(i) + "\" \\n\n.png"));
      ASSERT_TRUE(cv::imwrite(files_.back().string(), images_.back()));
    }
  }
  void TearDown() override { fs::remove_all(folder_); }

  static std::string server(const std::string& options = "--tracker kcf") {
    return ASTERISM_TRAX_TOOL " " + options;
  }
  static std::string server(int version) {
    return server("--tracker kcf --trax-version " + std::to_string(version));
  }

  TraxClientOptions logged() const {
    TraxClientOptions options;
    options.log = (folder_ / "log").string();
    return options;
  }
  std::string log() const {
    std::ifstream file(folder_ / "log");
    return {std::istreambuf_iterator<char>(file), {}};
  }

  // A tracker as a shell script, which answers one line of input at a time.
  std::string script(const std::string& text) const {
    const fs::path path = folder_ / "tracker.sh";
    std::ofstream(path) << text;
    return "exec sh " + path.string();
  }

  std::vector<TraxImage> sequence(bool by_path) const {
    std::vector<TraxImage> images;
    for (size_t i = 0; i < images_.size(); ++i) {
      images.push_back(by_path ? TraxImage(files_[i]) : TraxImage(images_[i]));
    }
    return images;
  }

  // For a rectangle, the region is the tracker's box; for a polygon, it is the first polygon moved by the
  // similarity transform that takes the first box to it.
  static void expect_region(const Region& region, const Region& start, const TrackResult& result) {
    ASSERT_EQ(region.is_rectangle(), start.is_rectangle());
    if (start.is_rectangle()) {
      EXPECT_EQ(region.box(), result.box);
      return;
    }
    using Complex = std::complex<double>;
    const auto middle = [](const cv::Rect2d& box) {
      return Complex(box.x + box.width / 2, box.y + box.height / 2);
    };
    const cv::Rect2d first = start.equal_area_box();
    const Complex factor = std::polar(result.box.width / first.width, result.angle);
    EXPECT_NEAR(std::abs(factor), result.box.height / first.height, 1e-9);
    ASSERT_EQ(region.points().size(), start.points().size());
    for (size_t i = 0; i < start.points().size(); ++i) {
      const cv::Point2d &p = start.points()[i], &q = region.points()[i];
      const Complex expected = middle(result.box) + factor * (Complex(p.x, p.y) - middle(first));
      EXPECT_LT(std::abs(Complex(q.x, q.y) - expected), 1e-9);
    }
  }

  // Through TraX the tracker gives the same results as when it is called directly.
  static void expect_same_track(TraxClient& client, const std::vector<TraxImage>& images,
                                const std::vector<Region>& objects, const std::string& name = "kcf") {
    std::vector<AnyTracker> trackers;
    for (size_t frame = 0; frame < images.size(); ++frame) {
      const std::vector<TraxClient::Reply> replies =
          frame == 0 ? client.initialize(images[0], objects) : client.frame(images[frame]);
      ASSERT_EQ(replies.size(), objects.size());
      const cv::Mat* const pixels = std::get_if<cv::Mat>(&images[frame]);
      const cv::Mat image = pixels ? *pixels : draw_frame(static_cast<int>(frame));
      for (size_t i = 0; i < objects.size(); ++i) {
        TrackResult expected;
        if (frame == 0) {
          trackers.push_back(make_tracker(name));
          trackers[i].init(image, objects[i].equal_area_box());
          expected.box = objects[i].equal_area_box();
          expected.confidence = 1;
        } else {
          expected = trackers[i].update(image);
        }
        const TraxClient::Reply& reply = replies[i];
        ASSERT_TRUE(reply.region);
        expect_region(*reply.region, objects[i], expected);
        EXPECT_EQ(reply.confidence, expected.confidence);
        EXPECT_EQ(reply.properties.at("lost"), expected.lost ? "1" : "0");
        std::vector<double> parts;
        for (const PartState& part : expected.parts) {
          parts.insert(parts.end(), {part.position.x(), part.position.y()});
        }
        EXPECT_EQ(reply.properties.contains("parts"), !parts.empty());
        if (!parts.empty()) {
          EXPECT_EQ(parse_numbers(reply.properties.at("parts")), parts);
        }
      }
    }
  }

  // The answer of asterism-trax to `input` on its standard input.
  struct Answer {
    int code;
    std::vector<std::string> lines;
    std::string errors;
  };
  Answer answer_to(const std::string& input, const std::string& options = "--tracker kcf") const {
    std::ofstream(folder_ / "in") << input;
    const std::string at = folder_.string();
    const int status = std::system(("timeout 60 " ASTERISM_TRAX_TOOL " " + options + " < " + at + "/in > " +
                                    at + "/out 2> " + at + "/err")
                                       .c_str());
    Answer answer{WIFEXITED(status) ? WEXITSTATUS(status) : -1, {}, {}};
    std::ifstream out(folder_ / "out"), errors(folder_ / "err");
    for (std::string line; std::getline(out, line);) answer.lines.push_back(line);
    answer.errors = {std::istreambuf_iterator<char>(errors), {}};
    return answer;
  }

  // The session must end with `part` in the reason that the client is told and in one line of error.
  void expect_error(const std::string& input, const std::string& part,
                    const std::string& options = "--tracker kcf") {
    SCOPED_TRACE(input.substr(0, 200));
    const Answer answer = answer_to(input, options);
    EXPECT_EQ(answer.code, 1);
    EXPECT_TRUE(answer.errors.starts_with("asterism-trax: ")) << answer.errors;
    EXPECT_EQ(std::count(answer.errors.begin(), answer.errors.end(), '\n'), 1) << answer.errors;
    EXPECT_NE(answer.errors.find(part), std::string::npos) << part << " in: " << answer.errors;
    ASSERT_GE(answer.lines.size(), 2u);
    for (const std::string& line : answer.lines) EXPECT_NO_THROW(parse_trax_message(line)) << line;
    const TraxMessage last = parse_trax_message(answer.lines.back());
    EXPECT_EQ(last.type, Type::Quit);
    ASSERT_TRUE(last.properties.contains("trax.reason"));
    EXPECT_NE(last.properties.at("trax.reason").find(part), std::string::npos) << answer.lines.back();
  }

  std::string initialize() const {
    return format_trax_message({Type::Initialize, {"file://" + files_[0].string(), "60,50,48,40"}, {}}) +
           '\n';
  }

  static Region rectangle() { return Region::rectangle(true_box(0)); }
  static Region polygon() {
    return Region::polygon({{84.5, 50.25}, {108, 70.125}, {84, 90}, {72, 85}, {60.75, 70}});
  }

  fs::path folder_;
  std::vector<cv::Mat> images_;
  std::vector<fs::path> files_;
};

TEST_F(Trax, TracksAsTheTrackerDoesInAllVersions) {
  for (int version = 1; version <= 4; ++version) {
    SCOPED_TRACE(version);
    TraxClient client(server(version), logged());
    EXPECT_EQ(client.hello().at("trax.version"), std::to_string(version));
    EXPECT_EQ(client.hello().at("trax.name"), "kcf");
    EXPECT_EQ(client.hello().contains("trax.channels"), version >= 2);
    EXPECT_EQ(client.hello().contains("trax.multiobject"), version >= 4);
    expect_same_track(client, sequence(true), {rectangle()});
    expect_same_track(client, sequence(false), {polygon()});  // starts again
  }
  EXPECT_EQ(log(), "") << "nothing but the protocol";
}

TEST_F(Trax, SaysWhereThePartsAre) {
  TraxClient client(server("--tracker dpt"));
  EXPECT_EQ(client.hello().at("trax.version"), "3");
  expect_same_track(client, sequence(true), {rectangle()}, "dpt");
}

TEST_F(Trax, TurnsAPolygonWithTheObject) {
  const cv::Rect2d box = true_box(0);
  const cv::Point2f middle(static_cast<float>(box.x + box.width / 2),
                           static_cast<float>(box.y + box.height / 2));
  std::vector<TraxImage> turning;
  for (int t = 0; t < kFrames; ++t) {
    cv::Mat image;
    cv::warpAffine(images_[0], image, cv::getRotationMatrix2D(middle, -2.0 * t, 1), images_[0].size());
    turning.emplace_back(image);
  }
  const Region start = polygon();
  for (const int version : {3, 4}) {
    TraxClient client(server("--tracker dpt --trax-version " + std::to_string(version)));
    expect_same_track(client, turning, {start}, "dpt");
    // It has rotated by some degrees, clockwise on the screen like the object.
    const Region last = *client.frame(turning.back())[0].region;
    const auto direction = [](const Region& region) {
      const cv::Point2d d = region.points()[1] - region.points()[0];
      return std::atan2(d.y, d.x);
    };
    EXPECT_GT(direction(last) - direction(start), 0.05);
    EXPECT_LT(direction(last) - direction(start), 0.3);
  }
}

TEST_F(Trax, TakesImagesInAllEncodings) {
  const std::vector<std::string> formats = {"path", "memory", "data"};
  std::string input;
  for (const std::string& format : formats) {
    input += "@@TRAX:initialize\n@@TRAX:initialize \"60,50,48,40\"\n";
    for (const TraxImage& image : sequence(format == "path")) {
      input += format_trax_message({Type::Frame, {encode_trax_image(image, {format})}, {}}) + '\n';
    }
  }
  const Answer answer = answer_to(input + "@@TRAX:quit\n", "--tracker kcf --trax-version 4");
  EXPECT_EQ(answer.code, 0) << answer.errors;
  ASSERT_EQ(answer.lines.size(), 1 + formats.size() * kFrames);
  for (size_t i = 1; i <= kFrames; ++i) {
    EXPECT_EQ(answer.lines[i], answer.lines[kFrames + i]);
    EXPECT_EQ(answer.lines[i], answer.lines[2 * kFrames + i]);
  }
}

// Tracking continues over damaged images, which are counted; a start in one is refused.
TEST_F(Trax, TakesDamagedImagesAsBlank) {
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", images_[3], bytes);
  const std::string half(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(bytes.size() / 2));
  std::ofstream(folder_ / "half.jpg", std::ios::binary) << half;
  std::ofstream(folder_ / "empty.jpg");
  const auto message = [](Type type, const std::vector<std::string>& arguments) {
    return format_trax_message({type, arguments, {}}) + '\n';
  };
  std::string input = message(Type::Initialize, {"file://" + files_[0].string(), "60,50,48,40"});
  for (const std::string& image :
       {files_[1].string(), (folder_ / "half.jpg").string(), (folder_ / "empty.jpg").string(),
        "data:image/jpeg;" + to_base64(half), files_[5].string(), files_[6].string()})
    input += message(Type::Frame, {image});
  const Answer answer = answer_to(input + "@@TRAX:quit\n");
  EXPECT_EQ(answer.code, 0) << answer.errors;
  EXPECT_EQ(answer.errors, "asterism-trax: note: damaged images, treated as blank: 3, the first is 3\n");
  ASSERT_EQ(answer.lines.size(), 8u);

  expect_error(message(Type::Initialize, {(folder_ / "half.jpg").string(), "60,50,48,40"}),
               "the image to start in is damaged");
  expect_error(message(Type::Initialize, {(folder_ / "empty.jpg").string(), "60,50,48,40"}),
               "a damaged image of unknown size");
}

TEST_F(Trax, TakesARangeForDeepImages) {
  cv::Mat gray, deep, narrow;
  cv::cvtColor(images_[0], gray, cv::COLOR_BGR2GRAY);
  gray.convertTo(deep, CV_16U, 257);
  gray.convertTo(narrow, CV_16U);
  std::vector<std::string> files;
  for (const auto& [name, image] : {std::pair("narrow.png", narrow), {"deep.png", deep}})
    ASSERT_TRUE(cv::imwrite((folder_ / name).string(), image));
  const auto session = [](const std::string& image) {
    return format_trax_message({Type::Initialize, {image, "60,50,48,40"}, {}}) + '\n' +
           format_trax_message({Type::Frame, {image}, {}}) + "\n@@TRAX:quit\n";
  };
  for (const std::string& image :
       {encode_trax_image(narrow, {"memory"}), encode_trax_image(folder_ / "narrow.png", {"path"})}) {
    expect_error(session(image), "at most 255");
    const Answer ranged = answer_to(session(image), "--tracker kcf --bits 8");
    EXPECT_EQ(ranged.code, 0) << ranged.errors;
    const Answer reference = answer_to(session(encode_trax_image(folder_ / "deep.png", {"path"})));
    EXPECT_EQ(ranged.lines, reference.lines);
  }
}

TEST_F(Trax, TracksSeveralObjectsInVersion4) {
  const Region other = Region::rectangle({200, 100, 40, 60});
  TraxClient client(server(4));
  expect_same_track(client, sequence(true), {rectangle(), other, polygon()});  // each in its own format
  expect_same_track(client, sequence(true), {other});
  TraxClient single(server(3));
  EXPECT_THROW(single.initialize(files_[0], {rectangle(), other}), std::invalid_argument);
  EXPECT_THROW(single.initialize(files_[0], {}), std::invalid_argument);
  expect_same_track(single, sequence(true), {rectangle()});
}

TEST_F(Trax, AddsObjectsToATrackInVersion4) {
  const std::string start = "@@TRAX:initialize \"60,50,48,40\"\n";
  const std::string frame = format_trax_message({Type::Frame, {"file://" + files_[0].string()}, {}}) + '\n';
  const Answer answer = answer_to(
      start + frame + start + frame + frame + "@@TRAX:initialize\n" + start + frame + "@@TRAX:quit\n",
      "--tracker kcf --trax-version 4");
  EXPECT_EQ(answer.code, 0) << answer.errors;
  EXPECT_EQ(answer.lines.size(), 1u + 1 + 2 + 2 + 1);
}

TEST_F(Trax, TalksThroughASocket) {
  TraxClientOptions options = logged();
  options.socket = true;
  for (const int version : {1, 4}) {
    TraxClient client(server(version), options);
    expect_same_track(client, sequence(version == 1), {rectangle()});
  }
  EXPECT_EQ(log(), "");
}

TEST_F(Trax, TalksThroughOtherDescriptors) {
  std::ofstream(folder_ / "in") << initialize() << "@@TRAX:quit\n";
  const std::string at = folder_.string();
  ASSERT_EQ(std::system(("TRAX_IN=7 TRAX_OUT=8 timeout 60 " + server() + " 7< " + at + "/in 8> " + at +
                         "/out > " + at + "/nothing < /dev/null")
                            .c_str()),
            0);
  EXPECT_EQ(fs::file_size(folder_ / "nothing"), 0u);
  std::ifstream out(folder_ / "out");
  std::string hello, state;
  EXPECT_TRUE(std::getline(out, hello) && std::getline(out, state));
  EXPECT_EQ(parse_trax_message(state).type, Type::State);
}

TEST_F(Trax, IgnoresWhatIsNoMessage) {
  const Answer answer = answer_to("hello?\n\n@@TRAXY\n" + initialize() + " @@TRAX:nothing\n@@TRAX:quit\n");
  EXPECT_EQ(answer.code, 0) << answer.errors;
  EXPECT_EQ(answer.lines.size(), 2u);
}

TEST_F(Trax, EndsASessionThatGoesWrong) {
  const std::string frame = "@@TRAX:frame \"file://" + (folder_ / "missing.png").string() + "\"\n";
  expect_error("", "without sending quit");
  expect_error(initialize(), "without sending quit");
  expect_error("@@TRAX:frame \"file", "without sending quit");
  expect_error("@@TRAX:nonsense\n", "unknown message 'nonsense'");
  expect_error("@@TRAX:frame \"a\n", "not closed");
  expect_error("@@TRAX:hello\n", "hello is a message that only trackers send");
  expect_error("@@TRAX:state \"1,2,3,4\"\n", "state is a message that only trackers send");
  expect_error(frame, "before an object");
  expect_error(initialize() + frame, "no such image: ");
  expect_error(initialize() + "@@TRAX:frame\n", "frame needs an image, but has 0 arguments");
  expect_error("@@TRAX:initialize\n", "an image and a region, but has 0 arguments");
  expect_error("@@TRAX:initialize \"x\" \"1,2,3,4\" \"y\"\n", "3 arguments");
  for (const std::string region : {"", "1,2,3", "1,2,3,4,5", "1,2,-3,4", "nan,2,3,4", "m0,0,3,3,1,2", "0"}) {
    expect_error("@@TRAX:initialize \"x\" \"" + region + "\"\n", "expected a rectangle or a polygon");
  }
  expect_error("@@TRAX:initialize \"file://" + folder_.string() + "/in\" \"1,2,3,4\"\n", "cannot decode");
  const std::string image = encode_trax_image(images_[0], {"memory"});
  expect_error("@@TRAX:initialize \"" + image + "\" \"4000,2,30,40\"\n", "kcf in image 1: ");
  expect_error("@@TRAX:initialize \"image:100000;100000;rgb;AAAA\" \"1,2,3,4\"\n", "100000 x 100000");

  const std::string four = "--tracker kcf --trax-version 4";
  expect_error("@@TRAX:initialize \"1,2,3\"\n", "expected a rectangle or a polygon", four);
  expect_error("@@TRAX:initialize \"x\" \"1,2,3,4\"\n", "initialize needs a region, but has 2 arguments",
               four);
  expect_error("@@TRAX:initialize\n" + frame, "before an object", four);
}

TEST_F(Trax, EndsASessionOfALineWithoutEnd) {
  const std::string at = folder_.string();
  EXPECT_NE(
      std::system(
          ("yes x | tr -d '\\n' | timeout 60 " + server() + " > " + at + "/out 2> " + at + "/err").c_str()),
      0);
  std::ifstream errors(folder_ / "err");
  std::string line;
  ASSERT_TRUE(std::getline(errors, line));
  expect_reason(line, {"asterism-trax: a line longer than "});
}

TEST_F(Trax, NoticesThatTheClientIsGone) {
  // Nobody reads the reply any more.
  const std::string at = folder_.string();
  std::ofstream(folder_ / "in") << initialize();
  EXPECT_EQ(std::system(("(sleep 0.3; cat " + at + "/in) | (timeout 60 " + server() + " 2> " + at +
                         "/err; echo $? > " + at + "/code) | true; while [ ! -s " + at +
                         "/code ]; do sleep 0.05; done")
                            .c_str()),
            0);
  std::ifstream errors(folder_ / "err"), code(folder_ / "code");
  std::string line;
  ASSERT_TRUE(std::getline(errors, line));
  expect_reason(line, {"asterism-trax: the client closed the connection"});
  ASSERT_TRUE(std::getline(code, line));
  EXPECT_EQ(line, "1");
}

TEST_F(Trax, RefusesItsArgumentsInOneLine) {
  const auto expect = [&](const std::string& options, const std::string& part) {
    SCOPED_TRACE(options);
    const Answer answer = answer_to("", options);
    EXPECT_GT(answer.code, 0);
    EXPECT_TRUE(answer.lines.empty()) << "no hello";
    EXPECT_EQ(std::count(answer.errors.begin(), answer.errors.end(), '\n'), 1) << answer.errors;
    EXPECT_NE(answer.errors.find(part), std::string::npos) << answer.errors;
  };
  expect("--tracker magic", "magic");
  expect("--trax-version 5", "--trax-version");
  expect("--trax-version 0", "--trax-version");
  expect("extra", "extra");
  for (const std::string variable :
       {"TRAX_SOCKET=x", "TRAX_SOCKET=70000", "TRAX_OUT=-1", "TRAX_OUT=999", "TRAX_IN=1e3"}) {
    EXPECT_EQ(WEXITSTATUS(std::system(
                  (variable + " timeout 60 " + server() + " < /dev/null 2> /dev/null > /dev/null").c_str())),
              1)
        << variable;
  }
}

// ---- The client and other trackers ----

constexpr char kHello[] = "echo '@@TRAX:hello trax.version=3 trax.image=path trax.channels='\n";

TEST_F(Trax, ClientTakesWhatTrackersAnswer) {
  const std::string tracker = script(std::string(kHello) + R"(
echo 'loading the network'
read line; echo "$line" >&2
echo '@@TRAX:status 1,2,3,4'
read line; printf '@@TRAX:state "0,0,10,0.5,10,10" "confidence=0.25" "note=\"\\\\\\n"\r\n'
read line; echo '@@TRAX:state "nan,nan,nan,nan" confidence=high'
read line; echo '@@TRAX:state 0'
read line; echo "$line" >&2
)");
  {
    TraxClient client(tracker, logged());
    std::vector<TraxClient::Reply> replies = client.initialize(files_[0], {polygon()});
    ASSERT_EQ(replies.size(), 1u);
    EXPECT_EQ(replies[0].region, Region::rectangle({1, 2, 3, 4}));
    EXPECT_FALSE(replies[0].confidence);
    const TraxClient::Reply reply = client.frame(files_[1])[0];
    EXPECT_EQ(reply.region, Region::polygon({{0, 0}, {10, 0.5}, {10, 10}}));
    EXPECT_EQ(reply.confidence, 0.25);
    EXPECT_EQ(reply.properties.at("note"), "\"\\\n");
    for (int i = 0; i < 2; ++i) {
      const TraxClient::Reply none = client.frame(files_[2])[0];
      EXPECT_FALSE(none.region);
      EXPECT_FALSE(none.confidence);
    }
  }
  EXPECT_NE(log().find("loading the network\n"), std::string::npos) << log();
  EXPECT_NE(log().find("\"60.75,50.25,47.25,39.75\""), std::string::npos)
      << "the polygon as a rectangle, which is all that it takes: " << log();
  EXPECT_NE(log().find("@@TRAX:quit"), std::string::npos) << log();
}

TEST_F(Trax, ClientSpeaksTheTrackersFormats) {
  const std::string tracker = script(R"(
echo '@@TRAX:hello "trax.version=4" "trax.image=buffer;" "trax.region=polygon;" "trax.channels=color;" "trax.multiobject=0"'
while read line; do
  echo "$line" | cut -c 1-60 >&2
  case $line in @@TRAX:frame*) echo '@@TRAX:state 1,2,3,4';; esac
done
)");
  {
    TraxClient client(tracker, logged());
    EXPECT_THROW(client.frame(files_[0]), std::logic_error);
    EXPECT_THROW(client.initialize(files_[0], {rectangle(), rectangle()}), std::invalid_argument);
    client.initialize(files_[0], {rectangle()});
    client.initialize(images_[0], {rectangle()});
  }
  const std::string once =
      "@@TRAX:initialize \"60,50,108,50,108,90,60,90\"\n@@TRAX:frame \"data:image/png;iVBORw0KG";
  EXPECT_TRUE(log().starts_with(once)) << log();
  EXPECT_NE(log().find("@@TRAX:initialize\n" + once), std::string::npos) << log();
}

#ifdef ASTERISM_PYTHON_TRACKER
TEST_F(Trax, ClientRunsATrackerInPython) {
  const Region moved_rectangle = Region::rectangle({64, 50, 48, 40});
  const Region moved_polygon =
      Region::polygon({{88.5, 50.25}, {112, 70.125}, {88, 90}, {76, 85}, {64.75, 70}});
  for (const std::string version : {"1", "2", "3", "4"}) {
    for (const std::string images : {"path", "memory;", "data", "buffer;"}) {
      SCOPED_TRACE(version + ' ' + images);
      TraxClient client(ASTERISM_PYTHON_TRACKER " " + version + " '" + images + "' 'rectangle;polygon;'",
                        logged());
      EXPECT_EQ(client.hello().at("trax.name"), "add \"2\"");
      std::vector<Region> expected = {moved_polygon};
      if (version == "4") expected.push_back(moved_rectangle);
      const std::vector<Region> objects = {polygon(), rectangle()};
      client.initialize(files_[0], {rectangle()});
      client.initialize(files_[0],
                        {objects.begin(), objects.begin() + static_cast<std::ptrdiff_t>(expected.size())});
      const std::vector<TraxClient::Reply> replies = client.frame(files_[1]);
      ASSERT_EQ(replies.size(), expected.size());
      for (size_t i = 0; i < expected.size(); ++i) {
        EXPECT_EQ(replies[i].region, expected[i]);
        EXPECT_EQ(replies[i].confidence, 0.75);
      }
    }
  }
}
#endif

TEST_F(Trax, ClientStartsAnewWhereTheTrackerWantsIt) {
  const std::string once = R"(echo "start $TRAX" >&2
echo "@@TRAX:hello trax.version=3 $0"
read line; echo '@@TRAX:state 1,2,3,4'
read line; read line
)";
  const auto run = [&](const std::string& hello, TraxClientOptions options) {
    std::string text = once;
    text.replace(text.find("$0"), 2, hello);
    fs::remove(folder_ / "log");
    TraxClient client(script(text), std::move(options));
    client.initialize(files_[0], {rectangle()});
    client.initialize(files_[0], {rectangle()});
  };
  run("vot=python", logged());  // the VOT toolkit's wrapper ends after one sequence
  EXPECT_EQ(log(), "start 1\nstart 1\n");
  TraxClientOptions options = logged();
  options.restart = true;
  run("", options);
  EXPECT_EQ(log(), "start 1\nstart 1\n");
}

TEST_F(Trax, ClientSaysWhatIsWrongWithTheTracker) {
  TraxClientOptions options = logged();
  const auto expect_start = [&](const std::string& command, const std::string& part) {
    SCOPED_TRACE(command);
    expect_reason(reason_of([&] { TraxClient(command, options); }), {"tracker '" + command + "': ", part});
  };
  const std::string wait = "read line\n";
  for (const bool socket : {false, true}) {
    options.socket = socket;
    expect_start("exit 3", "ended with exit code 3");
    expect_start("/no/such/tracker", "ended with exit code 127");
    expect_start("kill -9 $$", "ended by signal 9");
    options.timeout = 0.3;
    expect_start("sleep 60", socket ? "does not connect in 0.3 s" : "does not reply in 0.3 s");
    options.timeout = 30;
  }
  options.socket = false;
  expect_start(script("exec 0<&- 1<&-; sleep 60"), "closes the connection");
  expect_start("echo no protocol; exit 0", "ended with exit code 0");
  for (const auto& [says, part] : std::vector<std::pair<std::string, std::string>>{
           {"@@TRAX:state 1,2,3,4", "does not say hello"},
           {"@@TRAX:hello x", "does not say hello"},
           {"@@TRAX:hi", "unknown message"},
           {"@@TRAX:hello trax.version=5", "unknown version of the protocol, 5"},
           {"@@TRAX:hello trax.version=1.5", "unknown version"},
           {"@@TRAX:hello trax.version=x", "unknown version"},
           {"@@TRAX:hello trax.region=mask", "mask"},
           {"@@TRAX:hello \"trax.channels=color;depth\"", "color;depth"},
           {"@@TRAX:quit \"trax.reason=no GPU\"", "quits: no GPU"},
           {"@@TRAX:quit", "quits"}}) {
    expect_start("echo '" + says + "'; " + wait, part);
  }

  const auto expect_reply = [&](const std::string& reply, const std::string& part) {
    SCOPED_TRACE(reply);
    TraxClient client(script(kHello + wait + reply), options);
    expect_reason(reason_of([&] { client.initialize(files_[0], {rectangle()}); }), {part});
    EXPECT_THROW(client.frame(files_[1]), std::logic_error) << "it has ended";
  };
  expect_reply("echo '@@TRAX:hello'\n" + wait, "answers with hello");
  expect_reply("echo '@@TRAX:state'\n" + wait, "a state of 0 regions");
  expect_reply("echo '@@TRAX:state 1,2,3'\n" + wait, "neither a rectangle nor a polygon: '1,2,3'");
  expect_reply("echo '@@TRAX:state m0,0,3,3,1,2'\n" + wait, "neither a rectangle nor a polygon");
  expect_reply("echo '@@TRAX:state \"1,2'\n" + wait, "not closed");
  expect_reply("echo '@@TRAX:quit \"trax.reason=out of memory\"'\n" + wait, "quits: out of memory");
  expect_reply("exit 4", "ended with exit code 4");
  expect_reply("printf '@@TRAX:state 1,2,3,4'; exit 0", "ended with exit code 0");
  expect_reply("while true; do echo '@@TRAX:hello'; done", "answers with hello");
}

// Each of these would be mistaken for the answer to a later image.
TEST_F(Trax, ClientRefusesWhatItHasNotAskedFor) {
  constexpr char kState[] = "@@TRAX:state 1,2,3,4\\n",
                 kHi[] = "@@TRAX:hello trax.version=3 trax.image=path\\n";
  const std::string hi(kHi), state(kState), unasked = "sends a state that nothing asked for";
  const auto say = [](const std::string& text) { return "printf '" + text + "'\n"; };
  const std::string read = "read line\n", once = read + say(state);
  struct Case {
    const char* name;
    std::string script, part;
  };
  const Case cases[] = {
      {"a state before any object", say(hi + state) + once, unasked},
      {"a second hello", say(hi + hi) + once, "sends a hello that nothing asked for"},
      {"two states for the start", say(hi) + read + say(state + state) + once, unasked},
      {"two states for a frame", say(hi) + once + read + say(state + state) + once, unasked},
      {"two, with print between", say(hi) + once + read + say(state + "iou 0.5\\n" + state) + once, unasked},
      {"a second one later", say(hi) + once + read + say(state) + "sleep 0.1\n" + say(state) + once, unasked},
      {"a second one in pieces",
       say(hi) + once + read + say(state + "@@TRAX:st") + "sleep 0.1\n" + say("ate 1,2,3,4\\n") + once,
       unasked},
      {"a quit between frames", say(hi) + once + say("@@TRAX:quit trax.reason=tired\\n"), "quits: tired"},
      {"a quit in place of a reply", say(hi) + once + read + say("@@TRAX:quit\\n"), "quits"},
      {"an end in the middle of a line", say(hi) + once + read + say("@@TRAX:state 1,2") + "exit 0\n",
       "exit code 0"},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.name);
    TraxClientOptions options = logged();
    options.timeout = 20;
    TraxClient client(script(one.script + read), options);
    expect_reason(reason_of([&] {
                    client.initialize(files_[0], {rectangle()});
                    for (int i = 0; i < 4; ++i) {
                      std::this_thread::sleep_for(std::chrono::milliseconds(200));
                      client.frame(files_[1]);
                    }
                  }),
                  {one.part});
    EXPECT_THROW(client.frame(files_[1]), std::logic_error) << "it has ended";
  }
}

TEST_F(Trax, ClientDoesNotWaitForEver) {
  TraxClientOptions options = logged();
  options.timeout = 2;  // long enough for the hello
  const std::string chatter = "while true; do echo chatter; done\n";
  const cv::Mat small(4, 4, CV_8UC3, cv::Scalar::all(7)), large(400, 400, CV_8UC3, cv::Scalar::all(7));
  const auto expect = [&](const std::string& does, const cv::Mat& image, const std::string& part) {
    SCOPED_TRACE(does);
    TraxClient client(script("echo '@@TRAX:hello trax.image=memory'\n" + does), options);
    expect_reason(reason_of([&] { client.initialize(image, {rectangle()}); }), {part});
  };
  expect("read line; sleep 60", small, "does not reply in 2 s");
  expect("read line; kill -STOP $$", small, "does not reply in 2 s");
  expect("read line; " + chatter, small, "does not reply in 2 s");
  expect("read line; while true; do printf x; sleep 0.05; done", small, "does not reply in 2 s");
  expect("sleep 60", large, "takes no message in 2 s");
  expect(chatter, large, "takes no message in 2 s");
  for (const double timeout : {0.0, -1.0, std::nan("")}) {
    options.timeout = timeout;
    EXPECT_THROW(TraxClient(server(), options), std::invalid_argument);
  }
  options.timeout = std::numeric_limits<double>::infinity();
  TraxClient(server(), options).initialize(images_[0], {rectangle()});
}

TEST_F(Trax, ClientStartsAgainAfterAnError) {
  const fs::path mark = folder_ / "mark";
  TraxClient client("if [ -e " + mark.string() + " ]; then exec " + server() + "; fi; touch " +
                        mark.string() + "; echo '@@TRAX:hello'; read line; exit 1",
                    logged());
  EXPECT_THROW(client.initialize(files_[0], {rectangle()}), TraxError);
  expect_same_track(client, sequence(true), {rectangle()});
}

TEST_F(Trax, ClientKeepsTheTrackerWhereAnImageIsMissing) {
  TraxClient client(
      script("echo '@@TRAX:hello trax.image=memory'\nwhile read line; do echo '@@TRAX:state 1,2,3,4'; done"));
  client.initialize(images_[0], {rectangle()});
  expect_reason(reason_of([&] { client.frame(fs::path("/missing.png")); }), {"no such image: /missing.png"});
  EXPECT_EQ(client.frame(images_[1])[0].region, Region::rectangle({1, 2, 3, 4}));
}

TEST_F(Trax, ClientWritesWhileTheTrackerPrints) {
  // If both sides only wrote, neither could continue. The message of a tracker that has quit is read even
  // though it no longer reads.
  TraxClientOptions options = logged();
  options.timeout = 20;
  const std::string printing = "head -c 3000000 /dev/zero | tr '\\0' x | fold -w 1000; echo\n";
  const cv::Mat large(400, 400, CV_8UC3, cv::Scalar::all(7));
  {
    TraxClient client(script("echo '@@TRAX:hello trax.image=memory'\n" + printing +
                             "read line; echo '@@TRAX:state 1,2,3,4'\nread line\n"),
                      options);
    EXPECT_EQ(client.initialize(large, {rectangle()})[0].region, Region::rectangle({1, 2, 3, 4}));
  }
  TraxClient client(script("echo '@@TRAX:hello trax.image=memory'\necho '@@TRAX:quit trax.reason=no'\n"),
                    options);
  expect_reason(reason_of([&] { client.initialize(large, {rectangle()}); }), {"quits: no"});
}

TEST_F(Trax, ClientLeavesNoProcessBehind) {
  // A child of the shell, which does not react to quit.
  const std::string pid = (folder_ / "pid").string();
  const auto start = std::chrono::steady_clock::now();
  {
    TraxClient client(script(std::string(kHello) + "sleep 60 & echo $! > " + pid + "\nwait\n"), logged());
    while (!fs::exists(pid) || fs::file_size(pid) == 0)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
  std::ifstream file(pid);
  pid_t child = 0;
  ASSERT_TRUE(file >> child);
  // The child is not this process's to wait for; the system may take a moment to remove it.
  const auto is_there = [&] {
    std::ifstream stat("/proc/" + std::to_string(child) + "/stat");
    std::string number, name, state;
    return (stat >> number >> name >> state) && state != "Z";
  };
  for (int i = 0; i < 200 && is_there(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_FALSE(is_there());
}

}  // namespace
}  // namespace asterism::tools
