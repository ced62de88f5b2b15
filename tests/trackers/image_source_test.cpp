// The input of programs: image files of all kinds, folders, and videos as phones and recorders write them. A
// new kind is one more line in a table.
#include "image_source.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "image_file.hpp"
#include "moving_square.hpp"
#include "output_path.hpp"
#include "tool_main.hpp"
#include "trax_image.hpp"
#include "trax_message.hpp"

namespace asterism::tools {
namespace {

namespace fs = std::filesystem;

// Messages of libraries about damaged files do not belong in the report.
const bool kSilent = (silence_libraries(), true);

using Bytes = std::string;
using namespace std::string_literals;

class Folder : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "asterism-images-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path write(const std::string& name, const Bytes& bytes) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }
  fs::path folder_;
};

std::string reason_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const std::exception& error) {
    return error.what();
  }
  return {};
}

// ---- Image files ----

Bytes encoded(const std::string& ending, const std::vector<int>& flags = {}, int frame = 0) {
  std::vector<unsigned char> bytes;
  cv::imencode(ending, draw_frame(frame), bytes, flags);
  return {bytes.begin(), bytes.end()};
}

Bytes number(std::uint64_t value, int bytes, bool big_endian = true) {
  Bytes text;
  for (int i = 0; i < bytes; ++i) {
    const int at = big_endian ? bytes - 1 - i : i;
    text += static_cast<char>(at < 8 ? value >> 8 * at : 0);
  }
  return text;
}
Bytes little(std::uint64_t value, int bytes) { return number(value, bytes, false); }

Bytes patched(Bytes file, std::size_t at, const Bytes& by) { return file.replace(at, by.size(), by); }

Bytes png_chunk(const Bytes& body) {  // body includes the chunk's name
  std::uint32_t crc = ~0u;
  for (const char c : body) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xedb88320u : 0);
  }
  return number(body.size() - 4, 4) + body + number(~crc, 4);
}

// Two frames, the second one taken from a separate PNG.
Bytes animated_png() {
  const Bytes first = encoded(".png"), second = encoded(".png", {}, 1);
  const auto data = [](const Bytes& png) {
    Bytes all;
    for (std::size_t at = 8; at < png.size();) {
      std::size_t length = 0;
      for (std::size_t i = 0; i < 4; ++i) length = length << 8 | static_cast<unsigned char>(png[at + i]);
      if (png.compare(at + 4, 4, "IDAT") == 0) all += png.substr(at + 8, length);
      at += length + 12;
    }
    return all;
  };
  const auto control = [](std::uint32_t sequence) {
    return png_chunk("fcTL" + number(sequence, 4) + number(320, 4) + number(240, 4) + number(0, 8) +
                     number(1, 2) + number(20, 2) + number(0, 2));
  };
  return first.substr(0, 33) + png_chunk("acTL" + number(2, 4) + number(0, 4)) + control(0) +
         png_chunk("IDAT" + data(first)) + control(1) + png_chunk("fdAT" + number(2, 4) + data(second)) +
         png_chunk("IEND");
}

