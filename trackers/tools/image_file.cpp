#include "image_file.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <stdexcept>

#include "region.hpp"

namespace asterism::tools {
namespace {

namespace fs = std::filesystem;

// Reads numbers from a file; beyond its end they are 0, and `ended` is set.
class Bytes {
 public:
  explicit Bytes(std::span<const unsigned char> bytes, bool big_endian = true)
      : bytes_(bytes), big_endian_(big_endian) {}

  std::size_t size() const { return bytes_.size(); }
  bool ended() const { return ended_; }
  bool has(std::size_t at, std::string_view text) const {
    return at <= size() && text.size() <= size() - at &&
           std::memcmp(bytes_.data() + at, text.data(), text.size()) == 0;
  }
  std::uint64_t number(std::uint64_t at, unsigned count) {
    if (at > size() || count > size() - at) {
      ended_ = true;
      return 0;
    }
    std::uint64_t value = 0;
    for (unsigned i = 0; i < count; ++i)
      value = value << 8 | bytes_[static_cast<std::size_t>(at) + (big_endian_ ? i : count - 1 - i)];
    return value;
  }
  // Position of the first 0xff from `at` on; the size if there is none.
  std::size_t find_ff(std::size_t at) const {
    const void* found = at < size() ? std::memchr(bytes_.data() + at, 0xff, size() - at) : nullptr;
    return found == nullptr
               ? size()
               : static_cast<std::size_t>(static_cast<const unsigned char*>(found) - bytes_.data());
  }

 private:
  std::span<const unsigned char> bytes_;
  bool big_endian_, ended_ = false;
};

cv::Size size_of(std::uint64_t width, std::uint64_t height) {
  constexpr std::uint64_t kMost = std::numeric_limits<int>::max();
  return {static_cast<int>(std::min(width, kMost)), static_cast<int>(std::min(height, kMost))};
}

// Reads marker by marker to the end of the image; anything after it (padding, a preview, a clip) is ignored.
ImageHeader read_jpeg(std::span<const unsigned char> file) {
  Bytes bytes(file);
  ImageHeader header{.size = {}, .whole = false};
  for (std::size_t at = 2; (at = bytes.find_ff(at)) + 1 < bytes.size();) {
    const auto marker = static_cast<unsigned>(bytes.number(at + 1, 1));
    if (marker == 0xff) {  // padding
      ++at;
      continue;
    }
    at += 2;
    if (marker == 0xd9) {
      header.whole = !header.size.empty();
      break;
    }
    if (marker == 0 || marker == 1 || (marker >= 0xd0 && marker <= 0xd8)) continue;  // within coded data
    if (marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc) {
      header.size = size_of(bytes.number(at + 5, 2), bytes.number(at + 3, 2));
      const std::uint64_t bits = bytes.number(at + 2, 1);
      if (bits != 8) header.unusual = "a JPEG of " + std::to_string(bits) + " bits a sample";
      if (marker > 0xc2) header.unusual = "a JPEG that is lossless, arithmetically coded or hierarchical";
    }
    at += std::max<std::size_t>(static_cast<std::size_t>(bytes.number(at, 2)), 2);
  }
  return header;
}

std::uint32_t crc32(std::span<const unsigned char> bytes) {
  static const auto table = [] {
    std::array<std::uint32_t, 256> made{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      made[i] = i;
      for (int bit = 0; bit < 8; ++bit) made[i] = made[i] >> 1 ^ (made[i] & 1 ? 0xedb88320u : 0);
    }
    return made;
  }();
  std::uint32_t crc = ~0u;
  for (const unsigned char byte : bytes) crc = crc >> 8 ^ table[(crc ^ byte) & 0xff];
  return ~crc;
}

// Reads chunk by chunk. Ancillary chunks (their names begin with a small letter) may be damaged.
ImageHeader read_png(std::span<const unsigned char> file) {
  Bytes bytes(file);
  ImageHeader header{.size = size_of(bytes.number(16, 4), bytes.number(20, 4)), .whole = false};
  for (std::size_t at = 8; !header.whole;) {
    const auto length = static_cast<std::size_t>(bytes.number(at, 4)), body = at + 8;
    const auto crc = bytes.number(body + length, 4);
    if (bytes.ended()) break;
    const bool needed = (file[at + 4] & 0x20) == 0;
    if (needed && crc32(file.subspan(at + 4, length + 4)) != crc) break;
    header.whole = bytes.has(at + 4, "IEND");
    header.animated |= bytes.has(at + 4, "acTL") && bytes.number(body, 4) > 1;
    at = body + length + 4;
  }
  return header;
}

ImageHeader read_bmp(std::span<const unsigned char> file) {
  Bytes bytes(file, false);
  if (bytes.number(14, 4) == 12) return {.size = size_of(bytes.number(18, 2), bytes.number(20, 2))};
  const auto height = static_cast<std::int32_t>(bytes.number(22, 4));  // negative: rows from top to bottom
  return {.size = size_of(bytes.number(18, 4), static_cast<std::uint64_t>(std::abs(std::int64_t{height})))};
}

// The properties of a TIFF's page that decide whether OpenCV reads it.
struct TiffKind {
  std::uint64_t samples = 1, bits = 1, format = 1, compression = 1;  // the standard's defaults

