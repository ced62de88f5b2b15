#pragma once

#include <asterism/parts/concept/frame.hpp>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::tools {

/// Images with more pixels are refused before they are decoded, as a file of some kilobytes can announce
/// gigabytes. Frames of 16K video (15360 x 8640) are below this limit.
inline constexpr std::int64_t kMostPixels = std::int64_t{1} << 27;

/// The properties of an image file that are known before it is decoded.
struct ImageHeader {
  cv::Size size = {};     ///< [px] of the largest page; empty if the file ends before its size
  bool whole = true;      ///< false for a JPEG that ends before its end marker; decoders notice all others
  bool animated = false;  ///< PNG or WebP with several frames
  std::vector<std::uint64_t> pages = {};  ///< offsets in a TIFF of pages of full size
  int images = 1;                         ///< in the file, as far as it is cheap to find out
  bool deep_gray = false;  ///< a TIFF of one sample a pixel, of 32 or 64 bits; OpenCV makes no color of it
  std::string unusual =
      {};  ///< why a decoder may refuse the file though it is undamaged; empty if it should not
};

/// Reads the header of a JPEG, PNG, BMP, TIFF, WebP, JPEG 2000, portable anymap (PBM, PGM, PPM, PAM, PFM) or
/// Sun raster file; empty for any other file.
std::optional<ImageHeader> read_image_header(std::span<const unsigned char> bytes);

/// A frame read from a file, BGR.
struct FrameImage {
  cv::Mat pixels;
  bool damaged =
      false;  ///< the file is cut short or cannot be decoded: the pixels are a blank (128, 128, 128)
};

/// Reads an image as a frame, in the same way for all programs: with 8 bits per channel if a range is given,
/// otherwise with the file's depth (8, 16 or float; double becomes float). An empty file, or one that begins
/// as an image and ends early or cannot be decoded, is a damaged frame: a blank one of the size `otherwise`,
/// or if that is empty, of the size that the file announces. Throws std::runtime_error, with the file's name
/// and the reason, if there is no such file, no image of a known format, one of more than kMostPixels, one of
/// several frames or pages, or one of a kind that the decoder does not read (a TIFF of half floats, say);
/// without a range, for integers that have a sign or 32 bits; with a range, for pixels that are not finite.
FrameImage read_frame(const std::filesystem::path& file, const std::optional<PixelRange>& range = {},
                      cv::Size otherwise = {});
/// The same from the bytes of a file of that name. first_page: read the first page of a TIFF that has
/// several.
FrameImage decode_frame(std::span<const unsigned char> bytes, const std::string& name,
                        const std::optional<PixelRange>& range = {}, cv::Size otherwise = {},
                        bool first_page = false);
/// Makes a TIFF's page, one of ImageHeader::pages, the first of the file.
void make_first_page(std::span<unsigned char> tiff, std::uint64_t page);

/// Reads the bytes of a file. Throws std::runtime_error, with its name, if it cannot be read, is not a
/// regular file, or is larger than 2 GiB.
std::vector<unsigned char> read_bytes(const std::filesystem::path& file);

/// Converts an image of any depth to 8-bit BGR, by the range or else as Frame does.
cv::Mat to_bgr8(const cv::Mat& image, const std::optional<PixelRange>& range = {});

/// The range that "LOW,HIGH" describes. Throws std::invalid_argument for anything else.
PixelRange parse_range(std::string_view text);

}  // namespace asterism::tools