Bytes read(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

Bytes stack(int pages) {
  const fs::path path =
      fs::path(testing::TempDir()) / ("asterism_stack_" + std::to_string(getpid()) + ".tif");
  std::vector<cv::Mat> images;
  for (int i = 0; i < pages; ++i) images.push_back(draw_frame(i));
  cv::imwritemulti(path.string(), images);
  const Bytes bytes = read(path);
  fs::remove(path);
  return bytes;
}

// As ffmpeg -c:v libwebp_anim writes it, with frames of the size and without their pixels' end.
Bytes animated_webp() {
  const Bytes still = encoded(".webp");  // RIFF, length, WEBP, then the chunk of the pixels
  const Bytes frame = "ANMF" + little(16 + still.size() - 12, 4) + little(0, 6) + little(319, 3) +
                      little(239, 3) + little(100, 3) + "\2" + still.substr(12);
  const Bytes body = "WEBPVP8X" + little(10, 4) + little(2, 4) + little(319, 3) + little(239, 3) + "ANIM" +
                     little(6, 4) + little(0xffffffff, 4) + little(0, 2) + frame + frame;
  return "RIFF" + little(body.size(), 4) + body;
}

// Two pages of 4 x 2 pixels with gray levels 10 and 20, in the 64-bit format, in either byte order.
Bytes big_stack(bool big_endian) {
  const auto n = [&](std::uint64_t value, int bytes) { return number(value, bytes, big_endian); };
  Bytes file = (big_endian ? "MM" : "II") + n(43, 2) + n(8, 2) + n(0, 2) + n(16, 8);
  for (int page = 0; page < 2; ++page) {
    const std::uint64_t entries = 8, pixels = file.size() + 8 + 20 * entries + 8;
    const auto entry = [&](std::uint64_t tag, std::uint64_t value) {
      return n(tag, 2) + n(3, 2) + n(1, 8) + n(value, 2) + Bytes(6, '\0');
    };
    file += n(entries, 8) + entry(256, 4) + entry(257, 2) + entry(258, 8) + entry(259, 1) + entry(262, 1) +
            n(273, 2) + n(16, 2) + n(1, 8) + n(pixels, 8) + entry(278, 2) + n(279, 2) + n(16, 2) + n(1, 8) +
            n(8, 8) + n(page == 0 ? pixels + 8 : 0, 8) + Bytes(8, page == 0 ? '\x0a' : '\x14');
  }
  return file;
}

// Changes the value of a tag in a little-endian TIFF written by OpenCV, in its first directory or in that at
// `directory`.
Bytes with_tag(Bytes tiff, std::uint16_t tag, std::uint32_t value, std::size_t directory = 0) {
  const auto at = [&](std::size_t where, int count) {
    std::size_t found = 0;
    for (int i = count - 1; i >= 0; --i)
      found = found << 8 | static_cast<unsigned char>(tiff[where + static_cast<std::size_t>(i)]);
    return found;
  };
  if (directory == 0) directory = at(4, 4);
  for (std::size_t i = 0; i < at(directory, 2); ++i)
    if (const std::size_t entry = directory + 2 + 12 * i; at(entry, 2) == tag)
      return patched(patched(tiff, entry + 2, little(4, 2)), entry + 8, little(value, 4));
  return {};
}

Bytes cut(const Bytes& file, double share) {
  return file.substr(0, static_cast<std::size_t>(share * static_cast<double>(file.size())));
}

struct File {
  std::string name;
  Bytes bytes;
  enum { Frame, Damaged, Refused } outcome;
  std::string reason = {};
};

std::vector<File> files() {
  std::vector<File> all;
  for (const std::string ending : {"jpg", "png", "bmp", "tif", "webp", "ppm", "jp2"}) {
    const Bytes whole = encoded("." + ending);
    all.push_back({ending, whole, File::Frame});
    for (const double share : {0.99, 0.5, 0.2})
      all.push_back(
          {ending + "CutTo" + std::to_string(std::lround(100 * share)), cut(whole, share), File::Damaged});
  }
  const Bytes jpeg = encoded(".jpg"), png = encoded(".png"), bmp = encoded(".bmp"), tiff = encoded(".tif");
  const Bytes jp2 = encoded(".jp2"), with_preview = jpeg.substr(0, 2) + "\xff\xe1" +
                                                    number(jpeg.size() + 2, 2) + jpeg + jpeg.substr(2);
  const std::string side = std::to_string(60000), many = "pixels, and at most 134217728 are read";
  const std::size_t sof = jpeg.find("\xff\xc0\x00\x11"s), siz = jp2.find("\xff\x51\x00\x2f"s);
  const std::vector<File> special = {
      {"JpegProgressive", encoded(".jpg", {cv::IMWRITE_JPEG_PROGRESSIVE, 1}), File::Frame},
      {"JpegProgressiveCut", cut(encoded(".jpg", {cv::IMWRITE_JPEG_PROGRESSIVE, 1}), 0.7), File::Damaged},
      {"JpegWithRestarts", encoded(".jpg", {cv::IMWRITE_JPEG_RST_INTERVAL, 2}), File::Frame},
      {"JpegWithRestartsCut", cut(encoded(".jpg", {cv::IMWRITE_JPEG_RST_INTERVAL, 2}), 0.7), File::Damaged},
      {"JpegWithoutItsEnd", jpeg.substr(0, jpeg.size() - 2), File::Damaged},
      {"JpegWithPadding", jpeg + Bytes(512, '\0'), File::Frame},
      {"JpegWithAClipBehind", jpeg + "ftypmp42" + Bytes(64, '\xff'), File::Frame},
      {"JpegWithAPreview", with_preview, File::Frame},
      {"JpegWithAPreviewCut", cut(with_preview, 0.9), File::Damaged},
      {"JpegCutInItsHeader", jpeg.substr(0, 20), File::Damaged},
      {"JpegOfZerosInTheMiddle", cut(jpeg, 0.5) + Bytes(jpeg.size() / 2, '\0'), File::Damaged},
      {"PngWithAWrongByte", patched(png, png.size() / 2, "?!?!"), File::Damaged},
      {"PngWithoutItsEnd", png.substr(0, png.size() - 12), File::Damaged},
      {"PngWithSomethingBehind", png + "more", File::Frame},
      {"PngOfZerosInTheMiddle", cut(png, 0.5) + Bytes(png.size() / 2, '\0'), File::Damaged},
      {"Empty", "", File::Damaged},
      {"Text", "broken", File::Refused, "not an image of a known format"},
      {"Zeros", Bytes(4096, '\0'), File::Refused, "not an image of a known format"},
      {"LargeJpeg", patched(jpeg, sof + 5, number(60000, 2) + number(60000, 2)), File::Refused, many},
      {"LargePng", patched(png, 16, number(60000, 4) + number(60000, 4)), File::Refused, many},
      {"LargePngOfAFewBytes", patched(png, 16, number(2147483647, 4) + number(2147483647, 4)).substr(0, 60),
       File::Refused, many},
      {"LargeBmp", patched(bmp, 18, little(60000, 4) + little(60000, 4)), File::Refused, many},
      {"LargeBmpFromTheTop", patched(bmp, 18, little(60000, 4) + little(std::uint64_t(-60000), 4)),
       File::Refused, many},
      {"LargeTiff", with_tag(with_tag(tiff, 256, 60000), 257, 60000), File::Refused, many},
      {"LargeWebp",
       "RIFF" + little(30, 4) + "WEBPVP8X" + little(10, 4) + little(0, 4) + little(16383, 3) +
           little(16383, 3),
       File::Refused, many},
      {"LargePpm", "P6 60000\n# a comment\n60000 255\n", File::Refused, many},
      {"LargePam", "P7\nWIDTH 60000\nHEIGHT 60000\nDEPTH 3\nMAXVAL 255\nENDHDR\n", File::Refused, many},
      {"LargeJp2", patched(jp2, siz + 6, number(60000, 4) + number(60000, 4)), File::Refused, many},
      {"AnimatedPng", animated_png(), File::Refused, "an animated PNG is not an image: make a video of it"},
      {"AnimatedWebp", animated_webp(), File::Refused,
       "an animated WebP is not an image: make a video of it"},
      {"AnimatedWebpCut", animated_webp().substr(0, 100), File::Refused, "an animated WebP"},
      {"JpegOfTwelveBits", patched(jpeg, sof + 4, "\x0c"), File::Refused, "a JPEG of 12 bits a sample"},
      {"JpegWithoutLoss", patched(jpeg, sof + 1, "\xc3"), File::Refused, "a JPEG that is lossless"},
      {"PamWithTransparency",
       "P7\nWIDTH 320\nHEIGHT 240\nDEPTH 4\nMAXVAL 255\nENDHDR\n" + Bytes(320 * 240 * 4, 'x'), File::Refused,
       "a PAM of 16 bits a sample or with transparency"},
      {"TiffOfUnknownCompression", with_tag(tiff, 259, 12345), File::Refused,
       "a TIFF of compression scheme 12345"},
      {"TiffOfPages", stack(3), File::Refused, "several images in one file"},
      {"PpmOfSeveral", encoded(".ppm") + encoded(".ppm"), File::Refused, "several images in one file"},
  };
  all.insert(all.end(), special.begin(), special.end());
  return all;
}

class ImageFiles : public Folder, public testing::WithParamInterface<File> {};

// Each file is put between two intact frames and read through every interface.
TEST_P(ImageFiles, AreFramesBlankFramesOrRefused) {
  const File& file = GetParam();
  const fs::path path = write("frames/2.img", file.bytes);
  const auto check = [&](const std::function<FrameImage()>& read, const std::string& how) {
    SCOPED_TRACE(how);
    FrameImage frame;
    const std::string reason = reason_of([&] { frame = read(); });
    if (file.outcome == File::Refused) {
      EXPECT_NE(reason.find(file.reason), std::string::npos) << reason;
      return;
    }
    ASSERT_EQ(reason, "");
    EXPECT_EQ(frame.damaged, file.outcome == File::Damaged);
    EXPECT_EQ(frame.pixels.size(), cv::Size(320, 240));
    EXPECT_EQ(frame.pixels.type(), CV_8UC3);
    const cv::Mat expected =
        frame.damaged ? cv::Mat(frame.pixels.size(), CV_8UC3, cv::Scalar::all(128)) : draw_frame(0);
    EXPECT_LE(cv::norm(frame.pixels, expected, cv::NORM_L1) / static_cast<double>(expected.total()),
              frame.damaged ? 0 : 25)
        << "of all channels, for the losses of JPEG";
  };
  const cv::Size size(320, 240);
  check([&] { return read_frame(path, {}, size); }, "a file");
  check([&] { return read_frame(path, PixelRange{0, 255}, size); }, "a file with a range");
  check([&] { return decode_trax_image("file://" + path.string(), {}, size); }, "TraX, a path");
  check([&] { return decode_trax_image("data:image/x;" + to_base64(file.bytes), {}, size); }, "TraX, data");
  fs::rename(path, folder_ / "frames/2.png");
  for (const int t : {1, 3}) write("frames/" + std::to_string(t) + ".jpg", encoded(".jpg"));
  ImageSource source = ImageSource::open((folder_ / "frames").string());
  cv::Mat image;
  ASSERT_TRUE(source.next(image));
  check(
      [&] {
        EXPECT_TRUE(source.next(image));
        return FrameImage{image, !source.damaged().empty()};
      },
      "a folder");
  if (file.outcome == File::Refused) return;
  EXPECT_TRUE(source.next(image));
  EXPECT_FALSE(source.next(image));
  EXPECT_EQ(source.damaged().size(), file.outcome == File::Damaged ? 1u : 0u);
  if (file.outcome == File::Damaged) {
    EXPECT_EQ(source.damaged()[0], "frame 2, " + (folder_ / "frames/2.png").string());
    // As the first frame, whose size is in its header or unknown.
    const std::string reason =
        reason_of([&] { EXPECT_EQ(read_frame(folder_ / "frames/2.png").pixels.size(), size); });
    EXPECT_TRUE(reason.empty() || reason.find("a damaged image of unknown size") != std::string::npos)
        << reason;
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, ImageFiles, testing::ValuesIn(files()),
                         [](const auto& instance) { return instance.param.name; });

void PrintTo(const File& file, std::ostream* out) { *out << file.name; }

// A file that ends within its size has none, rather than a part of it.
TEST(ImageHeaders, OfFilesCutAnywhereHaveTheirSizeOrNone) {
  std::vector<File> whole = {
      {"animated WebP", animated_webp(), File::Frame},
      {"PAM", "P7\nWIDTH 320\nHEIGHT 240\nDEPTH 3\nMAXVAL 255\nENDHDR\n", File::Frame}};
  for (const char* ending : {"jpg", "png", "bmp", "tif", "webp", "ppm", "jp2", "sr"})
    whole.push_back({ending, encoded(std::string(".") + ending), File::Frame});
  for (const File& file : whole) {
    int sizes = 0;
    for (std::size_t length = 0; length <= std::min<std::size_t>(file.bytes.size(), 1000); ++length) {
      const auto* const begin = reinterpret_cast<const unsigned char*>(file.bytes.data());
      const auto header = read_image_header({begin, length});
      if (!header || header->size.empty()) continue;
      EXPECT_EQ(header->size, cv::Size(320, 240)) << file.name << " cut to " << length << " bytes";
      ++sizes;
    }
    // The size of a TIFF may be at its end.
    EXPECT_TRUE(sizes > 0 || file.name == "tif") << file.name;
  }
}

// ---- Pixels of TIFFs ----

// An uncompressed TIFF of the frame's gray levels, or of its colors with 3 samples. Level 255 becomes
// `white`.
Bytes tiff_of(int samples, int bits, int format, double white) {
  cv::Mat frame = draw_frame(0), levels;
  cv::cvtColor(frame, frame, samples == 1 ? cv::COLOR_BGR2GRAY : cv::COLOR_BGR2RGB);
  frame.reshape(1).convertTo(levels, CV_64F, white / 255);
  Bytes pixels;
  const auto add = [&](auto value) { pixels.append(reinterpret_cast<const char*>(&value), sizeof value); };
  for (int y = 0; y < levels.rows; ++y)
    for (int x = 0; x < levels.cols; ++x) {
      const double value = levels.at<double>(y, x);
      if (format == 3 && bits == 64)
        add(value);
      else if (format == 3 && bits == 32)
        add(static_cast<float>(value));
      else if (format == 3)
        add(cv::float16_t(static_cast<float>(value)));
      else if (bits >= 8)
        pixels += little(static_cast<std::uint64_t>(std::llround(value)), bits / 8);
      else if (x % 2 == 1)
        pixels += static_cast<char>(std::lround(levels.at<double>(y, x - 1)) * 16 + std::lround(value));
    }
  const auto entry = [](std::uint64_t tag, std::uint64_t type, std::uint64_t count, std::uint64_t value) {
    return little(tag, 2) + little(type, 2) + little(count, 4) + little(value, 4);
  };
  const std::uint64_t entries = 10, after = 8 + 2 + 12 * entries + 4, per_sample = samples == 1 ? 0 : 12;
  Bytes lists;
  for (int i = 0; i < 3; ++i) lists += little(static_cast<std::uint64_t>(bits), 2);
  for (int i = 0; i < 3; ++i) lists += little(static_cast<std::uint64_t>(format), 2);
  const auto list = [&](std::uint64_t tag, int value, std::uint64_t at) {
    return samples == 1 ? entry(tag, 3, 1, static_cast<std::uint64_t>(value)) : entry(tag, 3, 3, after + at);
  };
  return "II*\0"s + little(8, 4) + little(entries, 2) + entry(256, 4, 1, 320) + entry(257, 4, 1, 240) +
         list(258, bits, 0) + entry(259, 3, 1, 1) + entry(262, 3, 1, samples == 1 ? 1 : 2) +
         entry(273, 4, 1, after + per_sample) + entry(277, 3, 1, static_cast<std::uint64_t>(samples)) +
         entry(278, 4, 1, 240) + entry(279, 4, 1, pixels.size()) + list(339, format, 6) + little(0, 4) +
         (samples == 1 ? "" : lists) + pixels;
}

struct Tiff {
  std::string name;
  int samples, bits, format;  // format: 1 unsigned, 2 signed, 3 floating point
  double white;
  bool needs_range;
  std::string reason = {};  // why it is refused with a range
};

void PrintTo(const Tiff& tiff, std::ostream* out) { *out << tiff.name; }

class Tiffs : public Folder, public testing::WithParamInterface<Tiff> {};

TEST_P(Tiffs, AreReadOrRefusedByTheirKindAndNeverDamaged) {
  const auto& [name, samples, bits, format, white, needs_range, reason] = GetParam();
  cv::Mat expected = draw_frame(0);
  if (samples == 1) {
    cv::cvtColor(expected, expected, cv::COLOR_BGR2GRAY);
    cv::cvtColor(expected, expected, cv::COLOR_GRAY2BGR);
  }
  const fs::path path = write("in/1.tif", tiff_of(samples, bits, format, white));
  for (const bool ranged : {false, true}) {
    SCOPED_TRACE(ranged);
    FrameOptions options;
    if (ranged) options.range = PixelRange{0, white};
    ImageSource source = ImageSource::open((folder_ / "in").string(), options);
    cv::Mat image;
    const std::string refusal = reason_of([&] { EXPECT_TRUE(source.next(image)); });
    EXPECT_TRUE(source.damaged().empty());
    if (!reason.empty() || (needs_range && !ranged)) {
      EXPECT_NE(refusal.find(reason.empty() ? "--range LOW,HIGH" : reason), std::string::npos) << refusal;
      EXPECT_NE(refusal.find("frame 1"), std::string::npos) << refusal;
      continue;
    }
    ASSERT_EQ(refusal, "");
    EXPECT_EQ(image.type(), CV_8UC3);
    EXPECT_LE(cv::norm(image, expected, cv::NORM_INF), 1);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, Tiffs,
    testing::Values(Tiff{"Gray8", 1, 8, 1, 255, false}, Tiff{"Gray16", 1, 16, 1, 65535, false},
                    Tiff{"GrayFloat", 1, 32, 3, 1, false}, Tiff{"GrayDouble", 1, 64, 3, 1, false},
                    Tiff{"ColorFloat", 3, 32, 3, 1, false}, Tiff{"GrayFloatTo255", 1, 32, 3, 255, true},
                    Tiff{"GrayDoubleTo255", 1, 64, 3, 255, true},
                    Tiff{"GrayFloatOf8BitsBy65535", 1, 32, 3, 255.0 / 65535, true},
                    Tiff{"GraySigned16", 1, 16, 2, 32767, true}, Tiff{"GraySigned32", 1, 32, 2, 1e6, true},
                    Tiff{"GrayHalf", 1, 16, 3, 1, true,
                         "1 sample a pixel, floating-point numbers of 16 bits"},
                    Tiff{"GrayUnsigned32", 1, 32, 1, 1e6, true, "unsigned integers of 32 bits"},
                    Tiff{"Gray4", 1, 4, 1, 15, true, "unsigned integers of 4 bits"},
                    Tiff{"ColorHalf", 3, 16, 3, 1, true, "3 samples a pixel, floating-point numbers of 16"},
                    Tiff{"ColorDouble", 3, 64, 3, 1, true, "floating-point numbers of 64 bits"}),
    [](const auto& instance) { return instance.param.name; });

// Reading a header of any bytes must not fail, and its time is bounded by their number.
TEST(ImageHeader, IsReadFromAnyBytes) {
  std::vector<File> all = files();
  all.push_back({"BigTiff", big_stack(false), File::Frame});
  cv::RNG random(5);
  for (const File& file : all) {
    const Bytes whole = file.bytes.substr(0, 6000);
    for (int i = 0; i < 400; ++i) {
      Bytes bytes =
          whole.substr(0, static_cast<std::size_t>(random.uniform(0, static_cast<int>(whole.size()) + 1)));
      for (int k = random.uniform(0, 4); k > 0 && !bytes.empty(); --k)
        bytes[static_cast<std::size_t>(random.uniform(0, std::min(static_cast<int>(bytes.size()), 200)))] =
            static_cast<char>(random.uniform(0, 256));
      const auto header =
          read_image_header({reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()});
      EXPECT_TRUE(!header || header->size.width >= 0);
    }
  }
  // A cyclic chain of pages.
  Bytes ring = "II*\0"s + little(8, 4) + little(0, 2) + little(8, 4);
  EXPECT_EQ(
      read_image_header({reinterpret_cast<const unsigned char*>(ring.data()), ring.size()})->pages.size(),
      1u);
}

// ---- Files of several images ----

TEST_F(Folder, AStackIsReadPageByPage) {
  const fs::path path = write("stack.tif", stack(5));
  ImageSource source = ImageSource::open(path.string());
  EXPECT_EQ(source.frame_count(), 5);
  ASSERT_TRUE(source.skip(1));
  cv::Mat image;
  for (int page = 1; page < 5; ++page) {
    ASSERT_TRUE(source.next(image));
    EXPECT_EQ(cv::norm(image, draw_frame(page), cv::NORM_INF), 0) << page;
  }
  EXPECT_FALSE(source.next(image));
  EXPECT_TRUE(source.reads(path));
  EXPECT_EQ(ImageSource::open(write("one.tif", stack(1)).string()).frame_count(), 1);
}

TEST_F(Folder, AStackMayHaveTheLargeForm) {
  for (const bool big_endian : {false, true}) {
    ImageSource source = ImageSource::open(write("big.tif", big_stack(big_endian)).string());
    EXPECT_EQ(source.frame_count(), 2);
    cv::Mat image;
    for (const int gray : {10, 20}) {
      ASSERT_TRUE(source.next(image));
      EXPECT_EQ(image.size(), cv::Size(4, 2));
      EXPECT_EQ(image.at<cv::Vec3b>(1, 3), cv::Vec3b::all(static_cast<uchar>(gray)));
    }
  }
}

TEST_F(Folder, ADamagedPageIsABlankFrame) {
  const Bytes whole = stack(3);
  const auto pages =
      read_image_header({reinterpret_cast<const unsigned char*>(whole.data()), whole.size()})->pages;
  ASSERT_EQ(pages.size(), 3u);
  const Bytes bytes = with_tag(whole, 273, 0x7fff0000, pages[1]);  // pixels beyond its end
  ImageSource source = ImageSource::open(write("stack.tif", bytes).string());
  cv::Mat image;
  for (int page = 0; page < 3; ++page) {
    ASSERT_TRUE(source.next(image));
    EXPECT_EQ(
        cv::norm(image, page == 1 ? cv::Mat(image.size(), CV_8UC3, cv::Scalar::all(128)) : draw_frame(page),
                 cv::NORM_INF),
        0)
        << page;
  }
  EXPECT_EQ(source.damaged().size(), 1u);
}

TEST_F(Folder, AnAnimatedPngIsAVideo) {
  ImageSource source = ImageSource::open(write("clip.png", animated_png()).string());
  cv::Mat image;
  for (int frame = 0; frame < 2; ++frame) {
    ASSERT_TRUE(source.next(image)) << frame;
    EXPECT_LE(cv::norm(image, draw_frame(frame), cv::NORM_INF), 1) << frame;
  }
}

// OpenCV and FFmpeg find no frame in it. Its name does not matter, as a GIF's is common.
TEST_F(Folder, AnAnimatedWebpIsRefusedUnderAnyName) {
  for (const char* name : {"clip.webp", "clip.WEBP", "clip.gif", "clip"}) {
    const fs::path path = write(name, animated_webp());
    const std::string reason = reason_of([&] {
      cv::Mat image;
      ImageSource::open(path.string()).next(image);
    });
    EXPECT_EQ(reason, "cannot decode frame 1, " + path.string() +
                          ": an animated WebP is not an image: make a video of it");
  }
}

// ---- Folders ----

struct Content {
  std::string name;
  std::vector<std::string> files;
  std::vector<std::string> frames;  // in order, or ..
  std::vector<std::string> reason;  // .. parts of the error message
  std::string pattern = {};
  std::string note = {};
};

void PrintTo(const Content& content, std::ostream* out) { *out << content.name; }

class Folders : public Folder, public testing::WithParamInterface<Content> {};

TEST_P(Folders, AreReadInOrderOrRefused) {
  for (const std::string& file : GetParam().files) write("in/" + file, "");
  fs::create_directory(folder_ / "in/7.png");  // a folder, not a frame
  std::vector<std::string> frames;
  const std::string reason = reason_of([&] {
    ImageSource source = ImageSource::open((folder_ / "in" / GetParam().pattern).string());
    for (const fs::path& image : source.images()) frames.push_back(image.filename().string());
    const std::vector<std::string> notes = source.take_notes();
    EXPECT_EQ(notes.size(), GetParam().note.empty() ? 0u : 1u);
    if (!notes.empty()) {
      EXPECT_NE(notes[0].find(GetParam().note), std::string::npos) << notes[0];
    }
  });
  EXPECT_EQ(frames, GetParam().frames) << reason;
  EXPECT_EQ(reason.empty(), GetParam().reason.empty()) << reason;
  for (const std::string& part : GetParam().reason) EXPECT_NE(reason.find(part), std::string::npos) << reason;
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, Folders,
    testing::Values(
        Content{"MixedEndings",
                {"3.bmp", "1.PNG", "4.Tiff", "2.JPEG"},
                {"1.PNG", "2.JPEG", "3.bmp", "4.Tiff"},
                {}},
        Content{"AMissingNumber",
                {"0001.jpg", "0002.jpg", "0004.jpg", "0005.jpg"},
                {"0001.jpg", "0002.jpg", "0004.jpg", "0005.jpg"},
                {},
                {},
                "0004.jpg is frame 3"},
        Content{"SeveralMissingNumbers",
                {"f7.png", "f8.png", "f9.png", "f15.png", "f16.png", "f18.png"},
                {"f7.png", "f8.png", "f9.png", "f15.png", "f16.png", "f18.png"},
                {},
                {},
                "images are missing: 6 by their numbers"},
        Content{"AMissingNumberByAPattern",
                {"0001.jpg", "0002.jpg", "0004.jpg", "0004_mask.jpg"},
                {"0001.jpg", "0002.jpg", "0004.jpg"},
                {},
                "%04d.jpg",
                "images are missing: 1 by"},
        Content{"EveryFifthNumber",
                {"0.png", "5.png", "10.png", "15.png"},
                {"0.png", "5.png", "10.png", "15.png"},
                {}},
        Content{"Masks",
                {"00000001.png", "00000001_mask.png", "00000002.png", "00000002_mask.png"},
                {},
                {"two images for one frame", "00000001.png", "00000001_mask.png", "'%08d.png'"}},
        Content{"OneMask", {"1.jpg", "2.jpg", "2_mask.png"}, {}, {"2.jpg", "2_mask.png", "'%d.jpg'"}},
        Content{"MasksInFront",
                {"img_01.png", "mask_img_01.png", "img_02.png"},
                {},
                {"img_01.png", "mask_img_01.png", "'img_%02d.png'"}},
        Content{"MasksByAPattern", {"01.png", "01_mask.png", "02.png"}, {"01.png", "02.png"}, {}, "%02d.png"},
        Content{"Letters", {"8_a.png", "8_b.png", "8_c.png"}, {"8_a.png", "8_b.png", "8_c.png"}, {}},
        Content{
            "OtherFiles",
            {"1.png", "Thumbs.db", "desktop.ini", ".DS_Store", ".2.png", "._1.png", "boxes.txt", "3.png~"},
            {"1.png"},
            {}},
        Content{"TwoFormats",
                {"0001.jpg", "0001.png", "0002.jpg"},
                {},
                {"two images for one frame", "0001.jpg", "0001.png", "'*.png'"}},
        Content{"TwoFormatsByAPattern",
                {"0001.jpg", "0001.png", "0002.jpg"},
                {"0001.jpg", "0002.jpg"},
                {},
                "*.jpg"},
        Content{"TwoFormatsByAWidePattern", {"0001.jpg", "0001.png"}, {}, {"two images for one frame"}, "0*"},
        Content{"TwoCases", {"1.png", "1.PNG"}, {}, {"two images for one frame"}},
        Content{"TwoWidths", {"img_01.png", "img_1.png"}, {}, {"two images for one frame"}},
        Content{"Zeros",
                {"0.png", "00010.png", "100.png", "a0b.png", "a0b0.png"},
                {"0.png", "00010.png", "100.png", "a0b.png", "a0b0.png"},
                {},
                {},
                "images are missing: 8"},
        Content{"None", {"boxes.txt", ".1.png"}, {}, {"no images in"}}),
    [](const auto& instance) { return instance.param.name; });

// The same scene at another resolution is scaled, a frame of another shape is not.
TEST_F(Folder, FramesOfAnotherSizeAreScaledToTheFirst) {
  fs::create_directories(folder_ / "in");
  cv::RNG random(3);
  cv::Mat rough(30, 40, CV_8UC3), scene;
  random.fill(rough, cv::RNG::UNIFORM, 0, 255);
  cv::resize(rough, scene, {320, 240}, 0, 0, cv::INTER_CUBIC);
  const std::vector<cv::Size> sizes = {{320, 240}, {160, 120}, {213, 160},
                                       {640, 480}, {320, 240}, {240, 240}};
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    cv::Mat image;
    cv::resize(scene, image, sizes[i], 0, 0, cv::INTER_AREA);
    cv::imwrite((folder_ / "in" / (std::to_string(i) + ".png")).string(), image);
  }
  ImageSource source = ImageSource::open((folder_ / "in").string());
  cv::Mat image;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    ASSERT_TRUE(source.next(image));
    ASSERT_EQ(image.size(), i == 5 ? sizes[i] : sizes[0]) << i;
    if (i < 5) {
      EXPECT_LE(cv::norm(image, scene, cv::NORM_L1) / static_cast<double>(3 * scene.total()), 6) << i;
    }
  }
  const std::vector<std::string> notes = source.take_notes();
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("frame 2 has 160 x 120 pixels"), std::string::npos) << notes[0];
}