  bool is_deep_gray() const { return samples == 1 && (bits == 32 || bits == 64); }

  // For ImageHeader::unusual.
  std::string unusual() const {
    constexpr std::array<std::uint64_t, 9> kCompressions = {1, 2, 3, 4, 5, 7, 8, 32773, 32946};
    if (std::find(kCompressions.begin(), kCompressions.end(), compression) == kCompressions.end())
      return "a TIFF of compression scheme " + std::to_string(compression);
    const bool floating = format == 3, is_signed = format == 2;
    const bool usual = floating
                           ? (bits == 32 && (samples == 1 || samples == 3)) || (bits == 64 && samples == 1)
                           : bits == 8 || bits == 16 || (bits == 1 && samples == 1) ||
                                 (bits == 32 && samples == 1 && is_signed);
    if (usual) return {};
    return "a TIFF of " + std::to_string(samples) + (samples == 1 ? " sample" : " samples") + " a pixel, " +
           (floating    ? "floating-point numbers"
            : is_signed ? "signed integers"
                        : "unsigned integers") +
           " of " + std::to_string(bits) + (bits == 1 ? " bit" : " bits");
  }
};

ImageHeader read_tiff(std::span<const unsigned char> file) {
  Bytes bytes(file, file[0] == 'M');
  const bool big = bytes.number(2, 2) == 43;
  const unsigned word = big ? 8 : 4, counts = big ? 8 : 2, entry = big ? 20 : 12;
  ImageHeader header;
  std::set<std::uint64_t> seen;  // a damaged chain of pages may be cyclic
  for (std::uint64_t page = bytes.number(big ? 8 : 4, word); page != 0 && seen.insert(page).second;) {
    std::uint64_t width = 0, height = 0, role = 0;
    TiffKind kind;
    const std::uint64_t count = bytes.number(page, counts);
    for (std::uint64_t i = 0; i < std::min<std::uint64_t>(count, 65536) && !bytes.ended(); ++i) {
      const std::uint64_t at = page + counts + i * entry, tag = bytes.number(at, 2);
      const std::uint64_t type = bytes.number(at + 2, 2), values = bytes.number(at + 4, word);
      const unsigned size = type == 1 ? 1 : type == 3 ? 2 : type == 16 ? 8 : 4;
      // The first value: here, or if the values take more than a word, where the word says.
      const auto value = [&] {
        const std::uint64_t here = at + (big ? 12 : 8);
        return bytes.number(values > word / size ? bytes.number(here, word) : here, size);
      };
      if (tag == 254) role = value();
      if (tag == 256) width = value();
      if (tag == 257) height = value();
      if (tag == 258) kind.bits = value();
      if (tag == 259) kind.compression = value();
      if (tag == 277) kind.samples = value();
      if (tag == 339) kind.format = value();
    }
    if (bytes.ended()) break;
    if (seen.size() == 1) {
      header.deep_gray = kind.is_deep_gray();
      header.unusual = kind.unusual();
    }
    // Neither a reduced version of another page nor a mask.
    if ((role & 5) == 0) header.pages.push_back(page);
    const cv::Size size = size_of(width, height);
    if (std::int64_t{size.width} * size.height >= std::int64_t{header.size.width} * header.size.height)
      header.size = size;
    page = bytes.number(page + counts + count * entry, word);
  }
  header.images = std::max(1, static_cast<int>(header.pages.size()));
  return header;
}

ImageHeader read_webp(std::span<const unsigned char> file) {
  Bytes bytes(file, false);
  if (bytes.has(12, "VP8X")) {
    const bool animated = (bytes.number(20, 1) & 2) != 0;
    const std::uint64_t width = bytes.number(24, 3) + 1, height = bytes.number(27, 3) + 1;
    return {.size = bytes.ended() ? cv::Size() : size_of(width, height), .animated = animated};
  }
  if (bytes.has(12, "VP8L")) {
    const std::uint64_t sides = bytes.number(21, 4);
    return {.size = bytes.ended() ? cv::Size() : size_of((sides & 0x3fff) + 1, (sides >> 14 & 0x3fff) + 1)};
  }
  return {.size = size_of(bytes.number(26, 2) & 0x3fff, bytes.number(28, 2) & 0x3fff)};
}

ImageHeader read_jpeg2000(std::span<const unsigned char> file) {
  Bytes bytes(file);
  std::uint64_t at = 0;
  if (!bytes.has(0, "\xff\x4f")) {  // a file of boxes; "jp2c" holds the codestream
    while (!bytes.ended() && !bytes.has(at + 4, "jp2c")) {
      const std::uint64_t length = bytes.number(at, 4);
      if (length == 0) return {};
      const std::uint64_t step = length == 1 ? bytes.number(at + 8, 8) : length;
      if (step < 8 || step > bytes.size()) return {};
      at += step;
    }
    at += bytes.number(at, 4) == 1 ? 16 : 8;
  }
  const auto side = [&](std::uint64_t where) {
    const std::uint64_t end = bytes.number(at + where, 4), begin = bytes.number(at + where + 8, 4);
    return end > begin ? end - begin : 0;
  };
  return {.size = size_of(side(8), side(12))};
}

// "P6 640 480 255", possibly over several lines with comments, or a list of keywords (PAM).
ImageHeader read_anymap(std::span<const unsigned char> file) {
  const std::string text(file.begin(), file.begin() + std::min<std::ptrdiff_t>(std::ssize(file), 4096));
  std::size_t at = 2;
  const auto word = [&] {
    while (at < text.size() && (std::isspace(static_cast<unsigned char>(text[at])) != 0 || text[at] == '#'))
      at = text[at] == '#' ? std::min(text.find('\n', at), text.size()) : at + 1;
    const std::size_t begin = at;
    while (at < text.size() && std::isspace(static_cast<unsigned char>(text[at])) == 0) ++at;
    return at < text.size() ? text.substr(begin, at - begin) : std::string();  // the file may end within it
  };
  const auto number = [&] {
    std::uint64_t value = 0;
    const std::string digits = word();
    std::from_chars(digits.data(), digits.data() + digits.size(), value);
    return value;
  };
  std::uint64_t width = 0, height = 0, samples = 0, most = 0;
  if (text[1] == '7') {
    for (std::string key = word(); !key.empty() && key != "ENDHDR"; key = word()) {
      if (key == "WIDTH") width = number();
      if (key == "HEIGHT") height = number();
      if (key == "DEPTH") samples = number();
      if (key == "MAXVAL") most = number();
    }
    return {.size = size_of(width, height),
            .unusual = samples > 3 || most > 255 ? "a PAM of 16 bits a sample or with transparency" : ""};
  }
  width = number(), height = number();
  ImageHeader header{.size = size_of(width, height)};
  if (text[1] < '4' || text[1] > '6') return header;
  // A further image may follow.
  most = text[1] == '4' ? 1 : number();
  const std::uint64_t row =
      text[1] == '4' ? (width + 7) / 8 : width * (text[1] == '6' ? 3 : 1) * (most > 255 ? 2 : 1);
  if (row != 0 && height < file.size() / row + 1) {
    const std::uint64_t end = at + 1 + row * height;
    if (end + 1 < file.size() && file[end] == 'P' && file[end + 1] >= '1' && file[end + 1] <= '7')
      header.images = 2;
  }
  return header;
}

cv::Mat decode(std::span<const unsigned char> bytes, bool deep_gray) try {
  const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<unsigned char*>(bytes.data()));
  return cv::imdecode(buffer, cv::IMREAD_ANYDEPTH | (deep_gray ? cv::IMREAD_GRAYSCALE : cv::IMREAD_COLOR));
} catch (const cv::Exception&) {
  return {};
}

// The same pixels in a depth that Frame takes.
cv::Mat as_frame(const cv::Mat& pixels, const std::optional<PixelRange>& range) {
  const int depth = pixels.depth();
  if (depth == CV_8U || depth == CV_16U || depth == CV_32F) return pixels;
  if (!range && depth != CV_64F && depth != CV_16F)
    throw std::invalid_argument(
        "integers that have a sign or 32 bits have no usual range: give it by --range LOW,HIGH");
  cv::Mat converted;
  pixels.convertTo(converted, CV_32F);
  return converted;
}

}  // namespace

