#include "trax_image.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <span>

#include "trax_message.hpp"

namespace asterism::tools {
namespace {

constexpr std::string_view kFile = "file:", kMemory = "image:", kData = "data:";

struct PixelFormat {
  std::string_view name;
  int type;
};
// Colors are transmitted as RGB.
constexpr std::array kPixelFormats = {PixelFormat{"rgb", CV_8UC3}, PixelFormat{"gray8", CV_8UC1},
                                      PixelFormat{"gray16", CV_16UC1}};

FrameImage read_file(const std::string& path, const std::optional<PixelRange>& range, cv::Size otherwise) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw TraxError("no such image: " + path);
  try {
    return read_frame(path, range, otherwise);
  } catch (const std::exception& e) {
    throw TraxError(std::string("cannot decode ") + e.what());
  }
}

// Removes the text before the next semicolon, and the semicolon, from `rest`; returns the text.
std::string_view take_field(std::string_view& rest) {
  const size_t end = rest.find(';');
  if (end == std::string_view::npos) throw TraxError("the header of an image is not complete");
  const std::string_view field = rest.substr(0, end);
  rest.remove_prefix(end + 1);
  return field;
}

int to_size(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || value < 1) {
    throw TraxError("the width or height of an image is not a positive number");
  }
  return value;
}

std::string to_bytes(std::string_view base64) {
  std::optional<std::string> bytes = from_base64(base64);
  if (!bytes) throw TraxError("an image is not in base64");
  return std::move(*bytes);
}

cv::Mat decode_memory(std::string_view rest, const std::optional<PixelRange>& range) {
  const int width = to_size(take_field(rest)), height = to_size(take_field(rest));
  const std::string_view name = take_field(rest);
  const auto format = std::find_if(kPixelFormats.begin(), kPixelFormats.end(),
                                   [&](const PixelFormat& f) { return f.name == name; });
  if (format == kPixelFormats.end()) throw TraxError("unknown pixel format of an image");
  // Nothing is allocated for the announced size until that many bytes have come.
  const std::string bytes = to_bytes(rest);
  if (std::uint64_t(width) * std::uint64_t(height) * CV_ELEM_SIZE(format->type) != bytes.size()) {
    throw TraxError("an image of " + std::to_string(width) + " x " + std::to_string(height) +
                    " pixels comes with " + std::to_string(bytes.size()) + " bytes");
  }
  cv::Mat image(height, width, format->type);
  std::memcpy(image.data, bytes.data(), bytes.size());
  if (image.channels() == 3) cv::cvtColor(image, image, cv::COLOR_RGB2BGR);
  if (!range) return image;
  const Frame frame(image, range);
  return (frame.bgr().empty() ? frame.gray() : frame.bgr()).clone();
}

FrameImage decode_data(std::string_view rest, const std::optional<PixelRange>& range, cv::Size otherwise) {
  take_field(rest);  // the format is read from the file itself
  // The documentation has "data:image/jpeg;base64;", a data URI has "base64,", and clients in use omit it.
  for (const std::string_view word : {"base64;", "base64,"}) {
    if (rest.starts_with(word)) rest.remove_prefix(word.size());
  }
  const std::string file = to_bytes(rest);
  try {
    const std::span bytes(reinterpret_cast<const unsigned char*>(file.data()), file.size());
    return decode_frame(bytes, "an image of " + std::to_string(file.size()) + " bytes", range, otherwise);
  } catch (const std::exception& e) {
    throw TraxError(std::string("cannot decode ") + e.what());
  }
}

std::string_view bytes_of(const void* data, size_t size) { return {static_cast<const char*>(data), size}; }

std::string encode_memory(const cv::Mat& image) {
  const auto format = std::find_if(kPixelFormats.begin(), kPixelFormats.end(),
                                   [&](const PixelFormat& f) { return f.type == image.type(); });
  if (format == kPixelFormats.end()) {
    throw TraxError("an image is neither BGR of 8 bit nor one channel of 8 or 16");
  }
  cv::Mat pixels;
  if (image.channels() == 3) {
    cv::cvtColor(image, pixels, cv::COLOR_BGR2RGB);
  } else {
    pixels = image.isContinuous() ? image : image.clone();
  }
  return std::string(kMemory) + std::to_string(image.cols) + ';' + std::to_string(image.rows) + ';' +
         std::string(format->name) + ';' +
         to_base64(bytes_of(pixels.data, pixels.total() * pixels.elemSize()));
}

std::string encode_data(const cv::Mat& image) {
  std::vector<unsigned char> file;
  cv::imencode(".png", image, file);
  return std::string(kData) + "image/png;" + to_base64(bytes_of(file.data(), file.size()));
}

}  // namespace

FrameImage decode_trax_image(const std::string& argument, const std::optional<PixelRange>& range,
                             cv::Size otherwise) {
  const std::string_view text = argument;
  if (text.starts_with(kMemory)) return {decode_memory(text.substr(kMemory.size()), range)};
  if (text.starts_with(kData)) return decode_data(text.substr(kData.size()), range, otherwise);
  if (!text.starts_with(kFile)) {
    if (text.find("://") != std::string_view::npos) throw TraxError("images by URL are not supported");
    return read_file(argument, range, otherwise);
  }
  const std::string_view path = text.substr(kFile.size());
  return read_file(std::string(path.starts_with("//") ? path.substr(2) : path), range, otherwise);
}

std::string encode_trax_image(const TraxImage& image, const std::vector<std::string>& formats) {
  const auto takes = [&](std::string_view format) {
    return std::find(formats.begin(), formats.end(), format) != formats.end();
  };
  const auto* path = std::get_if<std::filesystem::path>(&image);
  if (path != nullptr && takes("path")) return "file://" + std::filesystem::absolute(*path).string();
  const bool memory = takes("memory"), data = takes("data") || takes("buffer");
  if (!memory && !data)
    throw TraxError("the tracker takes images neither by path, nor from memory, nor as data");
  const cv::Mat pixels =
      path != nullptr ? to_bgr8(read_file(path->string(), {}, {}).pixels) : std::get<cv::Mat>(image);
  if (pixels.empty()) throw TraxError("an empty image");
  return memory ? encode_memory(pixels) : encode_data(pixels);
}

}  // namespace asterism::tools