// ---- Deep images ----

TEST_F(Folder, DeepImagesTakeARange) {
  const auto source = [&](int depth, double scale, const FrameOptions& options = {}) {
    cv::Mat image;
    draw_frame(0).convertTo(image, depth, scale);
    fs::create_directories(folder_ / "deep");
    for (const int t : {1, 2}) cv::imwrite((folder_ / "deep" / (std::to_string(t) + ".tif")).string(), image);
    return ImageSource::open((folder_ / "deep").string(), options);
  };
  cv::Mat image;
  const auto read = [&](ImageSource from) {
    EXPECT_TRUE(from.next(image) && from.next(image));
    EXPECT_EQ(image.type(), CV_8UC3);
    return from.take_notes();
  };
  EXPECT_TRUE(read(source(CV_16U, 257)).empty());
  EXPECT_LE(cv::norm(image, draw_frame(0), cv::NORM_INF), 0);
  const auto notes = read(source(CV_16U, 4095.0 / 255));
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("uses 12 of 16 bits: --bits 12"), std::string::npos) << notes[0];
  EXPECT_TRUE(read(source(CV_16U, 4095.0 / 255, {.range = PixelRange::of_bits(12)})).empty());
  EXPECT_LE(cv::norm(image, draw_frame(0), cv::NORM_INF), 1);
  EXPECT_NE(reason_of([&] { read(source(CV_16U, 1)); }).find("give --bits 8"), std::string::npos);
  EXPECT_TRUE(read(source(CV_16U, 1, {.range = PixelRange::of_bits(8)})).empty());
  EXPECT_LE(cv::norm(image, draw_frame(0), cv::NORM_INF), 0);
  EXPECT_TRUE(read(source(CV_32F, 1.0 / 255)).empty());
  EXPECT_LE(cv::norm(image, draw_frame(0), cv::NORM_INF), 5) << "OpenCV writes them with a loss";
  EXPECT_NE(reason_of([&] { read(source(CV_32F, 1)); }).find("by --range LOW,HIGH"), std::string::npos);
  EXPECT_TRUE(read(source(CV_32F, 1, {.range = PixelRange{0, 255}})).empty());
}