std::optional<ImageHeader> read_image_header(std::span<const unsigned char> file) {
  const Bytes bytes(file);
  using namespace std::string_view_literals;
  if (bytes.has(0, "\xff\xd8\xff")) return read_jpeg(file);
  if (bytes.has(0, "\x89PNG\r\n\x1a\n")) return read_png(file);
  if (bytes.has(0, "BM")) return read_bmp(file);
  if (bytes.has(0, "II*\0"sv) || bytes.has(0, "MM\0*"sv) || bytes.has(0, "II+\0"sv) ||
      bytes.has(0, "MM\0+"sv))
    return read_tiff(file);
  if (bytes.has(0, "RIFF") && bytes.has(8, "WEBP")) return read_webp(file);
  if (bytes.has(0, "\0\0\0\x0cjP  \r\n\x87\n"sv) || bytes.has(0, "\xff\x4f\xff\x51"))
    return read_jpeg2000(file);
  if (file.size() > 2 && file[0] == 'P' && std::strchr("1234567Ff", file[1]) != nullptr && file[1] != 0 &&
      std::isspace(file[2]) != 0)
    return read_anymap(file);
  if (bytes.has(0, "\x59\xa6\x6a\x95")) {
    Bytes raster(file);
    return ImageHeader{.size = size_of(raster.number(4, 4), raster.number(8, 4))};
  }
  return {};
}