// ---- Videos ----

const cv::Size kVideo(64, 48);

// White at the top left, red at the top right, black below.
cv::Mat quarters() {
  cv::Mat image(kVideo, CV_8UC3, cv::Scalar::all(0));
  image(cv::Rect(0, 0, 32, 24)) = cv::Scalar::all(255);
  image(cv::Rect(32, 0, 32, 24)) = cv::Scalar(0, 0, 255);
  return image;
}

class Videos : public Folder {
 protected:
  // A video with the header matrix of a rotated phone: frames must be rotated by `turned` degrees.
  fs::path mp4(int turned) {
    const fs::path path = folder_ / "video.mp4";
    cv::VideoWriter writer(path.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('m', 'p', '4', 'v'), 20,
                           kVideo);
    if (!writer.isOpened()) return {};
    for (int i = 0; i < 5; ++i) writer.write(quarters());
    writer.release();
    const int cosine = turned % 180 == 0 ? 1 - turned / 90 : 0,
              sine = turned % 180 == 90 ? 2 - turned / 90 : 0;
    Bytes matrix;
    for (const int value : {cosine, sine, 0, -sine, cosine, 0,
                            turned == 90    ? kVideo.height
                            : turned == 180 ? kVideo.width
                                            : 0,
                            turned == 180   ? kVideo.height
                            : turned == 270 ? kVideo.width
                                            : 0})
      matrix += number(static_cast<std::uint64_t>(value * 65536), 4);
    const Bytes file = read(path);
    return write("video.mp4", patched(file, file.find("tkhd") + 44, matrix));
  }
};