FrameImage decode_frame(std::span<const unsigned char> bytes, const std::string& name,
                        const std::optional<PixelRange>& range, cv::Size otherwise, bool first_page) {
  const auto fail = [&](const std::string& reason) { throw std::runtime_error(name + ": " + reason); };
  std::optional<ImageHeader> header = read_image_header(bytes);
  if (!header) {
    if (!bytes.empty()) fail("not an image of a known format");
    header = ImageHeader{.size = {}, .whole = false};
  }
  if (std::int64_t{header->size.width} * header->size.height > kMostPixels)
    fail("an image of " + std::to_string(header->size.width) + " x " + std::to_string(header->size.height) +
         " pixels, and at most " + std::to_string(kMostPixels) + " are read");
  if (header->animated)
    fail(std::string("an animated ") + (bytes[0] == 'R' ? "WebP" : "PNG") +
         " is not an image: make a video of it");
  if (header->images > 1 && !first_page)
    fail("several images in one file: a TIFF can be read where it is the input itself, split others");
  cv::Mat pixels;
  if (header->whole) pixels = decode(bytes, header->deep_gray);
  // OpenCV 4.6 makes a TIFF of an unknown compression black.
  if (!header->unusual.empty() && !pixels.empty() && cv::norm(pixels, cv::NORM_INF) == 0) pixels.release();
  try {
    if (!pixels.empty()) pixels = as_frame(pixels, range);
    if (!pixels.empty()) return {range ? to_bgr8(pixels, range) : pixels, false};
  } catch (const std::invalid_argument& error) {
    fail(error.what());
  }
  if (!header->unusual.empty()) fail(header->unusual + ", which is not read: convert it");
  const cv::Size size = otherwise.empty() ? header->size : otherwise;
  if (size.empty()) fail("a damaged image of unknown size");
  return {cv::Mat(size, CV_8UC3, cv::Scalar::all(128)), true};
}

void make_first_page(std::span<unsigned char> tiff, std::uint64_t page) {
  const bool big_endian = tiff[0] == 'M';
  const std::size_t count = tiff[big_endian ? 3 : 2] == 43 ? 8 : 4;  // size and position of the address
  for (std::size_t i = 0; i < count; ++i)
    tiff[count + (big_endian ? count - 1 - i : i)] = static_cast<unsigned char>(page >> (8 * i));
}

FrameImage read_frame(const fs::path& file, const std::optional<PixelRange>& range, cv::Size otherwise) {
  return decode_frame(read_bytes(file), file.string(), range, otherwise);
}

std::vector<unsigned char> read_bytes(const fs::path& file) {
  const auto fail = [&](const std::string& reason) {
    throw std::runtime_error(file.string() + ": " + reason);
  };
  std::error_code error;
  if (fs::exists(file, error) && !fs::is_regular_file(file, error)) fail("not a file");
  errno = 0;
  std::ifstream stream(file, std::ios::binary | std::ios::ate);
  if (!stream)
    fail(std::string("cannot be read") + (errno == 0 ? "" : std::string(": ") + std::strerror(errno)));
  const auto size = static_cast<std::int64_t>(stream.tellg());
  if (size > std::numeric_limits<int>::max()) fail("an image file of more than 2 GiB");
  std::vector<unsigned char> bytes(static_cast<std::size_t>(std::max<std::int64_t>(size, 0)));
  stream.seekg(0);
  stream.read(reinterpret_cast<char*>(bytes.data()), size);
  if (!stream) fail("cannot be read");
  return bytes;
}

cv::Mat to_bgr8(const cv::Mat& image, const std::optional<PixelRange>& range) {
  if (image.type() == CV_8UC3 && !range) return image;
  const Frame frame(image, range);
  if (!frame.bgr().empty()) return frame.bgr();
  cv::Mat bgr;
  cv::cvtColor(frame.gray(), bgr, cv::COLOR_GRAY2BGR);
  return bgr;
}

PixelRange parse_range(std::string_view text) {
  const std::vector<double> values = parse_numbers(text);
  if (values.size() != 2 || !(values[0] < values[1]))
    throw std::invalid_argument("\"" + std::string(text) +
                                "\" is not LOW,HIGH: the values that are black and white, LOW below HIGH");
  return {values[0], values[1]};
}

}  // namespace asterism::tools