std::string corners(const cv::Mat& image) {
  std::string text;
  for (const auto& [y, x] :
       {std::pair(5, 5), {5, image.cols - 6}, {image.rows - 6, 5}, {image.rows - 6, image.cols - 6}}) {
    const auto pixel = image.at<cv::Vec3b>(y, x);
    text += pixel[0] > 128 ? 'W' : pixel[2] > 128 ? 'R' : '.';
  }
  return text;
}

TEST_F(Videos, OfPhonesStandUpright) {
  if (mp4(0).empty()) GTEST_SKIP() << "OpenCV writes no mp4 here";
  const std::vector<std::pair<int, std::string>> turned = {
      {0, "WR.."}, {90, ".W.R"}, {180, "..RW"}, {270, "R.W."}};
  for (const auto& [degrees, expected] : turned) {
    SCOPED_TRACE(degrees);
    const std::string video = mp4(degrees).string();
    cv::Mat image;
    ImageSource source = ImageSource::open(video);
    ASSERT_TRUE(source.skip(1) && source.next(image));
    EXPECT_EQ(image.size(), degrees % 180 == 0 ? kVideo : cv::Size(kVideo.height, kVideo.width));
    EXPECT_EQ(corners(image), expected);
    // The user's option takes precedence, for images too.
    for (const auto& [asked, answer] : turned) {
      ASSERT_TRUE(ImageSource::open(video, {.rotate = asked}).next(image));
      EXPECT_EQ(corners(image), answer) << asked;
      cv::imwrite((folder_ / "image.png").string(), quarters());
      ASSERT_TRUE(ImageSource::open((folder_ / "image.png").string(), {.rotate = asked}).next(image));
      EXPECT_EQ(corners(image), answer) << asked;
    }
  }
}

Bytes jpeg_frame() {
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", quarters(), bytes);
  return {bytes.begin(), bytes.end()};
}

Bytes element(std::uint32_t id, const Bytes& body) {
  int length = 1;
  while (length < 4 && id >> 8 * length != 0) ++length;
  return number(id, length) + '\x01' + number(body.size(), 7) + body;
}

// Frames at individual times [ms]; the header announces 1000 per second.
Bytes matroska(const std::vector<int>& times, int end) {
  double duration = end;
  std::uint64_t bits = 0;
  std::memcpy(&bits, &duration, sizeof bits);
  Bytes clusters;
  for (const int time : times)
    clusters += element(0x1f43b675, element(0xe7, number(static_cast<std::uint64_t>(time), 4)) +
                                        element(0xa3, "\x81"s + number(0, 2) + "\x80"s + jpeg_frame()));
  const Bytes size = element(0xb0, number(64, 2)) + element(0xba, number(48, 2));
  const Bytes track = element(0xd7, number(1, 1)) + element(0x73c5, number(1, 1)) +
                      element(0x83, number(1, 1)) + element(0x86, "V_MJPEG") +
                      element(0x23e383, number(1000000, 4)) + element(0xe0, size);
  return element(0x1a45dfa3, element(0x4282, "matroska") + element(0x4287, number(2, 1)) +
                                 element(0x4285, number(2, 1))) +
         element(0x18538067, element(0x1549a966, element(0x2ad7b1, number(1000000, 4)) +
                                                     element(0x4489, number(bits, 8))) +
                                 element(0x1654ae6b, element(0xae, track)) + clusters);
}

// The same in a container without timestamps: one slot per millisecond, most of them empty.
Bytes avi(const std::vector<int>& times, int end, int rate) {
  const auto chunk = [](const Bytes& name, const Bytes& body) {
    return name + little(body.size(), 4) + body + Bytes(body.size() % 2, '\0');
  };
  Bytes frames, index;
  const auto count = static_cast<std::uint64_t>(end);
  for (int t = 0; t < end; ++t) {
    const bool there = std::find(times.begin(), times.end(), t) != times.end();
    const Bytes body = there ? jpeg_frame() : "";
    index += "00dc" + little(0x10, 4) + little(frames.size() + 4, 4) + little(body.size(), 4);
    frames += chunk("00dc", body);
  }
  const Bytes main = little(1000, 4) + little(0, 8) + little(0x10, 4) + little(count, 4) + little(0, 4) +
                     little(1, 4) + little(0, 4) + little(64, 4) + little(48, 4) + little(0, 16);
  const Bytes stream = "vidsMJPG" + little(0, 12) + little(1, 4) +
                       little(static_cast<std::uint64_t>(rate), 4) + little(0, 4) + little(count, 4) +
                       little(0, 4) + little(~0u, 4) + little(0, 12);
  const Bytes format = little(40, 4) + little(64, 4) + little(48, 4) + little(1, 2) + little(24, 2) + "MJPG" +
                       little(64 * 48 * 3, 4) + little(0, 16);
  const Bytes header =
      "hdrl" + chunk("avih", main) + chunk("LIST", "strl" + chunk("strh", stream) + chunk("strf", format));
  return chunk("RIFF",
               "AVI " + chunk("LIST", header) + chunk("LIST", "movi" + frames) + chunk("idx1", index));
}

// A video written by OpenCV; empty if it cannot. Its H.264 has B-frames, so that the last frames have no
// times.
Bytes written(const std::string& ending, const std::string& codec, int frames) {
  const fs::path path =
      fs::path(testing::TempDir()) / ("asterism_video_" + std::to_string(getpid()) + "." + ending);
  cv::VideoWriter writer(path.string(), cv::CAP_FFMPEG,
                         cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]), 25, {320, 240});
  if (!writer.isOpened()) return {};
  for (int i = 0; i < frames; ++i) writer.write(draw_frame(i % 70));  // then the square leaves the image
  writer.release();
  const Bytes bytes = read(path);
  fs::remove(path);
  return bytes;
}

// A Matroska file of frames 40 ms apart whose frame i is at 60 i ms, 30 ms later if i is odd.
Bytes with_uneven_times(Bytes file) {
  const auto value = [&](std::size_t at, std::size_t length) {
    std::uint64_t number = 0;
    for (std::size_t i = 0; i < length; ++i) number = number << 8 | static_cast<unsigned char>(file[at + i]);
    return number;
  };
  std::uint64_t cluster = 0;
  for (std::size_t at = 0; at < file.size();) {
    std::size_t id_length = 1, size_length = 1;
    while ((value(at, 1) & (0x100U >> id_length)) == 0) ++id_length;
    const std::uint64_t id = value(at, id_length);
    at += id_length;
    while ((value(at, 1) & (0x100U >> size_length)) == 0) ++size_length;
    const std::uint64_t size = value(at, size_length) & ((std::uint64_t{1} << 7 * size_length) - 1);
    at += size_length;
    if (id == 0x18538067 || id == 0x1f43b675 || id == 0x1549a966 || id == 0xa0) continue;  // look into these
    if (id == 0xe7) cluster = value(at, size);
    if (id == 0xa3 || id == 0xa1) {
      const std::uint64_t frame = (cluster + value(at + 1, 2)) / 40;
      file = patched(file, at + 1, number(60 * frame + (frame % 2) * 30 - cluster, 2));
    }
    if (id == 0x4489) {
      double duration = 60 * 60;
      std::uint64_t bits = 0;
      std::memcpy(&bits, &duration, sizeof bits);
      file = patched(file, at, number(bits, 8));
    }
    at += size;
  }
  return file;
}

struct Rate {
  std::string name;
  std::string file;
  Bytes bytes;
  int frames;
  double fps;
};

void PrintTo(const Rate& rate, std::ostream* out) { *out << rate.name; }

std::vector<Rate> rates() {
  std::vector<int> few, many, even, late;
  for (int i = 0, t = 0; i < 60; ++i, t += i % 2 == 0 ? 60 : 20) few.push_back(t);  // 2400 ms
  for (int i = 0, t = 0; i < 150; ++i, t += i <= 100 ? 20 : 80) many.push_back(t);  // 6000 ms
  for (int i = 0; i < 30; ++i) even.push_back(40 * i);
  for (int i = 0; i < 30; ++i) late.push_back(100000 + 40 * i);
  return {
      {"MatroskaThatVaries", "v.mkv", matroska(few, 2400), 60, 25},
      {"LongMatroskaThatVaries", "v.mkv", matroska(many, 6000), 150, 25},
      {"MatroskaOfOneRate", "v.mkv", matroska(even, 1200), 30, 25},
      {"AviThatVaries", "v.avi", avi(few, 2400, 1000), 60, 25},
      {"LongAviThatVaries", "v.avi", avi(many, 6000, 1000), 150, 25},
      {"AviOfOneRate", "v.avi", avi({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}, 12, 12), 12, 12},
      {"MatroskaWithAnOffset", "v.mkv", matroska(late, 101200), 30, 25},
      {"H264InMatroskaThatVaries", "v.mkv", with_uneven_times(written("mkv", "avc1", 60)), 60, 1000.0 / 60},
      {"H264InMatroska", "v.mkv", written("mkv", "avc1", 60), 60, 25},
      {"H264InFlv", "v.flv", written("flv", "avc1", 75), 75, 25},
      {"H264InMp4", "v.mp4", written("mp4", "avc1", 60), 60, 25},
      {"H264InATransportStream", "v.ts", written("ts", "avc1", 60), 60, 25},
      {"Flv", "v.flv", written("flv", "FLV1", 60), 60, 25},
      {"TransportStream", "v.ts", written("ts", "mpg2", 60), 60, 25}};
}

class Rates : public Folder, public testing::WithParamInterface<Rate> {};

TEST_P(Rates, AreTheMeanOfTheTimestamps) {
  if (GetParam().bytes.empty()) GTEST_SKIP() << "OpenCV cannot write such a video here";
  const std::string path = write(GetParam().file, GetParam().bytes).string();
  ImageSource source = ImageSource::open(path);
  cv::Mat image;
  int frames = 0;
  while (source.next(image)) ++frames;
  EXPECT_EQ(frames, GetParam().frames);
  EXPECT_NEAR(source.fps(), GetParam().fps, 0.02 * GetParam().fps);
  EXPECT_FALSE(source.ended_early());
  EXPECT_FALSE(source.missing());
  EXPECT_TRUE(source.take_notes().empty());
  EXPECT_EQ(ImageSource::open(path, {.fps = 7}).fps(), 7);
}

INSTANTIATE_TEST_SUITE_P(Kinds, Rates, testing::ValuesIn(rates()),
                         [](const auto& instance) { return instance.param.name; });

TEST_F(Videos, ThatAreCutHaveEndedEarly) {
  const Bytes whole = avi({0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}, 12, 12);
  ImageSource source = ImageSource::open(write("v.avi", cut(whole, 0.6)).string());
  cv::Mat image;
  while (source.next(image)) {
  }
  EXPECT_LT(source.position(), 12);
  EXPECT_TRUE(source.ended_early());
  EXPECT_EQ(source.fps(), 12);
}

// The middle fifth of a video is lost: it plays on behind it.
struct Loss {
  std::string name, ending, codec;
};

void PrintTo(const Loss& loss, std::ostream* out) { *out << loss.name; }

class Losses : public Folder, public testing::WithParamInterface<Loss> {};

TEST_P(Losses, OfFramesInTheMiddleAreCounted) {
  const auto& [name, ending, codec] = GetParam();
  Bytes bytes = written(ending, codec, 75);
  if (bytes.empty()) GTEST_SKIP() << "OpenCV cannot write such a video here";
  cv::RNG random(1);
  for (std::size_t i = bytes.size() * 2 / 5; i < bytes.size() * 3 / 5; ++i)
    bytes[i] = static_cast<char>(random.uniform(0, 256));
  for (const bool measured : {false, true}) {
    ImageSource source = ImageSource::open(write("v." + ending, bytes).string());
    if (measured) {
      EXPECT_NEAR(source.fps(), 25, 0.1);
    }
    cv::Mat image;
    while (source.next(image)) {
    }
    const int lost = 75 - source.position();
    ASSERT_GT(lost, 5);
    ASSERT_LT(lost, 60);
    if (const auto missing = source.missing()) {
      EXPECT_LE(missing->count, lost + 2);
      EXPECT_GE(missing->count, 5);
      EXPECT_GT(missing->after, 3);
      EXPECT_LT(missing->after, source.position());
    } else {
      EXPECT_TRUE(source.ended_early());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, Losses,
                         testing::Values(Loss{"TransportStream", "ts", "mpg2"},
                                         Loss{"H264InATransportStream", "ts", "avc1"},
                                         Loss{"Matroska", "mkv", "mpg2"}, Loss{"Flv", "flv", "FLV1"}),
                         [](const auto& instance) { return instance.param.name; });

TEST_F(Videos, OfEveryContainerThatAreCutHaveEndedEarly) {
  for (const auto& [ending, codec] :
       {std::pair("avi", "MJPG"), {"mkv", "avc1"}, {"mkv", "mpg2"}, {"flv", "FLV1"}}) {
    SCOPED_TRACE(ending);
    const Bytes whole = written(ending, codec, 50);
    if (whole.empty()) continue;
    ImageSource source = ImageSource::open(write("v."s + ending, cut(whole, 0.6)).string());
    cv::Mat image;
    while (source.next(image)) {
    }
    EXPECT_LT(source.position(), 45);
    EXPECT_TRUE(source.ended_early());
  }
}

TEST(SteadyInterval, IsThatOfMostFrames) {
  const auto times = [](std::vector<double> steps) {
    std::vector<double> all = {3};
    for (const double step : steps) all.push_back(all.back() + step);
    return all;
  };
  std::vector<double> steps(40, 0.04);
  EXPECT_NEAR(steady_interval(times(steps)).value(), 0.04, 1e-9);
  EXPECT_FALSE(missing_frames(times(steps)));
  steps[9] = 0.4;  // nine of them are missing after the tenth frame, then three
  steps[20] = 0.16;
  const auto missing = missing_frames(times(steps));
  ASSERT_TRUE(missing);
  EXPECT_EQ(missing->count, 12);
  EXPECT_EQ(missing->after, 10);
  for (std::size_t i = 0; i < steps.size(); i += 2) steps[i] = 0.1;
  EXPECT_FALSE(steady_interval(times(steps)));
  EXPECT_FALSE(missing_frames(times(steps)));
  EXPECT_FALSE(steady_interval(std::vector<double>{1, 2}));
}

// ---- Outputs ----

// One line per way to name a file of the input.
TEST_F(Folder, FilesOfTheInputAreSeenThroughLinks) {
  for (const int t : {1, 2, 3}) write("in/" + std::to_string(t) + ".png", encoded(".png"));
  write("elsewhere/4.png", "");
  fs::create_symlink("in/2.png", folder_ / "link");
  fs::create_symlink("link", folder_ / "link-to-link");
  fs::create_symlink("in/9.png", folder_ / "dangling");
  fs::create_symlink(fs::absolute(folder_ / "in/9.png"), folder_ / "dangling-absolute");
  fs::create_symlink("dangling", folder_ / "dangling-link-to-link");
  fs::create_directory_symlink("in", folder_ / "folder-link");
  fs::create_hard_link(folder_ / "in/3.png", folder_ / "hard");
  fs::create_symlink("ring", folder_ / "ring");
  fs::create_symlink("elsewhere/4.png", folder_ / "other");
  fs::create_symlink("elsewhere/5.png", folder_ / "other-dangling");
  fs::create_symlink("in/boxes.csv", folder_ / "no-frame");
  const ImageSource source = ImageSource::open((folder_ / "in").string());
  for (const auto& [name, reads] : {std::pair("in/1.png", true),
                                    {"in/new.png", true},
                                    {"link", true},
                                    {"link-to-link", true},
                                    {"dangling", true},
                                    {"dangling-absolute", true},
                                    {"dangling-link-to-link", true},
                                    {"folder-link/2.png", true},
                                    {"folder-link/new.png", true},
                                    {"hard", true},
                                    {"in/../in/1.png", true},
                                    {"ring", false},
                                    {"other", false},
                                    {"other-dangling", false},
                                    {"no-frame", false},
                                    {"boxes.csv", false},
                                    {"elsewhere/4.png", false}})
    EXPECT_EQ(source.reads(folder_ / name), reads) << name;
  EXPECT_TRUE(same_file(folder_ / "dangling", folder_ / "in/9.png"));
  EXPECT_TRUE(same_file(folder_ / "dangling", folder_ / "dangling-link-to-link"));
  EXPECT_TRUE(same_file(folder_ / "hard", folder_ / "in/3.png"));
  EXPECT_FALSE(same_file(folder_ / "dangling", folder_ / "in/8.png"));
  EXPECT_FALSE(same_file("", folder_ / "in/8.png"));
  EXPECT_FALSE(same_file("/dev/null", "/dev/null"));
}

}  // namespace
}  // namespace asterism::tools
